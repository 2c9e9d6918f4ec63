#include "fci/simulated_time/simulated_run.hpp"

#include <limits>
#include <utility>

#include "scene/build.hpp"

namespace multipanda::fci {

SimulatedRun::SimulatedRun(const Scene& scene, SimulatedRunOptions options)
    : registry_(options.registry ? std::move(*options.registry) : build_registry(scene.plugins)),
      world_(scene, std::move(options.time)) {
  constexpr std::size_t kRecords = 4;  // read after every cycle
  cycle_ = std::make_unique<ControlCycle>(build_cycle_config(scene, kRecords), registry_, world_);
  if (options.timeline) modes().schedule(build_schedule(scene, modes()));
  modes().activate_at_start(start_set(scene, modes()));
}

void SimulatedRun::begin() { world_.start(); }

bool SimulatedRun::step() {
  due_ = world_.wait();
  if (world_.ended()) return false;
  cycle_->step(due_);
  RecordRing& records = *cycle_->record();
  while (const Event* event = records.events.front()) {
    if (on_event) on_event(*event);
    records.events.pop();
  }
  while (const CycleRecord* record = records.ring.front()) {
    if (after_cycle) after_cycle(*record);
    records.ring.pop();
  }
  return true;
}

void SimulatedRun::run_for(double duration_s) {
  const std::int64_t end = world_.time_ns() + static_cast<std::int64_t>(1e9 * duration_s);
  while (world_.time_ns() < end && step()) {
  }
}

void SimulatedRun::end() { world_.finish(); }

Answer SimulatedRun::ask(const Request& request) {
  Answer answer;
  std::uint64_t ticket = 0;
  answer.verdict = modes().post(std::span(&request, 1), ticket, std::numeric_limits<double>::infinity());
  if (!answer.accepted()) return answer;
  while (step() && !modes().poll(ticket, answer)) {
  }
  return answer;
}

RequestAnswer SimulatedRun::ask(ArmIndex arm, ArmRequest request) {
  auto answer = world_.request(arm, std::move(request));
  while (answer.wait_for(std::chrono::seconds(0)) != std::future_status::ready) {
    if (!step()) return {false, "the run has ended"};
  }
  return answer.get();
}

}  // namespace multipanda::fci
