// Tasks 1 and 2 as the reference code runs them, on a Panda with an exact model and no friction: its damping
// of the velocity alone makes the arm lag behind its set-point by D v / K.
#include <numbers>

#include <gtest/gtest.h>

#include "core/controllets/cartesian_impedance.hpp"
#include "core/controllets/joint_impedance.hpp"
#include "core/testing/controllet_rig.hpp"
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
  for (int i = 0; i < 10000; ++i) {
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    if (i > 5000) {
      const JointVector e = joints.joints() - rig.state(0).q;
      four.see(rig.state(0).dq[3], e[3]);
      five.see(rig.state(0).dq[4], e[4]);
    }
    rig.integrate(0.001, {joint_constant(7, 0)}, 2);
  }
  RecordProperty("lag_4_mrad", std::to_string(1e3 * four.lag));
  RecordProperty("lag_5_mrad", std::to_string(1e3 * five.lag));
  // Where a joint is fastest its acceleration vanishes: K e = D dq, up to the coupling with the others.
  EXPECT_NEAR(four.lag, four.speed / 24, 0.0015);
  EXPECT_NEAR(five.lag, five.speed / 10, 0.0015);
  // The set-point is fastest at pi/8 * 2 pi / 5 s: 21 and 49 mrad, if the arm followed as fast.
  const double fastest = pi / 8 * 2 * pi / 5;
  EXPECT_NEAR(four.lag, fastest / 24, 0.1 * fastest / 24);
  EXPECT_NEAR(five.lag, fastest / 10, 0.1 * fastest / 10);
}

TEST(ReferenceLag, OfTask2) {
  const ControlletType type = cartesian_impedance_controllet();
  ControlletRig rig(type, {panda()});
  use_preset(type, "reference", rig);
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
