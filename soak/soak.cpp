#include "soak/soak.hpp"

#include <cmath>
#include <fstream>
#include <iterator>
#include <malloc.h>
#include <unistd.h>

#include <fmt/format.h>

#include "fci/simulated_time/simulated_run.hpp"
#include "scene/build.hpp"
#include "soak/disk_trouble.hpp"
#include "soak/fault_storm.hpp"
#include "soak/work_book.hpp"

namespace multipanda {
namespace {

constexpr double kSampleEvery = 60;  // [s]
// The first minute fills caches and queues: the heap is compared with its end. Pages are touched for the
// first time until every kind of fault has come a few times: resident memory is compared with the end of the
// first quarter.
constexpr double kWarmUp = 60;            // [s]
constexpr double kHeapGrowth_mb = 1;      // what happens to be under way
constexpr double kResidentGrowth_mb = 8;  // the allocator's own fluctuation
// Each change of a motion may fall between the two books.
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

// Real joints turn their motors along, which slows down a light wrist's fast modes: plants whose model states
// no motors get what is assumed of real arms.
Scene with_motors(Scene scene) {
  for (SceneArm& arm : scene.arms) {
    RobotDescription plant = plant_robot_of(arm);
    if (plant.motor_inertia.size() > 0) continue;
    plant.motor_inertia = joint_constant(plant.joint_count(), kAssumedMotorInertia);
    arm.plant_robot = std::make_shared<const RobotDescription>(std::move(plant));
  }
  return scene;
}

// A run with everything that watches it.
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
        books_(scene.arms.size()),
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
    if (run_.time_s() < options_.duration_s)
      invariants_.report(run_.time_s(), "the run ended before its time");
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
    for (ArmIndex i = 0; i < books_.size(); ++i) {
      const SimulatedArm& arm = run_.world().arm(i);
      books_[i].arm_period(arm.state().q, arm.torque_in_use());
    }
  }

  void check(const CycleRecord& cycle) {
    const CycleData& data = run_.data();
    for (ArmIndex i = 0; i < books_.size(); ++i) {
      const fci::ArmAccount& account = run_.world().account(i);
      counts_[i] = {account.periods_missed, account.motions_ended, account.torque_rate_max,
                    run_.world().arm(i).reflex_detail()};
      const ArmState& state = data.state[i];
      if (!state.fresh) continue;
      const bool usable = state.mode == ArmMode::move;
      if (usable != was_usable_[i]) ++changes_[i];
      books_[i].state(state.q, state.tau_J_d, state.sequence == last_sequence_[i] + 1,
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
    for (const WorkBook& book : books_) now.work_difference_j.push_back(book.difference());
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
        invariants_.report(now.time_s,
                           fmt::format("{} files are open, {} were", now.open_files, first.open_files));
    }
    result_.samples.push_back(std::move(now));
  }

  void close_books() {
    for (ArmIndex i = 0; i < books_.size(); ++i) {
      const double bound = kWorkPerSecond * run_.time_s() + kWorkPerChange * changes_[i] + books_[i].unseen();
      if (!(std::abs(books_[i].difference()) <= bound))
        invariants_.report(
            run_.time_s(),
            fmt::format("{}: the program booked {:.4f} J, the arm did {:.4f} J; bound {:.4f} J",
                        run_.layout().arms[i].name, books_[i].of_program(), books_[i].of_arm(), bound));
    }
  }

  SoakResult finish() {
    result_.simulated_s = run_.time_s();
    result_.cycles = invariants_.cycles();
    result_.requests = storm_.requests();
    result_.recoveries = storm_.recoveries();
    result_.records_written = disk_.written();
    result_.records_lost = disk_.lost();
    for (ArmIndex i = 0; i < books_.size(); ++i) {
      const fci::ArmAccount& account = run_.world().account(i);
      result_.arms.push_back({.name = run_.layout().arms[i].name,
                              .periods = account.states_sent,
                              .periods_missed = account.periods_missed,
                              .motions_ended = account.motions_ended,
                              .longest_miss = account.longest_miss,
                              .torque_rate_max = account.torque_rate_max,
                              .work_j = books_[i].of_arm(),
                              .work_difference_j = books_[i].difference(),
                              .work_unseen_j = books_[i].unseen()});
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
  std::vector<WorkBook> books_;
  std::vector<Invariants::ArmCount> counts_;
  std::vector<std::uint64_t> last_sequence_;
  std::vector<int> changes_;  // of the arms' motions: begun or ended
  std::vector<bool> was_usable_;
  double resident_mb_ = 0;  // at the end of the first quarter
};

}  // namespace

SoakResult soak(const Scene& scene, const SoakOptions& options) {
  return Soak(options.bare_joints ? scene : with_motors(scene), options).run();
}

}  // namespace multipanda
