#include <cstdio>

#include <gtest/gtest.h>

#include "analysis/identification/arm_regressor.hpp"
#include "analysis/identification/identify.hpp"
#include "analysis/identification/linear_fit.hpp"
#include "analysis/identification/simulated_log.hpp"

namespace multipanda {
namespace {

using namespace test;

Eigen::VectorXd true_base(const LinearFit& fit, const RobotDescription& robot) {
  return fit.base.combination * thetas_of(robot);
}

Eigen::MatrixXd centred(const Eigen::MatrixXd& tau) {
  Eigen::MatrixXd out = tau;
  for (Eigen::Index k = 0; k + 1 < tau.rows(); ++k) out.row(k) = 0.5 * (tau.row(k) + tau.row(k + 1));
  return out;
}

int env(const char* name, int value) { return std::getenv(name) ? std::atoi(std::getenv(name)) : value; }

TEST(Try, Base) {
  const RobotDescription robot = load_robot("fer");
  for (const int substeps : {1, 4}) {
    Scene scene = scene_of({arm_named("a", {}, false)});
    scene.substeps = static_cast<std::size_t>(substeps);
    MeasuredLog log = record(scene, RichMotion(1), {.duration_s = 20});
    for (int c = 0; c < 2; ++c) {
      if (c == 1) log.tau = centred(log.tau);
      const LinearFit fit = fit_linear(std::span(&log, 1), robot);
      const Eigen::VectorXd error = fit.value.head(fit.base.rank()) - true_base(fit, robot);
      const Eigen::VectorXd truth = true_base(fit, robot);
      std::printf("substeps %d centred %d: rel error %.5f cond %.1f scaled %.1f rmse %.5f\n", substeps, c,
                  error.norm() / truth.norm(), fit.condition.raw, fit.condition.scaled, fit.rmse.maxCoeff());
    }
  }
}

TEST(Try, Coverage) {
  const RobotDescription robot = load_robot("fer");
  const int trials = env("TRIALS", 10), substeps = env("SUBSTEPS", 1), centre = env("CENTRE", 0);
  const double period = env("PERIOD", 10), seconds = env("SECONDS", 10);
  Eigen::VectorXi inside;
  Eigen::VectorXd mean, sq, half;
  LinearFit fit;
  Eigen::VectorXd truth;
  for (int trial = 0; trial < trials; ++trial) {
    PlantFidelity plant = PlantFidelity::realistic();
    if (env("IDEAL", 0)) { plant.joint_friction = false; plant.torque_bandwidth_hz = 0; plant.command_delay_s = 0; }
    Scene scene = scene_of({arm_named("a", {}, false)}, plant);
    scene.substeps = static_cast<std::size_t>(substeps);
    scene.seed = static_cast<std::uint64_t>(1000 + trial);
    MeasuredLog log = record(scene, RichMotion(1, period), {.duration_s = seconds});
    if (centre) log.tau = centred(log.tau);
    fit = fit_linear(std::span(&log, 1), robot);
    truth = true_base(fit, robot);
    const Eigen::VectorXd error = fit.value - truth;
    if (inside.size() == 0) {
      inside = Eigen::VectorXi::Zero(error.size());
      mean = sq = half = Eigen::VectorXd::Zero(error.size());
    }
    for (Eigen::Index i = 0; i < error.size(); ++i) inside[i] += std::abs(error[i]) < fit.half95[i] ? 1 : 0;
    mean += error / trials;
    sq += error.cwiseAbs2() / trials;
    half += fit.half95 / trials;
  }
  std::printf("pooled %.3f, worst %d of %d, lag %ld, rmse %.4f\n", inside.cast<double>().mean() / trials, inside.minCoeff(), trials,
              static_cast<long>(fit.longest_lag), fit.rmse.mean());
  for (Eigen::Index i = 0; i < mean.size(); ++i) {
    const double sd = std::sqrt(std::max(0.0, sq[i] - mean[i] * mean[i]));
    if (env("SHOW", 1)) std::printf("%2ld inside %3d truth %9.5f bias/sd %6.2f sd %.2e half/1.96sd %.2f %s\n", static_cast<long>(i), inside[i], truth[i],
                mean[i] / sd, sd, half[i] / (1.96 * sd), fit.names[static_cast<std::size_t>(i)].substr(0, 40).c_str());
  }
}

TEST(Try, Payload) {
  const RobotDescription robot = load_robot("fer");
  const Vector3 coms[] = {{0, 0, 0.05}, {0.03, -0.02, 0.08}, {-0.04, 0.05, 0.03}};
  const double masses[] = {0.3, 0.8, 1.5};
  for (int i = 0; i < 3; ++i) {
    SceneArm arm = arm_named("a");
    arm.load_present = {.mass = masses[i], .p_FC = coms[i], .inertia_C = masses[i] * 1e-3 * Matrix3::Identity()};
    Scene scene = scene_of({arm}, PlantFidelity::realistic());
    scene.seed = static_cast<std::uint64_t>(i + 1);
    const MeasuredLog log = record(scene, RichMotion(static_cast<std::uint64_t>(i + 1)), {.duration_s = 30});
    const auto t0 = std::chrono::steady_clock::now();
    const Identification found = identify(std::span(&log, 1), robot, {.payload = true, .hand = true});
    std::printf("mass %.3f found %.4f +- %.4f, com error %.2f mm +- %.2f, %s %.1f s\n", masses[i], found.payload->mass, found.payload_mass_half95,
                1e3 * (found.payload->com - coms[i]).norm(), 1e3 * found.payload_com_half95, found.family.c_str(),
                std::chrono::duration<double>(std::chrono::steady_clock::now() - t0).count());
  }
}

}  // namespace
}  // namespace multipanda
