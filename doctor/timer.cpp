#include "doctor/timer.hpp"

#include <algorithm>
#include <thread>

#include <fmt/format.h>

#include "core/rt/pacer.hpp"

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
  finding.figures = late.figures();
  finding.figures.push_back({"missed", static_cast<double>(reading.missed), "periods"});
  finding.figures.push_back({"missed_in_row", static_cast<double>(reading.missed_in_row), "periods"});
  finding.figures.push_back({"later_than_limit", 100 * too_late, "%"});
  finding.histogram = late.bars;
  if (too_late == 0 && reading.missed == 0) {
    finding.judged = Judgment::ok;
    return finding;
  }
  // An arm tolerates single losses by repeating the last torque. Many losses, or many in a row, stop it.
  const bool stops = reading.missed_in_row >= kLostInRowLimit || too_late > 0.01;
  finding.judged = stops ? defect(purpose) : Judgment::warning;
  finding.cause = fmt::format(
      "{:.2g} % of the wake-ups were later than {:g} us, after which a torque misses its "
      "period{}",
      100 * too_late, kAnswerLimit_us,
      reading.missed_in_row >= kLostInRowLimit
          ? fmt::format("; {} in a row were missed, and an arm stops after {}", reading.missed_in_row,
                        kLostInRowLimit)
          : std::string());
  finding.cure =
      "fix the lines above that are not ok (kernel, SCHED_FIFO, governor, load) and measure again after each";
  return finding;
}

}  // namespace multipanda::doctor
