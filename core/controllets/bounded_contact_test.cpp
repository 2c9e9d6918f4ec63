// What every motion law has in common under bounds for contact: at each hand, pull and damping of the law
// without bounds give the wrench with bounds, by the rule of contact_bounds.hpp; and set-points wait.
#include <string>

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"

namespace multipanda::bounded_contact_test {
namespace {

using namespace test;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr ContactBounds kBounds{.hand_speed = 0.25, .spring_force = 60, .spring_moment = 15};

struct Law {
  ControlletType type;
  std::size_t arms;
  std::string input;
  bool scaled_as_a_whole;  // the direction of the pull in joint space is kept
  std::vector<std::pair<std::string, std::vector<double>>> parameters;
};

std::vector<Law> laws() {
  const std::pair<std::string, std::vector<double>> given{"damping_nms_per_rad", {9, 8, 7, 6, 3, 2, 1}};
  return {{joint_impedance_controllet(), 1, "joints", true, {}},
          {joint_impedance_controllet(), 1, "joints", true, {{"damping_design", {1}}}},
          {joint_impedance_controllet(), 1, "joints", true, {{"damping_design", {2}}, given}},
          {cartesian_impedance_controllet(), 1, "pose", false, {}},
          {dual_cartesian_impedance_controllet(), 2, "common_pose", false, {}},
          {dual_cartesian_impedance_controllet(), 2, "second_pose", false, {{"goals", {1}}}},
          {coupled_dual_cartesian_impedance_controllet(), 2, "pose", false, {}}};
}

struct Bench {
  Bench(const Law& law, Draw& draw) : rig(law.type, models(law, draw)) {
    for (const auto& [name, values] : law.parameters) rig.set(name, values);
  }

  Models models(const Law& law, Draw& draw) {
    Models all;
    for (std::size_t i = 0; i < law.arms; ++i) {
      const Pose X_WB{draw.rotation(), Vector3(0.1, i == 0 ? 0.4 : -0.4, 0.2)};
      // Poses far from singular: there the laws' inertia is the true one, as wrench() supposes.
      const TestArm arm = TestArm::make(7, i == 0 ? 1u : 3u);
      plain.emplace_back(arm, X_WB);
      all.push_back(arm.model(X_WB));
    }
    return all;
  }

  // The wrench of a torque at the hand of an arm: that of the dynamically consistent inverse, which does not
  // see what acts in the null space.
  VectorXd wrench(std::size_t arm, const VectorXd& q, const VectorXd& dq) {
    const MatrixXd J = plain[arm].jacobian(q), M = plain[arm].mass(q);
    const VectorXd tau = rig.tau(arm);
    return task_inertia(J, M) * J * inverse(M) * (tau - plain[arm].coriolis(q, dq));
  }

  std::vector<VectorXd> wrenches(const std::vector<JointVector>& q, const std::vector<JointVector>& dq,
                                 const ContactBounds& bounds) {
    rig.bound(bounds);
    for (std::size_t i = 0; i < q.size(); ++i) rig.place(i, q[i], dq[i]);
    EXPECT_EQ(rig.update(), LawResult::ok);
    std::vector<VectorXd> F;
    for (std::size_t i = 0; i < q.size(); ++i) F.push_back(wrench(i, q[i], dq[i]));
    return F;
  }

