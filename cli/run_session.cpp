#include "cli/run_session.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <functional>
#include <poll.h>
#include <sys/eventfd.h>
#include <system_error>
#include <termios.h>
#include <thread>
#include <unistd.h>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cli/live_table.hpp"
#include "core/types/gap_watch.hpp"
#include "runtime/softened_laws.hpp"

namespace multipanda::cli {

namespace {

// Single keys from the terminal, without Enter, on a separate thread: the stop key must not wait for drawing.
// Does nothing if the input is not a terminal. Ctrl-C and similar keys still raise their signals; the
// terminal is restored afterwards.
class KeyWatch {
 public:
  // `late`: perhaps pressed before this program stalled (GapWatch).
  using OnKey = std::function<void(char key, bool late)>;
  explicit KeyWatch(OnKey on_key);
  ~KeyWatch();
  KeyWatch(const KeyWatch&) = delete;

  bool active() const { return thread_.joinable(); }

 private:
  bool take_single_keys();
  void watch();

  OnKey on_key_;
  termios before_{};
  int end_file_ = -1;
  GapWatch gaps_;  // the thread's
  std::thread thread_;
};

KeyWatch::KeyWatch(OnKey on_key) : on_key_(std::move(on_key)) {
  // A background process must not change the terminal: it would be suspended.
  if (isatty(STDIN_FILENO) == 0 || tcgetpgrp(STDIN_FILENO) != getpgrp()) return;
  if (tcgetattr(STDIN_FILENO, &before_) != 0) return;
  end_file_ = eventfd(0, EFD_CLOEXEC);
  if (end_file_ < 0) return;
  if (!take_single_keys()) return;
  (void)gaps_.look();
  thread_ = std::thread([this] { watch(); });
}

KeyWatch::~KeyWatch() {
  if (thread_.joinable()) {
    const std::uint64_t one = 1;
    (void)!write(end_file_, &one, sizeof(one));
    thread_.join();
    tcsetattr(STDIN_FILENO, TCSANOW, &before_);
  }
  if (end_file_ >= 0) close(end_file_);
}

// Without waiting for the end of a line. A shell gives its own settings back after Ctrl-Z and `fg`.
bool KeyWatch::take_single_keys() {
  termios keys{};
  if (tcgetattr(STDIN_FILENO, &keys) != 0) return false;
  constexpr tcflag_t kLines = ICANON | ECHO;
  if ((keys.c_lflag & kLines) == 0) return true;
  keys.c_lflag &= ~kLines;
  return tcsetattr(STDIN_FILENO, TCSANOW, &keys) == 0;
}

void KeyWatch::watch() {
  constexpr int kSliceMs = 100;
  while (true) {
    // In the background, after Ctrl-Z and `bg`, keys are the shell's: to read them would stop this program.
    const bool foreground = tcgetpgrp(STDIN_FILENO) == getpgrp();
    if (foreground) (void)take_single_keys();
    pollfd files[2] = {{end_file_, POLLIN, 0}, {STDIN_FILENO, POLLIN, 0}};
    const int count = poll(files, foreground ? 2 : 1, kSliceMs);
    (void)gaps_.look();
    if (count <= 0) continue;
    if (files[0].revents != 0) return;
    char key = 0;
    if (read(STDIN_FILENO, &key, 1) != 1) return;  // the terminal was closed
    on_key_(key, gaps_.settles());
  }
}

}  // namespace

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
    console_.line("stopping: the arms hold, then the run ends (interrupt again after 2 s to quit at once)");
  }
}

namespace {

// Space stops all arms, a digit the arm of that number; r ends the stop. Controllets that ran before stay
// inactive until they are requested.
void handle_key(char key, bool late, Session& session) {
  MultimodeController& modes = session.modes();
  const ArmSet all = ArmSet::all(modes.arm_count());
  if (key == ' ' || key == 's') modes.stop(all);
  if (key >= '1' && key <= '9') {
    const auto arm = static_cast<ArmIndex>(key - '1');
    if (all.contains(arm)) modes.stop(ArmSet::of(arm));
  }
  if (key == 'r' && !late) {
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
      console.line(fmt::format("arm '{}': collision shapes that are not checked: {}", arm.name,
                               fmt::join(arm.unguarded, ", ")));
    }
    if (!arm.left_out_friction.empty()) {
      console.line(fmt::format("arm '{}': the URDF's friction is not simulated: {}", arm.name,
                               fmt::join(arm.left_out_friction, ", ")));
    }
  }
  for (const auto& text : session.scene().lifted) {
    console.line(fmt::format("contact bound raised by the scene: {}", text));
  }
  for (const auto& text : session.scene().unsafer_laws) {
    console.line(fmt::format("law with reduced safeguards: {}", text));
  }
  for (const auto& text : session.scene().lowered) console.line(text);
  for (const auto& text : session.scene().near_leaders) console.line(text);
  for (const auto& text : softened_laws(session.scene(), session.registry()))
    console.line("warning: " + text);
  signals.attach(session);
  LiveDisplay display(console, session.scene().name, session.duration_s());
  session.start();
  const KeyWatch keys([&](char key, bool late) { handle_key(key, late, session); });
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

InputEndWatch::InputEndWatch(std::function<void()> on_end) : on_end_(std::move(on_end)) {
  end_file_ = eventfd(0, EFD_CLOEXEC);
  if (end_file_ < 0) throw std::system_error(errno, std::generic_category(), "eventfd");
  thread_ = std::thread([this] { watch(); });
}

InputEndWatch::~InputEndWatch() {
  const std::uint64_t one = 1;
  (void)!write(end_file_, &one, sizeof(one));
  thread_.join();
  close(end_file_);
}

void InputEndWatch::watch() {
  for (;;) {
    pollfd files[2] = {{STDIN_FILENO, POLLIN, 0}, {end_file_, POLLIN, 0}};
    if (poll(files, 2, -1) < 0) continue;
    if (files[1].revents != 0) return;
    char discarded[256];
    const ssize_t size = read(STDIN_FILENO, discarded, sizeof(discarded));
    if (size > 0 || (size < 0 && (errno == EINTR || errno == EAGAIN))) continue;
    on_end_();
    return;
  }
}

}  // namespace multipanda::cli
