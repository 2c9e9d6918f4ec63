#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/controllets/task_spring.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"

// `ufic` and `force`, tested like the other laws; closed loops with MuJoCo are in tests/interaction/.
namespace multipanda::ufic_test {
namespace {

using namespace test;
using Eigen::MatrixXd;
using Eigen::VectorXd;

const Pose kTool{rotation_from_rpy({0.3, -0.2, 0.5}), Vector3(0.02, -0.01, 0.1)};

struct Bench {
  explicit Bench(const ControlletType& type, const Pose& X_WB = {}, std::size_t joints = 7)
      : arm(TestArm::make(joints)), plain(arm, X_WB, kTool), rig(type, {arm.model(X_WB)}) {
    rig.frames(0, {kTool, {}});
    rig.place(0, bent(joints), joint_constant(joints, 0));
    rig.state(0).has_wrench_estimate = true;
    rig.state(0).tau_J_d = joint_constant(joints, 0);
    rig.set("contact_threshold_n", {2});  // the estimate has no errors here
    rig.set("contact_motion_share", {0});
  }
  void feel(const Vector3& F) { rig.state(0).F_K_W_est.force() = F; }
  void want(const Vector3& F) {
    Target target;
    target.size = 6;
    target.duration_s = 0.4;
    std::copy_n(F.data(), 3, target.values.begin());
    rig.input("wrench").set(target);
  }
  void ticks(int count) {
    for (int i = 0; i < count; ++i) ASSERT_EQ(rig.tick(0.001), LawResult::ok);
  }
  double number(std::string_view output) { return rig.output(output)[0]; }
  TestArm arm;
  PlainArm plain;
  ControlletRig rig;
};

// In contact, filters at rest, tanks full: the torque is the stated sum, computed with explicit inverses.
TEST(Ufic, TorqueIsTheStatedLaw) {
  Draw draw(81);
  int checked = 0;
  for (int trial = 0; trial < 16; ++trial) {
    const std::size_t joints = trial % 2 == 0 ? 7 : 6;
    Bench bench(ufic_controllet(), draw.pose(1), joints);
    const Vector3 n = draw.vector3(1).normalized();
    bench.rig.set("press_direction", {n.x(), n.y(), n.z()});
    bench.rig.set("translational_stiffness_n_per_m", {400});
    bench.rig.set("force_integral_per_s", {0});
    bench.rig.set("force_proportional", {0.15});
    bench.rig.set("tangential_gain", {0.8});
    bench.rig.set("force_damping_n_s_per_m", {70});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Vector3 F_hat = 8 * n + n.cross(draw.vector3(3));
    bench.want(12 * n);
    bench.feel(F_hat);
    bench.ticks(3000);
    EXPECT_EQ(bench.number("in_contact"), 1);
    EXPECT_NEAR(bench.number("gamma_f"), 1, 1e-9);

    const Pose start = bench.rig.input("pose").pose();
    bench.rig.input("pose").set(pose_target(
        {exp_rotation(draw.vector3(0.2)) * start.rotation, start.position + draw.vector3(0.1)}, 1.0));
    bench.ticks(300);
    const JointVector q = bent(joints) + draw.joints(joints, 0.2), dq = draw.joints(joints, 0.5);
    bench.rig.place(0, q, dq);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    if (bench.rig.terms(0).task().floored) continue;
    ++checked;

    const Reference& pose = bench.rig.input("pose");
    const MatrixXd J = bench.plain.jacobian(q), M = bench.plain.mass(q);
    const MatrixXd Lambda = task_inertia(J, M);
    VectorXd K(6);
    K << 400, 400, 400, 20, 20, 20;
    const Matrix6 D = task_damping(Lambda, Matrix6(K.asDiagonal()), 1);
    const Eigen::AngleAxisd turn(pose.pose().rotation * bench.plain.end_effector(q).rotation.transpose());
    VectorXd F(6);
    F << 400 * (pose.pose().position - bench.plain.end_effector(q).position), 20 * turn.angle() * turn.axis();
    const VectorXd V = J * dq;
    F += D * (pose.twist().vector - V) + Lambda * pose.acceleration().vector;
    const double v_n = n.dot(Vector3(V.head(3)) - Vector3(pose.twist().linear()));
    F.head(3) += n * (12 + 0.15 * (12 - 8) - 70 * v_n) + 0.8 * (F_hat - n.dot(F_hat) * n);
    const MatrixXd N = null_space_projector(J, M);
    const VectorXd D_N = 2 * (10 * M.diagonal().array()).sqrt();
    const VectorXd null = N * (10 * (bent(joints) - q) - D_N.asDiagonal() * N.transpose() * dq);
    const VectorXd expected = J.transpose() * F + null + bench.plain.coriolis(q, dq);
    EXPECT_NEAR((bench.rig.tau(0) - expected).norm(), 0, 1e-4 * (1 + expected.norm())) << "trial " << trial;
  }
  EXPECT_GE(checked, 8);
}

// A force that may pull keeps to the bound, too, together with a spring that pulls the same way: within 60 N
// for the drawn hand at rest, whatever is felt.
TEST(Ufic, AForceThatMayPullKeepsToTheBound) {
  Draw draw(83);
  for (const auto& type : {ufic_controllet(), force_controllet()}) {
    double deepest = 0;
    for (int trial = 0; trial < 12; ++trial) {
      Bench bench(type, draw.pose(1));
      bench.rig.bound({});
      bench.rig.set("press_direction", {0, 0, -1});
      bench.rig.set("force_may_pull", {1});
      bench.rig.set("force_feedforward", {0});
      bench.rig.set("force_proportional", {5});
      bench.rig.set("force_integral_per_s", {20});
      bench.rig.set("force_integral_limit_n", {100});
      bench.rig.set("nullspace_stiffness_nm_per_rad", {0});
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      bench.want({0, 0, -3});
      bench.feel({draw.uniform(-10, 10), 0, -60});  // pressed far harder than desired
      bench.ticks(500);
      if (type.descriptor.type == "ufic") {
        const Pose X = bench.rig.input("pose").pose();
        bench.rig.input("pose").start(Pose{X.rotation, X.position + Vector3(0, 0, draw.uniform(-0.1, 0.1))});
      }
      bench.ticks(2000);
      if (bench.rig.terms(0).task().floored) continue;
      const JointVector q = bench.rig.state(0).q;
      const MatrixXd J = bench.plain.jacobian(q), M = bench.plain.mass(q);
      const Vector6 F = task_inertia(J, M) * J * inverse(M) * VectorXd(bench.rig.tau(0));
      EXPECT_LE(F.head<3>().norm(), 60 + 1e-6) << type.descriptor.type << ", trial " << trial;
      deepest = std::min(deepest, bench.number("force_command_n"));
    }
    EXPECT_LT(deepest, -20) << type.descriptor.type;  // it did pull
  }
}

// An estimate that is wrong by 30 N in free air: a force that may pull retreats from it, and feedback that
// always acts drives the hand after it, but no faster than the pull of a set-point may.
TEST(Ufic, AWrongEstimateDoesNotThrowTheHand) {
  struct Case {
    ControlletType type;
    double felt;
    bool back;
  };
  for (const auto& [type, felt, back] :
       {Case{ufic_controllet(), 30, true}, Case{force_controllet(), 30, true},
        Case{ufic_controllet(), -30, false}}) {
    Bench bench(type);
    bench.rig.bound({});
    for (const Preset& preset : type.descriptor.presets) {
      for (const auto& [parameter, values] : preset.values) {
        const std::size_t size = bench.rig.parameters().value_size(bench.rig.parameters().find(parameter));
        bench.rig.set(parameter, values.size() == size ? values : std::vector<double>(size, values[0]));
      }
    }
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.want({0, 0, -4});
    bench.feel({0, 0, -felt});
    double fastest = 0;
    for (int k = 0; k < 1200; ++k) {
      bench.ticks(1);
      bench.rig.integrate(0.001, {joint_constant(7, 0)}, 1);
      const double up = bench.rig.terms(0).V_WE().linear().z();
      fastest = std::max(fastest, back ? up : -up);
    }
    RecordProperty(type.descriptor.type + (back ? "_back" : "_forth"), std::to_string(fastest));
    EXPECT_GT(fastest, 0.05) << type.descriptor.type;
    EXPECT_LT(fastest, 1.5 * 0.25) << type.descriptor.type;
  }
}

// `always`: the feedback presses in free air, within the bound; by default it waits for the contact.
TEST(Ufic, FeedbackInFreeAirOnRequestOnly) {
  for (const bool always : {false, true}) {
    Bench bench(ufic_controllet());
    bench.rig.set("force_feedback", {always ? 1.0 : 0.0});
    bench.rig.set("force_feedforward", {0});
    bench.rig.set("force_proportional", {1});
    bench.rig.set("force_integral_per_s", {0});
    bench.rig.set("valve_law", {1});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.want({0, 0, -10});
    bench.feel({0, 0, 0});
    bench.ticks(2000);
    EXPECT_NEAR(bench.number("force_command_n"), always ? 10 : 0, 1e-6);
  }
}

// A hand held beside a tool that presses: what the arm feels across the pressing direction is what it pushes
// with, as from friction. Fed forward, it would grow for as long as the hand is held there.
TEST(Ufic, AHandInTheWayIsNoFrictionToOvercome) {
  for (const auto& type : {ufic_controllet(), force_controllet()}) {
    Bench bench(type);
    bench.rig.bound({});
    bench.rig.set("tangential_gain", {1});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.want({0, 0, -40});
    const auto force = [&]() -> Vector3 {
      const JointVector tau = bench.rig.tau(0);
      return Vector3((bench.rig.terms(0).task().J_bar.transpose() * tau).head<3>());
    };
    bench.feel({0, 0, -10});
    bench.ticks(500);
    ASSERT_EQ(bench.number("in_contact"), 1);
    const JointVector q_start = bench.rig.state(0).q;
    if (type.descriptor.type == "ufic") {
      Pose aside = bench.rig.input("pose").pose();
      aside.position.x() += 0.1;
      bench.rig.input("pose").set(pose_target(aside));
    } else {  // holds its pose, from which somebody has moved it
      JointVector q = bench.rig.state(0).q;
      for (int i = 0; i < 50; ++i) {
        Vector6 step = Vector6::Zero();
        step[0] = -0.05 / 50;
        q += bench.rig.terms(0).task().J_bar * step;
        bench.rig.place(0, q, joint_constant(7, 0));
      }
    }
    double across = 0, whole = 0;
    for (int k = 0; k < 8000; ++k) {
      bench.ticks(1);
      const Vector3 push = force();
      across = std::max(across, Vector3(push.x(), push.y(), 0).norm());
      whole = std::max(whole, push.norm());
      bench.feel({push.x(), push.y(), std::min(0.0, push.z())});  // the arm stands still and feels all of it
    }
    EXPECT_GT(across, 15) << type.descriptor.type;
    EXPECT_LE(whole, 60.5) << type.descriptor.type;
    // Let go, it presses again softly, and no harder than desired: nothing was stored meanwhile.
    double before = bench.number("force_command_n"), step = 0, most = 0;
    if (type.descriptor.type == "ufic")
      bench.rig.input("pose").start(bench.rig.terms(0).X_WE());
    else
      bench.rig.place(0, q_start, joint_constant(7, 0));
    for (int k = 0; k < 2000; ++k) {
      bench.ticks(1);
      const Vector3 push = force();
      bench.feel({push.x(), push.y(), std::min(0.0, push.z())});
      const double now = bench.number("force_command_n");
      step = std::max(step, std::abs(now - before));
      most = std::max(most, now);
      before = now;
    }
    EXPECT_LE(step, 0.5) << type.descriptor.type;
    EXPECT_LE(most, 40 * 1.1) << type.descriptor.type;
    // "force" has lost contact meanwhile, and approaches.
    if (type.descriptor.type == "ufic") {
      EXPECT_NEAR(before, 40, 1);
    }
  }
}

// A hand that is held while it presses obliquely, with the set-point below it: what is felt across the force
// is fed forward like friction, beside what the spring presses with.
TEST(Ufic, AHeldHandThatPressesObliquelyIsNotPushedBeyondTheBound) {
  Bench bench(ufic_controllet());
  bench.rig.bound({});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  Pose goal = bench.rig.terms(0).X_WE();
  goal.position += Vector3(0.05, 0, -0.2);
  bench.rig.input("pose").set(pose_target(goal, 2));
  bench.want({30, 0, -40});
  double largest = 0;
  for (int k = 0; k < 8000; ++k) {
    bench.ticks(1);
    const Vector3 push = (bench.rig.terms(0).task().J_bar.transpose() * bench.rig.tau(0)).head<3>();
    largest = std::max(largest, push.norm());
    bench.feel(push);  // all of it, in every direction
  }
  EXPECT_LE(largest, 60.5);
  EXPECT_GT(largest, 50);
}

// A set-point below the surface or beside the hand, and a force into it: not their sum presses on a hand.
TEST(Ufic, ForceAndSpringTogetherKeepToTheBound) {
  struct Case {
    double requested;
    Vector3 way;
  };
  for (const auto& [requested, way] :
       {Case{10, {0, 0, -0.3}}, Case{40, {0, 0, -0.3}}, Case{60, {0, 0, -0.3}}, Case{60, {0.3, 0, 0}},
        Case{60, {0.2, -0.1, -0.1}}, Case{60, {0, 0.12, 0}}}) {
    Bench bench(ufic_controllet());
    bench.rig.bound({});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    Pose goal = bench.rig.terms(0).X_WE();
    goal.position += way;
    bench.rig.input("pose").set(pose_target(goal));
    bench.want({0, 0, -requested});
    double largest = 0, forces = 0;
    for (int k = 0; k < 6000; ++k) {
      bench.ticks(1);
      const Vector3 push = (bench.rig.terms(0).task().J_bar.transpose() * bench.rig.tau(0)).head<3>();
      largest = std::max(largest, push.norm());
      forces = std::max(forces, bench.number("force_command_n"));
      bench.feel({0, 0, std::min(0.0, push.z())});  // the arm stands still: all of its push is felt
    }
    EXPECT_LE(largest, 60.5) << requested << " N, " << way.transpose();
    EXPECT_GT(largest, 45) << requested << " N, " << way.transpose();
    EXPECT_GT(forces, 5) << requested << " N, " << way.transpose();
  }
}

// The damping along the force pulls with the velocity of the set-point, in addition to the spring.
TEST(Ufic, DampingAlongTheForceIsPartOfThePull) {
  for (const auto& type : {ufic_controllet(), force_controllet()}) {
    Bench bench(type);
    bench.rig.bound({});
    bench.rig.set("force_damping_n_s_per_m", {300});
    const bool follows = type.descriptor.type == "ufic";
    if (!follows) bench.rig.set("approach_speed_m_per_s", {0.2});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    Pose below = bench.rig.terms(0).X_WE();
    below.position.z() -= 0.4;
    if (follows) bench.rig.input("pose").set(pose_target(below));
    bench.want({0, 0, -1});
    double largest = 0;
    for (int k = 0; k < 4000; ++k) {  // the arm is blocked where it is, and does not feel it
      bench.ticks(1);
      largest = std::max(largest,
                         (bench.rig.terms(0).task().J_bar.transpose() * bench.rig.tau(0)).head<3>().norm());
    }
    EXPECT_LE(largest, 60.5) << type.descriptor.type;
    EXPECT_GT(largest, 30) << type.descriptor.type;
  }
}

TEST(Ufic, IsZeroAtRestWithoutRequestedForce) {
  for (const auto& type : {ufic_controllet(), force_controllet()}) {
    Bench bench(type);
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.ticks(500);
    EXPECT_NEAR(bench.rig.tau(0).norm(), 0, 1e-9) << type.descriptor.type;
  }
}

TEST(Ufic, IsInvariantToThePoseOfTheWorld) {
  Draw draw(82);
  for (const auto& type : {ufic_controllet(), force_controllet()}) {
    const Pose X = draw.pose(2), X_WB = draw.pose(1);
    Bench here(type, X_WB), there(type, X * X_WB);
    const Vector3 n = draw.vector3(1).normalized(), F_hat = 7 * n + draw.vector3(2);
    const JointVector q = bent(7) + draw.joints(7, 0.02), dq = draw.joints(7, 0.2);
    for (auto* bench : {&here, &there}) {
      const Matrix3 R = bench == &here ? Matrix3(Matrix3::Identity()) : X.rotation;
      const Vector3 direction = R * n;
      bench->rig.set("press_direction", {direction.x(), direction.y(), direction.z()});
      bench->rig.set("translational_stiffness_n_per_m",
                     {400});  // with uneven stiffness, world axes would matter
      ASSERT_EQ(bench->rig.start(), LawResult::ok);
      bench->want(R * Vector3(10 * n));
      bench->feel(R * F_hat);
      bench->ticks(500);
      bench->rig.place(0, q, dq);
      bench->ticks(20);
    }
    EXPECT_GT(here.rig.tau(0).norm(), 1);
    EXPECT_NEAR((here.rig.tau(0) - there.rig.tau(0)).norm(), 0, 1e-7) << type.descriptor.type;
  }
}

// Empty tanks: no spring, no force outwards; only dampers.
TEST(Ufic, EmptyTanksLeaveOnlyDamping) {
  Draw draw(83);
  Bench bench(ufic_controllet());
  bench.rig.set("tank_start_j", {0});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  bench.want({0, 0, -20});
  bench.feel({0, 0, -20});
  const Pose start = bench.rig.input("pose").pose();
  bench.rig.input("pose").set(pose_target({start.rotation, start.position + Vector3(0.2, 0, 0)}, 1.0));
  bench.ticks(2000);
  EXPECT_EQ(bench.number("alpha_i"), -1);
  EXPECT_EQ(bench.number("alpha_f"), 0);
  EXPECT_NEAR(bench.rig.tau(0).norm(), 0, 1e-9);
  for (int trial = 0; trial < 50; ++trial) {
    const JointVector dq = draw.joints(7, 0.5);
    bench.rig.place(0, bent(7), dq);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    EXPECT_LT(dq.dot(bench.rig.tau(0) - bench.rig.terms(0).c()), 0);
  }
}

// For any motion: the energy that the arm and its spring gain, the tanks lose exactly. The test prescribes
// the motion of the arm, so the work of the torque follows from the path alone.
TEST(Ufic, TanksSupplyAllEnergyThatGoesIn) {
  Draw draw(84);
  for (int trial = 0; trial < 10; ++trial) {
    Bench bench(ufic_controllet());
    bench.rig.set("tank_start_j", {trial % 2 == 0 ? 50.0 : 0.15});
    bench.rig.set("translational_stiffness_n_per_m", {400});
    bench.rig.set("acceleration_feedforward", {trial % 3 == 0 ? 0.0 : 1.0});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const double tanks = bench.number("force_tank_j");
    EXPECT_EQ(tanks, 0);  // shown from the first tick on
    bench.want({0, 0, -15});
    bench.ticks(1);
    const double initial = bench.number("force_tank_j") + bench.number("impedance_tank_j");
    const Pose start = bench.rig.input("pose").pose();
    bench.rig.input("pose").set(
        pose_target({exp_rotation(draw.vector3(0.3)) * start.rotation, start.position + draw.vector3(0.2)}));
    const TaskStiffness K{400 * Matrix3::Identity(), 20 * Matrix3::Identity()};
    const JointVector direction = draw.joints(7, 0.15);
    JointVector q = bent(7), tau = bench.rig.tau(0);
    double into_arm = 0;
    for (int k = 1; k <= 1500; ++k) {
      const double t = 0.001 * k;
      const JointVector next = bent(7) + direction * std::sin(3 * t);
      into_arm += tau.dot(next - q);
      q = next;
      bench.rig.state(0).tau_J_d = tau;
      bench.feel({std::sin(5 * t), 0, -12 - 8 * std::sin(2 * t)});
      bench.rig.place(0, q, direction * 3 * std::cos(3 * t));
      ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
      tau = bench.rig.tau(0);
    }
    const double s = 1 + bench.number("alpha_i");
    const double spring =
        s * spring_energy(K, pose_error(bench.rig.input("pose").pose(), bench.plain.end_effector(q)));
    const double tank = bench.number("force_tank_j") + bench.number("impedance_tank_j");
    EXPECT_LE(into_arm + spring + tank, initial + 1e-9) << trial;  // less the overflow, which is zero here
    if (trial % 2 == 0) {
      EXPECT_NEAR(into_arm + spring + tank, initial, 1e-6) << trial;
    }
    EXPECT_GT(std::abs(into_arm), 0.01);
    // An overdraft is at most what a tick can take before the valve has closed.
    EXPECT_GT(bench.number("force_tank_j"), -0.02);
    EXPECT_GT(bench.number("impedance_tank_j"), -0.02);
  }
}

// A set-point that moves along with a fast arm takes a tenth of what its tank holds in one tick, and no more.
TEST(Ufic, ASetPointTakesATenthOfItsTankInATick) {
  Bench bench(ufic_controllet());
  bench.rig.set("tank_start_j", {0.15});
  bench.rig.set("tank_closing_j", {0.01});
  bench.rig.set("translational_stiffness_n_per_m", {400});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const Pose start = bench.rig.input("pose").pose();
  bench.rig.input("pose").set(pose_target({start.rotation, start.position + Vector3(0.2, 0, 0)}, 0.4));
  bench.ticks(60);
  const MatrixXd J = bench.plain.jacobian(bent(7));
  VectorXd V = VectorXd::Zero(6);
  V[0] = 3;
  const JointVector dq = J.transpose() * (J * J.transpose()).inverse() * V;
  bench.rig.place(0, bent(7), dq);
  ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
  const double tank = bench.number("impedance_tank_j");
  bench.rig.state(0).tau_J_d = bench.rig.tau(0);
  bench.rig.place(0, bent(7) + 0.001 * dq, dq);
  ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
  EXPECT_NEAR(0.001 * bench.number("power_feedforward_w"), 0.1 * tank, 1e-4);
}

// A force against the press direction would pull: it is no force, whatever its size.
TEST(Ufic, AForceOfTheWrongSignIsNone) {
  for (const auto& type : {ufic_controllet(), force_controllet()}) {
    Bench bench(type);
    bench.rig.set("press_direction", {0, 0, -1});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.feel({0, 0, -5});
    bench.want({0, 0, 20});
    bench.ticks(1000);
    EXPECT_EQ(bench.number("force_desired_n"), 0) << type.descriptor.type;
  }
}

TEST(Ufic, NotANumberIsAFault) {
  for (const auto& type : {ufic_controllet(), force_controllet()}) {
    for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
      for (int where = 0; where < 4; ++where) {
        Bench bench(type);
        ASSERT_EQ(bench.rig.start(), LawResult::ok);
        JointVector q = bent(7), dq = joint_constant(7, 0);
        if (where == 0) q[2] = bad;
        if (where == 1) dq[2] = bad;
        if (where == 2) bench.feel({0, bad, 0});
        if (where == 3) bench.rig.input("wrench").start_constant(bad);
        bench.rig.place(0, q, dq);
        EXPECT_EQ(bench.rig.tick(0.001), LawResult::fault) << type.descriptor.type << " " << where;
        // A new start from valid numbers succeeds.
        bench.feel({0, 0, 0});
        bench.rig.place(0, bent(7), joint_constant(7, 0));
        ASSERT_EQ(bench.rig.start(), LawResult::ok);
        EXPECT_EQ(bench.rig.tick(0.001), LawResult::ok);
      }
    }
  }
}

TEST(Ufic, WithoutAnEstimateItDoesNotStart) {
  for (const auto& type : {ufic_controllet(), force_controllet()}) {
    Bench bench(type);
    bench.rig.state(0).has_wrench_estimate = false;
    EXPECT_EQ(bench.rig.start(), LawResult::fault) << type.descriptor.type;
  }
}

// Everything that can change abruptly changes at the same time: the torque follows with a bounded rate.
TEST(Ufic, ContactCausesNoStep) {
  for (const auto& type : {ufic_controllet(), force_controllet()}) {
    Bench bench(type);
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.want({0, 0, -10});
    bench.ticks(1000);
    JointVector before = bench.rig.tau(0);
    bench.feel({0, 0, -10});
    for (int i = 0; i < 1000; ++i) {
      ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
      EXPECT_LT((bench.rig.tau(0) - before).cwiseAbs().maxCoeff(), 0.3) << type.descriptor.type << " " << i;
      before = bench.rig.tau(0);
    }
    EXPECT_EQ(bench.number("in_contact"), 1);
  }
}

// Against an elastic wall with the arm's own equations of motion: the controllet finds the wall and presses
// on it.
TEST(Force, FindsAWallAndPresses) {
  Bench bench(force_controllet());
  bench.rig.set("approach_speed_m_per_s", {0.05});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const Vector3 start = bench.rig.terms(0).X_WE().position;
  bench.want({0, 0, -12});
  double force = 0, filtered = 0;
  for (int i = 0; i < 4000; ++i) {
    ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    const double depth = start.z() - 0.02 - bench.rig.terms(0).X_WE().position.z();
    force = depth > 0 ? std::max(0.0, 5000 * depth - 100 * bench.rig.terms(0).V_WE().linear().z()) : 0.0;
    filtered += 0.17 * (force - filtered);  // as a 30 Hz observer
    bench.feel({0, 0, -filtered});
    Vector6 push = Vector6::Zero();
    push[2] = force;
    bench.rig.integrate(0.001, {bench.rig.terms(0).J_V_WE().transpose() * push}, 4);
  }
  EXPECT_NEAR(force, 12, 0.05);
  const auto error = bench.rig.output("position_error_m");
  EXPECT_LT(std::hypot(error[0], error[1]), 1e-3);
}

// Beyond the place of the last contact the force fades as exp(-d^2 / d_max^2); 5 mm beyond it, the law looks
// for a surface again.
TEST(Force, FadesBeyondTheLastContactAndThenApproachesAgain) {
  Bench bench(force_controllet());
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  bench.want({0, 0, -20});
  bench.feel({0, 0, -10});
  bench.ticks(600);
  ASSERT_EQ(bench.number("in_contact"), 1);
  bench.feel({0, 0, 0});
  bench.ticks(600);
  ASSERT_EQ(bench.number("in_contact"), 0);
  EXPECT_EQ(bench.number("approaching"), 0);
  EXPECT_EQ(bench.number("gamma_f"), 1);
  const double start = bench.rig.terms(0).X_WE().position.z();
  const auto advance_to = [&](double depth) {
    JointVector q = bench.rig.state(0).q;
    for (int i = 0; i < 20; ++i) {
      const double left = depth - (start - bench.rig.terms(0).X_WE().position.z());
      q += bench.rig.terms(0).task().J_bar * Vector6(-left * Vector6::Unit(2));
      bench.rig.place(0, q, joint_constant(7, 0));
    }
  };
  advance_to(0.004);
  bench.ticks(1);
  EXPECT_NEAR(bench.number("gamma_f"), std::exp(-std::pow(0.004 / 0.02, 2)), 1e-6);
  EXPECT_EQ(bench.number("approaching"), 0);
  advance_to(0.006);
  bench.ticks(1);
  EXPECT_NEAR(bench.number("gamma_f"), std::exp(-std::pow(0.006 / 0.02, 2)), 1e-6);
  EXPECT_EQ(bench.number("approaching"), 1);
}

// No surface: it continues at its speed, never faster.
TEST(Force, LooksForASurfaceSlowly) {
  Bench bench(force_controllet());
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const Vector3 start = bench.rig.terms(0).X_WE().position;
  bench.want({0, 0, -30});
  for (int i = 0; i < 2000; ++i) {
    ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    bench.rig.integrate(0.001, {joint_constant(7, 0)}, 2);
    ASSERT_LT(bench.rig.terms(0).V_WE().linear().norm(), 0.025) << i;
  }
  EXPECT_NEAR(start.z() - bench.rig.terms(0).X_WE().position.z(), 0.02 * 1.9, 0.005);
}

}  // namespace
}  // namespace multipanda::ufic_test
