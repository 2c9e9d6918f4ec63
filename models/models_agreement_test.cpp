// URDF (Pinocchio) and MJCF (MuJoCo) are written from the same figures: two engines with nothing in common
// must find the same arm in them.
#include <array>
#include <cstdlib>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <mujoco/mujoco.h>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/parsers/urdf.hpp>

#include "models/robot_description.hpp"
#include "models/to_mjcf.hpp"
#include "models/to_urdf.hpp"

namespace multipanda {
namespace {

constexpr int kConfigurations = 200;
constexpr double kTolerance = 1e-9;  // [m, rad, kg m^2, N m] by quantity; round-off is about 1e-13

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Eigen::VectorXd;

struct Terms {
  std::vector<Pose> poses;           // of the frames asked for, in the world
  std::vector<RowMatrix> jacobians;  // (6 x n), world axes, linear first
  Eigen::MatrixXd M;
  VectorXd c, g;
};

class MujocoArm {
 public:
  explicit MujocoArm(const std::string& mjcf) {
    std::array<char, 1000> error{};
    const std::unique_ptr<mjSpec, void (*)(mjSpec*)> spec(
        mj_parseXMLString(mjcf.c_str(), nullptr, error.data(), static_cast<int>(error.size())),
        mj_deleteSpec);
    if (!spec) throw std::runtime_error(error.data());
    model_.reset(mj_compile(spec.get(), nullptr));
    if (!model_) throw std::runtime_error(mjs_getError(spec.get()));
    data_.reset(mj_makeData(model_.get()));
  }

  int joints() const { return static_cast<int>(model_->nv); }

  void place_base(const Pose& X_WB) {
    const int base = mj_name2id(model_.get(), mjOBJ_BODY, "link0");
    const Quaternion q = X_WB.quaternion();
    const std::array<double, 4> wxyz{q.w(), q.x(), q.y(), q.z()};
    std::copy_n(X_WB.position.data(), 3, model_->body_pos + 3 * base);
    std::copy_n(wxyz.data(), 4, model_->body_quat + 4 * base);
  }

  Terms terms(const VectorXd& q, const VectorXd& dq, const std::vector<std::string>& sites) {
    Terms terms;
    const int n = joints();
    std::copy_n(q.data(), n, data_->qpos);
    std::copy_n(dq.data(), n, data_->qvel);
    mj_forward(model_.get(), data_.get());
    const VectorXd bias = Eigen::Map<VectorXd>(data_->qfrc_bias, n);
    RowMatrix M(n, n);
    mj_fullM(model_.get(), data_.get(), M.data());
    terms.M = M;
    for (const auto& name : sites) {
      const int site = mj_name2id(model_.get(), mjOBJ_SITE, name.c_str());
      EXPECT_GE(site, 0) << name;
      Pose pose;
      pose.position = Eigen::Map<Vector3>(data_->site_xpos + 3 * site);
      pose.rotation = Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(data_->site_xmat + 9 * site);
      terms.poses.push_back(pose);
      RowMatrix J(6, n);
      mj_jacSite(model_.get(), data_.get(), J.data(), J.data() + 3 * n, site);
      terms.jacobians.push_back(J);
    }
    mju_zero(data_->qvel, n);
    mj_forward(model_.get(), data_.get());
    terms.g = Eigen::Map<VectorXd>(data_->qfrc_bias, n);
    terms.c = bias - terms.g;
    return terms;
  }

 private:
  std::unique_ptr<mjModel, void (*)(mjModel*)> model_{nullptr, mj_deleteModel};
  std::unique_ptr<mjData, void (*)(mjData*)> data_{nullptr, mj_deleteData};
};

class PinocchioArm {
 public:
  explicit PinocchioArm(const std::string& urdf) {
    pinocchio::urdf::buildModelFromXML(urdf, model_);
    X_BJ1_ = model_.jointPlacements[1];
    data_ = pinocchio::Data(model_);
  }

  int joints() const { return model_.nv; }
  void place_base(const Pose& X_WB) {
    model_.jointPlacements[1] = pinocchio::SE3(X_WB.rotation, X_WB.position) * X_BJ1_;
  }

  Terms terms(const VectorXd& q, const VectorXd& dq, const std::vector<std::string>& frames) {
    Terms terms;
    const VectorXd zero = VectorXd::Zero(model_.nv);
    pinocchio::crba(model_, data_, q);
    terms.M = data_.M.selfadjointView<Eigen::Upper>();
    terms.g = pinocchio::rnea(model_, data_, q, zero, zero);
    terms.c = pinocchio::rnea(model_, data_, q, dq, zero) - terms.g;
    pinocchio::computeJointJacobians(model_, data_, q);
    pinocchio::updateFramePlacements(model_, data_);
    for (const auto& name : frames) {
      EXPECT_TRUE(model_.existFrame(name)) << name;
      const auto id = model_.getFrameId(name);
      terms.poses.push_back({data_.oMf[id].rotation(), data_.oMf[id].translation()});
      pinocchio::Data::Matrix6x J = pinocchio::Data::Matrix6x::Zero(6, model_.nv);
      pinocchio::getFrameJacobian(model_, data_, id, pinocchio::LOCAL_WORLD_ALIGNED, J);
      terms.jacobians.emplace_back(J);
    }
    return terms;
  }

