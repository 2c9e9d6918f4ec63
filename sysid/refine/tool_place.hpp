#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "models/robot_description.hpp"
#include "scene/scene.hpp"
#include "sysid/comparison/align.hpp"

namespace multipanda {

// The robot with its flange at X_LF in the last link. Hand and `tool` move along; their mass is taken from
// the last link, so that their sum stays the same, as closely as a physical link allows.
RobotDescription with_flange(const RobotDescription& robot, const SceneArm& arm, const Pose& X_LF);

// Finds the places of tools with which several arms hold one object. There is no fixed object as reference
// (tool_offset.hpp), the object moves with the hands, pads touch with an edge first, and the shift or turn of
// one tool affects all arms. Simulations of the task give the effect of each shift and turn, and least
// squares finds those that explain the measurements.

// Displacement of one arm's tool on the flange.
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

// Offset of the tool from its place in the scene, from runs in which it touches a surface whose place is
// known. The whole tool is moved by d. Compared with the simulation without d, along the force's direction n
// the assumed end effector is behind by d and goes deeper by the additional force:
//   n . (x_real - x_sim) = -n . d + compliance n . (F_real - F_sim)
// and the force acts elsewhere:
//   M_real - M_sim = d x F
// F is reduced by the estimate in free air at the start of the run. Least squares over all samples at which
// both press with at least 3 N, in the flange's frame [m]. None: too few such samples, or an offset of more
// than 2 cm.
std::optional<Vector3> tool_offset(std::span<const MeasuredLog> real, std::span<const MeasuredLog> sim,
                                   const SceneArm& arm, const AlignOptions& options,
                                   double compliance_m_per_n = 0);

// Compliance of the objects that the scene's arms touch [m/N], from their `contact`; 0: none has one,
// or they differ.
double surface_compliance(const Scene& scene);

// The robot with its flange moved by d (in the flange's frame), see last_link.hpp.
RobotDescription with_tool_offset(const RobotDescription& robot, const SceneArm& arm, const Vector3& d);

}  // namespace multipanda
