#include "sysid/excitation/dynamics_regressor.hpp"

#include <stdexcept>

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

}  // namespace multipanda
