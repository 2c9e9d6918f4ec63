#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <string>
#include <sys/types.h>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "core/types/tick.hpp"

namespace multipanda {

// The cycles of a run as a performance measurement needs them, kept in memory that is there before the run:
// when each step began, how long its stages took, which torque each arm was sent and which one it had in use.
class CommandTrace {
 public:
  struct Options {
    std::size_t lead = 1000;      // cycles left out after it could begin
    std::size_t samples = 30000;  // cycles kept
    // Whose features' outputs are kept. 0xFFFF: nobody's.
    std::uint16_t instance = 0xFFFF;
    bool streaming = false;  // begin only when it follows a stream
  };

  CommandTrace(const RecordLayout& layout, Options options);

  // Loop thread, after each step. Its own cost is two clock readings.
  void step_done(const Tick& tick);
  // Relay thread, every record in order.
  void take(const CycleRecord& record);

  // Any thread.
  bool streaming() const { return streaming_.load(std::memory_order_acquire); }
  bool begun() const { return count_.load(std::memory_order_acquire) > 0; }
  bool full() const { return count_.load(std::memory_order_acquire) >= options_.samples; }
  pid_t loop_thread() const { return loop_thread_.load(std::memory_order_acquire); }

  // After the run: numpy arrays (docs/experiments.md, "controller-performance").
  void write(const std::filesystem::path& npz) const;

  struct Sample {
    std::uint64_t cycle = 0, overruns = 0;
    std::int64_t t_ns = 0, start_ns = 0;
    StageTimes stages;
  };
  struct ArmCycle {
    std::uint64_t sequence = 0;
    double q[kMaxJoints], tau_J[kMaxJoints], tau_J_d[kMaxJoints], tau_cmd[kMaxJoints],
        tau_feature[kMaxJoints];
  };
  std::size_t count() const { return count_.load(std::memory_order_acquire); }
  const Sample& sample(std::size_t i) const { return samples_[i]; }
  const ArmCycle& arm(std::size_t i, std::size_t arm) const { return arms_[i * arm_count() + arm]; }
  std::size_t arm_count() const { return layout_.arms.size(); }
  const RecordLayout& layout() const { return layout_; }

 private:
  struct Column {
    std::string name;
    std::size_t offset = 0;  // in CycleRecord::outputs
  };
  bool begins(const CycleRecord& record);
  double whole_us(const Sample& sample) const;

  const RecordLayout layout_;
  const Options options_;
  std::size_t waited_ = 0;
  std::vector<Sample> samples_;
  std::vector<ArmCycle> arms_;          // [sample][arm]
  std::vector<Column> columns_;         // scalar outputs of features
  std::vector<double> feature_values_;  // [sample][column]
  std::vector<std::int64_t> whole_ns_;  // ring by cycle number; read after the run
  std::atomic<std::size_t> count_{0};
  std::atomic<bool> streaming_{false};
  std::atomic<pid_t> loop_thread_{0};
};

}  // namespace multipanda
