#include "core/model/model_terms.hpp"

#include <gtest/gtest.h>

#include "core/testing/dense_algebra.hpp"
#include "core/testing/test_arm.hpp"

// The tests compute every term a second time from the arm's parameters: poses by products of transforms,
// Jacobians by differences of poses, M from the kinetic energy of the links, c from differences of M, and g
// from differences of the potential energy.
namespace multipanda::model_terms_test {
namespace {

using test::Draw;
using test::TestArm;

constexpr double kGravity = 9.81;

struct Case {
  TestArm arm;
  Pose X_WB;
  ArmFrames frames;
  Load tool, load;

  std::vector<Pose> joints(const JointVector& q) const {
    std::vector<Pose> X;
    Pose X_WJ = X_WB;
    for (std::size_t i = 0; i < arm.links.size(); ++i) {
      const auto& link = arm.links[i];
      const double angle = q[static_cast<Eigen::Index>(i)];
      X_WJ = X_WJ * link.X_PJ * Pose{Eigen::AngleAxisd(angle, link.axis).toRotationMatrix(), Vector3::Zero()};
      X.push_back(X_WJ);
    }
    return X;
  }
  Pose flange(const JointVector& q) const { return joints(q).back() * arm.X_JF; }
  Pose effector(const JointVector& q) const { return flange(q) * frames.X_FE; }

  // Velocity of a frame per unit velocity of each joint, by central differences.
  template <typename Frame>
  Jacobian jacobian(Frame frame, const JointVector& q) const {
    constexpr double h = 1e-6;
    Jacobian J = Jacobian::Zero(6, q.size());
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      JointVector up = q, down = q;
      up[i] += h;
      down[i] -= h;
      const Pose A = frame(up), B = frame(down);
      J.col(i).head<3>() = (A.position - B.position) / (2 * h);
      J.col(i).tail<3>() = log_rotation(A.rotation * B.rotation.transpose()) / (2 * h);
    }
    return J;
  }

  struct Body {
    double mass;
    Matrix3 inertia;  // in the axes of the frame
    Pose X;           // frame in the joint (or flange) frame, at the center of mass
    std::size_t joint;
  };
  std::vector<Body> bodies() const {
    std::vector<Body> all;
    for (std::size_t i = 0; i < arm.links.size(); ++i) {
      const auto& link = arm.links[i];
      all.push_back({link.mass, link.inertia_C, {Matrix3::Identity(), link.p_JC}, i});
    }
    for (const Load& l : {tool, load}) {
      all.push_back(
          {l.mass, l.inertia_C, arm.X_JF * Pose{Matrix3::Identity(), l.p_FC}, arm.links.size() - 1});
    }
    return all;
  }
  JointMatrix mass_matrix(const JointVector& q) const {
    JointMatrix M = JointMatrix::Zero(q.size(), q.size());
    for (const Body& body : bodies()) {
      const auto frame = [&](const JointVector& at) { return joints(at)[body.joint] * body.X; };
      const Jacobian J = jacobian(frame, q);
      const Matrix3 R = frame(q).rotation;
      M += body.mass * J.topRows<3>().transpose() * J.topRows<3>();
      M += J.bottomRows<3>().transpose() * (R * body.inertia * R.transpose()) * J.bottomRows<3>();
    }
    return M;
  }
  double potential(const JointVector& q) const {
    double V = 0;
    for (const Body& body : bodies()) {
      V += body.mass * kGravity * (joints(q)[body.joint] * body.X.position).z();
    }
    return V;
  }
};

Case some_case(Draw& draw, std::size_t joints) {
  Case setup{TestArm::make(joints, static_cast<std::uint32_t>(draw.index(1000))), draw.pose(1), {}, {}, {}};
  setup.frames = {draw.pose(0.2), draw.pose(0.1)};
  setup.tool = draw.load(0.73);
  setup.load = draw.load(1.4);
  return setup;
}

class ModelTermsTest : public testing::TestWithParam<std::size_t> {};

TEST_P(ModelTermsTest, AgreesWithFirstPrinciples) {
  Draw draw(11);
  for (int k = 0; k < 10; ++k) {
    const Case setup = some_case(draw, GetParam());
    ModelTerms terms(setup.arm.model(setup.X_WB));
    terms.set_config(setup.frames, setup.tool, setup.load);
    const JointVector q = draw.joints(GetParam(), 2), dq = draw.joints(GetParam(), 1.5);
    terms.update(q, dq);

    const Pose X_WE = setup.effector(q);
    EXPECT_LT((terms.X_WE().position - X_WE.position).norm(), 1e-12);
    EXPECT_LT((terms.X_WE().rotation - X_WE.rotation).norm(), 1e-12);
    EXPECT_LT((terms.X_WF().position - setup.flange(q).position).norm(), 1e-12);
    EXPECT_LT((terms.X_WK().position - (X_WE * setup.frames.X_EK).position).norm(), 1e-12);
    for (std::size_t j = 0; j < GetParam(); ++j) {
      EXPECT_LT((terms.X_WJ(j).position - setup.joints(q)[j].position).norm(), 1e-12);
    }

    const Jacobian J = setup.jacobian([&](const JointVector& at) { return setup.effector(at); }, q);
    EXPECT_LT((terms.J_V_WE() - J).norm(), 1e-8);
    EXPECT_LT((terms.V_WE().vector - J * dq).norm(), 1e-8);

    const JointMatrix M = setup.mass_matrix(q);
    EXPECT_LT((terms.M() - M).norm(), 1e-7 * M.norm());
    EXPECT_EQ(terms.M(), JointMatrix(terms.M().transpose()));

    constexpr double h = 1e-5;
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      JointVector up = q, down = q;
      up[i] += h;
      down[i] -= h;
      EXPECT_NEAR(terms.g()[i], (setup.potential(up) - setup.potential(down)) / (2 * h), 1e-7);
    }

    // c = dM/dt dq - 1/2 d(dq^T M dq)/dq (Lagrange), both by differences of the mass matrix above.
    constexpr double d = 1e-3;
    JointVector forward = q, backward = q;
    forward += d * dq;
    backward -= d * dq;
    JointVector c = (setup.mass_matrix(forward) - setup.mass_matrix(backward)) * dq / (2 * d);
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      JointVector up = q, down = q;
      up[i] += d;
      down[i] -= d;
      c[i] -= 0.5 * dq.dot((setup.mass_matrix(up) - setup.mass_matrix(down)) * dq) / (2 * d);
    }
    EXPECT_LT((terms.c() - c).norm(), 1e-4 * (1 + c.norm()));

