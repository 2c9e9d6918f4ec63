#include "models/testing/two_engines.hpp"

#include <array>
#include <stdexcept>

#include <gtest/gtest.h>
#include <mujoco/mujoco.h>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/model.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/parsers/urdf.hpp>

namespace multipanda::test {

using Eigen::VectorXd;

struct MujocoArm::Engine {
  std::unique_ptr<mjModel, void (*)(mjModel*)> model{nullptr, mj_deleteModel};
  std::unique_ptr<mjData, void (*)(mjData*)> data{nullptr, mj_deleteData};
};

MujocoArm::MujocoArm(const std::string& mjcf) : engine_(std::make_unique<Engine>()) {
  std::array<char, 1000> error{};
  const std::unique_ptr<mjSpec, void (*)(mjSpec*)> spec(
      mj_parseXMLString(mjcf.c_str(), nullptr, error.data(), static_cast<int>(error.size())), mj_deleteSpec);
  if (!spec) throw std::runtime_error(error.data());
  engine_->model.reset(mj_compile(spec.get(), nullptr));
  if (!engine_->model) throw std::runtime_error(mjs_getError(spec.get()));
  engine_->data.reset(mj_makeData(engine_->model.get()));
}
MujocoArm::~MujocoArm() = default;

int MujocoArm::joints() const { return static_cast<int>(engine_->model->nv); }

void MujocoArm::place_base(const Pose& X_WB) {
  mjModel* model = engine_->model.get();
  const int base = mj_name2id(model, mjOBJ_BODY, "link0");
  const Quaternion q = X_WB.quaternion();
  const std::array<double, 4> wxyz{q.w(), q.x(), q.y(), q.z()};
  std::copy_n(X_WB.position.data(), 3, model->body_pos + 3 * base);
  std::copy_n(wxyz.data(), 4, model->body_quat + 4 * base);
}

Terms MujocoArm::terms(const VectorXd& q, const VectorXd& dq, const std::vector<std::string>& sites) {
  mjModel* model = engine_->model.get();
  mjData* data = engine_->data.get();
  Terms terms;
  const int n = joints();
  std::copy_n(q.data(), n, data->qpos);
  std::copy_n(dq.data(), n, data->qvel);
  mj_forward(model, data);
  const VectorXd bias = Eigen::Map<VectorXd>(data->qfrc_bias, n);
  RowMatrix M(n, n);
  mj_fullM(model, data, M.data());
  terms.M = M;
  for (const auto& name : sites) {
    const int site = mj_name2id(model, mjOBJ_SITE, name.c_str());
    EXPECT_GE(site, 0) << name;
    Pose pose;
    pose.position = Eigen::Map<Vector3>(data->site_xpos + 3 * site);
    pose.rotation = Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(data->site_xmat + 9 * site);
    terms.poses.push_back(pose);
    RowMatrix J(6, n);
    mj_jacSite(model, data, J.data(), J.data() + 3 * n, site);
    terms.jacobians.push_back(J);
  }
  mju_zero(data->qvel, n);
  mj_forward(model, data);
  terms.g = Eigen::Map<VectorXd>(data->qfrc_bias, n);
  terms.c = bias - terms.g;
  return terms;
}

struct PinocchioArm::Engine {
  pinocchio::Model model;
  pinocchio::Data data;
  pinocchio::SE3 X_BR = pinocchio::SE3::Identity();  // the file's root in the base
  // Joints that are attached to the root, and where.
  std::vector<std::pair<std::size_t, pinocchio::SE3>> on_root;
  void ready() {
    for (std::size_t j = 1; j < model.joints.size(); ++j) {
      if (model.parents[j] == 0) on_root.emplace_back(j, model.jointPlacements[j]);
    }
    data = pinocchio::Data(model);
  }
};

PinocchioArm::PinocchioArm(const std::string& urdf) : engine_(std::make_unique<Engine>()) {
  pinocchio::urdf::buildModelFromXML(urdf, engine_->model);
  engine_->ready();
}

PinocchioArm::PinocchioArm(const std::string& urdf, const std::string& base,
                           const std::vector<std::string>& joints, const std::map<std::string, double>& held)
    : engine_(std::make_unique<Engine>()) {
  pinocchio::Model whole;
  pinocchio::urdf::buildModelFromXML(urdf, whole);
  VectorXd stand = pinocchio::neutral(whole);
  std::vector<pinocchio::JointIndex> still;
  for (pinocchio::JointIndex j = 1; j < whole.joints.size(); ++j) {
    if (std::find(joints.begin(), joints.end(), whole.names[j]) != joints.end()) continue;
    still.push_back(j);
    if (held.count(whole.names[j]) > 0) stand[whole.idx_qs[j]] = held.at(whole.names[j]);
  }
  pinocchio::buildReducedModel(whole, still, stand, engine_->model);
  const auto& frame = engine_->model.frames[engine_->model.getFrameId(base)];
  EXPECT_EQ(frame.parentJoint, 0u) << base << " moves";
  engine_->X_BR = frame.placement.inverse();
  engine_->ready();
}
PinocchioArm::~PinocchioArm() = default;

int PinocchioArm::joints() const { return engine_->model.nv; }

void PinocchioArm::place_base(const Pose& X_WB) {
  const pinocchio::SE3 X_WR = pinocchio::SE3(X_WB.rotation, X_WB.position) * engine_->X_BR;
  for (const auto& [joint, X_RJ] : engine_->on_root) engine_->model.jointPlacements[joint] = X_WR * X_RJ;
}

Terms PinocchioArm::terms(const VectorXd& q, const VectorXd& dq, const std::vector<std::string>& frames) {
  auto& model = engine_->model;
  auto& data = engine_->data;
  Terms terms;
  const VectorXd zero = VectorXd::Zero(model.nv);
  pinocchio::crba(model, data, Eigen::Ref<const VectorXd>(q));  // the overload in Pinocchio's library
  terms.M = data.M.selfadjointView<Eigen::Upper>();
  terms.g = pinocchio::rnea(model, data, q, zero, zero);
  terms.c = pinocchio::rnea(model, data, q, dq, zero) - terms.g;
  pinocchio::computeJointJacobians(model, data, q);
  pinocchio::updateFramePlacements(model, data);
  for (const auto& name : frames) {
    EXPECT_TRUE(model.existFrame(name)) << name;
    const auto id = model.getFrameId(name);
    terms.poses.push_back({data.oMf[id].rotation(), data.oMf[id].translation()});
    pinocchio::Data::Matrix6x J = pinocchio::Data::Matrix6x::Zero(6, model.nv);
    pinocchio::getFrameJacobian(model, data, id, pinocchio::LOCAL_WORLD_ALIGNED, J);
    terms.jacobians.emplace_back(J);
  }
  return terms;
}

Pose Random::pose() {
  const double z = uniform(-1, 1), y = uniform(-2, 2);
  const Vector3 p(uniform(-2, 2), y, z);
  Quaternion q;
  for (double* value : {&q.z(), &q.y(), &q.x(), &q.w()}) *value = normal();
  return Pose::from(p, q);
}

VectorXd Random::between(const JointVector& low, const JointVector& high) {
  VectorXd v(low.size());
  for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = uniform(low[i], high[i]);
  return v;
}

constexpr double kTolerance = 1e-9;

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

}  // namespace multipanda::test
