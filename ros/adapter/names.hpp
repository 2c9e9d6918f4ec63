#pragma once

#include <cstddef>
#include <string>
#include <vector>

// Names shared by several parts and their users. Scene names consist of letters, digits and _, so they are
// valid in topics and frames.
namespace multipanda::ros {

// "left_joint1" ...
inline std::vector<std::string> joint_names(const std::string& arm, std::size_t count) {
  std::vector<std::string> names;
  for (std::size_t i = 1; i <= count; ++i) names.push_back(arm + "_joint" + std::to_string(i));
  return names;
}

inline std::string base_frame(const std::string& arm) { return arm + "_link0"; }
inline constexpr const char* kWorldFrame = "world";

// "~/pose0/collision_avoidance/distance_m" of a feature's output "collision_avoidance.distance_m"
inline std::string topic_of(const std::string& instance, std::string quantity) {
  for (char& c : quantity) c = c == '.' ? '/' : c;
  return "~/" + instance + "/" + quantity;
}

}  // namespace multipanda::ros
