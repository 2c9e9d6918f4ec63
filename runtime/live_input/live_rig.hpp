#pragma once

#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>

#include "core/test_support/test_world.hpp"
#include "runtime/live_input/command_desk.hpp"

namespace multipanda::test {

// A folder of its own that disappears with the test.
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
struct LiveRig {
  static InstanceConfig config(std::string name, std::string type, std::vector<ArmIndex> arms) {
    InstanceConfig config;
    config.name = std::move(name);
    config.type = std::move(type);
    config.arms = std::move(arms);
    return config;
  }

  LiveRig()
      : loop(
            2,
            {config("pose0", "cartesian_impedance", {0}), config("joint0", "joint_impedance", {0}),
             config("pose1", "cartesian_impedance", {1}), config("both", "dual_cartesian_impedance", {0, 1})},
            Registry::with_builtins(), 4096),
        board(2) {}

  LiveWorld world() {
    return {.scene = "rig",
            .modes = &loop.modes(),
            .backend = &loop.world,
            .board = &board,
            .models = loop.models};
  }

  // Steps, and hands the records on as the relay of a run does.
  void steps(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      loop.step();
      RecordRing& ring = *loop.cycle.record();
      for (; const Event* event = ring.events.front(); ring.events.pop()) board.take(*event);
      for (; const CycleRecord* record = ring.ring.front(); ring.ring.pop()) board.take(*record);
    }
  }

  TestLoop loop;
  StateBoard board;
};

// Steps a rig for as long as it lives.
class Stepping {
 public:
  explicit Stepping(LiveRig& rig)
      : thread_([&rig](const std::stop_token& stop) {
          while (!stop.stop_requested()) {
            rig.steps(1);
            std::this_thread::yield();
          }
        }) {}

 private:
  std::jthread thread_;
};

}  // namespace multipanda::test
