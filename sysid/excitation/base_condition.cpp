#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>

#include "sysid/excitation/excitation.hpp"

namespace multipanda {
namespace {

using Block = Eigen::Matrix<double, 3, 10>;

Matrix3 cross(const Vector3& v) {
  Matrix3 S;
  S << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return S;
}

// I v as a matrix times [Ixx, Ixy, Iyy, Ixz, Iyz, Izz].
Eigen::Matrix<double, 3, 6> inertia_times(const Vector3& v) {
  Eigen::Matrix<double, 3, 6> L;
  L << v.x(), v.y(), 0, v.z(), 0, 0,  //
      0, v.x(), v.y(), 0, v.z(), 0,   //
      0, 0, 0, v.x(), v.y(), v.z();
  return L;
}

constexpr int kStates = 200;       // far more rows than columns
constexpr double kNothing = 1e-9;  // relative to the largest pivot: smaller columns depend on the others

}  // namespace

DynamicsRegressor::DynamicsRegressor(const RobotDescription& robot)
    : p_(robot.joint_count()), z_(robot.joint_count()) {
  if (robot.has_prismatic_joints()) {
    throw std::invalid_argument("robot '" + robot.name +
                                "' has a prismatic joint; expected revolute joints only for identification");
  }
  for (const auto& joint : robot.joints) X_.push_back(joint.pose());
  const auto n = static_cast<Eigen::Index>(X_.size());
  Y_ = Eigen::MatrixXd::Zero(n, 10 * n);
}

const Eigen::MatrixXd& DynamicsRegressor::evaluate(const JointVector& q, const JointVector& dq,
                                                   const JointVector& ddq) {
  Matrix3 R = Matrix3::Identity();  // of the link in the base; all vectors below in the base's axes
  Vector3 p = Vector3::Zero(), omega = Vector3::Zero(), alpha = Vector3::Zero(), a(0, 0, 9.81);
  for (std::size_t i = 0; i < X_.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const Vector3 r = R * X_[i].position;
    a += alpha.cross(r) + omega.cross(omega.cross(r));
    p += r;
    R = R * X_[i].rotation * Eigen::AngleAxisd(q[k], Vector3::UnitZ()).toRotationMatrix();
    p_[i] = p;
    z_[i] = R.col(2);
    alpha += z_[i] * ddq[k] + omega.cross(z_[i] * dq[k]);
    omega += z_[i] * dq[k];

    const Matrix3 W = cross(omega);
    const Vector3 omega_L = R.transpose() * omega, alpha_L = R.transpose() * alpha;
    Block force, moment;
    force << a, (cross(alpha) + W * W) * R, Eigen::Matrix<double, 3, 6>::Zero();
    moment << Vector3::Zero(), -cross(a) * R,
        R * (inertia_times(alpha_L) + cross(omega_L) * inertia_times(omega_L));
    for (std::size_t j = 0; j <= i; ++j) {
      const Vector3 lever = z_[j].cross(p - p_[j]);  // z . (r x f) = (z x r) . f
      Y_.block<1, 10>(static_cast<Eigen::Index>(j), 10 * k) =
          z_[j].transpose() * moment + lever.transpose() * force;
    }
  }
  return Y_;
}

Eigen::VectorXd link_parameters(const RobotDescription& robot, bool hand) {
  const auto n = static_cast<Eigen::Index>(robot.joint_count());
  Eigen::VectorXd phi(10 * n);
  for (Eigen::Index k = 0; k < n; ++k) {
    RigidBody body = robot.links[static_cast<std::size_t>(k + 1)];
    if (hand && robot.hand && k + 1 == n) {
      body = merged(body, moved(rigid_hand(*robot.hand), robot.flange.pose() * robot.hand->mount.pose()));
    }
    const Matrix3 S = cross(body.com);
    const Matrix3 I = body.inertia - body.mass * S * S;
    phi.segment<10>(10 * k) << body.mass, body.mass * body.com, I(0, 0), I(0, 1), I(1, 1), I(0, 2), I(1, 2),
        I(2, 2);
  }
  return phi;
}

BaseCondition::BaseCondition(const RobotDescription& robot) : regressor_(robot) {
  const auto n = static_cast<Eigen::Index>(robot.joint_count());
  std::mt19937_64 bits(1);
  const auto draw = [&] {
    JointVector v(n);
    for (Eigen::Index i = 0; i < n; ++i) v[i] = (static_cast<double>(bits() >> 11) * 0x1p-52 - 1) * 3;
    return v;
  };
  Eigen::MatrixXd stacked(n * kStates, 10 * n);
  for (Eigen::Index s = 0; s < kStates; ++s) {
    const JointVector q = draw(), dq = draw(), ddq = draw();
    stacked.middleRows(n * s, n) = regressor_.evaluate(q, dq, ddq);
  }
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(stacked);
  qr.setThreshold(kNothing);
  for (Eigen::Index k = 0; k < qr.rank(); ++k) columns_.push_back(qr.colsPermutation().indices()[k]);
  std::sort(columns_.begin(), columns_.end());
  chosen_.resize(n, static_cast<Eigen::Index>(columns_.size()));
  begin();
}

void BaseCondition::begin() { gram_ = Eigen::MatrixXd::Zero(chosen_.cols(), chosen_.cols()); }

void BaseCondition::add(const JointVector& q, const JointVector& dq, const JointVector& ddq) {
  const Eigen::MatrixXd& Y = regressor_.evaluate(q, dq, ddq);
  for (std::size_t k = 0; k < columns_.size(); ++k) {
    chosen_.col(static_cast<Eigen::Index>(k)) = Y.col(columns_[k]);
  }
  gram_.selfadjointView<Eigen::Lower>().rankUpdate(chosen_.transpose());
}

double BaseCondition::value() const {
  const Eigen::VectorXd length = gram_.diagonal().cwiseSqrt();
  if (!(length.minCoeff() > 0)) return std::numeric_limits<double>::infinity();
  const Eigen::VectorXd scale = length.cwiseInverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * gram_ * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scaled, Eigen::EigenvaluesOnly);
  const double least = solver.eigenvalues().minCoeff(), most = solver.eigenvalues().maxCoeff();
  return least > 0 ? std::sqrt(most / least) : std::numeric_limits<double>::infinity();
}

}  // namespace multipanda
