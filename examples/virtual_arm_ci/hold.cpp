// Holds an arm at its current position for some seconds: hold ADDRESS [SECONDS]
// It uses multipanda's own client of the control interface and does not need libfranka.
//
// With libfranka the same program is franka::Robot robot(address, franka::RealtimeConfig::kIgnore);
// robot.control([](const franka::RobotState& state, franka::Duration) { ... }). It runs unchanged with the
// virtual arm.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <poll.h>

#include "fci/client/arm_connection.hpp"

using namespace multipanda;

namespace {

// Softer for joints that move little mass: [N m/rad], [N m s/rad]
constexpr std::array<double, 7> kStiffness{100, 100, 100, 100, 30, 20, 10}, kDamping{20, 20, 20, 20, 3, 2, 1};
constexpr double kTorqueStep = 0.9;  // largest change of a torque in 1 ms; an arm accepts 1 N m

// Computes the command that answers a state.
void spring(const fci::RobotState& state, const std::array<double, 7>& goal, fci::RobotCommand& command) {
  for (std::size_t i = 0; i < 7; ++i) {
    const double tau = kStiffness[i] * (goal[i] - state.q[i]) - kDamping[i] * state.dq[i];
    command.tau_J_d[i] += std::clamp(tau - command.tau_J_d[i], -kTorqueStep, kTorqueStep);
  }
}

double hold(fci::ArmConnection& arm, double seconds) {
  arm.start_motion({.controller = ArmController::external, .generator = MotionGenerator::none});
  arm.wait_until_running();
  const std::array<double, 7> goal = arm.last_state().q;
  const std::uint64_t end = arm.last_state().message_id + static_cast<std::uint64_t>(1000 * seconds);
  fci::RobotCommand command{};
  double farthest = 0;
  while (arm.newest().message_id < end) {
    pollfd waiting{arm.udp_file(), POLLIN, 0};
    if (poll(&waiting, 1, 1000) <= 0) throw std::runtime_error("no state from the arm for 1 s");
    if (!arm.receive()) continue;
    if (const auto outcome = arm.poll_motion()) throw std::runtime_error(outcome->text);
    spring(arm.newest(), goal, command);
    arm.send(command);
    for (std::size_t i = 0; i < 7; ++i) farthest = std::max(farthest, std::abs(arm.newest().q[i] - goal[i]));
  }
  (void)arm.finish(command);
  return farthest;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fputs("hold ADDRESS [SECONDS]\n", stderr);
    return 2;
  }
  try {
    fci::ArmConnection arm({.address = argv[1]});
    arm.connect();
    const double farthest = hold(arm, argc > 2 ? std::atof(argv[2]) : 2);
    std::printf("held by protocol version %d; farthest joint %.2e rad\n", arm.version(), farthest);
    return farthest < 1e-3 ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "hold: %s\n", error.what());
    return 1;
  }
}
