#pragma once

#include <nlohmann/json.hpp>

#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"

namespace multipanda::cockpit {

inline nlohmann::json numbers(const Vector3& v) { return {v.x(), v.y(), v.z()}; }
inline nlohmann::json numbers(const Quaternion& q) { return {q.w(), q.x(), q.y(), q.z()}; }
inline nlohmann::json numbers(const JointVector& v) {
  return std::vector<double>(v.data(), v.data() + v.size());
}

}  // namespace multipanda::cockpit
