#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/shape.hpp"
#include "core/state/arm_state.hpp"
#include "core/types/joint_range.hpp"
#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// The manufacturer's limits of one arm. Every vector is (n x 1).
struct ArmLimits {
  JointVector q_min, q_max;  // [rad]
  JointVector dq_max;        // [rad/s]
  JointVector ddq_max;       // [rad/s^2]
  JointVector tau_max;       // [N m]
  JointVector tau_rate_max;  // [N m/s]
  // Tighter than dq_max near the ends of the range; none: dq_max everywhere.
  std::optional<PositionBasedVelocity> velocity_by_position = {};
};

// Joint friction as the controllers know it. Every vector is (n x 1):
//   tau_f(dq) = p1 / (1 + exp(-p2 (dq + p3))) - p1 / (1 + exp(-p2 p3)), opposing the motion.
struct JointFrictionTable {
  JointVector p1;  // [N m]
  JointVector p2;  // [s/rad]
  JointVector p3;  // [rad/s]
};

// A part of an arm that can collide, fixed to one of its links.
struct CollisionShape {
  std::string name;   // "link5", "hand", "tool"
  int joint = -1;     // the link behind this joint, 0 to n-1; -1: the base
  ConvexShape shape;  // not a half space
  Pose X_JS;          // the shape's frame in that joint's frame; for the base: in B
  bool scene = true;  // checked against obstacles; false for parts that stand on them
};

// No usual tool extends farther from the flange; an end effector out there would turn the arm's real tool
// fast [m].
inline constexpr double kFarthestEndEffector = 0.5;

// The data that an ArmModel is built from. It fixes neither the joint count nor the manufacturer.
struct ArmModelSource {
  std::string name;    // used in messages
  std::string urdf;    // text; fixed base; one root link
  std::string flange;  // link that the frames of ArmFrames refer to
  Pose X_WB;           // pose of the base in the world
  ArmLimits limits;    // empty position, velocity and effort limits come from the URDF
  JointVector q_home;  // a comfortable configuration [rad]; empty: middle of the joint ranges
  std::optional<JointFrictionTable> known_friction;
  // The heaviest payload that may be declared, hand and tool not counted [kg]; none: no bound is known.
  std::optional<double> largest_load = {};
  double farthest_end_effector = kFarthestEndEffector;  // from the flange, that may be set [m]
  JointVector motor_inertia = {};  // seen at the joint [kg m^2] (n x 1); empty: none, or not known
  // The part of it that the mass matrix of ModelTerms contains (n x 1); empty: none. Momentum, Coriolis and
  // gravity torque remain those of the links, as the torque sensor measures them.
  JointVector known_motor_inertia = {};
  Load tool = {};  // what the flange carries from the start, for bounds before the first state
  // The point of hand and tool that is farthest from the flange, in its frame [m]; zero: none is known.
  Vector3 tool_end = Vector3::Zero();
  std::vector<CollisionShape> collision_shapes;  // empty: no collision checks
  // Indices of shapes that are checked against each other.
  std::vector<std::pair<std::size_t, std::size_t>> self_pairs;
};

// The fixed part of an arm's rigid-body model. Immutable, so threads may share it.
// Gravity is -9.81 m/s^2 along the world's z, whatever the pose of the base.
class ArmModel {
 public:
  // Throws std::invalid_argument with the reason if the URDF cannot be used.
  explicit ArmModel(ArmModelSource source);
  ~ArmModel();
  ArmModel(const ArmModel&) = delete;
  ArmModel& operator=(const ArmModel&) = delete;

  const std::string& name() const { return source_.name; }
  std::size_t joint_count() const { return joint_count_; }
  // A prismatic joint has meters, newtons and kilograms where a revolute one has rad, N m and kg m^2.
  bool is_prismatic(std::size_t joint) const;
  const Pose& X_WB() const { return source_.X_WB; }
  const ArmLimits& limits() const { return source_.limits; }
  JointRange joint_range() const;
  const JointVector& q_home() const { return source_.q_home; }
  const std::string& urdf() const { return source_.urdf; }
  const std::vector<CollisionShape>& collision_shapes() const { return source_.collision_shapes; }
  const std::vector<std::pair<std::size_t, std::size_t>>& self_pairs() const { return source_.self_pairs; }
  const JointVector& motor_inertia() const { return source_.motor_inertia; }              // empty: none
  const JointVector& known_motor_inertia() const { return source_.known_motor_inertia; }  // empty: none
  // The least inertia that a torque of one joint accelerates in any pose, with tool and motor, the other
  // joints free (n x 1) [kg m^2]. Computed at the first call; any thread except the loop's.
  const JointVector& least_inertia() const;
  // The heaviest payload that may be declared to this arm [kg]; none: no bound is known.
  const Load& tool() const { return source_.tool; }  // what the flange carries from the start
  const std::optional<double>& largest_load() const { return source_.largest_load; }
  const Vector3& tool_end() const { return source_.tool_end; }  // in the flange [m]
  // The farthest from the flange that an end effector may be set [m].
  double farthest_end_effector() const { return source_.farthest_end_effector; }
  // The friction that the scene declares to the controllers, if any.
  const std::optional<JointFrictionTable>& known_friction() const { return source_.known_friction; }

  struct Chain;  // defined in core/model only, so that no other file compiles Pinocchio's headers
  const Chain& chain() const { return *chain_; }

 private:
  struct LeastInertia {
    std::once_flag once;
    JointVector inertia;
  };

  ArmModelSource source_;
  std::size_t joint_count_ = 0;
  std::unique_ptr<Chain> chain_;
  std::unique_ptr<LeastInertia> least_ = std::make_unique<LeastInertia>();
};

// (n x 1) vector filled with `value`.
JointVector joint_constant(std::size_t n, double value);

}  // namespace multipanda