    // p = M dq. Its drift is dT/dq - dV/dq, with the gradient of the kinetic energy by differences.
    EXPECT_LT((terms.momentum() - M * dq).norm(), 1e-7 * (M * dq).norm());
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      JointVector up = q, down = q;
      up[i] += d;
      down[i] -= d;
      const double dT = 0.5 * dq.dot((setup.mass_matrix(up) - setup.mass_matrix(down)) * dq) / (2 * d);
      EXPECT_NEAR(terms.momentum_drift()[i], dT - terms.g()[i], 1e-4 * (1 + std::abs(dT)));
    }
    const Jacobian J_K =
        setup.jacobian([&](const JointVector& at) { return setup.effector(at) * setup.frames.X_EK; }, q);
    EXPECT_LT((terms.J_V_WK() - J_K).norm(), 1e-8);
  }
}

TEST_P(ModelTermsTest, PointJacobianMatchesDifferencesOfThePoint) {
  Draw draw(12);
  const Case setup = some_case(draw, GetParam());
  ModelTerms terms(setup.arm.model(setup.X_WB));
  const JointVector q = draw.joints(GetParam(), 2);
  terms.update(q, 0 * q);
  for (std::size_t j = 0; j < GetParam(); ++j) {
    const Vector3 p_J = draw.vector3(0.3);
    const Jacobian J = setup.jacobian(
        [&](const JointVector& at) {
          return setup.joints(at)[j] * Pose{Matrix3::Identity(), p_J};
        },
        q);
    Eigen::Matrix<double, 3, Eigen::Dynamic> J_point(3, q.size());
    terms.point_jacobian(j, setup.joints(q)[j] * p_J, J_point);
    EXPECT_LT((J_point - J.topRows<3>()).norm(), 1e-8);
  }
}

