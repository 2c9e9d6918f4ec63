// Recovers known parameters from torques; and checks which data are refused.
#include "sysid/identification/identify.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sysid/identification/equations.hpp"
#include "sysid/identification/inertial_parameters.hpp"
#include "sysid/identification/predict.hpp"

namespace multipanda::identify_test {
namespace {

using ::testing::HasSubstr;

// Fourier series per joint within the range of `fer`, with exact derivatives.
struct Motion {
  explicit Motion(unsigned seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> any(-1, 1);
    for (auto* values : {&a, &b}) *values = Eigen::MatrixXd::NullaryExpr(7, 4, [&] { return any(random); });
  }
  void at(double t, Eigen::VectorXd& q, Eigen::VectorXd& dq, Eigen::VectorXd& ddq) const {
    static const Eigen::VectorXd middle = (Eigen::VectorXd(7) << 0, 0, 0, -1.6, 0, 1.8, 0).finished();
    q = middle;
    dq.setZero(7);
    ddq.setZero(7);
    for (int k = 0; k < 4; ++k) {
      const double w = 2 * M_PI * 0.1 * (k + 1), size = 0.35 / (k + 1);
      q += size * (a.col(k) * std::sin(w * t) + b.col(k) * std::cos(w * t));
      dq += size * w * (a.col(k) * std::cos(w * t) - b.col(k) * std::sin(w * t));
      ddq -= size * w * w * (a.col(k) * std::sin(w * t) + b.col(k) * std::cos(w * t));
    }
  }
  Eigen::MatrixXd a, b;
};

// `fer` with other masses, centers of mass and inertias; each link is a possible body.
RobotDescription other_arm(unsigned seed) {
  RobotDescription robot = load_robot("fer");
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> any(-1, 1);
  for (std::size_t i = 1; i < robot.links.size(); ++i) {
    RigidBody& link = robot.links[i];
    link = floored(link, 1e-3);
    link.mass *= 1 + 0.1 * any(random);
    link.com += 0.01 * Vector3::NullaryExpr([&] { return any(random); });
    link.inertia *= 1 + 0.1 * any(random);
  }
  return robot;
}

MotionData exact(const RobotDescription& robot, const Motion& motion, double seconds, double step) {
  ArmRegressor regressor(robot);
  const Eigen::VectorXd theta = thetas_of(robot);
  const auto count = static_cast<Eigen::Index>(seconds / step);
  MotionData data;
  data.q.resize(count, 7);
  data.dq = data.ddq = data.tau = data.q;
  Eigen::VectorXd q, dq, ddq;
  for (Eigen::Index i = 0; i < count; ++i) {
    motion.at(static_cast<double>(i) * step, q, dq, ddq);
    data.q.row(i) = q;
    data.dq.row(i) = dq;
    data.ddq.row(i) = ddq;
    data.tau.row(i) = regressor.at(q, dq, ddq, {0, 0, -9.81}) * theta;
  }
  return data;
}

MeasuredLog log_of(const MotionData& data, double step, double noise, unsigned seed) {
  MeasuredLog log;
  log.source = "made.csv";
  log.t.setLinSpaced(data.q.rows(), 0, static_cast<double>(data.q.rows() - 1) * step);
  log.q = data.q;
  log.dq = data.dq;
  log.tau = data.tau;
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0, noise);
  if (noise > 0) log.tau += Eigen::MatrixXd::NullaryExpr(log.tau.rows(), 7, [&] { return normal(random); });
  return log;
}

double relative_error(const LinearFit& fit, const RobotDescription& truth, const MotionData& data) {
  // Columns are scaled, so that every base parameter is weighted by its torque.
  ArmRegressor regressor(truth);
  Eigen::VectorXd length = Eigen::VectorXd::Zero(fit.base.rank());
  for (Eigen::Index i = 0; i < data.q.rows(); i += 10) {
    const Eigen::MatrixXd Y = regressor.at(data.q.row(i), data.dq.row(i), data.ddq.row(i), {0, 0, -9.81});
    length += Y(Eigen::all, fit.base.leading).colwise().squaredNorm().transpose();
  }
  length = length.cwiseSqrt();
  const Eigen::VectorXd expected = fit.base.combination * thetas_of(truth);
  return length.cwiseProduct(fit.value - expected).norm() / length.cwiseProduct(expected).norm();
}

TEST(LinearFit, recovers_base_parameters_from_exact_inverse_dynamics) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    const RobotDescription truth = other_arm(seed);
    const std::vector<MotionData> data{exact(truth, Motion(seed), 10, 0.01)};
    const LinearFit fit = fit_linear(data, load_robot("fer"));
    EXPECT_EQ(fit.base.rank(), 43);  // of seven revolute joints, the first one vertical
    EXPECT_LT(relative_error(fit, truth, data.front()), 1e-9);
  }
}

