// Sends one sequence of commands to an arm with our own client; tests/fci/bytes_test.py compares its bytes
// with libfranka's. `fci_bytes serve ADDRESS SCENE` simulates the arm in lock-step until its standard input
// closes; `fci_bytes drive ADDRESS VERSION` sends the sequence.
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>

#include "core/modes/registry.hpp"
#include "fci/client/arm_connection.hpp"
#include "fci/server/virtual_arms.hpp"
#include "scene/load.hpp"

namespace multipanda::fci {
namespace {

int serve(const std::string& address, const std::string& path) {
  const Registry registry = Registry::with_builtins();
  VirtualArmOptions options{.pace = WorldPace::lockstep, .grippers = false, .idle_stands_still = true};
  options.places = {{.address = address}};
  VirtualArms arms(load_scene(path, registry), options);
  arms.start();
  std::puts("listening");
  std::fflush(stdout);
  // A line makes the world take one step; programs wait for one before their first command.
  while (std::getchar() != EOF) (void)arms.press_guiding(0, false);
  return 0;
}

// The Python side of the test computes these numbers by the same expressions.
constexpr int kTorques = 120, kMotion = 200;
constexpr double kPatience = 20;  // [s], for a virtual arm in another process on a busy machine

std::array<double, 7> torques(int k) {
  std::array<double, 7> tau{};
  for (int j = 0; j < 7; ++j) {
    tau[static_cast<std::size_t>(j)] = ((k * (j + 1)) % 16 - 7.5) / static_cast<double>(64 << j);
  }
  return tau;
}

double velocity(int k) {
  const double x = k < 100 ? k / 100.0 : (200 - k) / 100.0;
  return 0.02 * x * x * x * (10 + x * (6 * x - 15));
}

// As in libfranka: the state that reports the start of the motion is not answered, each later one is.
void torque_cycles(ArmConnection& connection, int count, RobotCommand& command) {
  for (int k = 0; k < count; ++k) {
    (void)connection.next_state(kPatience);
    command.tau_J_d = torques(k);
    if (k + 1 < count) (void)connection.send(command);
  }
}

void settings(ArmConnection& connection) {
  connection.set_collision_behavior({20, 21, 22, 23, 24, 25, 26}, {30, 31, 32, 33, 34, 35, 36},
                                    {20, 21, 22, 23, 24, 25}, {60, 61, 62, 63, 64, 65});
  connection.set_joint_impedance({3000, 3000, 3000, 2500, 2500, 2000, 2000});
  connection.set_cartesian_impedance({3000, 2900, 2800, 300, 290, 280});
  connection.set_K({Matrix3::Identity(), Vector3(0.125, 0.25, 0.5)});
  connection.set_EE({Matrix3::Identity(), Vector3(0, 0, 0.0625)});
  connection.set_load(
      {.mass = 0.015625, .p_FC = {0, 0, 0.125}, .inertia_C = 0.00390625 * Matrix3::Identity()});
}

// For the arm's own controllers; `fill` changes the last command into that of cycle k for the given state.
template <class Fill>
void motion(ArmConnection& connection, ArmController controller, MotionGenerator generator, Fill fill) {
  RobotCommand command;
  connection.start_motion({.controller = controller, .generator = generator});
  connection.wait_until_running(kPatience);
  for (int k = 0; k <= kMotion; ++k) {
    fill(command, connection.next_state(kPatience), k);
    if (k < kMotion) (void)connection.send(command);
  }
  (void)connection.finish(command);
}

void drive(const std::string& address, int version) {
  ArmConnection connection({.name = "left",
                            .address = address,
                            .version = version,
                            .connect_timeout_s = kPatience,
                            .reply_timeout_s = kPatience});
  connection.connect();
  if (version >= 10) {
    (void)connection.robot_model();
    // These commands begin at the measured state, so they come first, with the arm at the scene's start.
    motion(connection, ArmController::joint_impedance, MotionGenerator::joint_position,
           [](RobotCommand& c, const RobotState& s, int k) {
             if (k == 0) c.q_c = s.q_d;
           });
    motion(connection, ArmController::cartesian_impedance, MotionGenerator::cartesian_pose,
           [](RobotCommand& c, const RobotState& s, int k) {
             if (k == 0) c.O_T_EE_c = s.O_T_EE_c;
           });
  }
  settings(connection);
  if (version < 6) {
    SetCollisionBehaviorRequest eight;
    eight.lower_torque_thresholds_acceleration = {10, 11, 12, 13, 14, 15, 16};
    eight.upper_torque_thresholds_acceleration = {40, 41, 42, 43, 44, 45, 46};
    eight.lower_torque_thresholds_nominal = {20, 21, 22, 23, 24, 25, 26};
    eight.upper_torque_thresholds_nominal = {50, 51, 52, 53, 54, 55, 56};
    eight.lower_force_thresholds_acceleration = {10, 11, 12, 13, 14, 15};
    eight.upper_force_thresholds_acceleration = {40, 41, 42, 43, 44, 45};
    eight.lower_force_thresholds_nominal = {20, 21, 22, 23, 24, 25};
    eight.upper_force_thresholds_nominal = {50, 51, 52, 53, 54, 55};
    connection.set_collision_behavior(eight);
    connection.set_guiding_mode({true, false, true, false, true, false}, true);
  }

  // Torques, finished by the last command.
  RobotCommand command;
  connection.start_motion({});
  connection.wait_until_running(kPatience);
  torque_cycles(connection, kTorques, command);
  (void)connection.finish(command);

  // Torques, canceled.
  command = {};
  connection.start_motion({});
  connection.wait_until_running(kPatience);
  torque_cycles(connection, 30, command);
  (void)connection.send(command);
  connection.stop();

  if (version >= 10) {
    motion(connection, ArmController::joint_impedance, MotionGenerator::joint_velocity,
           [](RobotCommand& c, const RobotState&, int k) { c.dq_c[6] = velocity(k); });
    motion(connection, ArmController::cartesian_impedance, MotionGenerator::cartesian_velocity,
           [](RobotCommand& c, const RobotState&, int k) { c.O_dP_EE_c[2] = velocity(k) / 4; });
  }

  // A torque step, and the recovery.
  command = {};
  connection.start_motion({});
  connection.wait_until_running(kPatience);
  torque_cycles(connection, 10, command);
  command.tau_J_d = {5, 0, 0, 0, 0, 0, 0};
  (void)connection.send(command);
  (void)connection.wait_for_state(
      [](const RobotState& s) { return s.robot_mode == static_cast<int>(RobotMode::reflex); });
  (void)connection.wait_for_end(2);
  connection.stop();
  connection.recover();
}

}  // namespace
}  // namespace multipanda::fci

int main(int argc, char** argv) {
  try {
    const std::string what = argc == 4 ? argv[1] : "";
    if (what == "serve") return multipanda::fci::serve(argv[2], argv[3]);
    if (what == "drive") return multipanda::fci::drive(argv[2], std::atoi(argv[3])), 0;
    std::fputs("usage: fci_bytes serve ADDRESS SCENE | drive ADDRESS VERSION\n", stderr);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
  }
  return 1;
}
