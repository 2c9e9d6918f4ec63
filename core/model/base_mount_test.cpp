#include "core/model/base_mount.hpp"

#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/parsers/urdf.hpp>

#include "core/model/model_terms.hpp"
#include "core/model/pinocchio_chain.hpp"
#include "core/testing/test_arm.hpp"

// An arm that stands on another one: both models against Pinocchio's algorithms on one tree with the joints
// of both.
namespace multipanda::base_mount_test {
namespace {

using test::Draw;
using test::TestArm;
using VectorRef = Eigen::Ref<const Eigen::VectorXd>;

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
  return text;
}

// The base of a carried arm is a body of its carrier.
std::string with_base_body(const std::string& urdf) {
  return replaced(
      urdf, "<link name='base'/>",
      "<link name='base'><inertial><origin xyz='0.02 -0.01 0.06' rpy='0.3 0.2 -0.1'/><mass "
      "value='2.9'/><inertia ixx='0.02' ixy='0.001' ixz='-0.002' iyy='0.03' iyz='0.001' izz='0.025'/>"
      "</inertial></link>");
}

// Both in one tree, with the names of the carried arm's parts after "z_".
std::string tree(const std::string& carrier, const std::string& carried, const BaseMount& mount) {
  std::string other = carried;
  for (const std::string name : {"'link", "'joint", "'base'", "'flange'", "'to_flange'"})
    other = replaced(other, name, "'z_" + name.substr(1));
  other = replaced(replaced(other, "<robot name='test'>", ""), "</robot>", "");
  const Vector3& p = mount.X_JB.position;
  const Matrix3& R = mount.X_JB.rotation;
  char joint[400];
  std::snprintf(joint, sizeof joint,
                "<joint name='mount' type='fixed'><parent link='link%zu'/><child link='z_base'/><origin "
                "xyz='%.17g %.17g %.17g' rpy='%.17g %.17g %.17g'/></joint></robot>",
                mount.joint, p.x(), p.y(), p.z(), std::atan2(R(2, 1), R(2, 2)), std::asin(-R(2, 0)),
                std::atan2(R(1, 0), R(0, 0)));
  return replaced(carrier, "</robot>", "") + other + joint;
}

void expect_close(const Eigen::MatrixXd& actual, const Eigen::MatrixXd& expected, const std::string& what) {
  const double scale = std::max(0.1, expected.cwiseAbs().maxCoeff());
  EXPECT_LE((actual - expected).cwiseAbs().maxCoeff(), 1e-11 * scale) << what;
}

struct Pair {
  explicit Pair(std::uint32_t seed) : draw(seed) {
    carrier_joints = 1 + draw.index(8);
    const Pose X_WB = draw.pose(2);
    mount = {.carrier = 0, .joint = draw.index(carrier_joints), .X_JB = draw.pose(0.4)};
    const TestArm first = TestArm::make(carrier_joints, seed), second = TestArm::make(7, seed + 100);
    ArmModelSource source = second.source(draw.pose(1), "carried");
    source.urdf = with_base_body(source.urdf);
    carrier = std::make_unique<ModelTerms>(first.model(X_WB, "carrier"));
    carried = std::make_unique<ModelTerms>(std::make_shared<const ArmModel>(source));
    carrier->carry(*carried, mount.joint);
    pinocchio::urdf::buildModelFromXML(tree(first.urdf(), source.urdf, mount), model);
    for (pinocchio::JointIndex j = 1; j < model.joints.size(); ++j) {
      if (model.parents[j] == 0)
        model.jointPlacements[j] = pinocchio::SE3(X_WB.rotation, X_WB.position) * model.jointPlacements[j];
      (model.names[j].starts_with("z_") ? of_carried : of_carrier).push_back(model.joints[j].idx_v());
    }
    model.gravity.linear() = Vector3(0, 0, -9.81);
  }

  void move() {
    const JointVector q0 = draw.joints(carrier_joints, 2.5), dq0 = draw.joints(carrier_joints, 2);
    const JointVector q1 = draw.joints(7, 2.5), dq1 = draw.joints(7, 2);
    const Load tool = draw.load(0.7), load = draw.load(1.5);
    carried->set_config({draw.pose(0.2), draw.pose(0.1)}, tool, load);
    const auto& chain = carried->model().chain();
    const auto last = model.getJointId("z_joint6");
    model.inertias[last] = chain.joints.back().link;
    for (const Load& body : {tool, load}) model.inertias[last] += inertia_in_joint(chain.X_JF, body);
    carrier->update(q0, dq0);
    carried->update(q1, dq1);
    carried->stand_on(*carrier, mount);
    q.resize(model.nq);
    dq.resize(model.nv);
    for (std::size_t i = 0; i < of_carrier.size(); ++i) {
      q[of_carrier[i]] = q0[static_cast<Eigen::Index>(i)];
      dq[of_carrier[i]] = dq0[static_cast<Eigen::Index>(i)];
    }
    for (std::size_t i = 0; i < of_carried.size(); ++i) {
      q[of_carried[i]] = q1[static_cast<Eigen::Index>(i)];
      dq[of_carried[i]] = dq1[static_cast<Eigen::Index>(i)];
    }
  }