TEST_P(ModelTermsTest, EveryOrderOfCallsGivesTheSameBits) {
  Draw draw(13);
  const Case setup = some_case(draw, GetParam());
  const auto model = setup.arm.model(setup.X_WB);
  const JointVector q = draw.joints(GetParam(), 2), dq = draw.joints(GetParam(), 1);
  for (int k = 0; k < 60; ++k) {
    ModelTerms mixed(model);
    mixed.set_config(setup.frames, setup.tool, setup.load);
    mixed.update(q, dq);
    for (int asked = 0; asked < 12; ++asked) {
      ModelTerms fresh(model);
      fresh.set_config(setup.frames, setup.tool, setup.load);
      fresh.update(q, dq);
      switch (draw.index(8)) {
        case 0:
          EXPECT_EQ(mixed.X_WE().position, fresh.X_WE().position);
          break;
        case 1:
          EXPECT_EQ(mixed.J_V_WE(), fresh.J_V_WE());
          break;
        case 2:
          EXPECT_EQ(mixed.M(), fresh.M());
          break;
        case 3:
          EXPECT_EQ(mixed.c(), fresh.c());
          break;
        case 4:
          EXPECT_EQ(mixed.g(), fresh.g());
          break;
        case 5:
          EXPECT_EQ(mixed.task().Lambda, fresh.task().Lambda);
          break;
        case 6:
          EXPECT_EQ(mixed.X_WJ(0).position, fresh.X_WJ(0).position);
          break;
        default:
          EXPECT_EQ(mixed.manipulability(), fresh.manipulability());
          break;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Joints, ModelTermsTest, testing::Values(6, 7, 9));

// Each term is computed once: a second call returns the same object unchanged. The test overwrites the first
// result through a const_cast and expects to read its own value.
TEST(ModelTerms, EachTermIsComputedOncePerUpdate) {
  ModelTerms terms(TestArm::make().model());
  const JointVector q = joint_constant(7, 0.4), dq = joint_constant(7, 0.2);
  terms.update(q, dq);
  const auto entry = [](const auto& term) -> double& { return const_cast<double&>(*term.data()); };
  for (const auto& term : {&ModelTerms::c, &ModelTerms::g}) {
    entry((terms.*term)()) = 1234;
    EXPECT_EQ((terms.*term)()[0], 1234);
  }
  entry(terms.M()) = 1234;
  EXPECT_EQ(terms.M()(0, 0), 1234);
  terms.update(q, dq);
  EXPECT_NE(terms.c()[0], 1234);
  EXPECT_NE(terms.g()[0], 1234);
  EXPECT_NE(terms.M()(0, 0), 1234);
}

TEST(ModelTerms, StateSetsFramesAndLoads) {
  Draw draw(14);
  const auto model = TestArm::make().model(draw.pose(1));
  ArmState state;
  state.q = draw.joints(7, 1);
  state.dq = draw.joints(7, 1);
  state.frames.X_FE = draw.pose(0.3);
  state.load = draw.load(2);
  ModelTerms by_state(model), by_hand(model);
  by_hand.set_config(state.frames, state.tool, state.load);
  by_hand.update(state.q, state.dq);
  by_state.update(state);  // the first state sets frames and loads, whatever its version
  EXPECT_EQ(by_state.X_WE().position, by_hand.X_WE().position);
  EXPECT_EQ(by_state.M(), by_hand.M());
  state.load = {};
  state.config_version = 1;
  by_state.update(state);
  EXPECT_GT((by_state.M() - by_hand.M()).norm(), 0.01);
}

TEST(ModelTerms, TaskSpaceIsKhatibsAndFlooredNearSingularities) {
  Draw draw(15);
  ModelTerms terms(TestArm::make().model(draw.pose(1)));
  int exact = 0;
  for (int k = 0; k < 50; ++k) {
    const JointVector q = draw.joints(7, 1.5);
    terms.update(q, 0 * q);
    const auto& task = terms.task();
    const Eigen::MatrixXd J = terms.J_V_WE(), M = terms.M();
    const Eigen::MatrixXd A = J * test::inverse(M) * J.transpose();
    EXPECT_LT((task.mobility - A).norm(), 1e-8 * A.norm());
    if (task.floored) continue;
    ++exact;
    EXPECT_LT((task.Lambda * A - Matrix6::Identity()).norm(), 1e-6);
    const JointVector tau = draw.joints(7, 10);
    const JointVector null = task.null_space_torque(terms.J_V_WE(), tau);
    EXPECT_LT((J * test::inverse(M) * Eigen::VectorXd(null)).norm(), 1e-8);
    EXPECT_LT((J * Eigen::VectorXd(task.null_space_velocity(terms.J_V_WE(), tau))).norm(), 1e-8);
  }
  EXPECT_GT(exact, 10);
}

TEST(ArmModel, RefusesInvalidSources) {
  ArmModelSource source;
  source.name = "bad";
  source.urdf = "<robot";
  source.flange = "flange";
  EXPECT_THROW(ArmModel{source}, std::invalid_argument);
  source.urdf = TestArm::make().urdf();
  // An axis of length zero would make a rotation that is none: the arm would be computed at another place.
  std::string without_direction = source.urdf;
  const std::size_t at = without_direction.find("xyz='", without_direction.find("<axis ")) + 5;
  without_direction.replace(at, without_direction.find('\'', at) - at, "0 0 0");
  source.urdf.swap(without_direction);
  EXPECT_THROW(ArmModel{source}, std::invalid_argument);
  source.urdf.swap(without_direction);
  source.flange = "no_such_link";
  EXPECT_THROW(ArmModel{source}, std::invalid_argument);
  source.flange = "link2";
  EXPECT_THROW(ArmModel{source}, std::invalid_argument);
  source.flange = "flange";
  source.limits.q_min = joint_constant(6, -1);
  EXPECT_THROW(ArmModel{source}, std::invalid_argument);
  source.limits.q_min = joint_constant(7, 3);
  EXPECT_THROW(ArmModel{source}, std::invalid_argument);
  source.limits.q_min = joint_constant(7, -1);
  EXPECT_EQ(ArmModel(source).limits().q_min[3], -1);
  EXPECT_EQ(ArmModel(source).limits().tau_max[3], 80);
}

}  // namespace
}  // namespace multipanda::model_terms_test
