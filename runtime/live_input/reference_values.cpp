#include "runtime/live_input/reference_values.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace multipanda {
namespace {

std::vector<double> read_pair(const JsonFields& fields, const std::vector<std::string>& keys) {
  std::vector<double> values;
  for (const auto& key : keys) {
    const auto half = fields.has(key) ? fields.numbers(key, 3) : std::vector<double>(3, 0.0);
    values.insert(values.end(), half.begin(), half.end());
  }
  return values;
}

// x y z, w x y z, as given: the quaternion need not be normalized.
std::vector<double> pose_values(const JsonFields& fields, const std::optional<Matrix3>& rotation) {
  const int orientations = fields.has("rpy_rad") + fields.has("quaternion_wxyz");
  if (!fields.has("position_m") || orientations > 1 || (orientations == 0 && !rotation))
    fields.refuse(std::string("a pose needs ") + keys_of(Quantity::pose).expected);
  std::vector<double> values = fields.numbers("position_m", 3);
  if (fields.has("quaternion_wxyz")) {
    const auto q = fields.numbers("quaternion_wxyz", 4);
    values.insert(values.end(), q.begin(), q.end());
    return values;
  }
  Pose X;
  if (fields.has("rpy_rad")) {
    const auto a = fields.numbers("rpy_rad", 3);
    for (const double angle : a) {
      if (std::abs(angle) > 2.01 * std::numbers::pi)
        fields.expected("rpy_rad", "angles in radians, at most one turn (these look like degrees)");
    }
    X.rotation = rotation_from_rpy({a[0], a[1], a[2]});
  } else {
    X.rotation = *rotation;
  }
  const Quaternion q = X.quaternion();
  values.insert(values.end(), {q.w(), q.x(), q.y(), q.z()});
  return values;
}

}  // namespace

std::vector<std::string> reference_keys() {
  std::vector<std::string> all{"values"};
  for (const auto& row : quantity_keys()) all.insert(all.end(), row.keys.begin(), row.keys.end());
  return all;
}

Pose read_pose(const JsonFields& fields, const std::optional<Matrix3>& rotation) {
  const auto v = pose_values(fields, rotation);
  const Quaternion q(v[3], v[4], v[5], v[6]);
  if (!(std::abs(q.norm() - 1) <= 1e-2)) fields.expected("quaternion_wxyz", "a unit quaternion, w first");
  return Pose::from({v[0], v[1], v[2]}, q);
}

std::vector<double> read_reference(const JsonFields& fields, const InputSpec& input) {
  const auto& own = keys_of(input.quantity).keys;
  std::vector<std::string> found;
  for (const auto& key : reference_keys()) {
    if (fields.has(key)) found.push_back(key);
  }
  if (found == std::vector<std::string>{"values"}) return fields.numbers("values");
  const auto is_own = [&](const auto& key) { return std::ranges::find(own, key) != own.end(); };
  if (found.empty() || !std::ranges::all_of(found, is_own)) fields.refuse(carries_text(input));
  if (input.quantity == Quantity::pose) return pose_values(fields, {});
  if (own.size() == 2) return read_pair(fields, own);
  return fields.numbers(own[0]);
}

}  // namespace multipanda
