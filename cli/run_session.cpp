#include "cli/run_session.hpp"

#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cli/key_watch.hpp"
#include "cli/live_table.hpp"

namespace multipanda::cli {

StopSignals::StopSignals(const Console& console) : console_(console) {
  watch_.emplace([this](int) { stop(); });
}

void StopSignals::attach(Session& session) {
  const std::lock_guard lock(mutex_);
  session_ = &session;
  if (requested_) session.stop();
}

void StopSignals::end() { watch_.reset(); }

void StopSignals::stop() {
  const std::lock_guard lock(mutex_);
  requested_ = true;
  if (session_ != nullptr) session_->stop();
  if (!console_.is_terminal()) {
    console_.line("stopping: the arms hold, then the run ends (interrupt again to quit at once)");
  }
}

namespace {

// Space stops all arms, a digit the arm of that number; r ends the stop. Controllets that ran before stay
// inactive until they are requested.
void handle_key(char key, Session& session) {
  MultimodeController& modes = session.modes();
  const ArmSet all = ArmSet::all(modes.arm_count());
  if (key == ' ' || key == 's') modes.stop(all);
  if (key >= '1' && key <= '9') {
    const auto arm = static_cast<ArmIndex>(key - '1');
    if (all.contains(arm)) modes.stop(ArmSet::of(arm));
  }
  if (key == 'r') {
    const Request resume{.kind = Request::Kind::resume, .arms = all};
    std::uint64_t ticket = 0;
    (void)modes.post(std::span(&resume, 1), ticket);
  }
}

}  // namespace

RunSummary run_session(Session& session, StopSignals& signals, const Console& console) {
  for (const auto& arm : session.scene().arms) {
    for (const auto& text : arm.loosened) {
      console.line(fmt::format("arm '{}': looser than the manufacturer's limit: {}", arm.name, text));
    }
    if (!arm.unguarded.empty()) {
      console.line(fmt::format("arm '{}': collision shapes that are not kept apart: {}", arm.name,
                               fmt::join(arm.unguarded, ", ")));
    }
    if (arm.fci && arm.fci->rate_limit) {
      console.line(fmt::format(
          "arm '{}': 'fci: rate_limit' has no effect, the torque's rate is always limited; remove "
          "the key, the next release refuses it",
          arm.name));
    }
  }
  for (const auto& text : session.scene().lifted) {
    console.line(fmt::format("contact bound lifted by the scene: {}", text));
  }
  for (const auto& text : session.scene().unsafer_laws) {
    console.line(fmt::format("law without all safeguards: {}", text));
  }
  for (const auto& text : session.scene().lowered) console.line(text);
  for (const auto& text : session.scene().near_leaders) console.line(text);
  signals.attach(session);
  LiveDisplay display(console, session.scene().name, session.duration_s());
  session.start();
  const KeyWatch keys([&](char key) { handle_key(key, session); });
  if (keys.active())
    console.line("keys: space stops all arms (hold), 1-9 one arm, r resumes, Ctrl-C ends the run");
  while (!session.wait_for_end(LiveDisplay::kPeriod_s)) display.show(session.status());
  RunSummary summary = session.finish();
  signals.end();
  display.finish(session.status());
  return summary;
}

void print_switches(const RunSummary& summary, const Console& console) {
  for (const auto& s : summary.switches) {
    std::string steps;
    for (const auto& step : s.steps) {
      steps += fmt::format("{}{} {:.3f}", steps.empty() ? "" : ", ", step.arm, step.sent_nm);
      if (step.requested_nm > step.sent_nm + 1e-9)
        steps += fmt::format(" (requested {:.3f})", step.requested_nm);
    }
    console.line(fmt::format("  {:8.3f} s  {}", s.t.seconds(), describe(s)));
    if (!s.steps.empty()) {
      console.line(fmt::format("             cycle {}, first torque after {:.1f} us; torque step [N m]: {}",
                               s.cycle, s.computing_us, steps));
    } else if (s.accepted()) {
      console.line(fmt::format("             held in the same cycle {} ({})", s.cycle, s.cause));
    }
  }
}

void print_summary(const RunSummary& summary, const Console& console) {
  console.line(fmt::format(
      "{}: {} cycles, {:.3f} s of loop time in {:.3f} s ({:.1f} Hz, {:.1f} x real time), {} overruns",
      summary.scene, summary.cycles, summary.time_s, summary.elapsed_s, summary.rate_hz(),
      summary.elapsed_s > 0 ? summary.time_s / summary.elapsed_s : 0, summary.overruns));
  console.line(fmt::format("cycle [us]: p50 {:.1f}  p99 {:.1f}  p99.9 {:.1f}  max {:.1f}",
                           summary.cycle_us.median, summary.cycle_us.p99, summary.cycle_us.p999,
                           summary.cycle_us.worst));
  for (const auto& c : summary.connections) {
    console.line(fmt::format("arm {}: packets: {} received, {} lost, {} late; commands missed: {}", c.arm,
                             c.packets.received, c.packets.lost, c.packets.superseded, c.commands_missed));
  }
  std::string thread = "thread:";
  for (const auto& step : summary.thread) {
    thread += fmt::format(" {} {};", step.what,
                          step.done ? std::string("done") : fmt::format("not done ({})", step.reason));
  }
  if (!summary.paced) thread += " no SCHED_FIFO because unpaced;";
  thread.pop_back();
  console.line(thread);
  console.line(summary.switches.empty() ? "switches: none" : "switches:");
  print_switches(summary, console);
  for (const auto& i : summary.interventions) {
    console.line(fmt::format("intervention: {}: {} in {} cycle{}, {} episode{}{}", i.arm, to_string(i.rule),
                             i.count, i.count == 1 ? "" : "s", i.episodes, i.episodes == 1 ? "" : "s",
                             i.controllet.empty() ? "" : fmt::format(" ({})", i.controllet)));
  }
  for (const auto& reflex : summary.reflexes) {
    for (const auto& line : reflex.lines()) console.line(line);
  }
  if (summary.records_lost > 0) console.line(fmt::format("records lost: {}", summary.records_lost));
  if (!summary.log.empty()) console.line("log: " + summary.log.string());
}

}  // namespace multipanda::cli