 private:
  pinocchio::Model model_;
  pinocchio::Data data_;
  pinocchio::SE3 X_BJ1_;
};

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine_);
  }
  Pose pose() {
    const Vector3 p(uniform(-2, 2), uniform(-2, 2), uniform(-1, 1));
    return Pose::from(p, Quaternion(normal(), normal(), normal(), normal()));
  }
  VectorXd between(const JointVector& low, const JointVector& high) {
    VectorXd v(low.size());
    for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = uniform(low[i], high[i]);
    return v;
  }

 private:
  double normal() { return std::normal_distribution<double>()(engine_); }
  std::mt19937_64 engine_;
};

void expect_equal(const Terms& a, const Terms& b) {
  ASSERT_EQ(a.poses.size(), b.poses.size());
  for (std::size_t f = 0; f < a.poses.size(); ++f) {
    EXPECT_LT((a.poses[f].position - b.poses[f].position).lpNorm<Eigen::Infinity>(), kTolerance);
    EXPECT_LT((a.poses[f].rotation - b.poses[f].rotation).lpNorm<Eigen::Infinity>(), kTolerance);
    EXPECT_LT((a.jacobians[f] - b.jacobians[f]).lpNorm<Eigen::Infinity>(), kTolerance);
  }
  EXPECT_LT((a.M - b.M).lpNorm<Eigen::Infinity>(), kTolerance);
  EXPECT_LT((a.c - b.c).lpNorm<Eigen::Infinity>(), kTolerance);
  EXPECT_LT((a.g - b.g).lpNorm<Eigen::Infinity>(), kTolerance);
}

struct Case {
  const char* robot;
  bool hand;
};

std::string path_of(const std::string& robot) {
  return robot == "ur5e" ? MULTIPANDA_SOURCE_DIR "/tests/models/ur5e.yaml" : robot;
}

class Agreement : public testing::TestWithParam<Case> {};

TEST_P(Agreement, UrdfAndMjcfAreTheSameArm) {
  const auto [name, hand] = GetParam();
  const RobotDescription robot = load_robot(path_of(name));
  MujocoArm mujoco(to_mjcf(robot, {.hand = hand}));
  PinocchioArm pinocchio(to_urdf(robot, {.hand = hand}));
  ASSERT_EQ(mujoco.joints(), static_cast<int>(robot.joint_count()));
  ASSERT_EQ(pinocchio.joints(), static_cast<int>(robot.joint_count()));
  const std::vector<std::string> frames =
      hand ? std::vector<std::string>{"flange", "hand_tcp"} : std::vector<std::string>{"flange"};
  Random random(20240607);
  double largest_coriolis = 0;
  for (int i = 0; i < kConfigurations && !HasFailure(); ++i) {
    SCOPED_TRACE(i);
    const Pose X_WB = random.pose();
    mujoco.place_base(X_WB);
    pinocchio.place_base(X_WB);
    const VectorXd q = random.between(robot.limits.q_min, robot.limits.q_max);
    const VectorXd dq = random.between(-robot.limits.dq_max, robot.limits.dq_max);
    const Terms a = mujoco.terms(q, dq, frames);
    expect_equal(a, pinocchio.terms(q, dq, frames));
    largest_coriolis = std::max(largest_coriolis, a.c.norm());
  }
  EXPECT_GT(largest_coriolis, 1.0);  // the comparison of c is one of numbers that matter
}

class MovableHand : public testing::TestWithParam<const char*> {};

// A hand with movable fingers, held closed, is the rigid hand: checks the merging of the three bodies by an
// engine that knows nothing of it.
TEST_P(MovableHand, HeldClosedWeighsTheSameAsTheRigidOne) {
  const RobotDescription robot = load_robot(GetParam());
  MujocoArm locked(to_mjcf(robot, {.hand = true}));
  MujocoArm movable(to_mjcf(robot, {.hand = true, .fingers = Fingers::movable}));
  const auto n = static_cast<Eigen::Index>(robot.joint_count());
  ASSERT_EQ(movable.joints(), n + 2);
  Random random(7);
  for (int i = 0; i < 50 && !HasFailure(); ++i) {
    const Pose X_WB = random.pose();
    locked.place_base(X_WB);
    movable.place_base(X_WB);
    const VectorXd q = random.between(robot.limits.q_min, robot.limits.q_max);
    const VectorXd dq = random.between(-robot.limits.dq_max, robot.limits.dq_max);
    VectorXd q2 = VectorXd::Zero(n + 2), dq2 = VectorXd::Zero(n + 2);
    q2.head(n) = q;
    dq2.head(n) = dq;
    Terms b = movable.terms(q2, dq2, {"flange", "hand_tcp"});
    b.M = Eigen::MatrixXd(b.M.topLeftCorner(n, n));
    b.c = VectorXd(b.c.head(n));
    b.g = VectorXd(b.g.head(n));
    for (auto& J : b.jacobians) J = RowMatrix(J.leftCols(n));
    expect_equal(locked.terms(q, dq, {"flange", "hand_tcp"}), b);
  }
}

