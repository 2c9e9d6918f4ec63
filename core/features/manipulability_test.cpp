#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/features/builtins.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"
#include "models/arm_source.hpp"

namespace multipanda::manipulability_test {
namespace {

using namespace test;
using Eigen::MatrixXd;

// m from the singular values of a Jacobian, which no code under test computes.
double volume(const MatrixXd& J) { return singular_values(J).prod(); }

std::shared_ptr<const ArmModel> panda(const Pose& X_WB = {}) {
  return std::make_shared<const ArmModel>(arm_model_source(load_robot("fer"), X_WB, false));
}

JointVector within_limits(const ArmModel& model, Draw& draw) {
  JointVector q = model.limits().q_min;
  for (Eigen::Index i = 0; i < q.size(); ++i)
    q[i] = draw.uniform(model.limits().q_min[i], model.limits().q_max[i]);
  return q;
}

TEST(Manipulability, GradientAgreesWithFiniteDifferencesOnAnyArmAndBase) {
  Draw draw(11);
  int checked = 0;
  for (int trial = 0; trial < 120; ++trial) {
    const std::size_t n = 6 + static_cast<std::size_t>(trial % 3);
    const Pose X_WB = draw.pose(0.5), X_FE = draw.pose(0.2);
    const PlainArm plain(TestArm::make(n), X_WB, X_FE);
    ModelTerms terms(TestArm::make(n).model(X_WB));
    terms.set_config({X_FE, {}}, {}, {});
    const JointVector q = bent(n) + draw.joints(n, 1.0);
    terms.update(q, joint_constant(n, 0));
    const double m = volume(plain.jacobian(q));
    if (m < 3e-3) continue;  // near the kink, where the rounding acts
    ++checked;
    EXPECT_NEAR(terms.manipulability_terms().value, m, 1e-6 * m);
    EXPECT_NEAR(terms.manipulability(), m, 1e-9);
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      constexpr double h = 1e-5;
      JointVector above = q, below = q;
      above[i] += h;
      below[i] -= h;
      const double slope = (volume(plain.jacobian(above)) - volume(plain.jacobian(below))) / (2 * h);
      EXPECT_NEAR(terms.manipulability_gradient()[i], slope, 1e-6) << "joint " << i;
    }
  }
  EXPECT_GT(checked, 80);
}

TEST(Manipulability, TorqueIsTheGradientOfItsPotential) {
  Draw draw(12);
  const Models models{TestArm::make().model(draw.pose(0.3)), TestArm::make(8, 2).model(draw.pose(0.3))};
  ControlletRig rig(manipulability_feature(), models);
  const PlainArm plain(TestArm::make(), models[0]->X_WB());
  const double m_home = volume(plain.jacobian(bent(7)));
  rig.set("threshold", {1.2 * m_home});
  rig.set("gain_nm", {20});
  ASSERT_EQ(rig.start(), LawResult::ok);
  const auto potential = [&](const JointVector& q) {
    const double missing = std::max(0.0, 1.2 * m_home - volume(plain.jacobian(q)));
    return 20 * missing * missing;
  };
  bool below = false, above = false;
  for (int trial = 0; trial < 60; ++trial) {
    const JointVector q = bent(7) + draw.joints(7, 0.7);
    rig.place(0, q, joint_constant(7, 0));
    ASSERT_EQ(rig.update(), LawResult::ok);
    (potential(q) > 0 ? below : above) = true;
    for (Eigen::Index i = 0; i < 7; ++i) {
      constexpr double h = 1e-5;
      JointVector plus = q, minus = q;
      plus[i] += h;
      minus[i] -= h;
      EXPECT_NEAR(rig.tau(0)[i], -(potential(plus) - potential(minus)) / (2 * h), 1e-5);
    }
  }
  EXPECT_TRUE(below && above);
}

// Damping dissipates energy, does not move the hand, and vanishes with the push.
TEST(Manipulability, DampingActsOnSelfMotionsOnly) {
  Draw draw(13);
  const auto model = TestArm::make().model(draw.pose(0.3));
  ControlletRig with(manipulability_feature(), {model}), without(manipulability_feature(), {model});
  without.set("damping_nms_per_rad", {0});
  with.set("damping_nms_per_rad", {2});
  for (const double threshold : {1.0, 0.001}) {
    with.set("threshold", {threshold});
    without.set("threshold", {threshold});
    double taken = 0;
    for (int trial = 0; trial < 100; ++trial) {
      const JointVector q = bent(7) + draw.joints(7, 0.5), dq = draw.joints(7, 1);
      for (ControlletRig* rig : {&with, &without}) {
        rig->place(0, q, dq);
        ASSERT_EQ(rig->update(), LawResult::ok);
      }
      const JointVector damping = with.tau(0) - without.tau(0);
      const MatrixXd J = with.terms(0).J_V_WE();
      const Eigen::VectorXd null = null_direction(J);
      const Eigen::VectorXd expected = threshold > 0.5 ? Eigen::VectorXd(-2 * null * null.dot(dq)) : 0 * null;
      EXPECT_NEAR((damping - expected).norm(), 0, 1e-6);
      taken += damping.dot(dq);
    }
    EXPECT_LE(taken, 0);
    EXPECT_EQ(taken == 0, threshold < 0.5);
  }
}

// The law is bounded: m falls to zero at a singular pose, but its slope does not grow.
TEST(Manipulability, IsFiniteAndBoundedAtSingularPoses) {
  Draw draw(14);
  const auto model = panda();
  ControlletRig rig(manipulability_feature(), {model});
  ModelTerms terms(model);
  int singular = 0;
  for (int trial = 0; trial < 500; ++trial) {
    // Along the slope of m to where it is zero within rounding; then to a nearby point.
    JointVector q = within_limits(*model, draw);
    for (int k = 0; k < 50; ++k) {
      terms.update(q, joint_constant(7, 0));
      const Manipulability& m = terms.manipulability_terms();
      if (m.gradient.norm() < 1e-3) break;
      q -= 0.7 * m.value / m.gradient.squaredNorm() * m.gradient;
    }
    singular += volume(terms.J_V_WE()) < 1e-5 ? 1 : 0;
    if (trial % 3 != 0) q += draw.joints(7, std::pow(10.0, draw.uniform(-14, -1)));
    rig.place(0, q, draw.joints(7, 0.5));
    ASSERT_EQ(rig.update(), LawResult::ok);
    ASSERT_TRUE(rig.tau(0).allFinite());
    EXPECT_LE(rig.tau(0).norm(), 0.3 * std::sqrt(7.0) + 0.2 * 0.5 * std::sqrt(7.0));
    rig.place(0, q, joint_constant(7, 0));
    ASSERT_EQ(rig.update(), LawResult::ok);
    EXPECT_LE(rig.tau(0).lpNorm<Eigen::Infinity>(), 0.3);
  }
  EXPECT_GT(singular, 200);
}

TEST(Manipulability, FiguresOfAPanda) {
  Draw draw(15);
  const auto model = panda(draw.pose(0.5));
  ModelTerms terms(model);
  const JointVector still = joint_constant(7, 0);
  terms.update(model->q_home(), still);
  EXPECT_NEAR(terms.manipulability(), 0.080, 0.001);
  double largest_m = 0;
  for (int trial = 0; trial < 60; ++trial) {  // climbs from everywhere
    JointVector q = within_limits(*model, draw);
    for (int k = 0; k < 400; ++k) {
      terms.update(q, still);
      largest_m = std::max(largest_m, terms.manipulability());
      q += 0.5 * terms.manipulability_gradient();
      q = q.cwiseMax(model->limits().q_min).cwiseMin(model->limits().q_max);
    }
  }
  EXPECT_LT(largest_m, 0.132);
  EXPECT_GT(largest_m, 0.131);
}

// The self-motion manifold of a pose of E, traced from q in one direction: steps along the kernel of J, each
// corrected back to the pose. Largest m up to the first fall of more than `drop` below it.
double best_along(ModelTerms& terms, const JointVector& start, double direction, double drop) {
  const JointVector still = joint_constant(7, 0);
  JointVector q = start;
  terms.update(q, still);
  const Pose X = terms.X_WE();
  Eigen::VectorXd before = null_direction(terms.J_V_WE()) * direction;
  double best = terms.manipulability();
  for (int k = 0; k < 2000; ++k) {
    Eigen::VectorXd null = null_direction(terms.J_V_WE());
    if (null.dot(before) < 0) null = -null;
    before = null;
    q += 0.005 * null;
    for (int pull = 0; pull < 3; ++pull) {
      terms.update(q, still);
      const MatrixXd J = terms.J_V_WE();
      q += J.transpose() * (inverse(J * J.transpose()) * pose_error(X, terms.X_WE()));
    }
    terms.update(q, still);
    best = std::max(best, terms.manipulability());
    if (terms.manipulability() < best - drop) break;
  }
  return best;
}

// m after 100 s of a frictionless arm under a Cartesian impedance without posture.
double settled(const std::shared_ptr<const ArmModel>& model, const JointVector& q, double threshold,
               double gain) {
  ControlletRig arm(cartesian_impedance_controllet(), {model}), feature(manipulability_feature(), {model});
  feature.set("threshold", {threshold});
  feature.set("gain_nm", {gain});
  arm.set("nullspace_stiffness_nm_per_rad", {0});
  arm.set("translational_stiffness_n_per_m", {2000});
  arm.set("rotational_stiffness_nm_per_rad", {150});
  arm.place(0, q, joint_constant(7, 0));
  arm.input("pose").start(arm.terms(0).X_WE());
  EXPECT_EQ(arm.start(), LawResult::ok);
  EXPECT_EQ(feature.start(), LawResult::ok);
  for (int k = 0; k < 100'000; ++k) {
    EXPECT_EQ(arm.tick(1e-3), LawResult::ok);
    feature.place(0, arm.state(0).q, arm.state(0).dq);
    EXPECT_EQ(feature.update(), LawResult::ok);
    arm.integrate(1e-3, {feature.tau(0)}, 1);
  }
  return arm.terms(0).manipulability();
}

// The elbow moves to where m is m_0, or as large as the pose of the hand allows.
TEST(Manipulability, RisesToTheThresholdOrToItsMaximumOnTheSelfMotionManifold) {
  Draw draw(16);
  const auto model = panda(draw.pose(0.4));
  int tried = 0;
  for (int trial = 0; trial < 60 && tried < 2; ++trial) {
    const JointVector q = model->q_home() + draw.joints(7, 0.6);
    ModelTerms terms(model);
    terms.update(q, joint_constant(7, 0));
    const double m_start = terms.manipulability();
    if (m_start < 0.03 || m_start > 0.085) continue;
    // Uphill is one of the two directions.
    const double best = std::max(best_along(terms, q, 1, 1e-4), best_along(terms, q, -1, 1e-4));
    if (best > 0.1 || m_start > 0.93 * best) continue;
    ++tried;
    EXPECT_NEAR(settled(model, q, 0.1, 10), best, 0.01 * best) << "from " << m_start;
    // A push so near to its threshold is weak: 20 times the gain keeps the test short.
    const double threshold = 0.5 * (m_start + best);
    EXPECT_GE(settled(model, q, threshold, 200), 0.99 * threshold) << "from " << m_start;  // free beyond it
  }
  EXPECT_EQ(tried, 2);
}

// V = k (m_0 - m)^2 summed over the arms; the damping of self-motions fades within a tenth above m_0.
TEST(Manipulability, ShowsPotentialAndLargestTorque) {
  Draw draw(19);
  const Models models{TestArm::make().model(draw.pose(0.3)), TestArm::make(8, 2).model(draw.pose(0.3))};
  for (int trial = 0; trial < 20; ++trial) {
    ControlletRig rig(manipulability_feature(), models);
    double smallest = 1, potential = 0, m_0 = 0, m[2]{};
    for (std::size_t i = 0; i < 2; ++i) {
      const std::size_t n = models[i]->joint_count();
      const JointVector q = bent(n) + draw.joints(n, 0.4);
      rig.place(i, q, JointVector(draw.joints(n, 0.5)));
      const PlainArm plain(i == 0 ? TestArm::make() : TestArm::make(8, 2), models[i]->X_WB());
      m[i] = volume(plain.jacobian(q));
      smallest = std::min(smallest, m[i]);
      m_0 = std::max(m_0, 1.1 * m[i]);
    }
    const double k_m = 30;
    for (const double each : m) potential += k_m * (m_0 - each) * (m_0 - each);
    rig.set("gain_nm", {k_m});
    rig.set("threshold", {m_0});
    ASSERT_EQ(rig.start(), LawResult::ok);
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    EXPECT_NEAR(rig.output("manipulability")[0], smallest, 1e-9);
    EXPECT_NEAR(rig.output("potential_j")[0], potential, 1e-7);
    const double largest =
        std::max(rig.tau(0).lpNorm<Eigen::Infinity>(), rig.tau(1).lpNorm<Eigen::Infinity>());
    EXPECT_EQ(rig.output("largest_torque_nm")[0], largest);
  }
}

TEST(Manipulability, DampingFadesLinearlyAboveTheThreshold) {
  Draw draw(20);
  const Models models{TestArm::make().model(draw.pose(0.3))};
  ControlletRig rig(manipulability_feature(), models);
  const JointVector q = bent(7), dq = draw.joints(7, 0.5);
  rig.place(0, q, dq);
  const double m = volume(PlainArm(TestArm::make(), models[0]->X_WB()).jacobian(q));
  rig.set("damping_nms_per_rad", {0.4});
  ASSERT_EQ(rig.start(), LawResult::ok);
  const auto torque = [&](double share) {  // of the damping
    rig.set("threshold", {m / (1.1 - 0.1 * share)});
    EXPECT_EQ(rig.tick(0.001), LawResult::ok);
    return rig.tau(0);
  };
  const JointVector full = torque(1 - 1e-9);
  EXPECT_LT(full.dot(dq), 0);
  EXPECT_LT((PlainArm(TestArm::make(), models[0]->X_WB()).jacobian(q) * full).norm(), 1e-6);
  EXPECT_NEAR(-full.dot(dq), full.squaredNorm() / 0.4, 1e-6);  // d times the part of dq in the null space
  for (const double share : {0.1, 0.5, 0.9}) {
    EXPECT_LT((torque(share) - share * full).norm(), 1e-6 * full.norm() + 1e-9);
  }
  EXPECT_EQ(torque(-0.1).norm(), 0);
}

}  // namespace
}  // namespace multipanda::manipulability_test
