#include "sysid/excitation/excitation.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "core/geometry/shape.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/series.hpp"
#include "core/testing/test_arm.hpp"
#include "models/arm_source.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::excitation_test {
namespace {

using test::Draw;

JointVector drawn(Draw& draw, double by) {
  JointVector v(7);
  for (Eigen::Index i = 0; i < 7; ++i) v[i] = draw.uniform(-by, by);
  return v;
}

// Against the core's model (Pinocchio): M ddq + c + g.
TEST(Excitation, RegressorIsInverseDynamics) {
  Draw draw(1);
  for (const char* name : {"fer", "fr3"}) {
    for (const bool hand : {false, true}) {
      const RobotDescription robot = load_robot(name);
      ModelTerms terms(std::make_shared<const ArmModel>(arm_model_source(robot, {}, hand)));
      DynamicsRegressor regressor(robot);
      const Eigen::VectorXd phi = link_parameters(robot, hand);
      for (int k = 0; k < 50; ++k) {
        const JointVector q = drawn(draw, 3), dq = drawn(draw, 2), ddq = drawn(draw, 10);
        terms.update(q, dq);
        const Eigen::VectorXd expected = terms.M() * ddq + terms.c() + terms.g();
        EXPECT_LT((regressor.evaluate(q, dq, ddq) * phi - expected).norm(), 1e-9 * (1 + expected.norm()));
      }
    }
  }
}

// Seven joints whose axes are not all parallel, the first one vertical: 43 of 70 parameters are identifiable
// (Gaz et al. 2019 give the same number for this arm).
TEST(Excitation, FindsTheBaseParameters) { EXPECT_EQ(BaseCondition(load_robot("fer")).parameters(), 43u); }

TEST(Excitation, EvolutionFindsTheMinimum) {
  const Eigen::Index n = 12;
  const auto value = [&](const Eigen::VectorXd& x) {  // narrow, not along the axes
    double sum = 0;
    for (Eigen::Index i = 0; i + 1 < n; ++i) {
      sum += 1e4 * std::pow(x[i] + x[i + 1] - 2, 2) + std::pow(x[i] - 1, 2);
    }
    return sum;
  };
  Evolution search(Eigen::VectorXd::Zero(n), Eigen::VectorXd::Constant(n, 0.5), 3);
  double least = 1e9;
  for (int k = 0; k < 2000; ++k) {
    std::vector<double> values;
    for (const auto& x : search.ask()) values.push_back(value(x));
    least = std::min(least, *std::min_element(values.begin(), values.end()));
    search.tell(values);
  }
  EXPECT_LT(least, 1e-6);
}

// Checks every limit again, independently of the optimizer: on a grid of half a millisecond, and from the
// run's own reference where the limit concerns the set-point.
void expect_within_limits(const RobotDescription& robot, const Excitation& excitation,
                          const ExcitationLimits& limits) {
  const auto& own = robot.limits;
  InputSpec spec{.name = "joints", .quantity = Quantity::joints};
  spec.max_speed = 10;
  Reference reference(spec, 7);
  reference.start(excitation.motion.q_start);
  Target target;
  target.delivery = Delivery::motion;
  target.size = 7;
  const Harmonic& series = excitation.motion.series;
  target.period_s = series.period_s;
  target.cycles = series.cycles;
  target.ramp_s = series.ramp_s;
  target.values = series.rise;
  target.sine = series.sine;
  target.harmonic_count = static_cast<std::uint8_t>(series.harmonic_count);
  target.harmonics = series.harmonics;
  ASSERT_EQ(reference.check(target), Verdict::accepted);
  reference.set(target);
  const ArmModelSource source = arm_model_source(robot, {}, true);
  ModelTerms terms(std::make_shared<const ArmModel>(source));
  terms.set_config(
      {}, {},
      {.mass = limits.payload, .p_FC = {0, 0, limits.reach / 2}, .inertia_C = 1e-3 * Matrix3::Identity()});
  constexpr double kDt = 0.0005;
  JointVector ddq_before = JointVector::Zero(7);
  double nearest = 1, least_room = 1;
  for (double t = 0; t < series.duration() + 0.2; t += kDt) {
    reference.advance(kDt, t);
    const JointVector &q = reference.joints(), &dq = reference.joint_velocity(),
                      &ddq = reference.joint_acceleration();
    terms.update(q, dq);
    const Eigen::VectorXd tau = terms.M() * ddq + terms.c() + terms.g();
    for (Eigen::Index i = 0; i < 7; ++i) {
      ASSERT_GT(q[i], own.q_min[i] + limits.position_margin - 1e-9);
      ASSERT_LT(q[i], own.q_max[i] - limits.position_margin + 1e-9);
      ASSERT_LT(std::abs(dq[i]), 1.0001 * limits.velocity_share * own.dq_max[i]);
      ASSERT_LT(std::abs(ddq[i]), 1.0001 * limits.acceleration_share * own.ddq_max[i]);
      ASSERT_LT(std::abs(ddq[i] - ddq_before[i]), 1.01 * limits.jerk_share * own.dddq_max[i] * kDt);
      ASSERT_LT(std::abs(tau[i]), 1.0001 * limits.torque_share * own.tau_max[i]);
    }
    ddq_before = ddq;
    if (std::fmod(t, 0.01) >= kDt) continue;
    const auto placed = [&](const CollisionShape& shape) {
      return shape.joint < 0 ? shape.X_JS : terms.X_WJ(static_cast<std::size_t>(shape.joint)) * shape.X_JS;
    };
    for (const auto& [a, b] : source.self_pairs) {
      const auto &A = source.collision_shapes[a], &B = source.collision_shapes[b];
      nearest = std::min(nearest, closest_points(A.shape, placed(A), B.shape, placed(B)).distance);
    }
    for (const auto& shape : source.collision_shapes) {
      if (shape.joint < 1) continue;
      for (int axis = 0; axis < 3; ++axis) {
        for (const double sign : {1.0, -1.0}) {
          const Pose X = placed(shape);
          const Vector3 way = X.rotation.transpose() * (sign * Vector3::Unit(axis));
          // Along the axis' sign.
          const double farthest = sign * (X * shape.shape.support(way))[axis] + shape.shape.radius;
          least_room = std::min(
              least_room, sign > 0 ? limits.room_max[axis] - farthest : -limits.room_min[axis] - farthest);
        }
      }
    }
  }
  EXPECT_GT(nearest, limits.self_distance - 1e-6);
  EXPECT_GT(least_room, -1e-6);
  EXPECT_LT((reference.joints() - excitation.motion.q_start).norm(), 1e-9);
  EXPECT_EQ(reference.joint_velocity().norm(), 0);
}

TEST(Excitation, IsTwiceAsGoodAsTheBestOfAHundredAndWithinLimits) {
  const RobotDescription robot = load_robot("fer");
  ExcitationOptions options;
  options.seed = 7;
  test::Series series;  // of one case, so that --full keeps its result
  if (!series.takes(true)) return;
  if (!series.full()) options.evaluations = 4000;  // a tenth of the search
  options.progress = [](const std::string& line) { std::printf("%s\n", line.c_str()); };
  const Excitation excitation = optimize_excitation(robot, options);
  // The random motions again, by singular values of the whole matrix instead of its square.
  const std::vector<Eigen::Index> columns = BaseCondition(robot).columns();
  DynamicsRegressor regressor(robot);
  const auto by_singular_values = [&](const ExcitationMotion& motion) {
    Eigen::MatrixXd Y(7 * 96, static_cast<Eigen::Index>(columns.size()));
    for (Eigen::Index k = 0; k < 96; ++k) {
      const auto s = motion.at(options.ramp + options.period * static_cast<double>(k) / 96);
      const Eigen::MatrixXd& whole = regressor.evaluate(s.q, s.dq, s.ddq);
      for (Eigen::Index c = 0; c < Y.cols(); ++c) {
        Y.block<7, 1>(7 * k, c) = whole.col(columns[static_cast<std::size_t>(c)]);
      }
    }
    Y.colwise().normalize();
    const Eigen::VectorXd values = test::singular_values(Y);
    return values[0] / values[values.size() - 1];
  };
  double best = 1e9;
  for (const auto& motion : random_motions(robot, options)) best = std::min(best, by_singular_values(motion));
  EXPECT_NEAR(by_singular_values(excitation.motion), excitation.condition, 1e-6 * excitation.condition);
  EXPECT_NEAR(best, excitation.random_best, 1e-6 * best);
  series.record("condition", excitation.condition);
  series.record("random_best", excitation.random_best);
  EXPECT_LT(excitation.condition, 0.5 * best);
  for (const auto& use : excitation.use) {
    std::printf("%-15s %5.1f %%  %s\n", use.name.c_str(), 100 * use.use, use.worst.c_str());
    EXPECT_LE(use.use, 1) << use.name << ": " << use.worst;
  }
  expect_within_limits(robot, excitation, options.limits);
}

}  // namespace
}  // namespace multipanda::excitation_test
