#include <numbers>
#include <random>

#include <gtest/gtest.h>

#include "commission/fits.hpp"
#include "core/model/model_terms.hpp"
#include "core/testing/full_series.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::commission {
namespace {

SceneArm turned_arm(const Vector3& rpy) {
  SceneArm arm = open_scene("one_arm").scene.arms[0];
  arm.X_WB = {rotation_from_rpy(rpy), Vector3(0.3, -0.2, 0.7)};
  return arm;
}

// The torques that hold the true arm, from its model: the load is put into the model.
RestSample at_rest(SceneArm truth, const JointVector& q, std::mt19937_64& random, double noise_nm) {
  ModelTerms terms(build_arm_model(truth));
  terms.set_config(ArmFrames{}, truth.tool, truth.load_present);
  terms.update(q, JointVector::Zero(q.size()));
  RestSample sample{q, terms.g()};
  std::normal_distribution<double> noise(0, noise_nm);
  for (auto& value : sample.tau_J) value += noise(random);
  return sample;
}

std::vector<JointVector> postures(const SceneArm& arm, std::size_t count, std::mt19937_64& random) {
  std::uniform_real_distribution<double> off(-0.4, 0.4);
  std::vector<JointVector> all(count, robot_of(arm).q_home);
  for (auto& q : all) {
    for (auto& value : q) value += off(random);
  }
  return all;
}

TEST(GravityFit, AnArmAsDeclaredShowsNothing) {
  std::mt19937_64 random(21);
  SceneArm arm = turned_arm({0.4, -0.9, 2});
  arm.load_declared = {.mass = 0.8, .p_FC = Vector3(0.02, 0, 0.1), .inertia_C = Matrix3::Identity() * 1e-3};
  arm.load_present = arm.load_declared;
  std::vector<RestSample> samples;
  for (const auto& q : postures(arm, 3, random)) samples.push_back(at_rest(arm, q, random, 0));
  const GravityFit fit = fit_gravity(arm, samples);
  EXPECT_LT(fit.largest_nm, 1e-9);
  EXPECT_LT(fit.tilt_rad, 1e-9);
  EXPECT_LT(std::abs(fit.mass_kg), 1e-9);
}

TEST(GravityFit, FindsMassAndCenterOfAnUndeclaredLoad) {
  std::mt19937_64 random(22);
  std::uniform_real_distribution<double> angle(-3, 3), mass(0.3, 2), away(-0.1, 0.1);
  for (int k = 0; k < (test::full_series() ? 200 : 20); ++k) {
    SceneArm arm = turned_arm({angle(random), angle(random) / 2, angle(random)});
    arm.load_present.mass = mass(random);
    arm.load_present.p_FC = Vector3(away(random), away(random), 0.1);
    std::vector<RestSample> samples;
    for (const auto& q : postures(arm, 4, random)) samples.push_back(at_rest(arm, q, random, 0.002));
    const GravityFit fit = fit_gravity(arm, samples);
    EXPECT_TRUE(fit.load_explains()) << k;
    EXPECT_NEAR(fit.mass_kg, arm.load_present.mass, 0.02) << k;
    EXPECT_LT((fit.moment_kg_m - arm.load_present.mass * arm.load_present.p_FC).norm(), 0.02) << k;
  }
}

TEST(GravityFit, FindsATurnedBaseInOnePose) {
  std::mt19937_64 random(23);
  std::uniform_real_distribution<double> angle(-3, 3), tilt(0.15, 1.5);
  for (int k = 0; k < (test::full_series() ? 200 : 20); ++k) {
    const SceneArm arm = turned_arm({0.3 * angle(random), 0.2, angle(random)});
    SceneArm truth = arm;
    const Vector3 axis = Vector3(angle(random), angle(random), 0).normalized();  // not about the vertical
    const double turned = tilt(random);
    truth.X_WB.rotation = exp_rotation(turned * axis) * arm.X_WB.rotation;
    const auto q = postures(arm, 1, random).front();
    const std::vector<RestSample> samples{at_rest(truth, q, random, 0.002)};
    const GravityFit fit = fit_gravity(arm, samples);
    EXPECT_FALSE(fit.load_explains()) << k;
    EXPECT_NEAR(fit.tilt_rad, turned, 0.02) << k;
    EXPECT_GT(fit.largest_nm, 1.5) << k;
  }
}

TEST(GravityFit, AYawOfTheBaseIsInvisible) {
  std::mt19937_64 random(24);
  const SceneArm arm = turned_arm({0, 0, 0});
  SceneArm truth = arm;
  truth.X_WB.rotation = rotation_from_rpy({0, 0, 1.2});
  const std::vector<RestSample> samples{at_rest(truth, postures(arm, 1, random).front(), random, 0)};
  EXPECT_LT(fit_gravity(arm, samples).largest_nm, 1e-9);
}

TEST(GravityFit, RefusesWrongSamples) {
  const SceneArm arm = turned_arm({0, 0, 0});
  EXPECT_THROW(fit_gravity(arm, {}), std::invalid_argument);
  const std::vector<RestSample> six{{JointVector::Zero(6), JointVector::Zero(6)}};
  EXPECT_THROW(fit_gravity(arm, six), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::commission
