#include <stdexcept>
#include <string>

#include <pinocchio/multibody/data.hpp>
#include <pinocchio/multibody/model.hpp>

#include "sysid/identification/equations.hpp"
#include "sysid/identification/inertial_parameters.hpp"

// As in pinocchio/algorithm/regressor.hpp. Its inline definition takes half a minute to compile, although
// Pinocchio's library contains the function.
namespace pinocchio {
template <typename Scalar, int Options, template <typename, int> class Joints, typename Q, typename V,
          typename A>
typename DataTpl<Scalar, Options, Joints>::MatrixXs& computeJointTorqueRegressor(
    const ModelTpl<Scalar, Options, Joints>& model, DataTpl<Scalar, Options, Joints>& data,
    const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& dq, const Eigen::MatrixBase<A>& ddq);
}

namespace multipanda {

struct ArmRegressor::Engine {
  pinocchio::Model model;
  std::unique_ptr<pinocchio::Data> data;
  Eigen::VectorXd zero;
  Eigen::MatrixXd Y;
};

ArmRegressor::ArmRegressor(const RobotDescription& robot) : engine_(std::make_unique<Engine>()) {
  if (robot.has_prismatic_joints()) {
    throw std::invalid_argument("robot '" + robot.name +
                                "' has a prismatic joint; expected revolute joints only for identification");
  }
  pinocchio::Model& model = engine_->model;
  pinocchio::JointIndex parent = 0;
  for (std::size_t i = 0; i < robot.joint_count(); ++i) {
    const Pose X = robot.joints[i].pose();
    parent = model.addJoint(parent, pinocchio::JointModelRZ(), pinocchio::SE3(X.rotation, X.position),
                            "joint" + std::to_string(i + 1));
  }
  engine_->data = std::make_unique<pinocchio::Data>(model);
  engine_->zero = Eigen::VectorXd::Zero(model.nv);
}
ArmRegressor::~ArmRegressor() = default;
ArmRegressor::ArmRegressor(ArmRegressor&&) noexcept = default;

Eigen::Index ArmRegressor::joints() const { return engine_->model.nv; }

const Eigen::MatrixXd& ArmRegressor::at(const Eigen::VectorXd& q, const Eigen::VectorXd& dq,
                                        const Eigen::VectorXd& ddq, const Vector3& gravity_B) {
  engine_->model.gravity.linear() = gravity_B;
  engine_->Y = pinocchio::computeJointTorqueRegressor(engine_->model, *engine_->data, q, dq, ddq);
  return engine_->Y;
}

const Eigen::MatrixXd& ArmRegressor::of_field(const Eigen::VectorXd& q, const Vector3& field_B) {
  return at(q, engine_->zero, engine_->zero, field_B);
}

Eigen::VectorXd thetas_of(const RobotDescription& robot) {
  const auto n = static_cast<Eigen::Index>(robot.joint_count());
  Eigen::VectorXd theta(10 * n);
  for (Eigen::Index i = 0; i < n; ++i) {
    theta.segment<10>(10 * i) = theta_of(robot.links.at(static_cast<std::size_t>(i) + 1));
  }
  return theta;
}

std::optional<RigidBody> known_body(const RobotDescription& robot, bool hand,
                                    const std::optional<RigidBody>& tool) {
  std::optional<RigidBody> body;
  if (hand) {
    if (!robot.hand) {
      throw std::invalid_argument(
          robot.name + " has no hand; leave out --hand, or give the mass and center of the tool with --tool");
    }
    body = moved(rigid_hand(*robot.hand), robot.flange.pose() * robot.hand->mount.pose());
  }
  if (tool && tool->mass > 0) {
    const RigidBody there = moved(*tool, robot.flange.pose());
    body = body ? merged(*body, there) : there;
  }
  return body;
}

Vector3 tilted(const Vector3& gravity_B, const Eigen::Vector2d& tilt) {
  const Matrix3 R =
      (Eigen::AngleAxisd(tilt[1], Vector3::UnitY()) * Eigen::AngleAxisd(tilt[0], Vector3::UnitX()))
          .toRotationMatrix();
  return R.transpose() * gravity_B;
}

Eigen::Matrix<double, 3, 2> tilt_directions(const Vector3& gravity_B) {
  Eigen::Matrix<double, 3, 2> out;
  out.col(0) = -Vector3::UnitX().cross(gravity_B);
  out.col(1) = -Vector3::UnitY().cross(gravity_B);
  return out;
}

}  // namespace multipanda
