#pragma once

#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>

#include "core/testing/test_world.hpp"
#include "runtime/live_input/request_handler.hpp"

namespace multipanda::test {

// A separate folder that is removed after the test.
class PrivateFolder {
 public:
  PrivateFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "live_XXXXXX").string();
    path_ = mkdtemp(pattern.data());
  }
  ~PrivateFolder() { std::filesystem::remove_all(path_); }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// Two arms on rotated bases under multipanda's own controllets, stepped by the test or by a thread.
struct LiveFixture {
  static InstanceConfig config(std::string name, std::string type, std::vector<ArmIndex> arms) {
    InstanceConfig config;
    config.name = std::move(name);
    config.type = std::move(type);
    config.arms = std::move(arms);
    return config;
  }

  LiveFixture()
      : loop(
            2,
            {config("pose0", "cartesian_impedance", {0}), config("joint0", "joint_impedance", {0}),
             config("pose1", "cartesian_impedance", {1}), config("both", "dual_cartesian_impedance", {0, 1})},
            Registry::with_builtins(), 4096),
        latest(2) {}

  LiveInputContext run() {
    return {.scene = "fixture",
            .modes = &loop.modes(),
            .backend = &loop.world,
            .latest = &latest,
            .models = loop.models};
  }

  // Steps, and passes the records on like the relay of a run.
  void steps(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      loop.step();
      RecordRing& ring = *loop.cycle.record();
      for (; const Event* event = ring.events.front(); ring.events.pop()) latest.take(*event);
      for (; const CycleRecord* record = ring.ring.front(); ring.ring.pop()) latest.take(*record);
    }
  }

  TestLoop loop;
  LatestState latest;
};

// Steps a fixture during its lifetime.
class Stepping {
 public:
  explicit Stepping(LiveFixture& fixture)
      : thread_([&fixture](const std::stop_token& stop) {
          while (!stop.stop_requested()) {
            fixture.steps(1);
            std::this_thread::yield();
          }
        }) {}

 private:
  std::jthread thread_;
};

}  // namespace multipanda::test
