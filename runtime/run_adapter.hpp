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

// Parts of a run for an adapter. They outlive the adapter.
struct RunContext {
  const Scene* scene = nullptr;
  MultimodeController* modes = nullptr;  // members for threads other than the loop's
  Backend* backend = nullptr;            // capabilities() and request()
  const RecordLayout* layout = nullptr;
  std::vector<std::shared_ptr<const ArmModel>> models;  // per arm
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

}  // namespace multipanda
