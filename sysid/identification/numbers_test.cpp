// Filters, friction with memory, bodies and the cone of physically consistent ones: compared with formulas
// and independent computations.
#include <cmath>
#include <random>

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "sysid/identification/equations.hpp"
#include "sysid/identification/filtered_log.hpp"
#include "sysid/identification/inertial_parameters.hpp"

namespace multipanda::numbers_test {
namespace {

// |H|^2 of a Butterworth low pass of order 4 after the bilinear transform, in closed form.
double squared_gain(double frequency, double cutoff, double rate) {
  const double x = std::tan(M_PI * frequency / rate) / std::tan(M_PI * cutoff / rate);
  return 1 / (1 + std::pow(x, 8));
}

TEST(LowPass, passes_sines_with_the_squared_gain_of_its_law_and_no_phase) {
  constexpr double kRate = 1000, kCutoff = 10;
  const LowPass filter(4, kCutoff, kRate);
  for (const double f : {0.5, 5.0, 10.0, 20.0}) {
    Eigen::MatrixXd x(6000, 1);
    for (Eigen::Index i = 0; i < x.rows(); ++i)
      x(i, 0) = std::sin(2 * M_PI * f * static_cast<double>(i) / kRate);
    const Eigen::MatrixXd y = filter.zero_phase(x);
    const double error =
        (y - squared_gain(f, kCutoff, kRate) * x).middleRows(1500, 3000).lpNorm<Eigen::Infinity>();
    EXPECT_LT(error, 1e-7) << f << " Hz";
  }
}

TEST(LowPass, leaves_a_straight_line_as_it_is_up_to_its_ends) {
  Eigen::MatrixXd x(500, 1);
  x.col(0).setLinSpaced(500, -3, 7);
  // Reflection about the end point continues a line; the remaining error comes from the end of the extension.
  EXPECT_LT((LowPass(4, 50, 1000).zero_phase(x) - x).lpNorm<Eigen::Infinity>(), 0.02);
  const Eigen::MatrixXd constant = Eigen::MatrixXd::Constant(300, 2, 4.25);
  EXPECT_LT((LowPass(4, 10, 1000).zero_phase(constant) - constant).lpNorm<Eigen::Infinity>(), 1e-9);
}

TEST(LowPass, refuses_what_it_cannot_be) {
  EXPECT_THROW(LowPass(3, 10, 1000), std::invalid_argument);
  EXPECT_THROW(LowPass(4, 500, 1000), std::invalid_argument);
}

TEST(FilteredLog, is_the_protocol) {
  MeasuredLog log;
  constexpr Eigen::Index kCount = 3001;
  log.t.setLinSpaced(kCount, 5, 8);
  log.q.resize(kCount, 1);
  log.dq = log.tau = log.q;
  const double w = 2 * M_PI * 0.5;
  for (Eigen::Index i = 0; i < kCount; ++i) {
    log.q(i, 0) = std::sin(w * log.t[i]);
    log.dq(i, 0) = w * std::cos(w * log.t[i]);
    log.tau(i, 0) = 1.5;
  }
  const FilteredLog filtered = filter_log(log, 1);
  ASSERT_EQ(filtered.kept.size(), 261u);  // (3001 - 400) / 10, begun
  EXPECT_EQ(filtered.kept.front(), 200);
  EXPECT_EQ(filtered.kept[1], 210);
  const Eigen::MatrixXd ddq = filtered.kept_rows(filtered.ddq);
  for (Eigen::Index i = 0; i < ddq.rows();
       ++i) {  // of 10 rad/s^2: the effect of the 6 Hz filter's ends after 0.2 s
    EXPECT_NEAR(ddq(i, 0), -w * w * std::sin(w * filtered.t[filtered.kept[static_cast<std::size_t>(i)]]),
                0.05);
  }
  EXPECT_THROW(filter_log(log, 3.5), LogRefused);
}

TEST(Dahl, follows_its_differential_equation_and_never_drives) {
  // dz/dt = dq (1 - sign(dq) z / s), integrated by Heun's method with steps 50 times as fine.
  constexpr double kDt = 1e-3, kDistance = 0.02;
  constexpr int kFine = 50;
  Eigen::MatrixXd dq(4000, 1);
  const auto velocity = [](double t) { return 0.4 * std::sin(3 * t) + 0.2 * std::sin(7.3 * t); };
  for (Eigen::Index i = 0; i < dq.rows(); ++i) dq(i, 0) = velocity((static_cast<double>(i) + 0.5) * kDt);
  const Eigen::MatrixXd z = friction_column({FrictionKind::presliding, kDistance}, dq, dq, {}, kDt);
  double state = 0, worst = 0;
  if (std::abs(dq(0, 0)) > 0.02) FAIL() << "the motion should begin at rest";
  const auto rate = [&](double v, double x) { return v * (1 - (v > 0 ? 1 : -1) * x / kDistance); };
  for (Eigen::Index i = 0; i < dq.rows(); ++i) {
    for (int k = 0; k < kFine; ++k) {
      const double t = (static_cast<double>(i) + static_cast<double>(k) / kFine) * kDt, h = kDt / kFine;
      const double a = rate(velocity(t), state);
      state += h / 2 * (a + rate(velocity(t + h), state + h * a));
    }
    worst = std::max(worst, std::abs(z(i, 0) - state / kDistance));
  }
  EXPECT_LT(worst, 5e-4);
  EXPECT_LE(z.lpNorm<Eigen::Infinity>(), 1.0);
  EXPECT_GT((z.array() * dq.array()).sum(), 0);  // it dissipates energy over the whole motion
}

TEST(Dahl, begins_as_if_the_joint_had_been_moving) {
  const Eigen::MatrixXd fast = Eigen::MatrixXd::Constant(1, 1, -1.0), still = Eigen::MatrixXd::Zero(1, 1);
  const FrictionPart part{FrictionKind::presliding, 0.1};
  EXPECT_NEAR(friction_column(part, fast, fast, {}, 1e-3)(0, 0), -(1 - std::exp(-2.01)), 1e-12);
  EXPECT_EQ(friction_column(part, still, still, {}, 1e-3)(0, 0), 0);
}

// Dahl's law from a start at 1 minus the same from 0.
TEST(Dahl, the_part_of_a_start_fades_over_the_path) {
  Eigen::MatrixXd dq(3, 1);
  dq << 0.01, -0.02, 0.5;
  const double s = 1e-4;
  const Eigen::MatrixXd part = friction_column({FrictionKind::initial, s}, dq, dq, {}, 1e-3);
  double a = 1, b = 0;
  for (Eigen::Index i = 0; i < 3; ++i) {
    const double end = dq(i, 0) > 0 ? 1 : -1, kept = std::exp(-std::abs(dq(i, 0)) * 1e-3 / s);
    a = end + (a - end) * kept;
    b = end + (b - end) * kept;
    EXPECT_NEAR(part(i, 0), a - b, 1e-12);
  }
  const Eigen::MatrixXd moving = 10 * dq.topRows(1);
  EXPECT_EQ(friction_column({FrictionKind::initial, s}, moving, dq, {}, 1e-3)(0, 0), 0);
}

TEST(FrictionTorque, of_a_law_is_the_sum_of_its_columns) {
  FrictionLaw law;
  law.viscous = JointVector::Constant(1, 0.5);
  law.stribeck = JointVector::Constant(1, 0.2);
  law.presliding.push_back({0.01, JointVector::Constant(1, 0.3)});
  law.sigmoid =
      JointFriction{JointVector::Constant(1, 0.8), JointVector::Constant(1, 40.0), JointVector::Zero(1)};
  Eigen::MatrixXd dq(2, 1);
  dq << 0.0, 0.15;
  const double z = 1 - std::exp(-0.15e-3 / 0.01);
  const double expected = 0.5 * 0.15 + 0.2 * std::tanh(15.0) * std::exp(-0.25) + 0.3 * z +
                          0.4 * std::tanh(0.15 / 0.05);  // p1 40: a tanh of half the height
  EXPECT_NEAR(friction_torque(law, dq, 1e-3)(1, 0), expected, 1e-12);
}

RigidBody some_body(std::mt19937_64& random) {
  std::uniform_real_distribution<double> any(-1, 1);
  const Matrix3 A = Matrix3::NullaryExpr([&] { return any(random); });
  const Matrix3 S = 0.01 * (A * A.transpose() + 0.1 * Matrix3::Identity());  // second moment
  return {1 + any(random) / 2, 0.1 * Vector3::NullaryExpr([&] { return any(random); }),
          S.trace() * Matrix3::Identity() - S};
}

TEST(InertialParameters, come_back_and_are_possible_exactly_where_the_body_is) {
  std::mt19937_64 random(3);
  for (int i = 0; i < 50; ++i) {
    RigidBody body = some_body(random);
    const RigidBody back = body_of(theta_of(body));
    EXPECT_NEAR(back.mass, body.mass, 1e-14);
    EXPECT_LT((back.com - body.com).norm(), 1e-14);
    EXPECT_LT((back.inertia - body.inertia).norm(), 1e-14);
    if (i % 2 == 0) body.inertia(0, 0) *= 3;  // breaks the triangle inequality, mostly
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> solver(pseudo_inertia(theta_of(body)));
    EXPECT_EQ(is_physical(body), solver.eigenvalues().minCoeff() > 0);
    EXPECT_TRUE(is_physical(floored(body, 1e-4)));
  }
}

TEST(Divergence, is_zero_at_the_prior_and_has_the_derivatives_of_its_value) {
  std::mt19937_64 random(4);
  const Theta prior = theta_of(some_body(random)), at = theta_of(some_body(random));
  const Divergence divergence(prior);
  EXPECT_NEAR(divergence.value(prior), 0, 1e-12);
  EXPECT_GT(divergence.value(at), 0);
  EXPECT_FALSE(std::isfinite(divergence.value(-at)));
  Theta gradient, up, down;
  Eigen::Matrix<double, 10, 10> hessian;
  (void)divergence.value(at, &gradient, &hessian);
  for (int k = 0; k < 10; ++k) {
    const double h = 1e-6;
    const Theta step = h * Theta::Unit(k);
    const double slope = (divergence.value(at + step, &up) - divergence.value(at - step, &down)) / (2 * h);
    EXPECT_NEAR(gradient[k], slope, 1e-5 * (1 + std::abs(slope)));
    EXPECT_LT((hessian.col(k) - (up - down) / (2 * h)).norm(), 1e-4 * (1 + hessian.col(k).norm()));
  }
}

}  // namespace
}  // namespace multipanda::numbers_test
