#include "ros/adapter/compat/state_fields.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>

#include <fmt/format.h>

#include "arm_interface/arm_error.hpp"
#include "arm_interface/arm_interface.hpp"
#include "core/record/record_fields.hpp"
#include "ros/adapter/adapter_part.hpp"

namespace multipanda::ros {
namespace {

using Out = std::span<double>;
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

void fill_unknown(Out out) { std::fill(out.begin(), out.end(), kUnknown); }

template <class Bits>
auto flags(Bits ArmSample::*bits, int first) {
  return [bits, first](const ArmReport& from, Out out) {
    out[0] = (from.sample.*bits >> static_cast<std::size_t>(first) & 1u) != 0 ? 1 : 0;
  };
}

// Fields of the other system by our names; empty: it has none.
using Names = std::map<std::string, std::vector<std::string>>;

// A rule for each quantity of an arm: the field of the same name, or the one that `theirs` names. Lists that
// the arm does not report are NaN.
StateRules rules_of_quantities(std::size_t joints, Names theirs) {
  theirs.insert({{"command_success_rate", {"control_command_success_rate"}}, {"last_motion_errors", {}}});
  StateRules rules;
  const auto add = [&](const std::string& ours, std::size_t count, auto values) {
    const auto found = theirs.find(ours);
    const std::vector<std::string> paths = found != theirs.end() ? found->second : std::vector{ours};
    const bool needed = ours == "q" || ours == "dq" || ours == "tau_j";
    if (!paths.empty()) rules.push_back({paths, count, values, needed});
  };
#define MULTIPANDA_RULE(type, member, name, message, known, doc)                   \
  add(#message, count_of<type>(joints), [joints](const ArmReport& from, Out out) { \
    NumberWriter to(out.data());                                                   \
    visit_value(to, #name, from.sample.member, from.sample.known, joints);         \
  });
  MULTIPANDA_ARM_FIELDS(MULTIPANDA_RULE)
#undef MULTIPANDA_RULE
  return rules;
}

// Poses under the names of both messages. Empty: not reported by the arm.
using PoseOf = std::function<std::optional<Pose>(const ArmReport&)>;

std::optional<Pose> measured(const ArmReport& from) {
  return from.terms.model().X_WB().inverse() * from.terms.X_WE();
}

PoseOf reported(PoseArray ArmSample::*values) {
  return [values](const ArmReport& from) -> std::optional<Pose> {
    if (!from.sample.has_report) return {};
    return pose_of(from.sample.*values);
  };
}

struct NamedPose {
  const char* name;
  PoseOf pose;
  bool needed = false;
};

std::vector<NamedPose> poses() {
  return {{"o_t_ee", measured, true},
          {"o_t_ee_d", reported(&ArmSample::X_BE_d)},
          {"o_t_ee_c", reported(&ArmSample::X_BE_c)},
          {"f_t_ee", [](const ArmReport& from) { return std::optional(from.arm.frames.X_FE); }},
          {"f_t_ne", [](const ArmReport& from) { return std::optional(from.X_FN); }},
          {"ne_t_ee",
           [](const ArmReport& from) { return std::optional(from.X_FN.inverse() * from.arm.frames.X_FE); }},
          {"ee_t_k", [](const ArmReport& from) { return std::optional(from.arm.frames.X_EK); }}};
}

// As in Franka's interface: about the base's origin in the base's axes, or about K in K's axes.
auto wrench(bool in_base) {
  return [in_base](const ArmReport& from, Out out) {
    if (!from.sample.has_wrench_estimate) return fill_unknown(out);
    const Wrench F_K_W{Eigen::Map<const Vector6>(from.sample.F_K_W_est.data())};
    const Pose& X_WK = from.terms.X_WK();
    Eigen::Map<Vector6> F(out.data());
    if (in_base) {
      F = F_B_B_of(F_K_W, X_WK.position, from.terms.model().X_WB()).vector;
    } else {
      F << X_WK.rotation.transpose() * F_K_W.force(), X_WK.rotation.transpose() * F_K_W.torque();
    }
  };
}

void add_errors(StateRules& rules) {
  for (std::size_t i = 0; i < kArmErrorCount; ++i) {
    const std::string name = error_field(static_cast<ArmError>(i));
    rules.push_back({{"current_errors." + name}, 1, flags(&ArmSample::errors, static_cast<int>(i))});
    rules.push_back(
        {{"last_motion_errors." + name}, 1, flags(&ArmSample::last_motion_errors, static_cast<int>(i))});
  }
}

void append(StateRules& rules, const StateRules& more) {
  rules.insert(rules.end(), more.begin(), more.end());
}

// Fields with the same name in both messages, and the quantities of the arm.
StateRules common_rules(std::size_t joints, Names theirs) {
  StateRules rules{
      {{"time"},
       1,
       [](const ArmReport& from, Out out) { out[0] = 1e-9 * static_cast<double>(from.sample.t_robot_ns); }},
      {{"robot_mode"},
       1,
       [](const ArmReport& from, Out out) {
         constexpr std::uint8_t kLast = 6;  // theirs have no mode for a lost connection: other
         out[0] = from.sample.mode > kLast ? 0 : from.sample.mode;
       },
       true}};
  add_errors(rules);
  append(rules, rules_of_quantities(joints, std::move(theirs)));
  return rules;
}

}  // namespace

std::string error_field(ArmError error) {
  // libfranka prints these two under other names.
  if (error == ArmError::cartesian_position_motion_generator_invalid_frame)
    return "cartesian_position_motion_generator_invalid_frame";
  if (error == ArmError::tau_j_range_violation) return "tau_j_range_violation";
  return std::string(to_string(error));
}

void write_transform(const Pose& X, std::span<double> out) {
  Eigen::Map<Eigen::Matrix4d> M(out.data());
  M.setIdentity();
  M.topLeftCorner<3, 3>() = X.rotation;
  M.topRightCorner<3, 1>() = X.position;
}

Pose read_transform(std::span<const double> values, const std::string& what) {
  const Eigen::Map<const Eigen::Matrix4d> M(values.data());
  const Matrix3 R = M.topLeftCorner<3, 3>();
  constexpr double kTolerance = 1e-3;  // for sums in single precision
  const bool rotation =
      M.allFinite() && (R.transpose() * R - Matrix3::Identity()).norm() < kTolerance && R.determinant() > 0;
  const bool last = M.allFinite() && (M.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm() < kTolerance;
  if (!rotation || !last) {
    throw std::invalid_argument(fmt::format(
        "{}: expected a pose as 16 numbers of a 4 x 4 matrix, column by column (the last column is x y z 1); "
        "found {}",
        what,
        !M.allFinite() ? "a number that is not finite"
        : last         ? "no rotation"
                       : "another last row"));
  }
  return Pose::from(M.topRightCorner<3, 1>(), Quaternion(R));
}

StateRules franka_state_rules(std::size_t n) {
  StateRules rules = common_rules(n, {{"tau_ext", {"tau_ext_hat_filtered"}}});
  append(rules,
         {{{"o_f_ext_hat_k"}, 6, wrench(true)},
          {{"k_f_ext_hat_k"}, 6, wrench(false)},
          {{"m_load"}, 1, [](const ArmReport& from, Out out) { out[0] = from.arm.load.mass; }},
          {{"f_x_cload"},
           3,
           [](const ArmReport& from, Out out) { Eigen::Map<Vector3>(out.data()) = from.arm.load.p_FC; }},
          {{"i_load"}, 9, [](const ArmReport& from, Out out) {
             Eigen::Map<Matrix3>(out.data()) = from.arm.load.inertia_C;
           }}});
  for (const auto& named : poses()) {
    rules.push_back({{named.name},
                     16,
                     [pose = named.pose](const ArmReport& from, Out out) {
                       if (const auto X = pose(from)) return write_transform(*X, out);
                       fill_unknown(out);
                     },
                     named.needed});
  }
  return rules;
}

StateRules franka_robot_state_rules(std::size_t n) {
  StateRules rules = common_rules(n, {{"q", {"measured_joint_state.position"}},
                                      {"dq", {"measured_joint_state.velocity"}},
                                      {"tau_j", {"measured_joint_state.effort"}},
                                      {"q_d", {"desired_joint_state.position"}},
                                      {"dq_d", {"desired_joint_state.velocity"}},
                                      {"tau_j_d", {"desired_joint_state.effort"}},
                                      {"theta", {"measured_joint_motor_state.position"}},
                                      {"tau_ext", {"tau_ext_hat_filtered.effort"}},
                                      {"elbow", {"elbow.position"}},
                                      {"joint_contact", {"collision_indicators.is_joint_contact"}},
                                      {"joint_collision", {"collision_indicators.is_joint_collision"}},
                                      {"cartesian_contact", {}},
                                      {"cartesian_collision", {}}});
  // A separate rule for each, so that a message without one of them keeps the others.
  const auto axes = [&](const std::string& name, AxisFlags ArmSample::*bits, std::size_t first) {
    rules.push_back({parts("collision_indicators." + name, {"x", "y", "z"}), 3,
                     [bits, first](const ArmReport& from, Out out) {
                       if (!from.sample.has_report) return fill_unknown(out);
                       for (std::size_t i = 0; i < 3; ++i) out[i] = (from.sample.*bits)[first + i] ? 1 : 0;
                     }});
  };
  axes("is_cartesian_linear_contact", &ArmSample::cartesian_contact, 0);
  axes("is_cartesian_angular_contact", &ArmSample::cartesian_contact, 3);
  axes("is_cartesian_linear_collision", &ArmSample::cartesian_collision, 0);
  axes("is_cartesian_angular_collision", &ArmSample::cartesian_collision, 3);
  for (const bool in_base : {true, false}) {
    rules.push_back({parts(in_base ? "o_f_ext_hat_k.wrench" : "k_f_ext_hat_k.wrench",
                           {"force.x", "force.y", "force.z", "torque.x", "torque.y", "torque.z"}),
                     6, wrench(in_base)});
  }
  rules.push_back({parts("inertia_load.inertia",
                         {"m", "com.x", "com.y", "com.z", "ixx", "ixy", "ixz", "iyy", "iyz", "izz"}),
                   10, [](const ArmReport& from, Out out) {
                     const Load& load = from.arm.load;
                     const Matrix3& I = load.inertia_C;
                     const std::array values{load.mass, load.p_FC.x(), load.p_FC.y(), load.p_FC.z(), I(0, 0),
                                             I(0, 1),   I(0, 2),       I(1, 1),       I(1, 2),       I(2, 2)};
                     std::copy(values.begin(), values.end(), out.begin());
                   }});
  for (const auto& named : poses()) {
    rules.push_back({pose_parts(std::string(named.name) + ".pose"), 7,
                     [pose = named.pose](const ArmReport& from, Out out) {
                       const auto X = pose(from);
                       if (!X) return fill_unknown(out);
                       std::ranges::copy(X->values(), out.begin());
                     },
                     named.needed});
  }
  return rules;
}

namespace {

// Adds the stamps of all headers of the type.
StateRules with_stamps(const MessageType& type, StateRules rules) {
  const std::string end = "header.stamp.sec";
  for (const auto& path : type.paths()) {
    if (!path.ends_with(end)) continue;
    const std::string stamp = path.substr(0, path.size() - 4);
    rules.push_back({{stamp + ".sec", stamp + ".nanosec"}, 2, [](const ArmReport& from, Out out) {
                       constexpr std::int64_t kSecond = 1000000000;
                       out[0] = static_cast<double>(from.stamp_ns / kSecond);
                       out[1] = static_cast<double>(from.stamp_ns % kSecond);
                     }});
  }
  return rules;
}

}  // namespace

StateWriter::StateWriter(const MessageType& type, const ArmModels::Arm& arm, StateRules rules)
    : map_(type, with_stamps(type, std::move(rules))) {
  const std::vector<std::pair<std::string, std::string>> texts{
      {"header.frame_id", base_frame(arm.name)},
      {"o_t_ee.header.frame_id", base_frame(arm.name)},
      {"o_t_ee_d.header.frame_id", base_frame(arm.name)},
      {"o_t_ee_c.header.frame_id", base_frame(arm.name)},
      {"f_t_ee.header.frame_id", arm.name + "_link8"},
      {"ee_t_k.header.frame_id", arm.name + "_ee"},
      {"o_f_ext_hat_k.header.frame_id", base_frame(arm.name)},
      {"k_f_ext_hat_k.header.frame_id", arm.name + "_k"},
      {"inertia_load.header.frame_id", arm.name + "_link8"}};
  for (const auto& [path, text] : texts) {
    if (!type.place(path)) continue;
    texts_.emplace_back(Text(type, path), text);
    known_.push_back(path);
  }
  for (const char* joints : {"measured_joint_state", "desired_joint_state", "measured_joint_motor_state",
                             "tau_ext_hat_filtered"}) {
    const std::string path = std::string(joints) + ".name";
    if (!type.place(path)) continue;
    lists_.emplace_back(Texts(type, path), arm.joint_names);
    known_.push_back(path);
  }
}

void StateWriter::prepare(void* message) const {
  for (const auto& [field, text] : texts_) field.write(message, text);
  for (const auto& [field, texts] : lists_) field.write(message, texts);
}

std::vector<std::string> StateWriter::unknown() const {
  std::vector<std::string> unknown;
  for (const auto& path : map_.unknown()) {
    if (std::find(known_.begin(), known_.end(), path) == known_.end()) unknown.push_back(path);
  }
  return unknown;
}

}  // namespace multipanda::ros
