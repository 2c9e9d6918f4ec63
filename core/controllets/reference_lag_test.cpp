// Tasks 1 and 2 as the reference code runs them, on a Panda with an exact model and no friction: its damping
// of the velocity alone makes the arm lag behind its set-point by D v / K.
#include <array>
#include <numbers>

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_arm.hpp"
#include "models/arm_source.hpp"

namespace multipanda::reference_lag_test {
namespace {

using namespace test;
using std::numbers::pi;

std::shared_ptr<const ArmModel> panda() {
  return std::make_shared<const ArmModel>(arm_model_source(load_robot("fer"), {}, true));
}

void use_preset(const ControlletType& type, const std::string& name, ControlletRig& rig) {
  for (const Preset& preset : type.descriptor.presets) {
    if (preset.name != name) continue;
    for (const auto& [parameter, values] : preset.values) {
      const std::size_t size = rig.parameters().value_size(rig.parameters().find(parameter));
      rig.set(parameter, values.size() == size ? values : std::vector<double>(size, values[0]));
    }
    return;
  }
  FAIL() << type.descriptor.type << " has no preset " << name;
}

struct Peak {
  double speed = 0, lag = 0;  // at the greatest speed after the first period
  void see(double v, double e) {
    if (v <= speed) return;
    speed = v;
    lag = e;
  }
};

JointVector start_pose() {
  JointVector q(7);
  q << 0, -pi / 4, 0, -3 * pi / 4, 0, pi / 2, pi / 4;
  return q;
}

// With the torque two periods late, an arm that was pushed comes to rest under every preset, and under the
// least damping that can be given to stiff springs.
struct Calm {
  const char* preset;
  std::vector<std::pair<std::string, std::vector<double>>> more;
};

TEST(ReferenceStability, APushedArmComesToRestBehindTwoPeriods) {
  const Calm undamped{"reference",
                      {{"translational_stiffness_n_per_m", {5000, 5000, 5000}},
                       {"rotational_stiffness_nm_per_rad", {100, 100, 100}},
                       {"nullspace_stiffness_nm_per_rad", {50}},
                       {"translational_damping_n_s_per_m", {0, 0, 0}},
                       {"rotational_damping_nm_s_per_rad", {0, 0, 0}},
                       {"nullspace_damping_nm_s_per_rad", {0}}}};
  Draw draw(71);
  const ControlletType type = cartesian_impedance_controllet();
  for (const Calm& calm : {Calm{"paper", {}}, Calm{"reference", {}}, undamped}) {
    for (int trial = 0; trial < 6; ++trial) {
      ControlletRig rig(type, {panda()});
      use_preset(type, calm.preset, rig);
      for (const auto& [name, values] : calm.more) rig.set(name, values);
      const JointVector q = start_pose() + draw.joints(7, 0.5);
      rig.place(0, q, joint_constant(7, 0));
      ASSERT_EQ(rig.start(), LawResult::ok);
      rig.place(0, q, draw.joints(7, 0.2));
      std::array<JointVector, 3> late;
      late.fill(joint_constant(7, 0));
      double early = 0, end = 0;
      for (int i = 0; i < 6000; ++i) {
        ASSERT_EQ(rig.tick(0.001), LawResult::ok);
        late = {rig.tau(0), late[0], late[1]};
        rig.integrate(0.001, {JointVector(late[2] - rig.tau(0))}, 1);
        if (i < 200) early = std::max(early, rig.kinetic_energy(0));
        if (i >= 5800) end = std::max(end, rig.kinetic_energy(0));
      }
      EXPECT_LT(end, 0.02 * early) << calm.preset << ", trial " << trial << ", more " << calm.more.size();
    }
  }
}

TEST(ReferenceLag, OfTask1) {
  const ControlletType type = joint_impedance_controllet();
  ControlletRig rig(type, {panda()});
  use_preset(type, "reference", rig);
  rig.place(0, start_pose(), joint_constant(7, 0));
  ASSERT_EQ(rig.start(), LawResult::ok);
  Target motion{.delivery = Delivery::motion, .size = 7};
  motion.values[3] = motion.values[4] = pi / 4;
  motion.period_s = 5;
  motion.cycles = 2;
  motion.ramp_s = 0.1;
  Reference& joints = rig.input("joints");
  joints.set(motion);
  Peak four, five;
  JointVector before = joint_constant(7, 0), inertia = before;  // dq; row of M
  double unbalanced = 0, force = 0;                             // [N m]
  for (int i = 0; i < 10000; ++i) {
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    const JointVector e = joints.joints() - rig.state(0).q;
    const JointVector& dq = rig.state(0).dq;
    // K e - D dq is what accelerates the joint, coupled with all others: M ddq by differences.
    if (i > 0)
      unbalanced = std::max(unbalanced, std::abs(force - inertia.dot(JointVector((dq - before) / 0.001))));
    before = dq;
    inertia = rig.terms(0).M().row(3).transpose();
    force = 24 * e[3] - 1 * dq[3];
    if (i > 5000) {
      four.see(rig.state(0).dq[3], e[3]);
      five.see(rig.state(0).dq[4], e[4]);
    }
    rig.integrate(0.001, {joint_constant(7, 0)}, 2);
  }
  RecordProperty("lag_4_mrad", std::to_string(1e3 * four.lag));
  RecordProperty("lag_5_mrad", std::to_string(1e3 * five.lag));
  EXPECT_LT(unbalanced, 0.02);
  // Where a joint is fastest its own acceleration vanishes and K e = D dq, but for what the others'
  // acceleration does to it, and these soft gains (a tenth of critical damping) still swing after the start.
  EXPECT_NEAR(four.lag, four.speed / 24, 0.003);
  EXPECT_NEAR(five.lag, five.speed / 10, 0.003);
  // The set-point is fastest at pi/8 * 2 pi / 5 s: 21 and 49 mrad, if the arm followed as fast.
  const double fastest = pi / 8 * 2 * pi / 5;
  EXPECT_NEAR(four.lag, fastest / 24, 0.2 * fastest / 24);
  EXPECT_NEAR(five.lag, fastest / 10, 0.2 * fastest / 10);
}

TEST(ReferenceLag, OfTask2) {
  const ControlletType type = cartesian_impedance_controllet();
  ControlletRig rig(type, {panda()});
  use_preset(type, "reference", rig);
  // The damped pseudo-inverse lets a part of the posture's spring press with the hand; without it K e = D v.
  rig.set("nullspace_stiffness_nm_per_rad", {0});
  rig.set("nullspace_damping_nm_s_per_rad", {0});
  rig.place(0, start_pose(), joint_constant(7, 0));
  ASSERT_EQ(rig.start(), LawResult::ok);
  Target motion{.delivery = Delivery::motion, .size = 3};
  motion.sine[0] = motion.sine[1] = 0.1;
  motion.period_s = 2 * pi;
  motion.cycles = 2;
  motion.ramp_s = 0.1;
  Reference& pose = rig.input("pose");
  pose.set(motion);
  Peak x, y;
  for (int i = 0; i < 12600; ++i) {
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    if (i > 6300) {
      const Vector3 e = pose.pose().position - rig.terms(0).X_WE().position;
      const Vector3 v = rig.terms(0).V_WE().linear();
      x.see(v.x(), e.x());
      y.see(v.y(), e.y());
    }
    rig.integrate(0.001, {joint_constant(7, 0)}, 2);
  }
  RecordProperty("lag_x_mm", std::to_string(1e3 * x.lag));
  RecordProperty("lag_y_mm", std::to_string(1e3 * y.lag));
  EXPECT_NEAR(x.lag, 40 * 0.1 / 400, 0.001);  // 10 mm
  EXPECT_NEAR(y.lag, 40 * 0.1 / 400, 0.001);
}

}  // namespace
}  // namespace multipanda::reference_lag_test