INSTANTIATE_TEST_SUITE_P(Robots, Agreement,
                         testing::Values(Case{"fer", false}, Case{"fer", true}, Case{"fer_maker", false},
                                         Case{"fer_maker", true}, Case{"fr3", false}, Case{"fr3", true},
                                         Case{"ur5e", false}),
                         [](const auto& param) {
                           return std::string(param.param.robot) + (param.param.hand ? "_hand" : "");
                         });

INSTANTIATE_TEST_SUITE_P(Robots, MovableHand, testing::Values("fer", "fer_maker", "fr3"),
                         [](const auto& param) { return std::string(param.param); });

// The shift from link5 to link4 makes the links physical and changes nothing that can be felt at the joints.
TEST(FerMaker, MovesAsPublished) {
  const RobotDescription shifted = load_robot("fer_maker");
  RobotDescription published = shifted;
  published.links[4].inertia << 0.00784585566, -0.00339591957, 0.00158704074,  //
      -0.00339591957, 0.00649543136, -0.00181477884,                           //
      0.00158704074, -0.00181477884, 0.01003079917;
  published.links[5].inertia << 0.02297014781, -9.49345e-06, -2.063156e-05,  //
      -9.49345e-06, 0.02095060919, 0.00382345782,                            //
      -2.063156e-05, 0.00382345782, 0.00430606551;
  EXPECT_FALSE(is_physical(published.links[4]));  // the reason for the shift
  EXPECT_GT((published.links[5].inertia - shifted.links[5].inertia).norm(), 0.01);
  PinocchioArm a(to_urdf(shifted));
  PinocchioArm b(to_urdf(published));
  Random random(11);
  for (int i = 0; i < kConfigurations; ++i) {
    const VectorXd q = random.between(shifted.limits.q_min, shifted.limits.q_max);
    const VectorXd dq = random.between(-shifted.limits.dq_max, shifted.limits.dq_max);
    const Terms ta = a.terms(q, dq, {}), tb = b.terms(q, dq, {});
    ASSERT_LT((ta.M - tb.M).lpNorm<Eigen::Infinity>(), 1e-9);
    ASSERT_LT((ta.c - tb.c).lpNorm<Eigen::Infinity>(), 1e-9);
    ASSERT_LT((ta.g - tb.g).lpNorm<Eigen::Infinity>(), 1e-6);
  }
}

// Known poses, by hand.
TEST(Kinematics, ReadyPoseOfTheFrankaArmInClosedForm) {
  const RobotDescription robot = load_robot("fer");
  PinocchioArm arm(to_urdf(robot, {.hand = true}));
  const auto terms = arm.terms(robot.q_home, VectorXd::Zero(7), {"flange", "hand_tcp"});
  // In the plane y = 0: the upper arm leans back by 45 degrees, the forearm is level, the flange looks down.
  const double s = std::sqrt(0.5);
  const double x = -0.316 * s + 0.0825 * s + 0.384 + 0.088;
  const double z = 0.333 + 0.316 * s + 0.0825 * s + 0.0825 - 0.107;
  EXPECT_LT((terms.poses[0].position - Vector3(x, 0, z)).norm(), 1e-8);  // the pose is given to 9 digits
  EXPECT_LT((terms.poses[1].position - Vector3(x, 0, z - 0.1034)).norm(), 1e-8);
  EXPECT_LT((terms.poses[1].rotation - Matrix3(Vector3(1, -1, -1).asDiagonal())).norm(), 1e-7);
}

TEST(Kinematics, Ur5eFollowsItsDenavitHartenbergFigures) {
  const RobotDescription robot = load_robot(path_of("ur5e"));
  PinocchioArm arm(to_urdf(robot));
  const std::array<double, 6> d{0.1625, 0, 0, 0.1333, 0.0997, 0.0996}, a{0, -0.425, -0.3922, 0, 0, 0};
  const std::array<double, 6> alpha{M_PI_2, 0, 0, M_PI_2, -M_PI_2, 0};
  Random random(5);
  for (int i = 0; i < 20; ++i) {
    const VectorXd q = random.between(robot.limits.q_min, robot.limits.q_max);
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    for (std::size_t j = 0; j < 6; ++j) {
      T = T * Eigen::AngleAxisd(q[static_cast<Eigen::Index>(j)], Vector3::UnitZ()) *
          Eigen::Translation3d(a[j], 0, d[j]) * Eigen::AngleAxisd(alpha[j], Vector3::UnitX());
    }
    const auto terms = arm.terms(q, VectorXd::Zero(6), {"flange"});
    ASSERT_LT((terms.poses[0].position - T.translation()).norm(), 1e-12);
    ASSERT_LT((terms.poses[0].rotation - T.linear()).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace multipanda
