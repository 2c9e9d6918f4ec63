#include "benchmarks/soak/soak.hpp"

#include <array>
#include <cmath>
#include <fstream>
#include <iterator>
#include <malloc.h>
#include <stdexcept>
#include <unistd.h>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "benchmarks/soak/fault_storm.hpp"
#include "benchmarks/soak/invariants.hpp"
#include "fci/simulated_time/simulated_run.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

constexpr double kSampleEvery = 60;  // [s]
// The first minute fills caches and queues, so heap growth is measured from its end. Pages are mapped
// until every kind of fault has occurred a few times, so resident memory is measured from the end of the
// first quarter.
constexpr double kWarmUp = 60;            // [s]
constexpr double kHeapGrowth_mb = 1;      // allowance for operations in progress
constexpr double kResidentGrowth_mb = 8;  // allowance for the allocator's fluctuation
// Each change of a motion may fall between the two sums.
constexpr double kWorkPerSecond = 1e-3, kWorkPerChange = 0.05;  // [J/s], [J]

double resident_mb() {
  std::ifstream file("/proc/self/statm");
  double pages = 0, resident = 0;
  file >> pages >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1e6;
}

double heap_mb() {
  const struct mallinfo2 info = mallinfo2();
  return static_cast<double>(info.uordblks + info.hblkhd) / 1e6;
}

int open_files() {
  const std::filesystem::directory_iterator files("/proc/self/fd");
  return static_cast<int>(std::distance(begin(files), end(files)));
}

// The motor inertia of real joints slows down the fast modes of a light wrist: plants whose model states no
// motor inertia get the one assumed for real arms.
Scene with_motors(Scene scene) {
  for (SceneArm& arm : scene.arms) {
    RobotDescription plant = plant_robot_of(arm);
    if (plant.motor_inertia.size() > 0) continue;
    plant.motor_inertia = joint_constant(plant.joint_count(), kAssumedMotorInertia);
    arm.plant_robot = std::make_shared<const RobotDescription>(std::move(plant));
  }
  return scene;
}

// A run with all of its checks.
class Soak {
 public:
  Soak(const Scene& scene, const SoakOptions& options)
      : options_(options),
        run_(scene, {.time = {.seed = options.seed}}),
        disk_(options.folder, run_.layout()),
        storm_(run_, start_set(scene, run_.modes()), options.seed, options.mean_interval_s,
               [this](Fault fault, double lasts_s) {
                 disk_.begin(run_.time_s(), fault == Fault::full_disk, lasts_s);
               }),
        invariants_(run_.layout(), bounds(run_)),
        work_(scene.arms.size()),
        counts_(scene.arms.size()),
        last_sequence_(scene.arms.size(), 0),
        changes_(scene.arms.size(), 0),
        was_usable_(scene.arms.size(), false) {
    result_.scene = scene.name;
    result_.options = options;
  }

  SoakResult run() {
    run_.after_cycle = [this](const CycleRecord& cycle) { check(cycle); };
    run_.on_event = [this](const Event& event) {
      if (event.kind == EventKind::switched) ++result_.switches;
      invariants_.check(event, storm_.disturbed());
    };
    const HostTime begun = host_now();
    run_.begin();
    run_.world().every(kArmPeriodNs.count(), {}, {}, [this](std::int64_t) { book_arms(); });
    double next_sample_s = kSampleEvery;
    while (run_.step() && run_.time_s() < options_.duration_s) {
      storm_.step();
      // A log that is being written has its own file and memory.
      if (run_.time_s() < next_sample_s || disk_.is_writing()) continue;
      next_sample_s += kSampleEvery;
      sample();
      if (options_.progress) options_.progress(run_.time_s());
    }
    storm_.finish();
    if (run_.time_s() < options_.duration_s) invariants_.report(run_.time_s(), "the run ended early");
    if (!disk_.is_writing()) sample();
    close_books();
    run_.end();
    result_.real_s = seconds(host_now() - begun);
    return finish();
  }

 private:
  static std::vector<Invariants::ArmBounds> bounds(fci::SimulatedRun& run) {
    std::vector<Invariants::ArmBounds> all;
    for (ArmIndex i = 0; i < run.modes().arm_count(); ++i) {
      const ArmLimits& limits = run.cycle().safety().limits(i).joints;
      all.push_back({limits.tau_max, limits.tau_rate_max});
    }
    return all;
  }

  void book_arms() {
    for (ArmIndex i = 0; i < work_.size(); ++i) {
      const SimulatedArm& arm = run_.world().arm(i);
      work_[i].arm_period(arm.state().q, arm.torque_in_use());
    }
  }

  void check(const CycleRecord& cycle) {
    const CycleData& data = run_.data();
    for (ArmIndex i = 0; i < work_.size(); ++i) {
      const fci::ArmCounts& account = run_.world().counts(i);
      counts_[i] = {account.periods_missed, account.motions_ended, account.torque_rate_max,
                    run_.world().arm(i).reflex_detail()};
      const ArmState& state = data.state[i];
      if (!state.fresh) continue;
      const bool usable = state.mode == ArmMode::move;
      if (usable != was_usable_[i]) ++changes_[i];
      work_[i].state(state.q, state.tau_J_d, state.sequence == last_sequence_[i] + 1,
                     usable && was_usable_[i]);
      last_sequence_[i] = state.sequence;
      was_usable_[i] = usable;
    }
    invariants_.check(cycle, run_.modes().active(), counts_, storm_.disturbed());
    disk_.take(cycle);
    for (const std::string& finding : disk_.take_findings()) invariants_.report(cycle.t.seconds(), finding);
  }

