#include "doctor/arm_stream.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <poll.h>
#include <thread>

#include <fmt/format.h>

#include "arm_interface/arm_error.hpp"
#include "core/rt/thread_setup.hpp"
#include "doctor/examination.hpp"
#include "doctor/finding.hpp"
#include "fci/client/arm_connection.hpp"
#include "fci/wire/error_flags.hpp"

namespace multipanda::doctor {
namespace {

void listen(fci::ArmConnection& link, double seconds, ArmStreamReading& reading) {
  reading.gaps_us.reserve(static_cast<std::size_t>(seconds * 2000) + 16);
  const HostTime begin = host_now();
  const HostTime end = begin + std::chrono::nanoseconds(static_cast<std::int64_t>(seconds * 1e9));
  std::uint64_t before = 0, outdated = 0;
  HostTime arrived{};
  for (HostTime now = begin; now < end; now = host_now()) {
    pollfd waiting{link.udp_file(), POLLIN, 0};
    const timespec patience{0, 10000000};
    if (ppoll(&waiting, 1, &patience, nullptr) <= 0 || !link.receive()) continue;
    const std::uint64_t id = link.newest().message_id;
    if (before == 0) outdated = link.statistics().superseded;
    if (before != 0) {
      const std::uint64_t lost = id - before - 1;
      reading.lost += lost;
      reading.lost_in_row = std::max(reading.lost_in_row, lost);
      reading.gaps_us.push_back(static_cast<double>((link.received_at() - arrived).count()) * 1e-3);
    }
    ++reading.states;
    before = id;
    arrived = link.received_at();
  }
  reading.seconds = multipanda::seconds(host_now() - begin);
  reading.outdated = std::min(reading.lost, link.statistics().superseded - outdated);
}

constexpr std::uint64_t kWindowFull = 500;  // periods after which the arm's success rate is complete
constexpr double kSilence_s = 1;

double microseconds_between(HostTime from, HostTime to) {
  return static_cast<double>((to - from).count()) * 1e-3;
}

bool is_moving(const fci::RobotState& state) {
  return fci::mode_name(static_cast<std::uint8_t>(state.robot_mode)) == "move";
}

// Runs until the time is over, a stop is requested, or the arm leaves its motion.
void answer_states(fci::ArmConnection& link, const std::function<bool()>& keep_on,
                   CommunicationReading& reading) {
  const auto periods = static_cast<std::uint64_t>(reading.asked_s * 1000);
  fci::RobotCommand command{};  // zero torque
  const std::uint64_t first = link.last_state().message_id;
  std::uint64_t before = first;
  HostTime arrived{};
  while (keep_on()) {
    pollfd waiting{link.udp_file(), POLLIN, 0};
    const timespec patience{static_cast<time_t>(kSilence_s), 0};
    if (ppoll(&waiting, 1, &patience, nullptr) <= 0) {
      reading.ended = fmt::format("no state received for {:g} s", kSilence_s);
      return;
    }
    if (!link.receive()) continue;
    const fci::RobotState& state = link.newest();
    const std::uint64_t lost = state.message_id - before - 1;
    reading.lost += lost;
    reading.lost_in_row = std::max(reading.lost_in_row, lost);
    reading.periods = state.message_id - first;
    before = state.message_id;
    if (!is_moving(state)) {
      reading.errors = error_names(fci::error_bits(state.errors));
      reading.ended =
          fmt::format("the arm stopped itself: {}",
                      reading.errors.empty()
                          ? std::string("mode ") +
                                std::string(fci::mode_name(static_cast<std::uint8_t>(state.robot_mode)))
                          : reading.errors);
      return;
    }
    if (link.send(command)) {
      ++reading.answered;
    } else {
      ++reading.not_sent;
    }
    reading.answer_us.push_back(microseconds_between(link.received_at(), host_now()));
    if (arrived != HostTime{}) reading.cycle_us.push_back(microseconds_between(arrived, link.received_at()));
    arrived = link.received_at();
    if (reading.periods > kWindowFull) {
      reading.success_min = std::min(reading.success_min, state.control_command_success_rate);
      reading.success_sum += state.control_command_success_rate;
      ++reading.success_count;
    }
    if (reading.periods >= periods) return;
  }
  reading.ended = "stopped on request";
}

}  // namespace

ArmStreamReading read_arm_stream(const std::string& address, double seconds) {
  ArmStreamReading reading;
  reading.address = address;
  try {
    fci::ArmConnection link({.address = address});
    link.connect();
    reading.version = link.version();
    std::thread([&] {
      ThreadSetup setup;
      setup.lock_memory = false;
      (void)set_up_thread(setup);
      listen(link, seconds, reading);
    }).join();
    const fci::RobotState& state = link.newest();
    reading.mode = fci::mode_name(static_cast<std::uint8_t>(state.robot_mode));
    reading.errors = error_names(fci::error_bits(state.errors));
    link.close();
  } catch (const std::exception& error) {
    reading.reason = error.what();
  }
  return reading;
}

std::string arms_of_version(int version) {
  switch (version) {
    case 4:
    case 5:
      return "Panda";
    case 6:
    case 7:
    case 8:
    case 9:
      return "Franka Research 3, an older system";
    case 10:
      return "Franka Research 3";
    default:
      return "an arm of another manufacturer or generation";
  }
}

Finding judge_arm_version(const ArmStreamReading& reading, Purpose purpose) {
  Finding finding{.id = "arm_version:" + reading.address, .subject = fmt::format("arm {}", reading.address)};
  if (!reading.reason.empty()) {
    finding.measured = "no connection to its control interface";
    return finding.as(
        Judgment::bad, reading.reason,
        purpose == Purpose::real_arms
            ? "switch on the arm, open its brakes and activate FCI on its web page; end other programs that "
              "are connected to it"
            : "start the virtual arm: multipanda virtual-arm SCENE");
  }
  finding.measured = fmt::format("protocol version {} ({}), this client supports 4 to 10; mode {}{}",
                                 reading.version, arms_of_version(reading.version), reading.mode,
                                 reading.errors.empty() ? "" : ": " + reading.errors);
  finding.figures = {{"version", reading.version, ""}};
  finding.judged = Judgment::ok;
  if (reading.mode != "idle" && reading.mode != "move") {
    finding.judged = Judgment::warning;
    finding.cause = fmt::format("an arm in mode '{}' accepts no torques", reading.mode);
    finding.cure = reading.errors.empty()
                       ? "release the user stop, open the brakes, end hand guiding"
                       : "recover it on its web page, or with multipanda ctl recover during a run";
  }
  return finding;
}

Finding judge_state_stream(const ArmStreamReading& reading, Purpose purpose) {
  Finding finding{.id = "state_stream:" + reading.address,
                  .subject = fmt::format("states of {}", reading.address)};
  if (!reading.reason.empty() || reading.gaps_us.empty()) {
    finding.measured = reading.reason.empty() ? "none received" : "not measured";
    return finding.as(
        reading.reason.empty() ? Judgment::bad : Judgment::unknown,
        reading.reason.empty() ? "the arm accepted the connection, but its packets (UDP) do not arrive"
                               : "there is no connection to the arm",
        reading.reason.empty() ? "allow UDP from the arm in the firewall of this computer" : "");
  }
  const Distribution gaps = distribution_of(reading.gaps_us);
  std::vector<double> off_us;
  for (const double gap : reading.gaps_us) off_us.push_back(std::abs(gap - kPeriod_us));
  const double irregular = share_above(off_us, kAnswerLimit_us);
  const double rate = reading.seconds > 0 ? static_cast<double>(reading.states) / reading.seconds : 0;
  const double sent = static_cast<double>(reading.states + reading.lost);
  const double lost = static_cast<double>(reading.lost) / std::max(1.0, sent);
  finding.measured = fmt::format("{:.0f} Hz, intervals {}; {} of {:.0f} lost, {} in a row", rate, gaps.text(),
                                 reading.lost, sent, reading.lost_in_row);
  finding.show(gaps);
  finding.figures.push_back({"rate", rate, "Hz"});
  finding.figures.push_back({"lost", reading.lost, "packets"});
  finding.figures.push_back({"lost_in_row", reading.lost_in_row, "packets"});
  finding.figures.push_back({"irregular", 100 * irregular, "%"});
  if (sent < 0.9 * 1000 * reading.seconds)
    return finding.as(purpose == Purpose::real_arms ? Judgment::bad : Judgment::unknown,
                      purpose == Purpose::real_arms
                          ? "an arm sends 1000 states per second; this one sent fewer"
                          : "a virtual arm in lock-step, or on a busy computer, sends states at its own pace",
                      purpose == Purpose::real_arms
                          ? "restart the arm's control unit; if that does not help, ask the manufacturer"
                          : "start it with --pace realtime to measure its regularity");
  if (lost > 0.01 || reading.lost_in_row >= kLostInRowLimit || irregular > 0.05) {
    finding.judged = defect(purpose);
  } else if (reading.lost > 0 || irregular > 0.01) {
    finding.judged = Judgment::warning;
  } else {
    return finding.as(Judgment::ok);
  }
  return finding.because(
      fmt::format("{:.2g} % of the states were lost, {:.2g} % came more than {:g} us early or late",
                  100 * lost, 100 * irregular, kAnswerLimit_us),
      "if wake-ups above are late, fix those first; otherwise check cable, switch and card");
}

CommunicationReading run_communication_test(const std::string& address, double seconds,
                                            const std::function<bool()>& keep_on) {
  CommunicationReading reading;
  reading.address = address;
  reading.asked_s = seconds;
  const auto room = static_cast<std::size_t>(seconds * 1000) + 16;
  reading.cycle_us.reserve(room);
  reading.answer_us.reserve(room);
  fci::ArmConnection link({.address = address});
  link.connect();
  reading.version = link.version();
  std::exception_ptr failure;
  // All on one thread: the start waits for states, and a running motion waits for torques.
  std::thread([&] {
    (void)set_up_thread({});
    try {
      link.start_motion({.controller = ArmController::external, .generator = MotionGenerator::none});
      link.wait_until_running();
    } catch (...) {
      failure = std::current_exception();
      return;
    }
    try {
      answer_states(link, keep_on, reading);
      if (reading.errors.empty()) (void)link.finish({});
    } catch (const std::exception& error) {
      if (reading.ended.empty()) reading.ended = error.what();
    }
  }).join();
  if (failure) std::rethrow_exception(failure);
  return reading;
}

std::vector<Finding> judge_communication(const CommunicationReading& reading, Purpose purpose) {
  std::vector<Finding> findings;
  Finding run{.id = "torque_control", .subject = "torque control"};
  run.measured =
      fmt::format("{} of {:.0f} periods with zero torque, protocol version {} ({})", reading.periods,
                  1000 * reading.asked_s, reading.version, arms_of_version(reading.version));
  run.figures = {{"periods", reading.periods, ""},
                 {"answered", reading.answered, ""},
                 {"not_sent", reading.not_sent, ""}};
  run.judged = Judgment::ok;
  if (!reading.ended.empty()) {
    run.judged = Judgment::bad;
    run.measured += "; ended early";
    run.cause = reading.ended;
    const bool late = reading.errors.find("communication_constraints_violation") != std::string::npos;
    run.cure = late
                   ? fmt::format("run 'multipanda doctor {}' and fix what it reports; then recover the arm",
                                 reading.address)
                   : "remove the cause of the error (docs/errors.md), recover the arm and run the test again";
  }
  findings.push_back(run);

  Finding rate{.id = "success_rate", .subject = "success rate"};
  if (reading.success_count == 0) {
    rate.measured = "not measured";
    rate.cause = fmt::format("the test ended before {} periods", kWindowFull);
  } else {
    const double average = reading.success_average();
    rate.measured =
        fmt::format("average {:.4f}, minimum {:.2f} (counted by the arm over its last 100 periods)", average,
                    reading.success_min);
    rate.figures = {{"average", average, ""}, {"minimum", reading.success_min, ""}};
    rate.judged = Judgment::ok;
    if (average < 0.9)
      rate.judged = Judgment::bad;
    else if (average < 0.99 || reading.success_min < 0.9)
      rate.judged = Judgment::warning;
    if (rate.judged != Judgment::ok) {
      rate.cause = "torques did not reach the arm within their period";
      rate.cure = fmt::format(
          "'multipanda doctor {}' shows which part is late: this computer, its network, the connection",
          reading.address);
    }
  }
  findings.push_back(rate);

  Finding lost{.id = "states_lost", .subject = "states lost"};
  lost.measured = fmt::format("{} of {}, at most {} in a row (an arm stops after {} in a row)", reading.lost,
                              reading.periods, reading.lost_in_row, kLostInRowLimit);
  lost.figures = {{"lost", reading.lost, "packets"}, {"lost_in_row", reading.lost_in_row, "packets"}};
  const double share =
      static_cast<double>(reading.lost) / static_cast<double>(std::max<std::uint64_t>(1, reading.periods));
  lost.judged = Judgment::ok;
  if (reading.lost_in_row >= kLostInRowLimit || share > 0.01)
    lost.judged = defect(purpose);
  else if (reading.lost > 0)
    lost.judged = Judgment::warning;
  if (lost.judged != Judgment::ok) {
    lost.cause = "states were lost on the way, or a newer one had arrived before this computer woke";
    lost.cure = fmt::format("see the lines on timer wake-up and round trip of 'multipanda doctor {}'",
                            reading.address);
  }
  findings.push_back(lost);

  const Distribution cycles = distribution_of(reading.cycle_us), answers = distribution_of(reading.answer_us);
  Finding time{.id = "cycle_time", .subject = "cycle time", .measured = cycles.text()};
  time.judged = cycles.count > 0 ? Judgment::ok : Judgment::unknown;
  if (cycles.p99 > kPeriod_us + kAnswerLimit_us) {
    time.judged = defect(purpose);
    time.cause = "the arm's states arrived irregularly: the network delayed them, or this computer slept";
    time.cure = purpose == Purpose::real_arms
                    ? fmt::format("see the lines on timer wake-up and states of 'multipanda doctor {}'",
                                  reading.address)
                    : "the virtual arm shares this computer: reduce the load, or use --pace lockstep";
  }
  time.show(cycles);
  findings.push_back(time);
  Finding answer{.id = "answer_time", .subject = "time to answer", .measured = answers.text()};
  answer.judged = answers.count > 0 ? Judgment::ok : Judgment::unknown;
  answer.figures = answers.figures();
  if (answers.p999 > kAnswerLimit_us) {
    answer.judged = defect(purpose);
    answer.cause = "the answering thread was interrupted";
    answer.cure = "see SCHED_FIFO, load and kernel of 'multipanda doctor'";
  }
  findings.push_back(answer);
  return findings;
}

}  // namespace multipanda::doctor
