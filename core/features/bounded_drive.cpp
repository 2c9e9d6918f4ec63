#include "core/features/bounded_drive.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/types/triangular.hpp"

namespace multipanda {
namespace {

constexpr double kRise = 0.1;       // [s]
constexpr double kHandShare = 0.9;  // of hand_speed, at which tau ends: torques act some periods late
constexpr double kFastFrom = 0.6;   // of hand_speed, on any way: from here on tau falls earlier
constexpr double kJointSpeed = 1;   // of all joints together [rad/s], [m/s]
constexpr double kSteepest = 200;   // [1/s]

// The share of a pull that is allowed: together with the pulls of other features along it up to `most`, plus
// as much as they and the controllet, `rest`, press against it.
double allowed_share(double most, const Vector3& pull, const Vector3& others, const Vector3& rest,
                     double light) {
  const double size = pull.norm();
  if (!(size > 0)) return light;
  const double own = std::min(light, std::max(0.0, most - std::max(0.0, others.dot(pull) / size)) / size);
  return std::min(1.0, own + std::clamp(-rest.dot(pull) / size, 0.0, most) / size);
}

}  // namespace

JointVector BoundedDrive::limit(const ControlContext& context, const OwnedArm& arm, const JointVector& tau) {
  JointMatrix factor;
  if (tau.isZero(0) || !cholesky_factor(arm.terms->M(), factor)) {
    share_ = 0;
    return JointVector::Zero(tau.size());
  }
  const JointVector* law = nullptr;
  for (const OwnedArm& other : context.scene_arms) {
    if (other.terms == arm.terms) law = other.tau;
  }
  return limit(context, arm, tau, factor, law);
}

JointVector BoundedDrive::limit(const ControlContext& context, const OwnedArm& arm, const JointVector& tau,
                                const JointMatrix& factor, const JointVector* law) {
  const ContactBounds& contact = context.contact;
  const double before = std::exchange(share_, 0);
  if (!std::isfinite(contact.spring_force + contact.spring_moment + contact.hand_speed)) return tau;
  const JointVector ddq = cholesky_solve(factor, tau);
  const double mobility = tau.dot(ddq);
  if (!(mobility > 0)) return tau;
  const TaskSpace& task = arm.terms->task();
  const auto held = [&](const JointVector& torque) {
    const Vector6 pull = task.J_bar.transpose().lazyProduct(torque);
    return task.floored ? Vector6(task.press() * pull) : pull;
  };
  const bool known = law != nullptr && law->size() == tau.size();
  const Vector6 pull = held(tau), others = held(*arm.tau), rest = known ? held(*law) + others : others;
  const double hand = Vector3(arm.terms->J_V_WE().topRows<3>().lazyProduct(ddq)).norm();
  const double rate =
      std::max(hand / (kHandShare * contact.hand_speed), ddq.norm() / kJointSpeed);  // to those speeds [1/s]
  const double light = std::min(1.0, kSteepest / rate);
  double most =
      std::min(allowed_share(contact.spring_force, pull.head<3>(), others.head<3>(), rest.head<3>(), light),
               allowed_share(contact.spring_moment, pull.tail<3>(), others.tail<3>(), rest.tail<3>(), light));
  for (Eigen::Index i = 0; i < tau.size(); ++i) {
    if (!arm.model().is_prismatic(static_cast<std::size_t>(i))) continue;
    const double of_others = (*arm.tau)[i], of_rest = known ? (*law)[i] + of_others : of_others;
    most = std::min(most, allowed_share(contact.spring_force, tau[i] * Vector3::UnitX(),
                                        of_others * Vector3::UnitX(), of_rest * Vector3::UnitX(), 1));
  }
  const double drawn = most * std::max(pull.head<3>().norm() / contact.spring_force,
                                       pull.tail<3>().norm() / contact.spring_moment);
  share_ = std::min(drawn, before + context.dt / kRise);
  if (drawn > share_) most *= share_ / drawn;
  const double beta = std::max(0.0, tau.dot(arm.dq()) / mobility);
  const double speed = arm.terms->V_WE().linear().norm() / contact.hand_speed;
  const double fast = std::clamp((speed - kFastFrom) / (kHandShare - kFastFrom), 0.0, 1.0);
  const double gone = std::min(1.0, std::min(rate, kSteepest / most) * beta);
  return most * (1 - gone) * (1 - fast * gone) * tau;
}

}  // namespace multipanda
