// One sequence of commands to an arm, by our own client: tests/fci/bytes_test.py compares its bytes with
// those of the maker's library. `fci_bytes serve ADDRESS SCENE` is the arm, in lock-step, until its standard
// input closes; `fci_bytes drive ADDRESS VERSION` is the sequence.
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>

#include "core/modes/registry.hpp"
#include "fci/client/arm_link.hpp"
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
  // A word without effect: the world takes one step for it. Programs wait for one before their first command.
  while (std::getchar() != EOF) (void)arms.press_guiding(0, false);
  return 0;
}

// The numbers below are the same expressions in the Python side of the test.
constexpr int kTorques = 120, kMotion = 200;
constexpr double kPatience = 20;  // [s]; with arms that are another process, on a machine that may be full

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

// As the maker's library: the state that showed the motion's beginning is not answered, each later one is.
void torque_cycles(ArmLink& link, int count, RobotCommand& command) {
  for (int k = 0; k < count; ++k) {
    (void)link.next_state(kPatience);
    command.tau_J_d = torques(k);
    if (k + 1 < count) (void)link.send(command);
  }
}

void settings(ArmLink& link) {
  link.set_collision_behavior({20, 21, 22, 23, 24, 25, 26}, {30, 31, 32, 33, 34, 35, 36},
                              {20, 21, 22, 23, 24, 25}, {60, 61, 62, 63, 64, 65});
  link.set_joint_impedance({3000, 3000, 3000, 2500, 2500, 2000, 2000});
  link.set_cartesian_impedance({3000, 2900, 2800, 300, 290, 280});
  link.set_K({Matrix3::Identity(), Vector3(0.125, 0.25, 0.5)});
  link.set_EE({Matrix3::Identity(), Vector3(0, 0, 0.0625)});
  link.set_load({.mass = 0.015625, .p_FC = {0, 0, 0.125}, .inertia_C = 0.00390625 * Matrix3::Identity()});
}

// By the arm's own controllers; `fill` makes cycle k's command of the last one and the state it answers.
template <class Fill>
void motion(ArmLink& link, ArmController controller, MotionGenerator generator, Fill fill) {
  RobotCommand command;
  link.start_motion({.controller = controller, .generator = generator});
  link.wait_until_running(kPatience);
  for (int k = 0; k <= kMotion; ++k) {
    fill(command, link.next_state(kPatience), k);
    if (k < kMotion) (void)link.send(command);
  }
  (void)link.finish(command);
}

void drive(const std::string& address, int version) {
  ArmLink link({.name = "left",
                .address = address,
                .version = version,
                .connect_timeout_s = kPatience,
                .reply_timeout_s = kPatience});
  link.connect();
  if (version >= 10) {
    (void)link.robot_model();
    // First of all, while the arm stands where the scene has it: these commands begin at what the state says.
    motion(link, ArmController::joint_impedance, MotionGenerator::joint_position,
           [](RobotCommand& c, const RobotState& s, int k) {
             if (k == 0) c.q_c = s.q_d;
           });
    motion(link, ArmController::cartesian_impedance, MotionGenerator::cartesian_pose,
           [](RobotCommand& c, const RobotState& s, int k) {
             if (k == 0) c.O_T_EE_c = s.O_T_EE_c;
           });
  }
  settings(link);
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
    link.set_collision_behavior(eight);
    link.set_guiding_mode({true, false, true, false, true, false}, true);
  }

  // Torques, finished as commanded.
  RobotCommand command;
  link.start_motion({});
  link.wait_until_running(kPatience);
  torque_cycles(link, kTorques, command);
  (void)link.finish(command);

  // Torques, cut off.
  command = {};
  link.start_motion({});
  link.wait_until_running(kPatience);
  torque_cycles(link, 30, command);
  (void)link.send(command);
  link.stop();

  if (version >= 10) {
    motion(link, ArmController::joint_impedance, MotionGenerator::joint_velocity,
           [](RobotCommand& c, const RobotState&, int k) { c.dq_c[6] = velocity(k); });
    motion(link, ArmController::cartesian_impedance, MotionGenerator::cartesian_velocity,
           [](RobotCommand& c, const RobotState&, int k) { c.O_dP_EE_c[2] = velocity(k) / 4; });
  }

  // A torque that jumps, and the way back.
  command = {};
  link.start_motion({});
  link.wait_until_running(kPatience);
  torque_cycles(link, 10, command);
  command.tau_J_d = {5, 0, 0, 0, 0, 0, 0};
  (void)link.send(command);
  (void)link.wait_for_state(
      [](const RobotState& s) { return s.robot_mode == static_cast<int>(RobotMode::reflex); });
  (void)link.wait_for_end(2);
  link.stop();
  link.recover();
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