TEST(BaseParameters, make_the_same_torque_as_all_parameters) {
  const RobotDescription robot = other_arm(5);
  const BaseParameters base = base_parameters(robot);
  const Eigen::VectorXd theta = thetas_of(robot), beta = base.combination * theta;
  const MotionData data = exact(robot, Motion(6), 2, 0.05);
  ArmRegressor regressor(robot);
  for (Eigen::Index i = 0; i < data.q.rows(); ++i) {
    const Eigen::MatrixXd Y = regressor.at(data.q.row(i), data.dq.row(i), data.ddq.row(i), {0, 0, -9.81});
    EXPECT_LT((Y(Eigen::all, base.leading) * beta - Y * theta).norm(), 1e-9);
  }
  EXPECT_EQ(base.alone.size() + base.combined.size() + base.unidentifiable.size(), 70u);
}

TEST(ArmRegressor, tilt_turns_gravity_as_a_tilted_base_does) {
  const Eigen::Vector2d tilt(0.02, -0.03);
  const Vector3 g(0, 0, -9.81), linear = g + tilt_directions(g) * tilt;
  EXPECT_LT((tilted(g, tilt) - linear).norm(), 0.01);  // second order
  // The base turned by Ry Rx sees the world's vertical turned back.
  const Vector3 seen = tilted(g, tilt);
  const Vector3 again = rotation_from_rpy(Vector3(tilt[0], tilt[1], 0)) * seen;
  EXPECT_LT((again - g).norm(), 1e-12);
}

TEST(Identify, finds_an_arm_without_friction_and_chooses_the_simplest_family) {
  const RobotDescription truth = other_arm(11);
  const MotionData data = exact(truth, Motion(12), 10, 0.001);
  const std::vector<MeasuredLog> logs{log_of(data, 0.001, 0.05, 13)};
  const Identification id = identify(logs, load_robot("fer"));
  EXPECT_EQ(id.family, "rigid");
  EXPECT_TRUE(id.consistent);
  EXPECT_FALSE(id.robot.link_friction);
  // 0.05 N m of white noise leaves 0.05 sqrt(about 2 * 9.5 Hz / 1000 Hz) = 0.007 after the filter.
  EXPECT_LT(id.rmse_heldout.mean(), 0.03);
  const Prediction prior = predict(logs.front(), load_robot("fer"));
  EXPECT_LT(id.rmse_all.mean(), 0.1 * prior.rmse_mean);
  // Through the filters: within 1 % of the base parameters, weighted by the torque that they make.
  EXPECT_LT(relative_error(id.linear, truth, data), 0.01);
}

TEST(Identify, finds_friction_gains_and_tilt_that_were_put_in) {
  RobotDescription truth = other_arm(21);
  truth.base_tilt = {0.006, -0.004};
  FrictionLaw law;
  law.viscous = JointVector::Constant(7, 0.3);
  for (const double s : {0.003, 0.02, 0.1}) law.presliding.push_back({s, JointVector::Constant(7, 0.25)});
  truth.link_friction = law;
  truth.torque_sensor = TorqueSensor{.gain = {}, .offset = JointVector::Constant(7, 0.1)};
  MotionData data = exact(truth, Motion(22), 10, 0.001);
  ArmRegressor regressor(truth);
  const Eigen::VectorXd theta = thetas_of(truth);
  for (Eigen::Index i = 0; i < data.q.rows(); ++i) {
    data.tau.row(i) =
        regressor.at(data.q.row(i), data.dq.row(i), data.ddq.row(i), tilted({0, 0, -9.81}, truth.base_tilt)) *
        theta;
  }
  data.tau += friction_torque(law, data.dq, 0.001);
  data.tau.array() += 0.1;
  const std::vector<MeasuredLog> logs{log_of(data, 0.001, 0.02, 23)};
  IdentifyOptions options;
  options.families = {"rigid", "coulomb+tilt", "presliding3", "presliding3+tilt"};
  const Identification id = identify(logs, load_robot("fer"), options);
  EXPECT_EQ(id.family, "presliding3+tilt");
  EXPECT_TRUE(id.dissipative);
  EXPECT_NEAR(id.robot.base_tilt[0], 0.006, 0.002);
  EXPECT_NEAR(id.robot.base_tilt[1], -0.004, 0.002);
  ASSERT_TRUE(id.robot.link_friction);
  EXPECT_LT((id.robot.link_friction->viscous - law.viscous).lpNorm<Eigen::Infinity>(), 0.1);
  EXPECT_LT(id.rmse_heldout.mean(), 0.1);  // the initial states of the held-out file are estimated
  // The written model predicts the same as the fitted one.
  EXPECT_NEAR(predict(logs.front(), id.robot).rmse_mean, id.rmse_all.mean(), 1e-9);
}

