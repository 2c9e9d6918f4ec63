#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <variant>

#include "core/state/arm_state.hpp"
#include "core/types/time.hpp"

// Requests to a backend, off the loop: to an arm, to the gripper of an arm, or to the simulated world.
//
// A request declares its name and its fields once. `visit` hands every field to a visitor with
//   required(key, value, bound = any), optional(key, value, bound = any), pose(value), expect(condition,
//   text);
// the socket's JSON reader (runtime/live_input) is one. An optional field keeps its value when it is absent;
// `pose` takes its keys from the request itself. To add a request: a structure here and a place in its
// variant, its check (arm_interface/arm_settings.cpp), and what the simulated arm and the client of real arms
// do with it.
namespace multipanda {

// The name in the socket's requests: {"do": name}, for grippers {"do": name, "action": action}. The socket
// offers only the requests that have a name.
struct RequestName {
  const char* name;
  const char* action = nullptr;
};

// Latest start of a request: host time [ns], which its sender may bring forward. None: only the backend's
// own limit.
using BeginBy = std::shared_ptr<const std::atomic<std::int64_t>>;
inline bool is_past(const BeginBy& limit, HostTime now) {
  return limit && now.ns > limit->load(std::memory_order_relaxed);
}

template <class... Kinds>
struct AskedRequest : std::variant<Kinds...> {
  using Variant = std::variant<Kinds...>;
  using Variant::Variant;
  BeginBy begin_by;
};

// Range of a number. Every number must be finite.
enum class RequestBound : std::uint8_t { any, not_negative, positive };

// --- arms ---

// Declares the payload to the arm.
struct SetLoad {
  Load load;
  static constexpr RequestName kName{"set_load"};
  void visit(auto& fields) {
    fields.required("mass_kg", load.mass, RequestBound::not_negative);
    fields.optional("com_m", load.p_FC);
    fields.optional("inertia_kg_m2", load.inertia_C);
  }
};
struct SetFrames {
  std::optional<Pose> X_FE, X_EK;  // end-effector and stiffness frame; none: unchanged
  static constexpr RequestName kName{"set_frames"};
  void visit(auto& fields) {
    fields.optional("end_effector", X_FE);
    fields.optional("stiffness_frame", X_EK);
    fields.expect(X_FE || X_EK,
                  "expected 'end_effector' (in the flange) or 'stiffness_frame' (in the end effector)");
  }
};
// Stiffness of the arm's own joint controller.
struct SetJointStiffness {
  JointVector stiffness;  // [N m/rad] (n x 1)
  static constexpr RequestName kName{"set_joint_stiffness"};
  void visit(auto& fields) { fields.required("joint_stiffness_nm_per_rad", stiffness); }
};
// Stiffness of the arm's own Cartesian controller, in K.
struct SetCartesianStiffness {
  Vector6 stiffness = Vector6::Zero();  // [N/m, N m/rad]
  static constexpr RequestName kName{"set_cartesian_stiffness"};
  void visit(auto& fields) { fields.required("cartesian_stiffness", stiffness); }
};
// The arm reports contact above the lower threshold and stops with a reflex above the upper one. Both compare
// absolute values.
struct ContactThresholds {
  JointVector torque_lower, torque_upper;                                  // [N m] (n x 1)
  Vector6 wrench_lower = Vector6::Zero(), wrench_upper = Vector6::Zero();  // [N, N m]
  void visit(auto& fields) {
    fields.required("torque_lower_nm", torque_lower);
    fields.required("torque_upper_nm", torque_upper);
    fields.required("wrench_lower", wrench_lower);
    fields.required("wrench_upper", wrench_upper);
  }
};
struct SetCollisionThresholds {
  ContactThresholds nominal;                      // at constant velocity and at rest
  std::optional<ContactThresholds> acceleration;  // while the arm accelerates; none: as nominal
  // No name: higher thresholds would let an arm press harder on a person before it stops.
  void visit(auto& fields) {
    fields.required("nominal", nominal);
    fields.optional("acceleration", acceleration);
  }
};
// Axes that are free while a person guides the arm by hand.
struct SetGuidingMode {
  std::array<bool, 6> axes{};  // x, y, z, roll, pitch, yaw
  bool elbow = false;
  static constexpr RequestName kName{"set_guiding_mode"};
  void visit(auto& fields) {
    fields.required("axes", axes);
    fields.optional("elbow", elbow);
  }
};
// Clears the arm's error. The arm is held afterwards; the controllet that ran stays inactive.
struct RecoverFromError {
  static constexpr RequestName kName{"recover"};
  void visit(auto& /*fields*/) {}
};
// Real arms: connects again after the connection was lost.
struct Reconnect {
  static constexpr RequestName kName{"reconnect"};
  void visit(auto& /*fields*/) {}
};
// Ends the arm's motion. The arm holds itself until it is recovered.
struct StopMotion {
  static constexpr RequestName kName{"stop_motion"};
  void visit(auto& /*fields*/) {}
};
// Simulated arms: the stop button.
struct SetUserStop {
  bool pressed = false;
  static constexpr RequestName kName{"user_stop"};
  void visit(auto& fields) { fields.required("pressed", pressed); }
};

using ArmRequest =
    AskedRequest<SetLoad, SetFrames, SetJointStiffness, SetCartesianStiffness, SetCollisionThresholds,
                 SetGuidingMode, RecoverFromError, Reconnect, StopMotion, SetUserStop>;

// --- grippers ---

// Answered when the motion has ended. A new motion ends the running one.

struct GripperHoming {
  static constexpr RequestName kName{"gripper", "homing"};
  void visit(auto& /*fields*/) {}
};
struct GripperMove {
  double width = 0, speed = 0.1;  // [m], [m/s]
  static constexpr RequestName kName{"gripper", "move"};
  void visit(auto& fields) {
    fields.required("width_m", width, RequestBound::not_negative);
    fields.optional("speed_m_per_s", speed, RequestBound::positive);
  }
};
struct GripperGrasp {
  double width = 0, speed = 0.1, force = 40;  // [m], [m/s], [N]
  // The grasp succeeds if the width is within [width - tolerance_inner, width + tolerance_outer] [m].
  double tolerance_inner = 0.005, tolerance_outer = 0.005;
  static constexpr RequestName kName{"gripper", "grasp"};
  void visit(auto& fields) {
    fields.required("width_m", width, RequestBound::not_negative);
    fields.optional("speed_m_per_s", speed, RequestBound::positive);
    fields.optional("force_n", force, RequestBound::positive);
    double both = tolerance_inner;
    fields.optional("tolerance_m", both, RequestBound::not_negative);
    tolerance_inner = tolerance_outer = both;
    fields.optional("tolerance_inner_m", tolerance_inner, RequestBound::not_negative);
    fields.optional("tolerance_outer_m", tolerance_outer, RequestBound::not_negative);
  }
};
// Answered at once. The newest width counts, approached with `speed`. An object between the fingers is
// pressed with `force` and held until a width above its own arrives. Widths are skipped while another motion
// runs. Without the next one for `silence`, or without a width, the fingers stay where they are and keep
// what they hold.
struct GripperFollow {
  static constexpr double kMostSilence = 1;  // [s]
  std::optional<double> width;               // [m]
  double speed = 0.1, force = 40;            // [m/s], [N]
  double silence = 0.2;                      // [s]
  static constexpr RequestName kName{"gripper", "follow"};
  void visit(auto& fields) {
    fields.optional("width_m", width, RequestBound::not_negative);
    fields.optional("speed_m_per_s", speed, RequestBound::positive);
    fields.optional("force_n", force, RequestBound::positive);
    fields.optional("silence_s", silence, RequestBound::positive);
  }
};
struct GripperStop {
  static constexpr RequestName kName{"gripper", "stop"};
  void visit(auto& /*fields*/) {}
};
struct VacuumOn {
  double pressure_mbar = 100;  // below ambient pressure
  double timeout_s = 1;
  static constexpr RequestName kName{"vacuum", "on"};
  void visit(auto& fields) {
    fields.optional("vacuum_mbar", pressure_mbar, RequestBound::positive);
    fields.optional("timeout_s", timeout_s, RequestBound::positive);
  }
};
struct VacuumDrop {
  double timeout_s = 1;
  static constexpr RequestName kName{"vacuum", "drop"};
  void visit(auto& fields) { fields.optional("timeout_s", timeout_s, RequestBound::positive); }
};
struct VacuumStop {
  static constexpr RequestName kName{"vacuum", "stop"};
  void visit(auto& /*fields*/) {}
};

using GripperRequest = AskedRequest<GripperHoming, GripperMove, GripperGrasp, GripperFollow, GripperStop,
                                    VacuumOn, VacuumDrop, VacuumStop>;

// Why no gripper can carry out the request, or an empty string. Off the loop. The limits of a particular
// gripper are checked by its backend.
std::string check(const GripperRequest& request);

// --- simulated worlds ---

// Places a free object, at rest.
struct PlaceObject {
  std::string object;
  Pose X_WO;
  static constexpr RequestName kName{"place_object"};
  void visit(auto& fields) {
    fields.required("object", object);
    fields.pose(X_WO);
  }
};
struct ResetSimulation {
  static constexpr RequestName kName{"reset"};
  void visit(auto& /*fields*/) {}
};
struct PauseSimulation {
  bool paused = true;
  static constexpr RequestName kName{"pause"};
  void visit(auto& fields) { fields.optional("paused", paused); }
};
// Advances a paused simulation. Answered when the periods are over.
struct StepSimulation {
  std::uint32_t periods = 1;
  static constexpr RequestName kName{"step"};
  void visit(auto& fields) { fields.optional("periods", periods); }
};

// Pushes a free object at its center of mass for a time of the simulation. A new push replaces the one that
// acts; placing the object and a reset end it.
struct PushObject {
  static constexpr double kMostForce = 100, kMostTime = 2;  // [N], [s]
  std::string object;
  Vector3 f_W = Vector3::Zero();  // [N], world axes
  double duration = 0.2;          // [s]
  static constexpr RequestName kName{"push_object"};
  void visit(auto& fields) {
    fields.required("object", object);
    fields.required("force_n", f_W);
    fields.optional("duration_s", duration, RequestBound::positive);
  }
};

using WorldRequest = AskedRequest<PlaceObject, ResetSimulation, PauseSimulation, StepSimulation, PushObject>;

// --- answers ---

using BackendRequest = std::variant<ArmRequest, GripperRequest, WorldRequest>;

// A request that ends a motion is never too late.
inline bool ends_motion(const BackendRequest& request) {
  if (const auto* of_arm = std::get_if<ArmRequest>(&request)) {
    const auto* button = std::get_if<SetUserStop>(of_arm);
    return std::holds_alternative<StopMotion>(*of_arm) || (button != nullptr && button->pressed);
  }
  const auto* of_gripper = std::get_if<GripperRequest>(&request);
  if (of_gripper == nullptr) return false;
  const auto* follow = std::get_if<GripperFollow>(of_gripper);
  return std::holds_alternative<GripperStop>(*of_gripper) ||
         std::holds_alternative<VacuumStop>(*of_gripper) || (follow != nullptr && !follow->width);
}

struct RequestAnswer {
  bool success = false;
  std::string reason;  // why not, and the remedy
};

// An answer that is available at once.
std::future<RequestAnswer> answer_now(RequestAnswer answer);
std::future<RequestAnswer> refuse_request(std::string reason);
// The reason to refuse a request to arm `arm` of `count`.
std::string no_such_arm(std::size_t arm, std::size_t count);

}  // namespace multipanda
