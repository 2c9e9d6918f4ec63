#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/parsers/urdf.hpp>

#include "core/model/model_terms.hpp"
#include "core/model/pinocchio_chain.hpp"
#include "core/testing/test_arm.hpp"
#include "models/arm_source.hpp"

// Mass matrix, C dq, gravity and momentum against Pinocchio's own algorithms, on seeded random states.
namespace multipanda {
namespace {

using test::Draw;
using test::TestArm;

// Pinocchio's library has the instance for Eigen::Ref. A vector would instantiate the algorithm here.
using VectorRef = Eigen::Ref<const Eigen::VectorXd>;

// Within 1e-12 of the largest entry. The floor is for single joints, whose entries may be zero
// up to rounding.
void expect_close(const Eigen::MatrixXd& actual, const Eigen::MatrixXd& expected, const std::string& what) {
  const double scale = std::max(0.1, expected.cwiseAbs().maxCoeff());
  EXPECT_LE((actual - expected).cwiseAbs().maxCoeff(), 1e-12 * scale) << what;
}

// The model that Pinocchio's own reader makes of the URDF; ours must be the same up to rounding.
pinocchio::Model model_by_pinocchio(const ArmModelSource& source, const ArmModel::Chain& ours) {
  pinocchio::Model model;
  pinocchio::urdf::buildModelFromXML(source.urdf, model);
  model.jointPlacements[1] =
      pinocchio::SE3(source.X_WB.rotation, source.X_WB.position) * model.jointPlacements[1];
  model.gravity.linear() = Vector3(0, 0, -9.81);
  EXPECT_EQ(ours.joints.size() + 1, model.joints.size()) << source.name;
  EXPECT_TRUE(ours.base.isApprox(model.inertias[0], 1e-14)) << source.name;
  for (std::size_t j = 0; j < ours.joints.size(); ++j) {
    EXPECT_EQ(ours.joints[j].X_PJ, model.jointPlacements.at(j + 1)) << source.name << ", joint " << j;
    EXPECT_TRUE(ours.joints[j].link.isApprox(model.inertias[j + 1], 1e-14)) << source.name << ", joint " << j;
  }
  EXPECT_EQ(ours.limits.q_min, model.lowerPositionLimit) << source.name;
  EXPECT_EQ(ours.limits.q_max, model.upperPositionLimit) << source.name;
  EXPECT_EQ(ours.limits.dq_max, model.upperVelocityLimit) << source.name;
  EXPECT_EQ(ours.limits.tau_max, model.upperEffortLimit) << source.name;
  return model;
}

void expect_agreement(const ArmModelSource& source, Draw& draw) {
  const auto arm = std::make_shared<const ArmModel>(source);
  const pinocchio::Model by_pinocchio = model_by_pinocchio(source, arm->chain());
  const std::size_t n = arm->joint_count();
  ModelTerms terms(arm);
  for (int k = 0; k < 8; ++k) {
    const Load tool = k < 2 ? Load{} : draw.load(0.73), load = k < 4 ? Load{} : draw.load(2.0);
    terms.set_config({draw.pose(0.2), draw.pose(0.1)}, tool, load);
    const JointVector drawn_dq = draw.joints(n, 2);
    terms.update(draw.joints(n, 2.5), drawn_dq);

    pinocchio::Model model = by_pinocchio;
    auto& last = model.inertias.back();
    for (const Load& body : {tool, load}) {
      if (body.mass > 0) last += inertia_in_joint(arm->chain().X_JF, body);
    }
    pinocchio::Data data(model);
    const Eigen::VectorXd q = terms.q(), dq = terms.dq();
    Eigen::MatrixXd M = pinocchio::crba(model, data, VectorRef(q), pinocchio::Convention::LOCAL);
    M.triangularView<Eigen::StrictlyLower>() = M.transpose();
    const Eigen::VectorXd g = pinocchio::computeGeneralizedGravity(model, data, q);
    const Eigen::MatrixXd C = pinocchio::computeCoriolisMatrix(model, data, q, dq);
    model.gravity.setZero();
    const Eigen::VectorXd c = pinocchio::nonLinearEffects(model, data, q, dq);

    const std::string where = source.name + ", state " + std::to_string(k);
    expect_close(terms.M(), M, "mass matrix of " + where);
    expect_close(terms.g(), g, "gravity of " + where);
    expect_close(terms.c(), c, "C dq of " + where);
    expect_close(terms.momentum(), M * dq, "momentum of " + where);
    expect_close(terms.momentum_drift(), C.transpose() * dq - g, "momentum drift of " + where);
  }
}

// Every joint whose number is in `sliding` becomes prismatic.
std::string with_prismatic_joints(std::string urdf, const std::vector<std::size_t>& sliding) {
  const std::string turns = "type='revolute'", slides = "type='prismatic'";
  std::size_t at = 0;
  for (std::size_t joint = 0; (at = urdf.find(turns, at)) != std::string::npos; ++joint, ++at) {
    if (std::count(sliding.begin(), sliding.end(), joint) > 0) urdf.replace(at, turns.size(), slides);
  }
  return urdf;
}

class Dynamics : public testing::TestWithParam<std::size_t> {};

TEST_P(Dynamics, AgreesWithPinocchioForSyntheticArms) {
  Draw draw(static_cast<std::uint32_t>(GetParam()));
  for (const bool slides : {false, true}) {
    for (const bool moved : {false, true}) {
      const auto arm = TestArm::make(GetParam(), static_cast<std::uint32_t>(draw.index(1000)));
      auto source = arm.source(moved ? draw.pose(2) : Pose{}, std::to_string(GetParam()) + " joints");
      std::vector<std::size_t> sliding;
      for (std::size_t i = 0; slides && i < GetParam(); ++i) {
        if (i == GetParam() / 2 || draw.coin()) sliding.push_back(i);
      }
      source.urdf = with_prismatic_joints(source.urdf, sliding);
      expect_agreement(source, draw);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Joints, Dynamics, testing::Range<std::size_t>(1, 17));

TEST(ShippedRobots, DynamicsAgreeWithPinocchio) {
  Draw draw(99);
  for (const std::string name : {"fer", "fr3", "fr3v2"}) {
    const RobotDescription robot = load_robot(name);
    for (const bool hand : {false, true}) {
      if (hand && !robot.hand) continue;
      expect_agreement(arm_model_source(robot, {}, hand), draw);
      expect_agreement(arm_model_source(robot, draw.pose(2), hand), draw);
    }
  }
}

}  // namespace
}  // namespace multipanda
