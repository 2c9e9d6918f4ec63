#pragma once

#include <algorithm>
#include <fstream>
#include <iterator>
#include <map>
#include <string>

#include <gtest/gtest.h>

#include "models/from_urdf.hpp"
#include "models/testing/two_engines.hpp"
#include "models/write_robot.hpp"
#include "models/xml_text.hpp"

namespace multipanda::test {

// Bases anywhere, joints anywhere within their limits, against the original.
inline void expect_same_arm(const RobotDescription& arm, const std::string& original, const std::string& base,
                            const std::string& tip, const std::map<std::string, double>& held,
                            int configurations) {
  PinocchioArm reference(original, base, arm.joint_names, held);
  PinocchioArm ours(to_urdf(arm));
  MujocoArm plant(to_mjcf(arm));
  ASSERT_EQ(reference.joints(), static_cast<int>(arm.joint_count()));
  ASSERT_EQ(ours.joints(), reference.joints());
  ASSERT_EQ(plant.joints(), reference.joints());
  Random random(91);
  double coriolis = 0, gravity = 0;
  for (int i = 0; i < configurations && !testing::Test::HasFailure(); ++i) {
    SCOPED_TRACE(i);
    const Pose X_WB = random.pose();
    reference.place_base(X_WB);
    ours.place_base(X_WB);
    plant.place_base(X_WB);
    const Eigen::VectorXd q = random.between(arm.limits.q_min, arm.limits.q_max);
    const Eigen::VectorXd dq = random.between(-arm.limits.dq_max, arm.limits.dq_max);
    const Terms expected = reference.terms(q, dq, {tip});
    expect_equal(ours.terms(q, dq, {"flange"}), expected);
    expect_equal(plant.terms(q, dq, {"flange"}), expected);
    coriolis = std::max(coriolis, expected.c.norm());
    gravity = std::max(gravity, expected.g.norm());
  }
  EXPECT_GT(coriolis, 0.1);  // the compared values are not zero
  EXPECT_GT(gravity, 1.0);
}

// A robot with everything that an import must handle: skew axes, a prismatic joint below the arm, a held
// joint and a fixed link in the middle of it, side links that rotate, slide and mimic, another arm.
class OddRobot {
 public:
  OddRobot() {
    xml_.open("robot", {{"name", "odd"}});
    link("ground");
    joint("mount", "fixed", "ground", "mast");
    joint("lift", "prismatic", "mast", "chest");
    joint("shoulder", "revolute", "chest", "upper");
    joint("cover", "fixed", "upper", "shell");
    joint("elbow", "continuous", "shell", "lower");
    joint("twist", "revolute", "lower", "forearm");
    joint("brake", "revolute", "forearm", "cuff");
    joint("wrist", "revolute", "cuff", "palm", "0 0 -1");
    joint("tool_mount", "fixed", "palm", "tool");
    joint("thumb", "revolute", "palm", "thumb_link");
    joint("finger", "prismatic", "palm", "finger_link", "0 1 0", {"thumb", "-0.5", "0.02"});
    joint("other_arm", "revolute", "chest", "other");
    xml_.close();
  }
  const std::string& text() const { return xml_.text(); }

 private:
  struct Follows {
    std::string joint, multiplier, offset;
  };

  void link(const std::string& name) {
    // Eight point masses make a body whose inertia is consistent by construction.
    RigidBody body;
    for (int i = 0; i < 8; ++i) {
      const RigidBody point{random_.uniform(0.1, 0.4), 0.15 * random_.pose().position,
                            1e-4 * Matrix3::Identity()};
      body = i == 0 ? point : merged(body, point);
    }
    const Pose X_LC{random_.pose().rotation, body.com};  // principal directions are not those of the link
    const Matrix3 I = X_LC.rotation.transpose() * body.inertia * X_LC.rotation;
    const Vector3 rpy = X_LC.rotation.eulerAngles(2, 1, 0).reverse();
    xml_.open("link", {{"name", name}});
    xml_.open("inertial");
    xml_.leaf("origin", {{"xyz", exact(body.com)}, {"rpy", exact(rpy)}});
    xml_.leaf("mass", {{"value", exact(body.mass)}});
    xml_.leaf("inertia", {{"ixx", exact(I(0, 0))},
                          {"ixy", exact(I(0, 1))},
                          {"ixz", exact(I(0, 2))},
                          {"iyy", exact(I(1, 1))},
                          {"iyz", exact(I(1, 2))},
                          {"izz", exact(I(2, 2))}});
    xml_.close();
    xml_.close();
  }

  void joint(const std::string& name, const std::string& type, const std::string& parent,
             const std::string& child, std::string axis = "", const Follows& follows = {}) {
    if (axis.empty()) axis = exact(Vector3(random_.pose().position.normalized()));
    link(child);
    xml_.open("joint", {{"name", name}, {"type", type}});
    const double yaw = random_.uniform(-3, 3), pitch = random_.uniform(-1.5, 1.5);
    const Vector3 rpy(random_.uniform(-3, 3), pitch, yaw);
    xml_.leaf("origin", {{"xyz", exact(Vector3(0.3 * random_.pose().position))}, {"rpy", exact(rpy)}});
    xml_.leaf("parent", {{"link", parent}});
    xml_.leaf("child", {{"link", child}});
    if (type != "fixed") {
      xml_.leaf("axis", {{"xyz", axis}});
      xml_.leaf("limit", {{"lower", "-1.5"}, {"upper", "2"}, {"velocity", "2"}, {"effort", "40"}});
    }
    if (!follows.joint.empty()) {
      xml_.leaf("mimic",
                {{"joint", follows.joint}, {"multiplier", follows.multiplier}, {"offset", follows.offset}});
    }
    xml_.close();
  }

  Random random_{17};
  XmlText xml_;
};

inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

inline std::string content(const std::filesystem::path& file) {
  std::ifstream stream(file);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

}  // namespace multipanda::test
