#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "arm_interface/arm_error.hpp"
#include "backends/simulated_arm/measured_limits.hpp"
#include "core/cycle/backend.hpp"
#include "core/model/arm_model.hpp"
#include "core/record/cycle_record.hpp"
#include "core/safety/safety.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// Why an arm stopped itself, according to the records.
struct ErrorExplanation {
  ReflexDetail detail;  // of the first error with a figure, limits before contacts; count_: no figure
  std::vector<std::string> sentences;  // per error: event, joint or axis, value and limit
  std::vector<std::string> cures;      // what to do next, per error
  // Periods in these records, as seen by this computer: number, answered share, longest run of misses.
  std::size_t cycles = 0;
  double answered = 0;
  std::uint64_t missed_in_row = 0;
};

// An arm stopped itself in a run.
struct ReflexReport {
  std::string arm;
  double t_s = 0;  // loop time
  std::uint64_t cycle = 0;
  std::uint64_t errors = 0;  // bit i: ArmError i
  ErrorExplanation why;
  std::filesystem::path file;  // table of the last cycles; empty: not written
  std::string file_problem;    // why not

  std::string reason() const;              // "joint_reflex: joint 4 ..."
  std::string headline() const;            // "arm 'left' stopped itself at 2.500 s: joint_reflex"
  std::vector<std::string> lines() const;  // the whole report
};

// One arm's part of a cycle's record.
struct ArmCycle {
  std::uint64_t cycle = 0;
  LoopTime t;
  double period_s = 0;        // since the previous cycle
  std::int32_t total_ns = 0;  // computing time of the whole cycle
  bool others_due = false;    // a packet of another arm had arrived
  ArmSample arm;
};

// Limits of an arm, to explain its errors.
struct ArmErrorLimits {
  std::size_t joint_count = 0;
  MotionLimits motion;
  JointVector tau_max;       // [N m] (n x 1)
  JointVector tau_rate_max;  // [N m/s] (n x 1)
  // Contact thresholds sent to the arm; none: its own, which are unknown.
  std::optional<SetCollisionThresholds> thresholds;
  std::optional<double> power_max;      // [W]; none: not published
  std::optional<double> self_distance;  // smallest distance of two parts of the arm [m]; none: not published
  double velocity_margin = 1;           // factor on the velocity limits that the arm tolerates
  std::shared_ptr<const ArmModel> model;
  ArmFrames frames;
  Load tool, load;
  // Its base moves with another arm, or it carries one; those records are not evaluated: the arm's own
  // estimates may differ from the loop's.
  bool beside_moving_base = false;
};

// Explains errors (bit i: ArmError i) from the arm's last cycles, oldest first. The last cycle is the one in
// which the errors first appeared. The explanation names information missing in the records.
ErrorExplanation explain(std::uint64_t errors, std::span<const ArmCycle> cycles,
                         const ArmErrorLimits& limits);

// How to fix an error, one sentence.
std::string_view cure(ArmError error);

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
  std::filesystem::path folder();  // created if needed; empty: it cannot be. Any thread

 private:
  ReflexReport report(std::size_t arm, std::uint64_t errors);
  std::vector<ArmCycle> history(std::size_t arm) const;  // oldest first
  void write(ReflexReport& report, std::size_t arm, const std::vector<ArmCycle>& cycles);

  const RecordLayout layout_;
  std::vector<ArmErrorLimits> limits_;
  std::mutex folder_mutex_;
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
