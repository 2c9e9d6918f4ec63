#pragma once

#include <string>

#include <gtest/gtest.h>

#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"

namespace multipanda::test {

// A law under way to a set-point, its arms anywhere near, in motion.
struct MovingLaw {
  MovingLaw(const ControlletType& type, std::size_t arms, std::uint32_t seed)
      : draw(seed), rig(type, models(arms)), q(arms), dq(arms) {}

  Models models(std::size_t arms) {
    Models all;
    for (std::size_t i = 0; i < arms; ++i) {
      const Pose X_WB{draw.rotation(), Vector3(0.1, i == 0 ? 0.4 : -0.4, 0.2)};
      const TestArm arm = TestArm::make(7, i == 0 ? 1u : 3u);
      plain.emplace_back(arm, X_WB);
      all.push_back(arm.model(X_WB));
    }
    return all;
  }

  void place() {
    for (std::size_t i = 0; i < q.size(); ++i) {
      q[i] = bent(7) + draw.joints(7, 0.1);
      dq[i] = draw.joints(7, 0.3);
      rig.place(i, q[i], dq[i]);
    }
  }

  // A set-point anywhere near, in 1 s.
  void aim(const std::string& input, Draw& goals) {
    Reference& reference = rig.input(input);
    Target target;
    target.size = 7;
    target.duration_s = 1;
    if (input == "wrench") {
      target.size = 6;
      target.values = {1, 2, -15};
    } else if (input == "squeeze") {
      target.size = 1;
      target.values = {12};
    } else if (input == "joints") {
      const JointVector goal = reference.joints() + goals.joints(7, 0.4);
      std::copy(goal.begin(), goal.end(), target.values.begin());
    } else {
      const Pose X = reference.pose();
      const Matrix3 R = exp_rotation(goals.vector3(0.4)) * X.rotation;
      target = pose_target({R, X.position + goals.vector3(0.1)}, 1);
    }
    reference.set(target);
  }

  void run(const std::string& input) {
    aim(input, draw);
    for (int t = 0; t < 400; ++t) ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    place();
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
  }

  Pose X_WE(std::size_t i) const { return plain[i].end_effector(q[i]); }
  Vector6 V_WE(std::size_t i) const { return plain[i].jacobian(q[i]) * dq[i]; }
  Vector6 wrench(std::size_t i) {
    const Eigen::MatrixXd J = plain[i].jacobian(q[i]), M = plain[i].mass(q[i]);
    return task_inertia(J, M) * J * inverse(M) * (rig.tau(i) - plain[i].coriolis(q[i], dq[i]));
  }
  Vector3 shown(const std::string& name) {
    const std::vector<double> values = rig.output(name);
    EXPECT_EQ(values.size(), 3u) << name;
    return {values[0], values[1], values[2]};
  }
  Vector6 shown_wrench(const std::string& prefix) {
    Vector6 F;
    F << shown(prefix + "force_n"), shown(prefix + "moment_nm");
    return F;
  }

  Draw draw;
  std::vector<PlainArm> plain;
  ControlletRig rig;
  std::vector<JointVector> q, dq;
};

// Two arms near a bent pose, at rest. The test moves the one that leads; the other stays where it is.
struct LedLaw : MovingLaw {
  LedLaw(const ControlletType& type, std::size_t leader, std::uint32_t seed)
      : MovingLaw(type, 2, seed), leads(leader) {
    for (std::size_t i = 0; i < 2; ++i) {
      q[i] = bent(7) + draw.joints(7, 0.1);
      dq[i] = JointVector::Zero(7);
      rig.place(i, q[i], dq[i]);
    }
  }
  // One tick in which the leader moves with this velocity.
  LawResult tick(const JointVector& velocity) {
    q[leads] += 0.001 * velocity;
    dq[leads] = velocity;
    rig.place(leads, q[leads], dq[leads]);
    return rig.tick(0.001);
  }
  // A smooth motion of the leader from rest to rest.
  void lead(const JointVector& way, double seconds) {
    const int ticks = static_cast<int>(seconds * 1000);
    for (int k = 0; k < ticks; ++k) {
      const double s = (k + 0.5) / ticks;
      ASSERT_EQ(tick(30 * s * s * (1 - s) * (1 - s) / seconds * way), LawResult::ok);
    }
  }
  void wait(double seconds) {
    for (int k = 0; k < static_cast<int>(seconds * 1000); ++k)
      ASSERT_EQ(tick(JointVector::Zero(7)), LawResult::ok);
  }

  std::size_t leads;
};

}  // namespace multipanda::test
