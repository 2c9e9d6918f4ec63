#include <array>

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_arm.hpp"

// `ufic` along one direction, its default, as it was before it knew axes: torques recorded then.
namespace multipanda::ufic_recorded_test {
namespace {

using namespace test;

using Sums = std::array<double, 7>;
struct Case {
  double valve_law, force_feedback, tank_start_j;
  bool bounded;
  Sums recorded;  // per joint: sum of cos(0.1 t + joint) tau over all ticks t [N m]
};

// Path, force and estimate are given, so nothing feeds back. Contact comes and goes, F_d turns, the estimate
// has a part across, the end effector is redefined.
Sums sums_of(const Case& of) {
  const Pose X_WB{rotation_from_rpy({0.3, -0.2, 0.7}), Vector3(0.1, 0.2, -0.1)};
  ControlletRig rig(ufic_controllet(), {TestArm::make(7).model(X_WB)});
  rig.frames(0, {{rotation_from_rpy({0.3, -0.2, 0.5}), Vector3(0.02, -0.01, 0.1)},
                 {rotation_from_rpy({0.1, 0.2, 0.3}), Vector3(0.01, 0.02, -0.03)}});
  rig.place(0, bent(7), joint_constant(7, 0));
  rig.state(0).has_wrench_estimate = true;
  rig.state(0).tau_J_d = joint_constant(7, 0);
  if (of.bounded) rig.bound({});
  rig.set("contact_threshold_n", {2});
  rig.set("contact_motion_share", {0});
  rig.set("valve_law", {of.valve_law});
  rig.set("force_feedback", {of.force_feedback});
  rig.set("tank_start_j", {of.tank_start_j});
  EXPECT_EQ(rig.start(), LawResult::ok);
  Sums sums{};
  for (int t = 0; t < 4000; ++t) {
    const double s = 0.001 * t;
    if (t % 1000 == 100) {
      Target target;
      target.size = 6;
      target.duration_s = 0.3;
      const double x = t == 2100 ? 12 : -3, z = t == 3100 ? -2 : -14;
      target.values = {x, 2, z, 0.5, -1, 2};
      rig.input("wrench").set(target);
    }
    if (t == 500) {
      const Pose X = rig.input("pose").pose();
      rig.input("pose").set(pose_target(
          {exp_rotation({0.1, -0.2, 0.1}) * X.rotation, X.position + Vector3(0.05, -0.02, -0.08)}, 2));
    }
    if (t == 2700) rig.redefine(0, {rotation_from_rpy({0.2, 0.1, -0.3}), Vector3(0.03, 0.02, 0.06)});
    rig.state(0).F_K_W_est.vector.setZero();
    if (t % 1500 > 300)
      rig.state(0).F_K_W_est.vector << 3 * std::sin(7 * s), 2, -9 - 6 * std::sin(11 * s), 0.3, 0.2, 0.1;
    JointVector q = bent(7), dq = joint_constant(7, 0);
    for (int j = 0; j < 7; ++j) {
      q[j] += 0.05 * std::sin((1 + 0.3 * j) * s);
      dq[j] = 0.05 * (1 + 0.3 * j) * std::cos((1 + 0.3 * j) * s);
    }
    rig.state(0).tau_J_d = rig.tau(0);
    rig.place(0, q, dq);
    EXPECT_EQ(rig.tick(0.001), LawResult::ok);
    for (int j = 0; j < 7; ++j) sums[static_cast<std::size_t>(j)] += std::cos(0.1 * t + j) * rig.tau(0)[j];
  }
  return sums;
}

// Where they were recorded every torque was the same to the bit; elsewhere sines round another last digit.
TEST(UficRecorded, AlongOneDirectionTheTorquesAreAsRecorded) {
  const Case cases[] = {{0,
                         0,
                         100,
                         true,
                         {-6.293300432608901, 174.09817876571631, -133.03112816474999, -45.191020321560124,
                          -143.88939477052696, -91.292445273678439, 23.696706625834508}},
                        {0,
                         0,
                         100,
                         false,
                         {9.6821498289636665, 158.92725610306215, -222.42184845851142, -26.551285416557107,
                          -193.82472347334647, -116.37287324203268, 6.0831889941807402}},
                        {1,
                         1,
                         0.3,
                         true,
                         {59.622660858624926, 143.64203455640782, -172.02450646927261, -20.352675396566148,
                          -135.35204681789918, -91.852303816412672, -14.042680671517033}}};
  for (const Case& of : cases) {
    const Sums sums = sums_of(of);
    for (std::size_t j = 0; j < 7; ++j) EXPECT_NEAR(sums[j], of.recorded[j], 1e-9) << j;
  }
}

}  // namespace
}  // namespace multipanda::ufic_recorded_test