// Joint 5 hardly moves. An elastic-plastic element (Maxwell's, not Dahl's) begins slid to one side in the
// fitted logs and to the other side in the new one, so either start must come from that log's torque.
TEST(Identify, leaves_the_start_of_resting_friction_open_and_reads_it_from_the_torque) {
  constexpr double kFriction = 0.4, kSlides = 0.002;
  const RobotDescription truth = load_robot("fer");
  const auto with_friction = [&](unsigned seed, double start) {
    Motion motion(seed);
    motion.a.row(4) *= 0.03;
    motion.b.row(4) *= 0.03;
    MotionData data = exact(truth, motion, 10, 0.001);
    EXPECT_LT(std::abs(data.dq(0, 4)), 0.02);
    double z = start * kSlides;
    for (Eigen::Index i = 0; i < data.q.rows(); ++i) {
      z = std::clamp(z + 0.001 * data.dq(i, 4), -kSlides, kSlides);
      data.tau(i, 4) += kFriction * z / kSlides;
    }
    return log_of(data, 0.001, 0.02, seed);
  };
  IdentifyOptions options;
  options.families = {"stribeck+presliding6+tilt"};
  options.choose = false;
  const Identification id =
      identify(std::vector{with_friction(42, 1), with_friction(43, 1)}, load_robot("fer"), options);
  double slid = 0;
  for (const PreslidingElement& e : id.robot.link_friction->presliding) slid += e.amplitude[4];
  EXPECT_NEAR(slid, kFriction, 0.08);
  EXPECT_LT(predict(with_friction(44, -1), id.robot).rmse[4], 0.1);

  // The same element at a joint that never moves: only the start matters.
  Motion still(45);
  still.a.row(4).setZero();
  still.b.row(4).setZero();
  MotionData data = exact(truth, still, 10, 0.001);
  data.tau.col(4).array() -= 0.7 * kFriction;
  RobotDescription known = truth;
  known.link_friction = FrictionLaw{};
  known.link_friction->presliding.push_back({kSlides, kFriction * JointVector::Unit(7, 4)});
  EXPECT_LT(predict(log_of(data, 0.001, 0.02, 46), known).rmse[4], 0.02);
}

TEST(Identify, weighs_a_payload) {
  const RobotDescription arm = load_robot("fer");
  RobotDescription loaded = arm;
  const RigidBody load{0.8, Vector3(0.02, -0.03, 0.09), 0.002 * Matrix3::Identity()};
  loaded.links.back() = merged(arm.links.back(), moved(load, arm.flange.pose()));
  const MotionData data = exact(loaded, Motion(31), 30, 0.001);
  const std::vector<MeasuredLog> logs{log_of(data, 0.001, 0.05, 32)};
  IdentifyOptions options;
  options.payload = true;
  const Identification id = identify(logs, arm, options);
  ASSERT_TRUE(id.payload);
  EXPECT_NEAR(id.payload->mass, 0.8, 0.016);
  EXPECT_LT((id.payload->com - load.com).lpNorm<Eigen::Infinity>(), 0.003);
  EXPECT_TRUE(id.consistent);
  EXPECT_GT(id.payload_mass_half95, 0);
  EXPECT_LT(std::abs(id.payload->mass - 0.8), 3 * id.payload_mass_half95 + 0.004);
}

std::string refusal(const MeasuredLog& log) {
  try {
    (void)identify(std::vector{log}, load_robot("fer"));
  } catch (const LogRefused& refused) {
    return refused.what();
  }
  return "accepted";
}

TEST(Identify, refuses_with_the_number_that_shows_it) {
  const RobotDescription robot = load_robot("fer");
  const MotionData data = exact(robot, Motion(41), 10, 0.001);
  const MeasuredLog good = log_of(data, 0.001, 0.02, 42);

  MeasuredLog brief = good;
  brief.t = good.t.head(1500).eval();
  brief.q = good.q.topRows(1500).eval();
  brief.dq = good.dq.topRows(1500).eval();
  brief.tau = good.tau.topRows(1500).eval();
  EXPECT_THAT(refusal(brief), HasSubstr("1.5 s of data are too short"));

  MeasuredLog still = good;
  still.q = good.q.row(0).replicate(good.q.rows(), 1).eval();
  still.dq.setZero();
  still.tau = good.tau.row(0).replicate(good.q.rows(), 1).eval();
  EXPECT_THAT(refusal(still), HasSubstr("condition number"));

  MeasuredLog six = good;
  six.q = good.q.leftCols(6).eval();
  six.dq = good.dq.leftCols(6).eval();
  six.tau = good.tau.leftCols(6).eval();
  EXPECT_THAT(refusal(six), HasSubstr("6 joints, but fer has 7"));

  MeasuredLog flipped = good;
  flipped.tau = -good.tau;
  EXPECT_THAT(refusal(flipped), HasSubstr("200 % of the measured torque unexplained"));

  MeasuredLog outside = good;
  outside.q.col(3).array() += 2.5;
  EXPECT_THAT(refusal(outside), HasSubstr("joint4 moves from"));
}

TEST(Identify, refuses_families_that_do_not_exist) {
  IdentifyOptions options;
  options.families = {"presliding33"};
  const MeasuredLog log = log_of(exact(load_robot("fer"), Motion(41), 4, 0.001), 0.001, 0.02, 42);
  EXPECT_THROW((void)identify(std::vector{log}, load_robot("fer"), options), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::identify_test
