#include "ros/adapter/compat/state_fields.hpp"

#include <cmath>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>

#include "device/arm_error.hpp"
#include "ros/adapter/names.hpp"

namespace multipanda::ros {
namespace {

using Out = std::span<double>;
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

void fill_unknown(Out out) { std::fill(out.begin(), out.end(), kUnknown); }

// Numbers of the sample, which are NaN unless `has` says that the arm reports them.
template <class Values>
auto sampled(Values ArmSample::*values, bool ArmSample::*has = nullptr) {
  return [values, has](const ArmReport& from, Out out) {
    if (has != nullptr && !(from.sample.*has)) return fill_unknown(out);
    std::copy_n((from.sample.*values).begin(), out.size(), out.begin());
  };
}

template <class Number>
auto number(Number ArmSample::*value, double scale = 1) {
  return [value, scale](const ArmReport& from, Out out) {
    out[0] = scale * static_cast<double>(from.sample.*value);
  };
}

template <class Bits>
auto flags(Bits ArmSample::*bits, int first = 0) {
  return [bits, first](const ArmReport& from, Out out) {
    for (std::size_t i = 0; i < out.size(); ++i)
      out[i] = (from.sample.*bits >> (static_cast<std::size_t>(first) + i) & 1u) != 0 ? 1 : 0;
  };
}

Pose pose_of(const std::array<double, 12>& values) {
  return {Eigen::Map<const Matrix3>(values.data() + 3), Eigen::Map<const Vector3>(values.data())};
}

// Poses as both messages name them. Nothing: the arm does not report it.
using PoseOf = std::function<std::optional<Pose>(const ArmReport&)>;

std::optional<Pose> measured(const ArmReport& from) {
  return from.terms.model().X_WB().inverse() * from.terms.X_WE();
}

PoseOf reported(std::array<double, 12> ArmSample::*values) {
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

// The wrench about K in the axes of the base, or of K.
auto wrench(bool in_base) {
  return [in_base](const ArmReport& from, Out out) {
    if (!from.sample.has_wrench_estimate) return fill_unknown(out);
    const Matrix3 R_WA = in_base ? from.terms.model().X_WB().rotation : from.terms.X_WK().rotation;
    const Eigen::Map<const Vector6> F(from.sample.F_K_W_est.data());
    Eigen::Map<Vector3>(out.data()) = R_WA.transpose() * F.head<3>();
    Eigen::Map<Vector3>(out.data() + 3) = R_WA.transpose() * F.tail<3>();
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

// What both messages have under one name.
StateRules common_rules() {
  StateRules rules{{{"time"}, 1, number(&ArmSample::t_robot_ns, 1e-9)},
                   {{"control_command_success_rate"}, 1, number(&ArmSample::command_success_rate)},
                   {{"robot_mode"},
                    1,
                    [](const ArmReport& from, Out out) {
                      constexpr std::uint8_t kLast = 6;  // theirs have no mode for a lost connection: other
                      out[0] = from.sample.mode > kLast ? 0 : from.sample.mode;
                    },
                    true}};
  add_errors(rules);
  return rules;
}

std::vector<std::string> parts(const std::string& path, std::initializer_list<const char*> names) {
  std::vector<std::string> paths;
  for (const char* name : names) paths.push_back(path + "." + name);
  return paths;
}

}  // namespace

std::string error_field(ArmError error) {
  // libfranka prints these two otherwise than it names them.
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
  constexpr double kTolerance = 1e-3;  // single precision and sums of it
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
  StateRules rules = common_rules();
  const StateRules more{
      {{"q"}, n, sampled(&ArmSample::q), true},
      {{"dq"}, n, sampled(&ArmSample::dq), true},
      {{"tau_j"}, n, sampled(&ArmSample::tau_J), true},
      {{"tau_j_d"}, n, sampled(&ArmSample::tau_J_d)},
      {{"tau_ext_hat_filtered"}, n, sampled(&ArmSample::tau_ext, &ArmSample::has_tau_ext)},
      {{"q_d"}, n, sampled(&ArmSample::q_d, &ArmSample::has_report)},
      {{"dq_d"}, n, sampled(&ArmSample::dq_d, &ArmSample::has_report)},
      {{"theta"}, n, sampled(&ArmSample::theta, &ArmSample::has_report)},
      {{"elbow"}, 2, sampled(&ArmSample::elbow, &ArmSample::has_report)},
      {{"joint_contact"}, n, flags(&ArmSample::joint_contact)},
      {{"joint_collision"}, n, flags(&ArmSample::joint_collision)},
      {{"cartesian_contact"}, 6, flags(&ArmSample::cartesian_contact)},
      {{"cartesian_collision"}, 6, flags(&ArmSample::cartesian_collision)},
      {{"o_f_ext_hat_k"}, 6, wrench(true)},
      {{"k_f_ext_hat_k"}, 6, wrench(false)},
      {{"m_load"}, 1, [](const ArmReport& from, Out out) { out[0] = from.arm.load.mass; }},
      {{"f_x_cload"},
       3,
       [](const ArmReport& from, Out out) { Eigen::Map<Vector3>(out.data()) = from.arm.load.p_FC; }},
      {{"i_load"}, 9, [](const ArmReport& from, Out out) {
         Eigen::Map<Matrix3>(out.data()) = from.arm.load.inertia_C;
       }}};
  rules.insert(rules.end(), more.begin(), more.end());
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
  StateRules rules = common_rules();
  const StateRules more{
      {{"measured_joint_state.position"}, n, sampled(&ArmSample::q), true},
      {{"measured_joint_state.velocity"}, n, sampled(&ArmSample::dq), true},
      {{"measured_joint_state.effort"}, n, sampled(&ArmSample::tau_J), true},
      {{"desired_joint_state.position"}, n, sampled(&ArmSample::q_d, &ArmSample::has_report)},
      {{"desired_joint_state.velocity"}, n, sampled(&ArmSample::dq_d, &ArmSample::has_report)},
      {{"desired_joint_state.effort"}, n, sampled(&ArmSample::tau_J_d)},
      {{"measured_joint_motor_state.position"}, n, sampled(&ArmSample::theta, &ArmSample::has_report)},
      {{"tau_ext_hat_filtered.effort"}, n, sampled(&ArmSample::tau_ext, &ArmSample::has_tau_ext)},
      {{"elbow.position"}, 2, sampled(&ArmSample::elbow, &ArmSample::has_report)},
      {{"collision_indicators.is_joint_contact"}, n, flags(&ArmSample::joint_contact)},
      {{"collision_indicators.is_joint_collision"}, n, flags(&ArmSample::joint_collision)}};
  rules.insert(rules.end(), more.begin(), more.end());
  const auto axes = [&](const std::string& name, std::uint8_t ArmSample::*bits, int first) {
    rules.push_back({parts("collision_indicators." + name, {"x", "y", "z"}), 3, flags(bits, first)});
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
    rules.push_back(
        {parts(std::string(named.name) + ".pose", {"position.x", "position.y", "position.z", "orientation.w",
                                                   "orientation.x", "orientation.y", "orientation.z"}),
         7,
         [pose = named.pose](const ArmReport& from, Out out) {
           const auto X = pose(from);
           if (!X) return fill_unknown(out);
           const Quaternion q = X->quaternion();
           const std::array values{
               X->position.x(), X->position.y(), X->position.z(), q.w(), q.x(), q.y(), q.z()};
           std::copy(values.begin(), values.end(), out.begin());
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