  Draw draw;
  std::size_t carrier_joints = 0;
  BaseMount mount;
  std::unique_ptr<ModelTerms> carrier, carried;
  pinocchio::Model model;
  std::vector<Eigen::Index> of_carrier, of_carried;
  Eigen::VectorXd q, dq;
};

TEST(MovingBase, TermsOfBothArmsAreThoseOfTheirCommonTree) {
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    Pair pair(seed);
    pinocchio::Data data(pair.model);
    ASSERT_EQ(pair.of_carrier.size(), pair.carrier_joints);
    for (int k = 0; k < 4; ++k) {
      pair.move();
      const std::string where = "seed " + std::to_string(seed) + ", state " + std::to_string(k);
      pinocchio::forwardKinematics(pair.model, data, pair.q, pair.dq);
      pinocchio::updateFramePlacements(pair.model, data);
      const auto flange = pair.model.getFrameId("z_flange");
      const Pose X_WF = pair.carried->X_WF();
      expect_close(X_WF.rotation, data.oMf[flange].rotation(), "rotation of " + where);
      expect_close(X_WF.position, data.oMf[flange].translation(), "position of " + where);
      // The velocity of E, which is fixed to the flange.
      const auto at_flange =
          pinocchio::getFrameVelocity(pair.model, data, flange, pinocchio::LOCAL_WORLD_ALIGNED);
      Vector6 V_WE;
      V_WE << at_flange.linear() +
                  Vector3(at_flange.angular()).cross(Vector3(pair.carried->X_WE().position - X_WF.position)),
          at_flange.angular();
      expect_close(pair.carried->V_WE().vector, V_WE, "twist of " + where);

      Eigen::MatrixXd M = pinocchio::crba(pair.model, data, VectorRef(pair.q), pinocchio::Convention::LOCAL);
      M.triangularView<Eigen::StrictlyLower>() = M.transpose();
      const Eigen::VectorXd p = M * pair.dq;
      const Eigen::VectorXd g = pinocchio::computeGeneralizedGravity(pair.model, data, pair.q);
      const Eigen::VectorXd drift =
          pinocchio::computeCoriolisMatrix(pair.model, data, pair.q, pair.dq).transpose() * pair.dq - g;
      for (const bool first : {true, false}) {
        ModelTerms& terms = first ? *pair.carrier : *pair.carried;
        const auto& of = first ? pair.of_carrier : pair.of_carried;
        const std::string whose = (first ? " of the carrier, " : " of the carried arm, ") + where;
        expect_close(terms.M(), M(of, of), "mass matrix" + whose);
        expect_close(terms.g(), g(of), "gravity" + whose);
        expect_close(terms.momentum(), p(of), "momentum" + whose);
        expect_close(terms.momentum_drift(), drift(of), "momentum drift" + whose);
      }
    }
  }
}

// The Jacobian's rate against a finite difference along a motion of both arms. The base moves along, so dJ/dt
// v is compared with the motion of the columns.
TEST(MovingBase, TurnsTheColumnsOfTheJacobian) {
  for (std::uint32_t seed = 31; seed <= 36; ++seed) {
    Pair pair(seed);
    pair.move();
    const JointVector q0 = pair.carrier->q(), dq0 = pair.carrier->dq(), q1 = pair.carried->q(),
                      dq1 = pair.carried->dq();
    const JointVector v = pair.draw.joints(7, 1);
    const Vector6 rate = pair.carried->jacobian_rate_times(v);
    const auto at = [&](double t) {
      pair.carrier->update(q0 + t * dq0, dq0);
      pair.carried->update(q1 + t * dq1, dq1);
      pair.carried->stand_on(*pair.carrier, pair.mount);
      return Vector6(pair.carried->J_V_WE() * v);
    };
    constexpr double h = 1e-6;
    EXPECT_LT((rate - (at(h) - at(-h)) / (2 * h)).norm(), 1e-6 * std::max(1.0, rate.norm())) << seed;
  }
}

