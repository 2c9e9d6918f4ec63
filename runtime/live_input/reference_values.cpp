#include "runtime/live_input/reference_values.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace multipanda {
namespace {

constexpr const char* kPoseKeys = "position_m [m] with rpy_rad [rad] or quaternion_wxyz";

const char* expectation(Quantity quantity) {
  switch (quantity) {
    case Quantity::pose:
      return kPoseKeys;
    case Quantity::twist:
      return "linear_m_per_s [m/s] and/or angular_rad_per_s [rad/s]";
    case Quantity::wrench:
      return "force_n [N] and/or torque_nm [N m]";
    case Quantity::joints:
      return "q_rad [rad], one number per joint";
    case Quantity::scalar:
      return "value, one number";
  }
  return "";
}

std::vector<double> read_pair(const JsonFields& fields, const std::vector<std::string>& keys) {
  std::vector<double> values;
  for (const auto& key : keys) {
    const auto half = fields.has(key) ? fields.numbers(key, 3) : std::vector<double>(3, 0.0);
    values.insert(values.end(), half.begin(), half.end());
  }
  return values;
}

}  // namespace

std::vector<std::string> keys_of(Quantity quantity) {
  switch (quantity) {
    case Quantity::pose:
      return {"position_m", "rpy_rad", "quaternion_wxyz"};
    case Quantity::twist:
      return {"linear_m_per_s", "angular_rad_per_s"};
    case Quantity::wrench:
      return {"force_n", "torque_nm"};
    case Quantity::joints:
      return {"q_rad"};
    case Quantity::scalar:
      return {"value"};
  }
  return {};
}

std::vector<std::string> reference_keys() {
  std::vector<std::string> all;
  for (const auto quantity :
       {Quantity::pose, Quantity::twist, Quantity::wrench, Quantity::joints, Quantity::scalar}) {
    const auto keys = keys_of(quantity);
    all.insert(all.end(), keys.begin(), keys.end());
  }
  return all;
}

Pose read_pose(const JsonFields& fields, const std::optional<Matrix3>& rotation) {
  const int orientations = fields.has("rpy_rad") + fields.has("quaternion_wxyz");
  if (!fields.has("position_m") || orientations > 1 || (orientations == 0 && !rotation)) {
    fields.refuse(std::string("a pose needs ") + kPoseKeys);
  }
  const auto p = fields.numbers("position_m", 3);
  const Vector3 position(p[0], p[1], p[2]);
  if (orientations == 0) return {*rotation, position};
  if (fields.has("rpy_rad")) {
    const auto a = fields.numbers("rpy_rad", 3);
    for (const double angle : a) {
      if (std::abs(angle) > 2.01 * std::numbers::pi)
        fields.expected("rpy_rad", "angles in radians, at most one turn (these look like degrees)");
    }
    return {rotation_from_rpy({a[0], a[1], a[2]}), position};
  }
  const auto q = fields.numbers("quaternion_wxyz", 4);
  const Quaternion quaternion(q[0], q[1], q[2], q[3]);
  if (std::abs(quaternion.norm() - 1) > 1e-2)
    fields.expected("quaternion_wxyz", "a unit quaternion, w first");
  return Pose::from(position, quaternion);
}

std::vector<double> read_reference(const JsonFields& fields, const InputSpec& input, std::size_t size) {
  const auto right = keys_of(input.quantity);
  const auto carries = "input '" + input.name + "' carries a " + std::string(to_string(input.quantity)) +
                       ": expected " + expectation(input.quantity);
  for (const auto& key : reference_keys()) {
    if (fields.has(key) && std::find(right.begin(), right.end(), key) == right.end()) fields.refuse(carries);
  }
  if (std::none_of(right.begin(), right.end(), [&](const auto& key) { return fields.has(key); })) {
    fields.refuse(carries);
  }
  switch (input.quantity) {
    case Quantity::pose: {
      const Pose X = read_pose(fields);
      const Quaternion q = X.quaternion();
      return {X.position.x(), X.position.y(), X.position.z(), q.w(), q.x(), q.y(), q.z()};
    }
    case Quantity::twist:
    case Quantity::wrench:
      return read_pair(fields, right);
    case Quantity::joints:
      return fields.numbers("q_rad", size);
    case Quantity::scalar:
      break;
  }
  return {fields.number("value")};
}

}  // namespace multipanda
