#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <sys/types.h>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "core/types/tick.hpp"

namespace multipanda {

// Records the cycles of a run for a performance measurement, in memory allocated before the run: the start of
// each step, the duration of its stages, and the torque sent to and used by each arm. Cycles after the last
// sample are not recorded, however long the run goes on.
class CommandTrace {
 public:
  struct Options {
    std::size_t lead = 1000;      // cycles skipped at the beginning
    std::size_t samples = 30000;  // cycles kept
    // Instance whose feature outputs are kept. 0xFFFF: none.
    std::uint16_t instance = 0xFFFF;
    bool streaming = false;  // begin once the instance follows a stream
  };

  CommandTrace(const RecordLayout& layout, Options options);

  // Loop thread, after each step. Reads the clock twice.
  void step_done(const Tick& tick);
  // Relay thread, every record in order.
  void take(const CycleRecord& record);

  // Any thread.
  bool streaming() const { return streaming_.load(std::memory_order_acquire); }
  bool started() const { return count_.load(std::memory_order_acquire) > 0; }
  bool full() const { return last_cycle_.load(std::memory_order_acquire) != kNoCycle; }
  pid_t loop_thread() const { return loop_thread_.load(std::memory_order_acquire); }

  // After the last step_done() and take(): writes numpy arrays (docs/experiments.md,
  // "controller-performance") and, unless it is empty, the text `about`. Throws std::runtime_error if the
  // file cannot be written.
  void write(const std::filesystem::path& npz, const std::string& about = {}) const;

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
  static constexpr std::uint64_t kNoCycle = std::numeric_limits<std::uint64_t>::max();
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
  std::atomic<std::uint64_t> last_cycle_{kNoCycle};  // of the last sample, once no further one is taken
  std::atomic<bool> streaming_{false};
  std::atomic<pid_t> loop_thread_{0};
};

}  // namespace multipanda
