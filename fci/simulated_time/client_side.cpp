#include "fci/simulated_time/client_side.hpp"

#include <algorithm>
#include <utility>

#include "fci/client/arm_connection.hpp"

namespace multipanda::fci {
namespace {

using Vector7 = Eigen::Matrix<double, 7, 1>;
constexpr std::uint16_t kArmsPort = 1;  // arbitrary: the only sender on this network

}  // namespace

ClientSide::ClientSide(const FciArmConfig& config, const Dialect& dialect, Send send)
    : dialect_(dialect),
      send_(std::move(send)),
      packet_(config.model->X_WB(), config.hand_declared.value_or(config.hand)),
      limiter_({.tau_max = config.model->limits().tau_max,
                .tau_rate_max = config.model->limits().tau_rate_max.cwiseMin(kTorqueRateMax),
                .period_s = kArmPeriod,
                .low_pass_hz = 0}),
      posture_(config.model, config.frames, config.tool, config.load) {
  connect();
}

void ClientSide::connect() {
  intake_.expect(&dialect_);
  unread_ = false;
  start_of_motion();
}

void ClientSide::start_of_motion() {
  posture_.release();
  commanded_ = refused_ = false;
}

void ClientSide::take_state(std::span<const std::byte> datagram, std::int64_t now_ns) {
  if (phase_ == ArmPhase::offline || intake_.take(datagram, kArmsPort) != StateIntake::Taken::newest) return;
  unread_ = true;
  received_ns_ = now_ns;
}

ArmMode ClientSide::mode(std::int64_t now_ns, double lost_after_s) const {
  if (phase_ == ArmPhase::offline || newest().message_id == 0) return ArmMode::disconnected;
  if (1e-9 * static_cast<double>(now_ns - received_ns_) > lost_after_s) return ArmMode::disconnected;
  return mode_of(newest(), phase_, ArmMotion::torque, ArmMotion::torque);
}

void ClientSide::fill(std::int64_t now_ns, double lost_after_s, ArmState& state) {
  state.mode = mode(now_ns, lost_after_s);
  if (state.mode != ArmMode::move) commanded_ = refused_ = false;
  packet_.fill(newest(), commanded_, state);
  state.t_host = {received_ns_};
}

bool ClientSide::command(const JointVector& tau) {
  if (refused_ || mode_of(newest(), phase_, ArmMotion::torque, ArmMotion::torque) != ArmMode::move)
    return true;
  if (tau.size() != 7 || !tau.allFinite()) {
    refused_ = true;
    return false;
  }
  send_torque(commanded_ ? tau : limited(tau));
  return true;
}

void ClientSide::hold(bool last) {
  if (mode_of(newest(), phase_, ArmMotion::torque, ArmMotion::torque) != ArmMode::move) return;
  const JointVector& tau = posture_.torque(Eigen::Map<const Vector7>(newest().q.data()),
                                           Eigen::Map<const Vector7>(newest().dq.data()));
  const JointVector& held = limited(tau);
  if (last) ArmConnection::mark_finished(dialect_, false, command_);
  send_torque(held);
}

const JointVector& ClientSide::limited(const JointVector& tau) {
  const Eigen::Map<const Vector7> shown(newest().tau_J_d.data());
  if (commanded_) {
    limiter_.observe(shown);
  } else {
    limiter_.begin(shown);
  }
  TorqueLimiter::Cuts cuts;
  return limiter_.limit(tau, kArmPeriod, cuts);
}

void ClientSide::send_torque(const JointVector& tau) {
  std::copy(tau.begin(), tau.end(), command_.tau_J_d.begin());
  command_.message_id = newest().message_id;
  const std::size_t size = encode(dialect_, command_, bytes_);
  command_.motion_generation_finished = command_.torque_command_finished = false;
  send_({bytes_.data(), size});
  limiter_.restart(tau);
  commanded_ = true;
}

}  // namespace multipanda::fci
