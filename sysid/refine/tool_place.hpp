#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "models/robot_description.hpp"
#include "scene/scene.hpp"
#include "sysid/comparison/align.hpp"

// Finds the places of tools with which several arms hold one object. No fixed object shows a place directly
// (tool_offset.hpp). The object turns and moves with the hands, pads press with an edge first, and one tool's
// shift or turn affects all arms. So simulations of the task show the effect of each shift and turn, and
// least squares finds those that explain the measurements.
namespace multipanda {

// Of one arm: the tool on the flange, moved as a whole.
struct ToolPlace {
  Vector3 shift = Vector3::Zero();  // of the end effector E, in the assumed E [m]
  Vector3 turn = Vector3::Zero();   // about E: rotation vector in the assumed E [rad]
};
using ToolPlaces = std::vector<ToolPlace>;  // one per arm

// The robot with its flange moved by this place, see last_link.hpp.
RobotDescription with_tool_place(const RobotDescription& robot, const SceneArm& arm, const ToolPlace& place);

// Simulates the task with the tools at each of these places, in any order: [candidate][arm]. Fewer results
// than candidates: stopped.
using PlaceRuns = std::function<std::vector<std::vector<MeasuredLog>>(const std::vector<ToolPlaces>&)>;

struct PlaceFit {
  ToolPlaces places;
  double before = 0, after = 0;  // cost, see below; after <= before
  std::size_t runs = 0;
};

// Least squares over position of E, force and moment (world axes, filtered by `options`), averaged over
// pieces of about a second:
//   cost(p) = mean over pieces of sum |(real - sim(p)) / (0.1 mm, 0.03 N, 0.008 N m)|^2
//             + sum |p / (10 mm, 2 degrees)|^2
// p holds all shifts and turns. sim(p) is linearized, with slopes from one run per component of p moved by 2
// mm or 1 degree. There are up to three steps with these slopes, and each is kept only if the cost of its
// own run is smaller. Unidentifiable components minimize the second sum: a turn about the line of force is
// 0, and a sum or difference of two arms' shifts is shared equally (least norm), which need not be true. A
// static grasp determines about half as many combinations as p has components. The places explain this grasp
// and are not valid for another one. One log per arm. None: the logs lack a quantity, do not overlap, or
// `run` was stopped.
std::optional<PlaceFit> fit_places(std::span<const MeasuredLog> real, const PlaceRuns& run,
                                   const AlignOptions& options);

}  // namespace multipanda
