#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"

// The share of the force that `ufic` commands against the damping of its impedance: ForceShare tests the
// function that the law calls, this the law, with whatever damping it passes.
namespace multipanda::force_share_law_test {
namespace {

using namespace test;

constexpr double kForce = 30;  // [N]

// In free air the force acts only against a hand that comes in, and rises with its speed. By its own
// definition (smooth step, steepest slope 1.5 / width) that is a damper of at most n^T D n, with the
// impedance's own D; and of no less: a smaller one would let the hand come in freely.
TEST(UficForceShare, IsNoStifferADamperThanTheImpedance) {
  Draw draw(91);
  int checked = 0;
  for (int trial = 0; trial < 8; ++trial) {
    const Pose X_WB = draw.pose(1);
    const TestArm arm = TestArm::make();
    const PlainArm plain(arm, X_WB, {});
    ControlletRig rig(ufic_controllet(), {arm.model(X_WB)});
    const double stiffness = trial % 2 == 0 ? 400 : 900, zeta = trial % 4 < 2 ? 1.0 : 0.6;
    const JointVector q = bent(7) + draw.joints(7, 0.2);
    rig.place(0, q, joint_constant(7, 0));
    rig.state(0).has_wrench_estimate = true;
    rig.state(0).tau_J_d = joint_constant(7, 0);
    const Vector3 n = draw.vector3(1).normalized();
    rig.set("press_direction", {n.x(), n.y(), n.z()});
    rig.set("translational_stiffness_n_per_m", {stiffness});
    rig.set("damping_ratio", {zeta});
    ASSERT_EQ(rig.start(), LawResult::ok);
    Target wrench;
    wrench.size = 6;
    wrench.duration_s = 0.1;
    for (int i = 0; i < 3; ++i) wrench.values.at(static_cast<std::size_t>(i)) = kForce * n[i];
    rig.input("wrench").set(wrench);
    for (int i = 0; i < 1500; ++i) ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    ASSERT_EQ(rig.output("in_contact")[0], 0);
    ASSERT_NEAR(rig.output("force_desired_n")[0], kForce, 1e-9);
    if (rig.terms(0).task().floored) continue;
    ++checked;

    const Eigen::MatrixXd J = plain.jacobian(q), M = plain.mass(q);
    Eigen::VectorXd K(6);
    K << stiffness, stiffness, stiffness, 20, 20, 20;
    const Eigen::MatrixXd D = modal_damping(task_inertia(J, M), K.asDiagonal(), zeta);
    const double damping = n.dot(Eigen::Matrix3d(D.topLeftCorner(3, 3)) * n);
    // The hand moves along n only, at a speed of -v.
    Eigen::VectorXd along = Eigen::VectorXd::Zero(6);
    along.head(3) = n;
    const JointVector way = J.transpose() * (J * J.transpose()).inverse() * along;
    const auto command = [&](double v) -> double {
      rig.place(0, q, -v * way);
      EXPECT_EQ(rig.update(), LawResult::ok);
      return rig.output("force_command_n")[0];
    };
    const double width = 1.5 * kForce / damping;
    constexpr double kStep = 1e-4;
    double steepest = 0;
    for (double v = 0; v < 1.1 * width; v += width / 50) {
      steepest = std::max(steepest, (command(v + kStep) - command(v)) / kStep);
    }
    EXPECT_LT(steepest, 1.01 * damping) << trial;
    EXPECT_GT(steepest, 0.97 * damping) << trial;
    EXPECT_NEAR(command(0), 0, 1e-9);
    EXPECT_NEAR(command(1.5 * width), kForce, 1e-6);
  }
  EXPECT_GE(checked, 4);
}

}  // namespace
}  // namespace multipanda::force_share_law_test
