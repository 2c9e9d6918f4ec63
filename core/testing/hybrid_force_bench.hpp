#pragma once

#include <algorithm>

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"

// One arm under `hybrid_force`, for its tests.
namespace multipanda::hybrid_force_test {

using namespace test;
using Eigen::MatrixXd;
using Eigen::VectorXd;

inline const Pose kTool{rotation_from_rpy({0.3, -0.2, 0.5}), Vector3(0.02, -0.01, 0.1)};
inline const char* const kAxisNames[] = {"force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z"};

inline Vector6 six(const Vector3& linear, const Vector3& angular) {
  Vector6 x;
  x << linear, angular;
  return x;
}

// The tool's z is the axis of the last joint, which turns little.
inline TestArm light_wrist() {
  TestArm light = TestArm::make(7);
  light.X_JF.rotation = kTool.rotation.transpose();
  light.links[6].mass = 0.3;
  light.links[6].p_JC = {0, 0, 0.02};
  light.links[6].inertia_C = 1e-3 * Matrix3::Identity();
  return light;
}

struct Bench {
  explicit Bench(const Pose& X_WB = {}, const ControlletType& type = hybrid_force_controllet(),
                 const TestArm& of = TestArm::make(7))
      : arm(of), plain(arm, X_WB, kTool), rig(type, {arm.model(X_WB)}) {
    rig.frames(0, {kTool, {}});
    rig.place(0, bent(7), joint_constant(7, 0));
    rig.state(0).has_wrench_estimate = true;
    for (const auto& parameter : type.descriptor.parameters) {  // the estimate has no errors here
      if (parameter.name == "contact_threshold_n") rig.set(parameter.name, {2});
      if (parameter.name == "moment_threshold_nm") rig.set(parameter.name, {0.5});
      if (parameter.name == "contact_motion_share") rig.set(parameter.name, {0});
    }
  }
  void select(int axis, bool on = true) { rig.set(kAxisNames[axis], {on ? 1.0 : 0.0}); }
  void feel(const Vector6& F) { rig.state(0).F_K_W_est.vector = F; }
  void want(const Vector6& F, double duration_s = 0.4) {
    Target target;
    target.size = 6;
    target.duration_s = duration_s;
    std::copy_n(F.data(), 6, target.values.begin());
    rig.input("wrench").set(target);
  }
  void ticks(int count) {
    for (int i = 0; i < count; ++i) ASSERT_EQ(rig.tick(0.001), LawResult::ok);
  }
  const Pose& X() { return rig.terms(0).X_WE(); }
  Vector6 V() { return rig.terms(0).V_WE().vector; }
  Vector3 three(const char* output) {
    const auto values = rig.output(output);
    return {values[0], values[1], values[2]};
  }
  Vector6 command() { return six(three("commanded_force_n"), three("commanded_moment_nm")); }
  // The wrench of the torque, by the dynamically consistent inverse.
  Vector6 wrench() {
    const JointVector q = rig.state(0).q, dq = rig.state(0).dq;
    const MatrixXd J = plain.jacobian(q), M = plain.mass(q);
    return task_inertia(J, M) * J * inverse(M) * VectorXd(rig.tau(0) - JointVector(plain.coriolis(q, dq)));
  }
  // One period of the arm's own motion under this wrench on it.
  void move(const Vector6& on_arm) { rig.integrate(0.001, {rig.terms(0).J_V_WE().transpose() * on_arm}, 2); }

  TestArm arm;
  PlainArm plain;
  ControlletRig rig;
};

// What a 30 Hz observer shows of a wrench.
struct Observer {
  Vector6 shown = Vector6::Zero();
  const Vector6& update(const Vector6& F) { return shown += 0.17 * (F - shown); }
};

}  // namespace multipanda::hybrid_force_test
