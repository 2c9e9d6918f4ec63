#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "runtime/error_report.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// Follows the records of a run and explains new errors of arms. For the thread that takes the
// records, never on the loop's.
class ReflexWatch {
 public:
  static constexpr std::size_t kCycles = 50;  // number of stored and written cycles

  // One element of `limits` per arm. `folder`: folder of the run; empty: a new temporary folder, created with
  // the first table.
  ReflexWatch(RecordLayout layout, std::vector<ArmErrorLimits> limits, std::filesystem::path folder);

  void take(const Event& event);  // handles changes of frames and loads
  // Reports on arms whose errors begin with this record.
  std::vector<ReflexReport> take(const CycleRecord& record);

 private:
  ReflexReport report(std::size_t arm, std::uint64_t errors);
  std::vector<ArmCycle> history(std::size_t arm) const;  // oldest first
  void write(ReflexReport& report, std::size_t arm, const std::vector<ArmCycle>& cycles);

  const RecordLayout layout_;
  std::vector<ArmErrorLimits> limits_;
  std::filesystem::path folder_;
  std::vector<ArmCycle> ring_;  // kCycles per arm
  std::size_t taken_ = 0;
  std::vector<std::uint64_t> errors_;  // errors already reported
  std::size_t files_ = 0;
};

// Limits of each arm from the scene; for simulated arms also those of the simulation.
std::vector<ArmErrorLimits> error_limits(const Scene& scene,
                                         const std::vector<std::shared_ptr<const ArmModel>>& models,
                                         const std::vector<bool>& simulated);

// The cycles as a table: one line per cycle, SI units in column names.
std::string to_csv(const std::vector<ArmCycle>& cycles, std::size_t joint_count);

}  // namespace multipanda
