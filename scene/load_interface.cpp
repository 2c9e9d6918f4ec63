#include <algorithm>
#include <arpa/inet.h>
#include <cctype>
#include <cstdlib>

#include "scene/load_parts.hpp"
#include "scene/schema.hpp"

namespace multipanda {
namespace {

// One number for all, or a list of `count`.
Eigen::VectorXd numbers_or_one(const Mapping& mapping, const std::string& key, std::size_t count) {
  const Entry entry = mapping.entry(key);
  const auto size = static_cast<Eigen::Index>(count);
  if (entry.node().IsScalar()) return Eigen::VectorXd::Constant(size, entry.number(mapping.field(key)));
  const std::vector<double> values = mapping.numbers(key, count);
  return Eigen::Map<const Eigen::VectorXd>(values.data(), size);
}

void check_order(const Mapping& mapping, const std::string& lower_key, const std::string& upper_key,
                 const Eigen::VectorXd& lower, const Eigen::VectorXd& upper, const char* place) {
  for (Eigen::Index i = 0; i < lower.size(); ++i) {
    if (lower[i] <= upper[i]) continue;
    mapping.entry(mapping.has(lower_key) ? lower_key : upper_key)
        .refuse(std::string(place) + std::to_string(i + 1) + ": expected " + lower_key + " at most " +
                upper_key + ", found " + number_text(lower[i]) + " and " + number_text(upper[i]));
  }
}

// What is not written is as in `absent`; a lower threshold never above its upper one.
ContactThresholds read_thresholds(const Mapping& mapping, std::size_t joint_count,
                                  const ContactThresholds& absent) {
  const auto value = [&](const std::string& key, std::size_t count, const Eigen::VectorXd& otherwise) {
    return mapping.has(key) ? numbers_or_one(mapping, key, count) : otherwise;
  };
  ContactThresholds t;
  t.torque_upper = value("torque_upper_nm", joint_count, absent.torque_upper);
  t.torque_lower = value("torque_lower_nm", joint_count, absent.torque_lower.cwiseMin(t.torque_upper));
  t.wrench_upper = value("wrench_upper", 6, absent.wrench_upper);
  t.wrench_lower = value("wrench_lower", 6, absent.wrench_lower.cwiseMin(t.wrench_upper));
  check_order(mapping, "torque_lower_nm", "torque_upper_nm", t.torque_lower, t.torque_upper, "joint");
  check_order(mapping, "wrench_lower", "wrench_upper", t.wrench_lower, t.wrench_upper, "axis ");
  return t;
}

SetCollisionThresholds read_collision(const Mapping& mapping, const RobotDescription& robot) {
  const Vector6 wrench = Vector6::Constant(100);  // [N, N m]
  const JointVector& torque = robot.limits.tau_max;
  const std::size_t n = robot.joint_count();
  SetCollisionThresholds out{.nominal = read_thresholds(mapping, n, {torque, torque, wrench, wrench}),
                             .acceleration = {}};
  if (mapping.has("acceleration")) {
    out.acceleration = read_thresholds(mapping.section("acceleration"), n, out.nominal);
  }
  return out;
}

bool is_address(const std::string& text) {
  constexpr std::size_t kLongest = 253;  // of a host name
  if (text.empty() || text.size() > kLongest) return false;
  const auto is_one_of = [&](const char* others, auto kind) {
    return std::all_of(text.begin(), text.end(), [&](char c) {
      return kind(static_cast<unsigned char>(c)) != 0 ||
             std::string_view(others).find(c) != std::string_view::npos;
    });
  };
  in_addr ignored{};
  if (is_one_of(".", [](int c) { return std::isdigit(c); }))
    return inet_pton(AF_INET, text.c_str(), &ignored) == 1;
  return is_one_of(".-_", [](int c) { return std::isalnum(c); }) && text.front() != '-' &&
         text.front() != '.';
}

FciConnection read_fci(const Mapping& arm, const SceneReader& reader) {
  FciConnection fci;
  const Entry entry = arm.entry("fci");
  fci.place = entry.place();
  std::optional<Mapping> mapping;
  if (!entry.node().IsScalar()) mapping.emplace(entry, schema::fci());
  const Entry address = mapping ? mapping->entry("address") : entry;
  fci.address = address.node().IsScalar() ? address.node().Scalar() : "";
  if (!is_address(fci.address)) address.expected("an IPv4 address or a host name, as 172.16.0.2");
  for (const auto& other : reader.scene.arms) {
    if (other.fci && other.fci->address == fci.address) {
      address.refuse("arm '" + other.name + "' has the same address " + fci.address +
                     "; every arm has its own");
    }
  }
  if (!mapping) return fci;
  const std::string version = mapping->text("version");
  fci.version = version == "auto" ? 0 : std::atoi(version.c_str());
  fci.gripper = mapping->boolean("gripper");
  fci.vacuum = mapping->boolean("vacuum");
  fci.low_pass_hz = mapping->number("low_pass_hz");
  fci.rate_limit = mapping->boolean("rate_limit");
  fci.check_model = mapping->boolean("check_model");
  return fci;
}

}  // namespace

void read_arm_interface(const Mapping& arm, const RobotDescription& robot, const SceneReader& reader,
                        SceneArm& out) {
  if (arm.has("fci")) out.fci = read_fci(arm, reader);
  if (arm.has("collision")) out.collision = read_collision(arm.section("collision"), robot);
  if (arm.has("joint_stiffness_nm_per_rad")) {
    out.joint_stiffness = JointVector(numbers_or_one(arm, "joint_stiffness_nm_per_rad", robot.joint_count()));
  }
  if (arm.has("cartesian_stiffness")) {
    const std::vector<double> k = arm.numbers("cartesian_stiffness", 6);
    out.cartesian_stiffness = Eigen::Map<const Vector6>(k.data());
  }
}

}  // namespace multipanda
