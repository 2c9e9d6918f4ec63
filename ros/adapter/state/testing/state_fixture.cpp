#include "ros/adapter/state/testing/state_fixture.hpp"

#include <chrono>
#include <cstdlib>
#include <thread>
#include <unistd.h>

namespace multipanda::ros::test {
namespace {

// Each process uses its own domain, over shared memory.
std::vector<std::string> on_own_domain() {
  setenv("ROS_DOMAIN_ID", std::to_string(1 + ::getpid() % 100).c_str(), 1);
  setenv("FASTDDS_BUILTIN_TRANSPORTS", "SHM", 1);
  setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT", 1);
  return {};
}

}  // namespace

StateFixture::StateFixture(const std::string& scene_text)
    : scene_(parse_scene(scene_text, "test.yaml", registry_)),
      backend_(scene_, {.pace = Pace::unpaced}),
      config_(build_cycle_config(scene_, 64)),
      cycle_(config_, registry_, backend_),
      context_(on_own_domain()),
      node_(context_, scene_.ros.node, scene_.ros.name_space) {
  cycle_.modes().schedule(build_schedule(scene_, cycle_.modes()));
  cycle_.modes().activate_at_start(start_set(scene_, cycle_.modes()));
  static_cast<RosSection&>(options_) = scene_.ros;
  run_.scene = &scene_;
  run_.modes = &cycle_.modes();
  run_.backend = &backend_;
  run_.layout = &cycle_.layout();
  for (const auto& arm : config_.arms) run_.models.push_back(arm.model);
  run_.context = &context_;
  run_.node = &node_;
  run_.executor = run_.stops = &executor_;
  run_.options = &options_;
  run_.counters = &counters_;
  run_.stamps.simulated = true;
  run_.diagnostics = [] { return std::vector<Diagnostic>(); };
  run_.warn = [](const std::string&, const std::string&) {};
}

void StateFixture::run(std::size_t cycles, const AdapterParts& parts,
                       const std::function<void(const CycleRecord&)>& on_record) {
  if (!started_) backend_.start();
  started_ = true;
  std::size_t made = 0;
  cycle_.run([&] {
    RecordRing& ring = *cycle_.record();
    if (made > 0) {
      for (const auto& part : parts) part->on_loop(cycle_.data().tick, backend_);
    }
    while (const Event* event = ring.events.front()) {
      for (const auto& part : parts) part->take(*event);
      ring.events.pop();
    }
    while (const CycleRecord* record = ring.ring.front()) {
      for (const auto& part : parts) part->take(*record);
      if (on_record) on_record(*record);
      ring.ring.pop();
    }
    return made++ < cycles;
  });
}

bool wait_for(const std::function<bool()>& condition, double deadline_s) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(deadline_s);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::microseconds(500));
  }
  return true;
}

}  // namespace multipanda::ros::test
