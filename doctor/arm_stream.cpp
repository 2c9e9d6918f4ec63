#include "doctor/arm_stream.hpp"

#include <algorithm>
#include <cmath>
#include <poll.h>
#include <thread>

#include <fmt/format.h>

#include "core/rt/thread_setup.hpp"
#include "device/arm_error.hpp"
#include "doctor/timer.hpp"
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
    finding.judged = Judgment::bad;
    finding.measured = "no connection to its control interface";
    finding.cause = reading.reason;
    finding.cure =
        purpose == Purpose::real_arms
            ? "switch on the arm, open its brakes and activate FCI on its web page; end other programs that "
              "are connected to it"
            : "start the virtual arm: multipanda virtual-arm SCENE";
    return finding;
  }
  finding.measured = fmt::format("protocol version {} ({}), this client supports 4 to 10; mode {}{}",
                                 reading.version, arms_of_version(reading.version), reading.mode,
                                 reading.errors.empty() ? "" : ": " + reading.errors);
  finding.figures = {{"version", static_cast<double>(reading.version), ""}};
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
    finding.judged = reading.reason.empty() ? Judgment::bad : Judgment::unknown;
    finding.cause = reading.reason.empty()
                        ? "the arm accepted the connection, but its packets (UDP) do not arrive"
                        : "there is no connection to the arm";
    finding.cure = reading.reason.empty() ? "allow UDP from the arm in the firewall of this computer" : "";
    return finding;
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
  finding.figures = gaps.figures();
  finding.figures.push_back({"rate", rate, "Hz"});
  finding.figures.push_back({"lost", static_cast<double>(reading.lost), "packets"});
  finding.figures.push_back({"lost_in_row", static_cast<double>(reading.lost_in_row), "packets"});
  finding.figures.push_back({"irregular", 100 * irregular, "%"});
  finding.histogram = gaps.bars;
  if (sent < 0.9 * 1000 * reading.seconds) {
    finding.judged = purpose == Purpose::real_arms ? Judgment::bad : Judgment::unknown;
    finding.cause = purpose == Purpose::real_arms
                        ? "an arm sends 1000 states per second; this one sent fewer"
                        : "a virtual arm in lock-step, or on a busy computer, sends states at its own pace";
    finding.cure = purpose == Purpose::real_arms
                       ? "restart the arm's control unit; if that does not help, ask the manufacturer"
                       : "start it with --pace realtime to measure its regularity";
    return finding;
  }
  if (lost > 0.01 || reading.lost_in_row >= kLostInRowLimit || irregular > 0.05) {
    finding.judged = defect(purpose);
  } else if (reading.lost > 0 || irregular > 0.01) {
    finding.judged = Judgment::warning;
  } else {
    finding.judged = Judgment::ok;
    return finding;
  }
  finding.cause =
      fmt::format("{:.2g} % of the states were lost, {:.2g} % came more than {:g} us early or late",
                  100 * lost, 100 * irregular, kAnswerLimit_us);
  finding.cure = "if wake-ups above are late, fix those first; otherwise check cable, switch and card";
  return finding;
}

}  // namespace multipanda::doctor
