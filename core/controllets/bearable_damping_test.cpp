#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/features/builtins.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/lagging_motors.hpp"
#include "core/testing/test_arm.hpp"
#include "models/arm_source.hpp"

namespace multipanda::bearable_damping_test {
namespace {

using namespace test;
using Eigen::MatrixXd;
using Eigen::VectorXd;

std::shared_ptr<const ArmModel> arm(const char* robot, bool hand, double motor_inertia) {
  ArmModelSource source = arm_model_source(load_robot(robot), {}, hand);
  if (motor_inertia > 0) source.motor_inertia = joint_constant(7, motor_inertia);
  return std::make_shared<const ArmModel>(std::move(source));
}

// The joint impedance example of the manufacturer's library.
const std::vector<double> kExampleStiffness{600, 600, 600, 600, 250, 150, 50};
const std::vector<double> kExampleDamping{50, 50, 50, 50, 30, 25, 15};

// Largest eigenvalue, by size, of one period of M ddq = -D dq (- K q): the torque acts one period late,
// behind motors of the given bandwidth (0: none).
double growth(const MatrixXd& M, const VectorXd& K, const VectorXd& D, double bandwidth_hz) {
  constexpr int kSteps = 10;
  constexpr double kStep = 0.001 / kSteps;
  const double fade = bandwidth_hz > 0 ? std::exp(-2 * std::numbers::pi * bandwidth_hz * kStep) : 0;
  const MatrixXd M_inverse = inverse(M);
  MatrixXd cycle(28, 28);
  for (Eigen::Index i = 0; i < 28; ++i) {
    VectorXd x = VectorXd::Unit(28, i);
    const VectorXd command = -K.cwiseProduct(x.segment(0, 7)) - D.cwiseProduct(x.segment(7, 7));
    for (int k = 0; k < kSteps; ++k) {
      x.segment(14, 7) = (fade * x.segment(14, 7) + (1 - fade) * x.segment(21, 7)).eval();
      x.segment(7, 7) += kStep * M_inverse * x.segment(14, 7);
      x.segment(0, 7) += kStep * x.segment(7, 7);
    }
    x.segment(21, 7) = command;
    cycle.col(i) = x;
  }
  return eigenvalues(cycle).cwiseAbs().maxCoeff();
}

JointVector anywhere(const ArmModel& model, Draw& draw) {
  JointVector q = joint_constant(7, 0);
  for (Eigen::Index i = 0; i < 7; ++i) q[i] = draw.uniform(model.limits().q_min[i], model.limits().q_max[i]);
  return q;
}

// In 100 drawn poses each joint's inertia, the others free, is hardly below the least one.
TEST(LeastInertia, IsFoundInAnyPose) {
  Draw draw(21);
  for (const bool hand : {false, true}) {
    const auto model = arm("fer", hand, 0);
    ModelTerms terms(model);
    for (int trial = 0; trial < 100; ++trial) {
      terms.update(anywhere(*model, draw), joint_constant(7, 0));
      const MatrixXd M_inverse = inverse(terms.M());
      for (Eigen::Index i = 0; i < 7; ++i) EXPECT_GT(1 / M_inverse(i, i), 0.8 * model->least_inertia()[i]);
    }
    const auto with_motors = arm("fer", hand, 0.1);
    EXPECT_GT((with_motors->least_inertia() - model->least_inertia()).minCoeff(), 0.09);
  }
}

// Every joint at its bound is stable alone; all at once, too, behind motors that lag.
TEST(BearableDamping, IsStableInEveryPose) {
  Draw draw(22);
  for (const double motors : {0.0, 0.1}) {
    const auto model = arm("fr3", true, motors);
    const JointVector most = bearable_damping(*model);
    for (int trial = 0; trial < 50; ++trial) {
      ModelTerms terms(model);
      terms.update(anywhere(*model, draw), joint_constant(7, 0));
      MatrixXd M = terms.M();
      M.diagonal().array() += motors;
      for (Eigen::Index i = 0; i < 7; ++i) {
        VectorXd alone = VectorXd::Zero(7);
        alone[i] = most[i];
        EXPECT_LT(growth(M, VectorXd::Zero(7), alone, 0), 1 + 1e-9) << i;
        EXPECT_LT(growth(M, VectorXd::Zero(7), alone, 50), 1 + 1e-9) << i;
      }
    }
  }
}

// The example is unstable on a plant whose joints have no motors, and stable with the assumed ones.
TEST(BearableDamping, SeparatesTheExampleWithAndWithoutMotors) {
  Draw draw(23);
  const VectorXd K = Eigen::Map<const VectorXd>(kExampleStiffness.data(), 7);
  const VectorXd D = Eigen::Map<const VectorXd>(kExampleDamping.data(), 7);
  for (const char* robot : {"fer", "fr3"}) {
    const auto bare = arm(robot, true, 0), real = arm(robot, true, 0.1);
    ModelTerms terms(bare);
    MatrixXd M = terms.M();
    EXPECT_GT(growth(M, K, D, 0), 1.05);
    EXPECT_GT(growth(M, K, D, 50), 1.05);
    for (int trial = 0; trial < 20; ++trial) {
      terms.update(anywhere(*bare, draw), joint_constant(7, 0));
      M = terms.M();
      M.diagonal().array() += 0.1;
      EXPECT_LT(growth(M, K, D, 0), 1);
    }
    EXPECT_LT(bearable_damping(*bare)[6], 15);
    EXPECT_TRUE((bearable_damping(*real) - D).minCoeff() > 0) << bearable_damping(*real).transpose();
  }
}

TEST(BearableDamping, BoundsTheParameterWithAReason) {
  for (const double motors : {0.0, 0.1}) {
    const auto model = arm("fer", true, motors);
    const ControlletType type = joint_impedance_controllet();
    ParameterSet parameters(type.descriptor.parameters, 7);
    const Models models{model};
    type.create(models)->bound_parameters(parameters);
    const std::size_t i = parameters.find("damping_nms_per_rad");
    EXPECT_EQ(parameters.check(i, kExampleDamping), motors > 0 ? Verdict::accepted : Verdict::out_of_bounds);
    EXPECT_EQ(parameters.check(i, std::vector<double>{2, 2, 2, 1, 1, 1, 0.5}), Verdict::accepted);
    EXPECT_EQ(parameters.bound_reason(i).find("no motor inertia") != std::string::npos, motors == 0);
  }
}

// The damping of each joint alone, sqrt(K_i M_ii), counts the inertia of the joint while all others stand
// still. With them free, it is a fraction of that: at the greatest damping ratio some poses were unstable, on
// arms with motors, too.
TEST(BearableDamping, BoundsTheDampingThatIsDesignedForEachJointAlone) {
  Draw draw(24);
  const auto model = arm("fr3", true, 0.1);
  ControlletRig rig(joint_impedance_controllet(), {model});
  rig.set("damping_design", {1});
  rig.set("damping_ratio", {2});
  const VectorXd K = Eigen::Map<const VectorXd>(kExampleStiffness.data(), 7);
  int fast = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const JointVector q = anywhere(*model, draw);
    rig.place(0, q, joint_constant(7, 0));
    ASSERT_EQ(rig.start(), LawResult::ok);
    VectorXd D(7);
    for (Eigen::Index i = 0; i < 7; ++i) {
      rig.place(0, q, JointVector::Unit(7, i));
      ASSERT_EQ(rig.update(), LawResult::ok);
      D[i] = (rig.terms(0).c() - rig.tau(0))[i];
    }
    MatrixXd M = rig.terms(0).M();
    fast += (D - 4 * (K.array() * M.diagonal().array()).sqrt().matrix()).cwiseAbs().maxCoeff() > 1e-6;
    M.diagonal().array() += 0.1;
    EXPECT_LT(growth(M, K, D, 0), 1) << trial;
    EXPECT_LT(growth(M, K, D, 50), 1) << trial;
  }
  EXPECT_GT(fast, 0);   // the bound acts in some poses,
  EXPECT_LT(fast, 60);  // and not in all
}

// A joint with little inertia gets less of the one damping that the feature has for all.
TEST(BearableDamping, LimitsTheDampingAtJointLimits) {
  const auto model = arm("fer", false, 0);
  const double most = bearable_damping(*model)[6];
  ASSERT_LT(most, 20);
  ControlletRig rig(joint_limits_feature(), {model});
  rig.set("damping_nms_per_rad", {20});
  rig.set("stiffness_nm_per_rad", {0});
  ASSERT_EQ(rig.start(), LawResult::ok);
  JointVector q = model->q_home(), dq = joint_constant(7, 0);
  q[6] = model->limits().q_max[6];
  dq[6] = 0.5;
  rig.place(0, q, dq);
  ASSERT_EQ(rig.update(), LawResult::ok);
  EXPECT_NEAR(rig.tau(0)[6], -most * 0.5, 1e-12);
}

// Laws at the bounds of their gains, linearized in drawn poses, behind motors of 50 Hz and one or two periods
// of delay, with rotors of which the model says nothing, or none. 1000 N m/rad on a wrist, or 5000 N/m and
// 300 N m/rad with a damping ratio of 0.1, grew by 1.1 and more per period.
class BearableGains : public testing::TestWithParam<const char*> {
 public:
  static double growth_of(ControlletRig& rig, const JointVector& q, double rotors, int delay) {
    rig.place(0, q, joint_constant(7, 0));
    EXPECT_EQ(rig.start(), LawResult::ok);
    MatrixXd M = rig.terms(0).M();
    M.diagonal().array() += rotors;
    const auto torque = [&](const JointVector& moved, const JointVector& dq) {
      rig.place(0, moved, dq);
      EXPECT_EQ(rig.update(), LawResult::ok);
      return JointVector(rig.tau(0) - rig.terms(0).c());
    };
    return growth_behind_motors(torque, q, M, delay);
  }
};

TEST_P(BearableGains, AreStableAtTheirBounds) {
  Draw draw(25);
  for (const char* robot : {"fer", "fr3", "fr3v2"}) {
    for (const bool hand : {false, true}) {
      const auto model = arm(robot, hand, 0);
      const ControlletType type = std::string(GetParam()) == "joint_impedance"
                                      ? joint_impedance_controllet()
                                      : cartesian_impedance_controllet();
      ControlletRig rig(type, {model});
      for (int trial = 0; trial < 12; ++trial) {
        std::string gains;
        for (const ParameterSpec& spec : type.descriptor.parameters) {
          const bool gain = spec.name.find("stiffness_n") != spec.name.npos || spec.name == "damping_ratio";
          if (!gain || spec.name.starts_with("nullspace")) continue;
          // Least or greatest; a joint without stiffness drifts, so that its eigenvalue is 1.
          const double value =
              spec.name == "damping_ratio" || trial % 2 == 0 ? (draw.coin() ? spec.max : spec.min) : spec.max;
          rig.set(spec.name, {value});
          gains += " " + spec.name + " " + std::to_string(value);
        }
        const JointVector q = pose_within_limits(draw, *model);
        rig.place(0, q, joint_constant(7, 0));
        if (rig.terms(0).task().floored) continue;  // the posture moves the hand there
        for (const double rotors : {0.0, 0.1, 0.4}) {
          // The soft posture is not consistent with an inertia that the model does not know, nor passive.
          const bool posture = std::string(GetParam()) == "cartesian_impedance";
          const double most = !posture ? 1e-6 : rotors > 0 ? 3e-3 : 5e-5;
          for (const int delay : {1, 2})
            EXPECT_LT(growth_of(rig, q, rotors, delay), 1 + most)
                << robot << hand << " rotors " << rotors << " delay " << delay << gains;
        }
      }
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Laws, BearableGains, testing::Values("joint_impedance", "cartesian_impedance"));

}  // namespace
}  // namespace multipanda::bearable_damping_test
