#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/robot_description.hpp"
#include "sysid/identification/filtered_log.hpp"

// Friction laws whose torque is linear in one amplitude per joint, as a torque sensor shows them.
namespace multipanda {

enum class FrictionKind {
  offset,        // 1
  viscous,       // dq
  stribeck,      // tanh(dq / 0.01) exp(-(dq / 0.3)^2)
  coulomb,       // tanh(dq / 0.05)
  sigmoid,       // the shape of the robot's table without its p1
  presliding,    // z / s with Dahl's state z (PreslidingElement)
  initial,       // what a joint at rest adds to z / s where z / s began at 1 instead of 0
  acceleration,  // ddq: inertia about the joint that no link explains
};

struct FrictionPart {
  FrictionKind kind = FrictionKind::offset;
  double distance = 0;  // presliding, initial [rad]
  bool operator==(const FrictionPart&) const = default;
};

std::string to_string(const FrictionPart& part);  // "presliding 3 mrad"
std::string unit_of(const FrictionPart& part);    // of its amplitude
bool has_sign(const FrictionPart& part);          // its amplitude must be >= 0, otherwise it would add energy

// A presliding state starts at 0 for a resting joint, and for a moving one as if it had moved 0.2 rad from
// rest in the same direction: the log does not show the motion before it. Where a resting joint began is
// unknown; equations of presliding parts leave it open, and predictions read it from the torque at the start.

// Column of one part for every joint, at 1 ms, before any filter. dq, ddq (N x n) -> (N x n).
// `table` is the robot's, for `sigmoid`; throws std::invalid_argument if it is needed and there is none.
Eigen::MatrixXd friction_column(const FrictionPart& part, const Eigen::MatrixXd& dq,
                                const Eigen::MatrixXd& ddq, const std::optional<JointFriction>& table,
                                double dt);

// Friction torque of a law along a motion at steps of dt, before any filter (N x n) [N m].
Eigen::MatrixXd friction_torque(const FrictionLaw& law, const Eigen::MatrixXd& dq, double dt);
// The same for a table: p1 / (1 + exp(-p2 (dq + p3))) - p1 / (1 + exp(-p2 p3)).
Eigen::MatrixXd friction_torque(const JointFriction& table, const Eigen::MatrixXd& dq);

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

// Rigid-body torque of one arm as a linear function of the inertial parameters of its moving links:
//   M ddq + c + g = Y(q, dq, ddq) theta,  theta (10 n), ten per moving link in its own frame, link1 first.
// Gravity is a vector in the base frame, so any mounting and tilt is possible. One instance per thread.
class ArmRegressor {
 public:
  explicit ArmRegressor(const RobotDescription& robot);  // only its kinematics are used
  ~ArmRegressor();
  ArmRegressor(ArmRegressor&&) noexcept;

  Eigen::Index joints() const;
  // (n x 10 n); valid until the next call.
  const Eigen::MatrixXd& at(const Eigen::VectorXd& q, const Eigen::VectorXd& dq, const Eigen::VectorXd& ddq,
                            const Vector3& gravity_B);
  // The contribution of gravity alone, per unit of a field in direction `field_B` (n x 10 n).
  const Eigen::MatrixXd& of_field(const Eigen::VectorXd& q, const Vector3& field_B);

 private:
  struct Engine;
  std::unique_ptr<Engine> engine_;
};

// theta of every moving link (10 n).
Eigen::VectorXd thetas_of(const RobotDescription& robot);

// Hand (if `hand`) and tool as one body in the frame of the last link. Throws std::invalid_argument if `hand`
// is set and the robot has none.
std::optional<RigidBody> known_body(const RobotDescription& robot, bool hand,
                                    const std::optional<RigidBody>& tool);

// Gravity in the frame of a base tilted by RobotDescription::base_tilt, and its derivative by each angle at
// zero tilt.
Vector3 tilted(const Vector3& gravity_B, const Eigen::Vector2d& tilt);
Eigen::Matrix<double, 3, 2> tilt_directions(const Vector3& gravity_B);

}  // namespace multipanda
