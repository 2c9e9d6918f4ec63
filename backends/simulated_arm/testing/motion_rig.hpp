#pragma once

// An arm's desired motion alone, with explicit commands, for tests of its rules and of how it ends.
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "backends/simulated_arm/desired_motion.hpp"
#include "core/testing/test_arm.hpp"
#include "models/arm_source.hpp"

namespace multipanda::test {

struct Arm {
  explicit Arm(const std::string& name, std::function<void(MotionLimits&)> change = {})
      : model(std::make_shared<const ArmModel>(arm_model_source(load_robot(name), Draw(3).pose(1), false))),
        limits(MotionLimits::of(load_robot(name))) {
    if (change) change(limits);
    motion.emplace(model, limits);
  }
  DesiredMotion& begin(MotionGenerator generator) { return begin(generator, model->q_home()); }
  DesiredMotion& begin(MotionGenerator generator, const JointVector& q) {
    motion->hold(q, {});
    EXPECT_EQ(motion->start({.controller = ArmController::joint_impedance, .generator = generator}),
              MotionStart::started);
    return *motion;
  }
  std::shared_ptr<const ArmModel> model;
  MotionLimits limits;
  std::optional<DesiredMotion> motion;
};

// Only Cartesian rules.
inline void any_joints(MotionLimits& limits) {
  limits.dq_max.setConstant(1e6);
  limits.ddq_max.setConstant(1e9);
  limits.dddq_max.setConstant(1e12);
  limits.velocity_offset.resize(0);
  limits.deceleration.resize(0);
}

inline InterfaceCommand positions(const JointVector& q) {
  InterfaceCommand c;
  c.q_c = q;
  return c;
}
inline InterfaceCommand velocities(const JointVector& dq) {
  InterfaceCommand c;
  c.dq_c = dq;
  return c;
}
inline InterfaceCommand twist(const Vector6& V) {
  InterfaceCommand c;
  c.O_dP_EE_c = V;
  return c;
}
inline InterfaceCommand pose(const Pose& X) {
  InterfaceCommand c;
  Eigen::Map<Eigen::Matrix4d> T(c.O_T_EE_c.data());
  T.setIdentity();
  T.topLeftCorner<3, 3>() = X.rotation;
  T.topRightCorner<3, 1>() = X.position;
  return c;
}

// On a copy.
inline std::vector<ArmError> errors_after(DesiredMotion motion, const InterfaceCommand& command) {
  std::vector<ArmError> errors;
  if (motion.step(&command) != MotionStep::violation) return errors;
  for (const Violation& v : motion.violations()) errors.push_back(v.error);
  return errors;
}

}  // namespace multipanda::test
