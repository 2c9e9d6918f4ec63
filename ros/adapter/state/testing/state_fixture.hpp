#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "ros/rcl/rcl.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

// A simulated scene and the context of the parts that publish it, without threads of a run: the test makes
// the steps and delivers the records.
namespace multipanda::ros::test {

class StateFixture {
 public:
  explicit StateFixture(const std::string& scene_text);

  const Scene& scene() const { return scene_; }
  MujocoBackend& backend() { return backend_; }
  const AdapterContext& run_context() const { return run_; }
  Node& node() { return node_; }
  Context& context() { return context_; }
  Executor& executor() { return executor_; }

  // Runs this many cycles and passes each record to the parts and to `seen`.
  void run(std::size_t cycles, const AdapterParts& parts = {},
           const std::function<void(const CycleRecord&)>& on_record = nullptr);

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
  AdapterContext run_;
};

// Messages of a topic. The executor's thread counts them.
template <class M>
struct Received {
  Received(StateFixture& fixture, Node& node, const std::string& name, const Qos& qos = Qos::reliable(2000))
      : subscription(fixture.executor(), node, name, qos, Doc{}, [this](const M& message) {
          const std::lock_guard lock(mutex);
          messages.push_back(message);
        }) {}
  std::size_t count() {
    const std::lock_guard lock(mutex);
    return messages.size();
  }
  std::mutex mutex;
  std::vector<M> messages;
  Subscription<M> subscription;
};

// Polls until the condition holds; returns false after the deadline.
bool wait_for(const std::function<bool()>& condition, double deadline_s = 20);

}  // namespace multipanda::ros::test
