#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/model/arm_model.hpp"
#include "core/modes/multimode_controller.hpp"
#include "core/record/cycle_record.hpp"
#include "core/types/tick.hpp"
#include "runtime/followed.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// Parts of a run for an adapter. They outlive the adapter.
struct RunContext {
  const Scene* scene = nullptr;
  MultimodeController* modes = nullptr;  // members for threads other than the loop's
  Backend* backend = nullptr;            // capabilities() and request()
  const RecordLayout* layout = nullptr;
  std::vector<std::shared_ptr<const ArmModel>> models;  // per arm
  std::shared_ptr<Followed> followed;                   // none: nothing follows widths
  std::function<ArmSample(ArmIndex)> newest;            // of the run's records; none: not known
};

// Connects a run with other programs (ROS): receives its records and sends requests to its controller and
// backend. Exists from before the first cycle until after the last one, and owns its threads.
class RunAdapter {
 public:
  virtual ~RunAdapter() = default;
  // On the relay thread, for every record in order. Must not wait, because the log is written afterwards.
  virtual void take(const CycleRecord& record) = 0;
  virtual void take(const Event& event) = 0;
  // On the loop's thread between two steps, to read the world. Must not allocate or lock.
  virtual void on_loop(const Tick&, const Backend&) {}
};

using MakeRunAdapter = std::function<std::unique_ptr<RunAdapter>(const RunContext&)>;

// ROS options of the command line; empty members: as in the scene.
struct RosArguments {
  std::string node, name_space;
  std::vector<std::string> remaps;  // "joint_states:=arms/joint_states"
  bool operator==(const RosArguments&) const = default;
};

// The library with the ROS adapter is loaded only with --ros: other runs have no ROS library, no Python and
// no second logger in their process. It exports
//   unsigned multipanda_ros_version()
//   RunAdapter* multipanda_make_ros_adapter(const RunContext&, const RosArguments&)
//   SetPointChannel* multipanda_make_topic_link(const TopicArguments&)
//   (motion_generators/set_point_channel.hpp)
// The version must match the program's. It contains the sizes of shared types to detect old libraries.
inline constexpr unsigned kRosModuleVersion =
    1'000'000u * 1u + static_cast<unsigned>(sizeof(Scene) + 3 * sizeof(ArmSample) + 5 * sizeof(RunContext) +
                                            7 * sizeof(Event) + 11 * sizeof(Capabilities)) %
                          1'000'000u;

// The library "libmultipanda_ros.so": next to the program, in a wheel in lib/ros.
std::filesystem::path ros_module_path();

// Loads the library, which is never unloaded, and returns one of its functions. Throws std::runtime_error
// with the remedy if the library is missing or unusable.
void* ros_module_function(const char* name, const std::filesystem::path& module = ros_module_path());

// Loads the library, which is never unloaded. Throws std::runtime_error with advice if the library is missing
// or unusable. The returned function throws std::runtime_error if ROS fails.
MakeRunAdapter load_ros_adapter(RosArguments words, const std::filesystem::path& module = ros_module_path());

}  // namespace multipanda
