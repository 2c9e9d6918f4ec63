#include <algorithm>
#include <filesystem>
#include <thread>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/process.hpp"
#include "core/rt/pacer.hpp"
#include "doctor/examination.hpp"

namespace multipanda::doctor {

TimerReading read_timer(double seconds) {
  TimerReading reading;
  const auto count = static_cast<std::size_t>(std::max(1.0, seconds * 1000));
  reading.late_us.reserve(count);
  std::thread([&] {
    ThreadSetup setup;
    setup.lock_memory = false;  // concerns the whole process and is requested elsewhere
    reading.setup = set_up_thread(setup);
    Pacer pacer;
    pacer.start();
    for (std::size_t periods = 0; periods < count;) {
      const std::uint64_t before = pacer.overruns();
      pacer.wait();
      const std::uint64_t missed = pacer.overruns() - before;
      reading.late_us.push_back(static_cast<double>(pacer.lateness().count()) * 1e-3);
      reading.missed += missed;
      reading.missed_in_row = std::max(reading.missed_in_row, missed);
      periods += 1 + missed;
    }
  }).join();
  return reading;
}

Finding judge_timer(const TimerReading& reading, Purpose purpose) {
  Finding finding{.id = "timer_wake_up", .subject = "timer wake-up at 1 kHz"};
  if (reading.late_us.empty()) {
    finding.measured = "not measured";
    return finding;
  }
  const Distribution late = distribution_of(reading.late_us);
  const double too_late = share_above(reading.late_us, kAnswerLimit_us);
  finding.measured = fmt::format("late by {}; {} of {} periods missed", late.text(), reading.missed,
                                 late.count + reading.missed);
  finding.show(late);
  finding.figures.push_back({"missed", reading.missed, "periods"});
  finding.figures.push_back({"missed_in_row", reading.missed_in_row, "periods"});
  finding.figures.push_back({"later_than_limit", 100 * too_late, "%"});
  if (too_late == 0 && reading.missed == 0) return finding.as(Judgment::ok);
  // An arm tolerates single losses by repeating the last torque. Many losses, or many in a row, stop it.
  const bool stops = reading.missed_in_row >= kLostInRowLimit || too_late > 0.01;
  return finding.as(
      stops ? defect(purpose) : Judgment::warning,
      fmt::format(
          "{:.2g} % of the wake-ups were later than {:g} us, after which a torque misses its period{}",
          100 * too_late, kAnswerLimit_us,
          reading.missed_in_row >= kLostInRowLimit
              ? fmt::format("; {} in a row were missed, and an arm stops after {}", reading.missed_in_row,
                            kLostInRowLimit)
              : std::string()),
      "fix the lines above that are not ok (kernel, SCHED_FIFO, governor, load) and measure again after "
      "each");
}

ControlCycleReading parse_control_cycle(const std::string& json) {
  try {
    const auto object = nlohmann::json::parse(json);
    ControlCycleReading reading;
    reading.scene = object.at("scene").get<std::string>();
    reading.reason = object.value("reason", "");
    if (!reading.reason.empty()) return reading;
    reading.cycles = object.at("cycles").get<std::uint64_t>();
    reading.p50 = object.at("p50_us").get<double>();
    reading.p99 = object.at("p99_us").get<double>();
    reading.p999 = object.at("p999_us").get<double>();
    reading.worst = object.at("worst_us").get<double>();
    reading.guarded = object.at("guarded").get<bool>();
    reading.memory_locked = object.at("memory_locked").get<bool>();
    reading.heap_calls = object.at("heap_calls").get<std::uint64_t>();
    reading.lock_calls = object.at("lock_calls").get<std::uint64_t>();
    reading.page_faults = object.at("page_faults").get<std::uint64_t>();
    reading.interruptions = object.at("interruptions").get<std::uint64_t>();
    return reading;
  } catch (const nlohmann::json::exception& error) {
    throw std::runtime_error(
        fmt::format("the measuring program did not answer as expected: {}", error.what()));
  }
}

ControlCycleReading read_control_cycle(const std::string& scene, std::uint64_t cycles) {
  ControlCycleReading reading;
  reading.scene = scene;
  try {
    const auto self = std::filesystem::read_symlink("/proc/self/exe");
    const ProgramResult probe =
        run_program(self.parent_path() / "multipanda_cycle_probe", {scene, std::to_string(cycles)});
    reading.reason = probe.reason;
    return probe.reason.empty() ? parse_control_cycle(probe.output) : reading;
  } catch (const std::exception& error) {
    reading.reason = error.what();
  }
  return reading;
}

Finding judge_control_cycle(const ControlCycleReading& reading, Purpose purpose) {
  Finding finding{.id = "control_cycle", .subject = "control cycle"};
  if (!reading.reason.empty()) {
    finding.measured = fmt::format("scene {} was not measured", reading.scene);
    return finding.because(
        reading.reason,
        "run 'multipanda check SCENE' to see what is wrong, or choose another scene with --scene");
  }
  finding.measured = fmt::format(
      "scene {}: p50 {:.1f}, p99 {:.1f}, p99.9 {:.1f}, worst {:.1f} us of {:g} ({} cycles)", reading.scene,
      reading.p50, reading.p99, reading.p999, reading.worst, kPeriod_us, reading.cycles);
  finding.figures = {{"cycles", reading.cycles, ""},
                     {"p50", reading.p50, "us"},
                     {"p99", reading.p99, "us"},
                     {"p999", reading.p999, "us"},
                     {"worst", reading.worst, "us"},
                     {"budget", kPeriod_us, "us"},
                     {"interruptions", reading.interruptions, ""}};
  if (reading.p999 <= kAnswerLimit_us) return finding.as(Judgment::ok);
  // The median is the cost of the controllers; the tail of an interrupted thread is caused by the computer.
  const bool own = reading.p50 > kAnswerLimit_us / 2;
  return finding.as(
      reading.p999 > kPeriod_us && own ? defect(purpose) : Judgment::warning,
      own ? fmt::format("the controllets and features of this scene need {:.0f} us; an arm waits "
                        "about {:g} us for its torque",
                        reading.p50, kAnswerLimit_us)
          : fmt::format("the median cycle is fast but a few are slow: the thread was interrupted {} times",
                        reading.interruptions),
      own ? "switch features off one by one to find the costly one (collision_avoidance is the "
            "first to try); 'multipanda bench' measures the cost of each"
          : "see load, SCHED_FIFO and kernel above");
}

Finding judge_loop_guard(const ControlCycleReading& reading, Purpose purpose) {
  Finding finding{.id = "loop_guard", .subject = "loop guard"};
  if (!reading.reason.empty()) {
    finding.measured = "not counted";
    return finding.because(reading.reason);
  }
  finding.measured =
      reading.guarded
          ? fmt::format("{} heap calls, {} locks, {} page faults in {} cycles", reading.heap_calls,
                        reading.lock_calls, reading.page_faults, reading.cycles)
          : fmt::format("{} page faults in {} cycles", reading.page_faults, reading.cycles);
  if (reading.guarded) {
    finding.figures = {{"heap_calls", reading.heap_calls, ""}, {"lock_calls", reading.lock_calls, ""}};
  }
  finding.figures.push_back({"page_faults", reading.page_faults, ""});
  if (reading.heap_calls > 0 || reading.lock_calls > 0)
    return finding.as(
        defect(purpose),
        "a controllet or feature of the scene allocates or locks in its update() and may wait for any "
        "other thread",
        "move allocations into the constructor or start(); docs/writing_a_controllet.md shows how to test "
        "it");
  if (reading.page_faults > 0)
    return finding.as(reading.memory_locked ? Judgment::warning : Judgment::unknown,
                      reading.memory_locked ? "memory is touched for the first time in the loop"
                                            : "memory could not be locked, so pages may be swapped out",
                      reading.memory_locked ? "let the controllet touch its memory in start()"
                                            : "fix the line 'permission to lock memory' first");
  if (!reading.guarded)
    return finding.because("heap calls and locks are not counted in this build (sanitizers replace malloc)");
  return finding.as(Judgment::ok);
}

}  // namespace multipanda::doctor