TEST(MovingBase, StaysWhereItWasWhileTheCarrierIsNotKnown) {
  Pair pair(7);
  pair.move();
  const Pose X = pair.carried->X_WB();
  const JointVector q = pair.carrier->q(), dq = pair.carrier->dq();
  ModelTerms at_rest(pair.carried->shared_model());
  for (const bool of_velocity : {false, true}) {
    JointVector bad_q = q, bad_dq = dq;
    (of_velocity ? bad_dq : bad_q)[0] = std::nan("");
    pair.carrier->update(bad_q, bad_dq);
    pair.carried->update(pair.carried->q(), pair.carried->dq());
    pair.carried->stand_on(*pair.carrier, pair.mount);
    EXPECT_EQ(pair.carried->X_WB().position, X.position);
    EXPECT_TRUE(pair.carried->M().allFinite());
    // As of a base at rest: the twist is that of its own joints, the momentum M dq.
    expect_close(pair.carried->V_WE().vector, pair.carried->J_V_WE() * pair.carried->dq(), "twist");
    expect_close(pair.carried->momentum(), pair.carried->M() * pair.carried->dq(), "momentum");
  }
}

// The carrier with a body that is fixed to its link: as of a carried arm whose joints do not move.
TEST(MovingBase, CountsAnUnknownCarriedArmAsTheBodyThatItWas) {
  for (std::uint32_t seed = 41; seed <= 46; ++seed) {
    Pair pair(seed);
    pair.move();
    const JointVector q1 = pair.carried->q();
    (void)pair.carrier->M();  // the last body that is known
    const JointVector q0 = pair.draw.joints(pair.carrier_joints, 2),
                      dq0 = pair.draw.joints(pair.carrier_joints, 2);
    const auto carrier_beside = [&](const JointVector& q_carried) {
      pair.carrier->update(q0, dq0);
      pair.carried->update(q_carried, JointVector::Zero(7));
      pair.carried->stand_on(*pair.carrier, pair.mount);
    };
    carrier_beside(JointVector::Constant(7, std::nan("")));
    const JointMatrix M = pair.carrier->M();
    const JointVector g = pair.carrier->g(), p = pair.carrier->momentum(),
                      drift = pair.carrier->momentum_drift();
    carrier_beside(q1);
    expect_close(M, pair.carrier->M(), "mass matrix");
    expect_close(g, pair.carrier->g(), "gravity");
    expect_close(p, pair.carrier->momentum(), "momentum");
    expect_close(drift, pair.carrier->momentum_drift(), "momentum drift");
  }
}

// Power: the torques of the joints before the base move the hand with their part of its twist.
TEST(MovingBase, TorquesOfAWrenchAtTheHandHaveItsPower) {
  for (std::uint32_t seed = 51; seed <= 56; ++seed) {
    Pair pair(seed);
    pair.move();
    Vector6 F;
    F << pair.draw.vector3(50), pair.draw.vector3(10);
    const Vector6 swept = pair.carried->V_WE().vector - Vector6(pair.carried->J_V_WE() * pair.carried->dq());
    const JointVector tau = pair.carrier->torque_of(pair.mount.joint, pair.carried->X_WE().position, F);
    EXPECT_NEAR(tau.dot(pair.carrier->dq()), F.dot(swept), 1e-9 * std::max(1.0, std::abs(F.dot(swept))));
  }
}

TEST(Upright, AsksForVerticalAndLevelAxesInEveryPose) {
  const TestArm arm = TestArm::make(8, 3);
  const auto lean = [&](double angle, double yaw) {
    return arm.model({rotation_from_rpy({0, 0, yaw}) * rotation_from_rpy({angle, 0, 0}), {1, 2, 0.5}},
                     "torso");
  };
  EXPECT_EQ(turns_against_gravity(*lean(0, 1), 0), "");
  EXPECT_EQ(turns_against_gravity(*lean(0.019, 1), 0), "");
  EXPECT_NE(turns_against_gravity(*lean(0.021, 1), 0).find("joint1 of 'torso' can be 1.2 degrees"),
            std::string::npos)
      << turns_against_gravity(*lean(0.021, 1), 0);
  EXPECT_NE(turns_against_gravity(*lean(0, 1), 1).find("joint2"), std::string::npos)
      << "nearly level, and turns";
  EXPECT_EQ(turns_against_gravity(*lean(std::acos(-1.0), 1), 0), "") << "hanging";

  // An axis that slides is to be level.
  ArmModelSource source = arm.source();
  const std::string turns = "type='revolute'";
  source.urdf.replace(source.urdf.find(turns), turns.size(), "type='prismatic'");
  const auto sliding = [&](double angle) {
    source.X_WB.rotation = rotation_from_rpy({std::acos(0.0) + angle, 0, 0});
    return turns_against_gravity(ArmModel(source), 0);
  };
  EXPECT_EQ(sliding(0), "");
  EXPECT_EQ(sliding(0.019), "");
  EXPECT_NE(sliding(-0.021).find("1.2 degrees from level"), std::string::npos) << sliding(-0.021);
}

}  // namespace
}  // namespace multipanda::base_mount_test
