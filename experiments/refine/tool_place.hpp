#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "analysis/comparison/align.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

// Where the tools of arms truly are that hold one object between them. Nothing stands still there that would
// tell a place by itself (tool_offset.hpp): the object turns and moves with the hands, pads press with an
// edge first, and what one tool's shift or turn does is felt by all arms. So the task's own simulation says
// what each of them does, and least squares says which of them explain what the arms showed.
namespace multipanda {

// Of one arm: what is on the flange, moved as a whole.
struct ToolPlace {
  Vector3 shift = Vector3::Zero();  // of the end effector E, in E as believed [m]
  Vector3 turn = Vector3::Zero();   // about E: rotation vector in E as believed [rad]
};
using ToolPlaces = std::vector<ToolPlace>;  // one per arm

// The robot with its flange moved so, see last_link.hpp.
RobotDescription with_tool_place(const RobotDescription& robot, const SceneArm& arm, const ToolPlace& place);

// Simulates the task with the tools at each of these places, in any order: [candidate][arm]. Fewer than
// asked: stopped.
using PlaceRuns = std::function<std::vector<std::vector<MeasuredLog>>(const std::vector<ToolPlaces>&)>;

struct PlaceFit {
  ToolPlaces places;
  double before = 0, after = 0;  // cost, see below; after <= before
  std::size_t runs = 0;
};

// Least squares over position of E, force and moment (world axes, filtered as `options` say), averaged over
// pieces of about a second:
//   cost(p) = mean over pieces of sum |(real - sim(p)) / (0.1 mm, 0.03 N, 0.008 N m)|^2
//             + sum |p / (10 mm, 2 degrees)|^2
// p: all shifts and turns. sim(p) is taken as linear, its slopes from one run per component of p with that
// one moved by 2 mm or 1 degree; up to three steps with these slopes, each only kept if the cost of its own
// run is less. What logs do not tell stays where the second sum is least: a turn about the line of force is
// 0, and of a sum or difference of two arms' shifts each gets an equal share (least norm), which need not be
// the truth. A grasp that is only held tells about half as many combinations as p has parts: the places
// explain this grasp, and are not to be believed of another one. One log per arm; none: the logs lack a
// quantity, do not overlap, or `run` was stopped.
std::optional<PlaceFit> fit_places(std::span<const MeasuredLog> real, const PlaceRuns& run,
                                   const AlignOptions& options);

}  // namespace multipanda
