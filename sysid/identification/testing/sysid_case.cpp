// Data for sysid_test.py: logs of simulated arms, our fits of them, and the input with which a second program
// can do the same. Usage: sysid_case FOLDER
#include <filesystem>
#include <fstream>
#include <iostream>

#include <nlohmann/json.hpp>

#include "models/write_robot.hpp"
#include "sysid/identification/rollout_fit.hpp"
#include "sysid/identification/testing/simulated_log.hpp"

namespace multipanda {
namespace {

using namespace test;

nlohmann::json numbers(const Eigen::VectorXd& v) {
  return std::vector<double>(v.data(), v.data() + v.size());
}

void write_table(const std::filesystem::path& file, const std::vector<const Eigen::MatrixXd*>& parts) {
  std::ofstream out(file);
  out.precision(17);
  for (Eigen::Index k = 0; k < parts[0]->rows(); ++k) {
    const char* separator = "";
    for (const auto* part : parts) {
      for (Eigen::Index j = 0; j < part->cols(); ++j) {
        out << separator << (*part)(k, j);
        separator = ",";
      }
    }
    out << '\n';
  }
}

// Torque without friction: the second program models only first-order tracking and a delay.
nlohmann::json actuation_case(const std::filesystem::path& folder) {
  PlantFidelity plant = PlantFidelity::realistic();
  plant.joint_friction = false;
  plant.torque_bandwidth_hz = 40;
  plant.command_delay_s = 0.002;
  Scene scene = scene_of({arm_named("a", {}, false)}, plant);
  scene.seed = 3;
  const MeasuredLog log = record(scene, RichMotion(3), {.duration_s = 2, .dither_nm = 0.5});
  const Eigen::MatrixXd beyond_gravity =
      log.tau.bottomRows(log.samples() - 1) - log.gravity.topRows(log.samples() - 1);
  const Eigen::MatrixXd command = log.tau_cmd.topRows(log.samples() - 1);
  write_table(folder / "torque.csv", {&command, &beyond_gravity});
  const ActuationFit fit = fit_actuation(std::span(&log, 1), load_robot("fer"));
  const ActuationRollouts rollouts =
      fit_actuation_by_rollouts(std::span(&log, 1), scene, 0, fit, {.windows = 50, .threads = 2});
  return {{"delay", fit.actuation.command_delay},
          {"bandwidth", fit.actuation.torque_bandwidth_hz},
          {"rollouts_delay", rollouts.actuation.command_delay},
          {"rollouts_bandwidth", rollouts.actuation.torque_bandwidth_hz},
          {"true_delay", plant.command_delay_s},
          {"true_bandwidth", plant.torque_bandwidth_hz}};
}

nlohmann::json surface_case(const std::filesystem::path& folder) {
  constexpr double kStiffness = 2e4;
  const Pressed pressed = press(kStiffness, ball(), 0, 21);
  const SurfaceFit fit = fit_surface(pressed.log, pressed.scene, 0, "table", {.windows = 60, .threads = 2});
  write_table(folder / "pressed.csv", {&pressed.log.q, &pressed.log.dq, &pressed.log.tau});
  const SceneObject& table = pressed.scene.objects[0];
  const Quaternion turn = table.X_WO.quaternion();
  return {{"stiffness", fit.stiffness},
          {"height", fit.height},
          {"true_stiffness", kStiffness},
          {"damping_ratio", table.contact->damping_ratio},
          {"table_size", numbers(table.size)},
          {"table_position", numbers(table.X_WO.position)},
          {"table_quaternion", {turn.w(), turn.x(), turn.y(), turn.z()}},
          {"ball_diameter", pressed.scene.arms[0].tool_shapes[0].size.x()},
          {"ball_in_flange", numbers(pressed.scene.arms[0].tool_shapes[0].X_FS.position)}};
}

}  // namespace
}  // namespace multipanda

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: sysid_case FOLDER\n";
    return 2;
  }
  using namespace multipanda;
  const std::filesystem::path folder = argv[1];
  std::ofstream(folder / "arm.xml") << to_mjcf(load_robot("fer"), {.hand = false});
  std::ofstream(folder / "ours.json")
      << nlohmann::json{{"actuation", actuation_case(folder)}, {"surface", surface_case(folder)}};
  return 0;
}