  void sample() {
    SoakSample now{.time_s = run_.time_s(),
                   .resident_mb = resident_mb(),
                   .heap_mb = heap_mb(),
                   .open_files = open_files(),
                   .work_difference_j = {}};
    for (const WorkBalance& work : work_) now.work_difference_j.push_back(work.difference());
    if (!result_.samples.empty() && now.time_s > kWarmUp) {
      const SoakSample& first = result_.samples.front();
      if (now.heap_mb > first.heap_mb + kHeapGrowth_mb)
        invariants_.report(now.time_s, fmt::format("allocated memory grew from {:.2f} to {:.2f} MB",
                                                   first.heap_mb, now.heap_mb));
      if (now.time_s > options_.duration_s / 4) {
        if (resident_mb_ == 0) resident_mb_ = now.resident_mb;
        if (now.resident_mb > resident_mb_ + kResidentGrowth_mb)
          invariants_.report(now.time_s, fmt::format("resident memory grew from {:.1f} to {:.1f} MB",
                                                     resident_mb_, now.resident_mb));
      }
      if (now.open_files != first.open_files)
        invariants_.report(now.time_s, fmt::format("{} files are open, {} were open before", now.open_files,
                                                   first.open_files));
    }
    result_.samples.push_back(std::move(now));
  }

  void close_books() {
    for (ArmIndex i = 0; i < work_.size(); ++i) {
      const double bound = kWorkPerSecond * run_.time_s() + kWorkPerChange * changes_[i] + work_[i].unseen();
      if (!(std::abs(work_[i].difference()) <= bound))
        invariants_.report(run_.time_s(), fmt::format("{}: work is {:.4f} J according to the program, {:.4f} "
                                                      "J according to the arm; allowed difference {:.4f} J",
                                                      run_.layout().arms[i].name, work_[i].of_program(),
                                                      work_[i].of_arm(), bound));
    }
  }

  SoakResult finish() {
    result_.simulated_s = run_.time_s();
    result_.cycles = invariants_.cycles();
    result_.requests = storm_.requests();
    result_.recoveries = storm_.recoveries();
    result_.records_written = disk_.written();
    result_.records_lost = disk_.lost();
    for (ArmIndex i = 0; i < work_.size(); ++i) {
      const fci::ArmCounts& account = run_.world().counts(i);
      result_.arms.push_back({.name = run_.layout().arms[i].name,
                              .periods = account.states_sent,
                              .periods_missed = account.periods_missed,
                              .motions_ended = account.motions_ended,
                              .longest_miss = account.longest_miss,
                              .torque_rate_max = account.torque_rate_max,
                              .work_j = work_[i].of_arm(),
                              .work_difference_j = work_[i].difference(),
                              .work_unseen_j = work_[i].unseen()});
    }
    result_.faults = storm_.injected();
    result_.violation_count = invariants_.count();
    result_.violations = invariants_.violations();
    return std::move(result_);
  }

  SoakOptions options_;
  SoakResult result_;
  fci::SimulatedRun run_;
  DiskTrouble disk_;
  FaultStorm storm_;
  Invariants invariants_;
  std::vector<WorkBalance> work_;
  std::vector<Invariants::ArmCount> counts_;
  std::vector<std::uint64_t> last_sequence_;
  std::vector<int> changes_;  // of the arms' motions: starts and ends
  std::vector<bool> was_usable_;
  double resident_mb_ = 0;  // at the end of the first quarter
};

}  // namespace

SoakResult soak(const Scene& scene, const SoakOptions& options) {
  return Soak(options.bare_joints ? scene : with_motors(scene), options).run();
}

void write_result(const SoakResult& result, const std::filesystem::path& folder) {
  using Json = nlohmann::ordered_json;
  Json arms = Json::array(), faults = Json::object(), samples = Json::array(), violations = Json::array();
  for (const SoakArm& arm : result.arms)
    arms.push_back({{"name", arm.name},
                    {"periods", arm.periods},
                    {"periods_missed", arm.periods_missed},
                    {"longest_miss", arm.longest_miss},
                    {"motions_ended", arm.motions_ended},
                    {"torque_rate_max_nm_per_s", arm.torque_rate_max},
                    {"work_j", arm.work_j},
                    {"work_difference_j", arm.work_difference_j},
                    {"work_unseen_j", arm.work_unseen_j}});
  for (std::size_t i = 0; i < static_cast<std::size_t>(Fault::count_); ++i)
    faults[std::string(name_of(static_cast<Fault>(i)))] = Json::array();
  for (const InjectedFault& fault : result.faults)
    faults[std::string(name_of(fault.fault))].push_back(fault.at_s);
  for (const SoakSample& sample : result.samples)
    samples.push_back({{"time_s", sample.time_s},
                       {"resident_mb", sample.resident_mb},
                       {"heap_mb", sample.heap_mb},
                       {"open_files", sample.open_files},
                       {"work_difference_j", sample.work_difference_j}});
  for (const BrokenInvariant& violation : result.violations)
    violations.push_back({{"at_s", violation.at_s}, {"what", violation.what}});
  const Json all{{"scene", result.scene},
                 {"seed", result.options.seed},
                 {"bare_joints", result.options.bare_joints},
                 {"simulated_s", result.simulated_s},
                 {"real_s", result.real_s},
                 {"cycles", result.cycles},
                 {"switches", result.switches},
                 {"requests", result.requests},
                 {"recoveries", result.recoveries},
                 {"records_written", result.records_written},
                 {"records_lost", result.records_lost},
                 {"passed", result.passed()},
                 {"violation_count", result.violation_count},
                 {"violations", violations},
                 {"arms", arms},
                 {"faults", faults},
                 {"samples", samples}};
  const std::filesystem::path file = folder / "soak.json";
  std::ofstream out(file);
  out << all.dump(1) << '\n';
  out.close();
  if (!out) throw std::runtime_error("cannot write " + file.string());
}

}  // namespace multipanda
