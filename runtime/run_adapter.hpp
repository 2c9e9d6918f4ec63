#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/model/arm_model.hpp"
#include "core/modes/multimode_controller.hpp"
#include "core/record/cycle_record.hpp"
#include "core/types/tick.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// What a run shows of itself to whoever speaks for it. All of it outlives the adapter.
struct RunWorld {
  const Scene* scene = nullptr;
  MultimodeController* modes = nullptr;  // the members for other threads than the loop's
  Backend* backend = nullptr;            // capabilities() and request()
  const RecordLayout* layout = nullptr;
  std::vector<std::shared_ptr<const ArmModel>> models;  // per arm
};

// Connects a run with the outside (ROS): takes its records and asks its controller and backend. Lives from
// before the first cycle until after the last one; what it needs of threads it has itself.
class RunAdapter {
 public:
  virtual ~RunAdapter() = default;
  // Relay thread, in order, every one. Must not wait: the log comes behind.
  virtual void take(const CycleRecord& record) = 0;
  virtual void take(const Event& event) = 0;
  // Loop's thread, between two steps: what only the world itself can tell. No allocation, no lock.
  virtual void on_loop(const Tick&, const Backend&) {}
};

using MakeRunAdapter = std::function<std::unique_ptr<RunAdapter>(const RunWorld&)>;

}  // namespace multipanda
