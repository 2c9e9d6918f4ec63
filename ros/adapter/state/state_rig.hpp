#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "ros/adapter/part.hpp"
#include "ros/rcl/rcl.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

// A scene in simulation and the parts that show it, without threads of the run: the test makes the steps and
// hands the records on.
namespace multipanda::ros::test {

class StateRig {
 public:
  explicit StateRig(const std::string& scene_text);

  const Scene& scene() const { return scene_; }
  MujocoBackend& backend() { return backend_; }
  const AdapterWorld& world() const { return world_; }
  Node& node() { return node_; }
  Context& context() { return context_; }
  Executor& executor() { return executor_; }

  // So many cycles. What they leave goes to the parts and to `seen`.
  void run(std::size_t cycles, const Parts& parts = {},
           const std::function<void(const CycleRecord&)>& seen = nullptr);

 private:
  Registry registry_ = Registry::with_builtins();
  Scene scene_;
  MujocoBackend backend_;
  CycleConfig config_;
  ControlCycle cycle_;
  bool started_ = false;
  Context context_;
  Node node_;
  Executor executor_;
  RosOptions options_;
  AdapterCounters counters_;
  AdapterWorld world_;
};

// Polls until the condition holds; false after the deadline.
bool wait_for(const std::function<bool()>& condition, double deadline_s = 20);

}  // namespace multipanda::ros::test