  std::vector<PlainArm> plain;
  ControlletRig rig;
};

// The input's set-point `ahead` of where it is now, by 0.3 m or 0.5 rad.
void aim(Bench& bench, const Law& law, Draw& draw) {
  Reference& input = bench.rig.input(law.input);
  Target target;
  target.duration_s = 1.0;
  if (law.input == "joints") {
    const JointVector q = input.joints() + draw.joints(7, 0.5);
    target.size = 7;
    std::copy(q.begin(), q.end(), target.values.begin());
  } else {
    const Pose X = input.pose();
    const Vector3 way = draw.vector3(1).normalized() * 0.3;
    target = pose_target({exp_rotation(draw.vector3(0.5)) * X.rotation, X.position + way}, 1.0);
  }
  input.set(target);
}

// The rule, written from its description.
VectorXd bounded(const Law& law, const VectorXd& P, const VectorXd& DV, const Vector3& v) {
  const auto part = [](const VectorXd& x, int i) { return Vector3(x.segment<3>(3 * i)); };
  double share[2];
  for (int i = 0; i < 2; ++i) {
    const double size = part(P, i).norm();
    const Vector3 n = part(P, i) / size;
    double most = i == 0 ? kBounds.spring_force : kBounds.spring_moment;
    double overcome = std::max(0.0, n.dot(part(DV, i)));
    if (const double speed = n.dot(v); i == 0 && speed > 0) {
      most *= std::max(0.0, 1 - speed / (1.5 * kBounds.hand_speed));
      if (speed > kBounds.hand_speed) overcome *= kBounds.hand_speed / speed;
    }
    share[i] = std::min(1.0, (most + overcome) / size);
  }
  if (law.scaled_as_a_whole) share[0] = share[1] = std::min(share[0], share[1]);
  VectorXd left = P;
  left.head<3>() *= share[0];
  left.tail<3>() *= share[1];
  return left - DV;
}

TEST(BoundedContact, PullAtEachHandIsBoundedByTheRuleOfEveryLaw) {
  Draw draw(97);
  for (const Law& law : laws()) {
    int changed = 0, whole = 0;
    for (int trial = 0; trial < 12; ++trial) {
      Bench bench(law, draw);
      std::vector<JointVector> q(law.arms), dq(law.arms), rest(law.arms, JointVector::Zero(7));
      for (std::size_t i = 0; i < law.arms; ++i) {
        q[i] = bent(7) + draw.joints(7, 0.1);
        bench.rig.place(i, q[i], rest[i]);
      }
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      aim(bench, law, draw);
      const int ticks = trial % 3 == 0 ? 60 : 700;  // little pull, much pull
      for (int t = 0; t < ticks; ++t) ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
      const double fast = trial % 2 == 0 ? 0.15 : 0.6;
      for (std::size_t i = 0; i < law.arms; ++i) dq[i] = draw.joints(7, fast);
      const auto P = bench.wrenches(q, rest, ContactBounds::lifted());  // no motion, no damping
      const auto F = bench.wrenches(q, dq, ContactBounds::lifted());
      const auto F_bounded = bench.wrenches(q, dq, kBounds);
      for (std::size_t i = 0; i < law.arms; ++i) {
        const VectorXd DV = P[i] - F[i];
        const Vector3 v = (bench.plain[i].jacobian(q[i]) * dq[i]).head<3>();
        const VectorXd expected = bounded(law, P[i], DV, v);
        EXPECT_LT((F_bounded[i] - expected).norm(), 1e-5 * (1 + P[i].norm()))
            << law.type.descriptor.type << ", trial " << trial << ", arm " << i;
        ((expected - F[i]).norm() > 1 ? changed : whole) += 1;
      }
    }
    EXPECT_GE(changed, 3) << law.type.descriptor.type;
    EXPECT_GE(whole, 3) << law.type.descriptor.type;
  }
}

// Hands that cannot follow: the set-point brakes where it pulls with the bound, and waits soon after.
TEST(BoundedContact, SetPointsWaitForHandsThatAreHeldBack) {
  Draw draw(98);
  for (const Law& law : laws()) {
    for (int trial = 0; trial < 4; ++trial) {
      Bench bench(law, draw);
      bench.rig.bound(kBounds);
      std::vector<JointVector> q(law.arms, bent(7)), rest(law.arms, JointVector::Zero(7));
      for (std::size_t i = 0; i < law.arms; ++i) bench.rig.place(i, q[i], rest[i]);
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      aim(bench, law, draw);
      double largest = 0;
      for (int t = 0; t < 4000; ++t) ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
      for (const VectorXd& P : bench.wrenches(q, rest, ContactBounds::lifted())) {
        largest = std::max(
            {largest, P.head<3>().norm() / kBounds.spring_force, P.tail<3>().norm() / kBounds.spring_moment});
      }
      EXPECT_LT(largest, 2.0) << law.type.descriptor.type;
      EXPECT_GT(largest, 0.7) << law.type.descriptor.type;
    }
  }
}

// A pose on the way from a bent to a stretched arm with the given smallest eigenvalue of A = J M^-1 J^T,
// below TaskSpace::kMobilityFloor.
JointVector nearly_stretched(const PlainArm& arm, const JointVector& stretched, double eigenvalue) {
  double near = 0, far = 1;  // share of the way
  const auto at = [&](double share) { return JointVector(bent(7) + share * (stretched - bent(7))); };
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (near + far);
    const MatrixXd J = arm.jacobian(at(middle));
    const double least = symmetric_eigenvalues(J * inverse(arm.mass(at(middle))) * J.transpose()).minCoeff();
    (least > eigenvalue ? near : far) = middle;
  }
  return at(near);
}

// Near the stretched elbow a small torque presses hard, as in a toggle press. There the laws' own inertia has
// a floor, and the null space leaks into the hand: a twentieth of the bounds at most.
TEST(BoundedContact, NearStretchedPosesTheHandPressesNoHarder) {
  Draw draw(100);
  for (const Law& law : laws()) {
    if (law.type.descriptor.type == "coupled_dual_cartesian_impedance")
      continue;  // hands that jump apart are a fault
    int bounded_ones = 0;
    for (const double eigenvalue : {0.015, 0.004, 0.001, 0.0003}) {
      Bench bench(law, draw);
      std::vector<JointVector> q(law.arms, bent(7)), rest(law.arms, JointVector::Zero(7));
      for (std::size_t i = 0; i < law.arms; ++i) bench.rig.place(i, q[i], rest[i]);
      ASSERT_EQ(bench.rig.start(), LawResult::ok);  // the posture of the null space is the bent one
      for (std::size_t i = 0; i < law.arms; ++i) {
        q[i] = nearly_stretched(bench.plain[i], draw.joints(7, 0.02), eigenvalue);
      }
      const auto free = bench.wrenches(q, rest, ContactBounds::lifted());
      const auto F = bench.wrenches(q, rest, kBounds);
      for (std::size_t i = 0; i < law.arms; ++i) {
        EXPECT_LT(F[i].head<3>().norm(), 1.0501 * kBounds.spring_force)
            << law.type.descriptor.type << eigenvalue;
        EXPECT_LT(F[i].tail<3>().norm(), 1.0501 * kBounds.spring_moment)
            << law.type.descriptor.type << eigenvalue;
        bounded_ones += (F[i] - free[i]).norm() > 1;
      }
    }
    EXPECT_GE(bounded_ones, 3) << law.type.descriptor.type;
  }
}

TEST(BoundedContact, NearStretchedPosesThePostureDrawsTheHandLittle) {
  Draw draw(101);
  Law law = laws()[3];
  ASSERT_EQ(law.type.descriptor.type, "cartesian_impedance");
  int leaks = 0;
  for (const double eigenvalue : {0.015, 0.004, 0.001, 0.0003}) {
    Bench bench(law, draw);
    bench.rig.place(0, bent(7), JointVector::Zero(7));
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const JointVector q = nearly_stretched(bench.plain[0], draw.joints(7, 0.02), eigenvalue);
    bench.rig.input("pose").start(bench.plain[0].end_effector(q));  // no pull but the posture's
    const VectorXd free = bench.wrenches({q}, {JointVector::Zero(7)}, ContactBounds::lifted())[0];
    const VectorXd F = bench.wrenches({q}, {JointVector::Zero(7)}, kBounds)[0];
    EXPECT_LT(F.head<3>().norm(), 0.0501 * kBounds.spring_force) << eigenvalue;
    EXPECT_LT(F.tail<3>().norm(), 0.0501 * kBounds.spring_moment) << eigenvalue;
    leaks += free.head<3>().norm() > 0.06 * kBounds.spring_force;
  }
  EXPECT_GE(leaks, 2);  // without bounds
}

// The paper's projector is not consistent with the dynamics: its posture draws the hand in every pose, not
// only near the stretched elbow.
TEST(BoundedContact, UnderThePapersProjectorThePostureDrawsTheHandLittle) {
  Draw draw(103);
  Law law = laws()[3];
  int leaks = 0;
  for (int trial = 0; trial < 20; ++trial) {
    law.parameters = {{"projector", {trial < 10 ? 1.0 : 2.0}}, {"nullspace_stiffness_nm_per_rad", {200}}};
    Bench bench(law, draw);
    bench.rig.place(0, bent(7), JointVector::Zero(7));
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const JointVector q = trial % 10 < 7 ? JointVector(bent(7) + draw.joints(7, 0.5))
                                         : nearly_stretched(bench.plain[0], draw.joints(7, 0.02), 0.004);
    bench.rig.input("pose").start(bench.plain[0].end_effector(q));  // no pull but the posture's
    const VectorXd free = bench.wrenches({q}, {JointVector::Zero(7)}, ContactBounds::lifted())[0];
    const VectorXd F = bench.wrenches({q}, {JointVector::Zero(7)}, kBounds)[0];
    EXPECT_LT(F.head<3>().norm(), 0.0501 * kBounds.spring_force) << trial;
    EXPECT_LT(F.tail<3>().norm(), 0.0501 * kBounds.spring_moment) << trial;
    leaks += free.head<3>().norm() > 0.06 * kBounds.spring_force;
  }
  EXPECT_GE(leaks, 10);  // without bounds
}

TEST(BoundedContact, OneBoundAloneIsNoneOfTheOther) {
  Draw draw(99);
  for (const Law& law : laws()) {
    Bench bench(law, draw);
    std::vector<JointVector> q(law.arms, bent(7)), rest(law.arms, JointVector::Zero(7));
    for (std::size_t i = 0; i < law.arms; ++i) bench.rig.place(i, q[i], rest[i]);
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    aim(bench, law, draw);
    for (int t = 0; t < 1000; ++t) ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    const auto free = bench.wrenches(q, rest, ContactBounds::lifted());
    const auto wide = bench.wrenches(q, rest, {.hand_speed = 10, .spring_force = 1e5, .spring_moment = 1e5});
    for (std::size_t i = 0; i < law.arms; ++i)
      EXPECT_LT((free[i] - wide[i]).norm(), 1e-8 * (1 + free[i].norm()));
  }
}

}  // namespace
}  // namespace multipanda::bounded_contact_test
