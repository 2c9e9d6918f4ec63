#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "runtime/run_adapter.hpp"

namespace multipanda {

// What a command line says about ROS beyond the scene; empty: as the scene says.
struct RosWords {
  std::string node, name_space;
  std::vector<std::string> remaps;  // "joint_states:=arms/joint_states"
  bool operator==(const RosWords&) const = default;
};

// The library with the ROS adapter is loaded only for runs that want it, so that others have no ROS library,
// no Python and no second logger in their process. It exports
//   unsigned multipanda_ros_version()
//   RunAdapter* multipanda_make_ros_adapter(const RunWorld&, const RosWords&)
//   SetPointLink* multipanda_make_topic_link(const TopicWords&)       (generators/topic_link.hpp)
// The number must match the program's; the sizes in it show that one of the two is older than the other.
inline constexpr unsigned kRosModuleVersion =
    1'000'000u * 1u + static_cast<unsigned>(sizeof(Scene) + 3 * sizeof(ArmSample) + 5 * sizeof(RunWorld) +
                                            7 * sizeof(Event) + 11 * sizeof(Capabilities)) %
                          1'000'000u;

// Beside the program: "libmultipanda_ros.so".
std::filesystem::path ros_module_path();

// Loads the library, which is never unloaded, and returns one of its functions. Throws std::runtime_error
// that says what to do where there is none or it cannot be used.
void* ros_module_function(const char* name, const std::filesystem::path& module = ros_module_path());

// Loads the library; it is never unloaded. Throws std::runtime_error that says what to do where there is none
// or it cannot be used. What is returned throws std::runtime_error where ROS refuses.
MakeRunAdapter load_ros_adapter(RosWords words, const std::filesystem::path& module = ros_module_path());

}  // namespace multipanda
