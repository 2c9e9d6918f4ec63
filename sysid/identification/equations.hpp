#pragma once

#include <functional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "models/robot_description.hpp"
#include "sysid/identification/filtered_log.hpp"
#include "sysid/identification/friction_columns.hpp"

namespace multipanda {

// The equations of one joint, compressed: A = Q R with
//   A = [Y | Y_a | Y_b | F | tau]
// Y: rigid-body regressor without the columns of the links before this joint, which are zero (10 (n -
// j)); Y_a, Y_b: its derivatives by the two angles of tilt; F: one column per friction part. |A x| = |R
// x| for all x.
struct JointEquations {
  Eigen::MatrixXd R;
  Eigen::Index rows = 0;  // of A
};
using Equations = std::vector<JointEquations>;  // per joint

struct EquationSource {
  const RobotDescription* robot = nullptr;  // kinematics, and the table for FrictionKind::sigmoid
  std::vector<FrictionPart> parts;
  Vector3 gravity_B{0, 0, -9.81};  // of logs that do not have their own
};

// The kept rows of every log, cut into `blocks` parts (block_ranges): part k of all logs together. With
// `restart`, laws with memory start again 0.2 s before each part, as if it were a separate file.
std::vector<Equations> equations_of(std::span<const FilteredLog> logs, const EquationSource& source,
                                    std::size_t blocks, bool restart = false);

// Combines several parts.
Equations stacked(std::span<const Equations> parts, const std::function<bool(std::size_t)>& requested);

// Friction columns of one log after the torque sensor's filter, kept rows only, one per part (N x n).
std::vector<Eigen::MatrixXd> kept_friction(const FilteredLog& log, const std::vector<FrictionPart>& parts,
                                           const std::optional<JointFriction>& table);
// The same for the kept rows `begin` to `end`, with laws with memory started again 0.2 s before them.
std::vector<Eigen::MatrixXd> restarted_friction(const FilteredLog& log, Eigen::Index begin, Eigen::Index end,
                                                const std::vector<FrictionPart>& parts,
                                                const std::optional<JointFriction>& table);

}  // namespace multipanda
