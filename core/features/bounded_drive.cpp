#include "core/features/bounded_drive.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/types/triangular.hpp"

namespace multipanda {
namespace {

constexpr double kRise = 0.1;       // [s]
constexpr double kFall = 0.2;       // [s], as ParameterSet::kRamp
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

// The share of a torque that is left at the arm's speed. `rate`: its acceleration to the fastest allowed
// motions [1/s]; `most`: of it acts.
double share_at_speed(const ControlContext& context, const OwnedArm& arm, const JointVector& tau,
                      double mobility, double rate, double most) {
  const double beta = std::max(0.0, tau.dot(arm.dq()) / mobility);
  const double speed = arm.terms->V_WE().linear().norm() / context.contact.hand_speed;
  const double fast = std::clamp((speed - kFastFrom) / (kHandShare - kFastFrom), 0.0, 1.0);
  const double gone = std::min(1.0, std::min(rate, kSteepest / most) * beta);
  return most * (1 - gone) * (1 - fast * gone);
}

}  // namespace

double release_pace(const OwnedArm& arm, const ContactBounds& contact) {
  constexpr double kShare = 0.4, kTurning = 0.5, kSlowest = 0.05;  // of its speed, [rad/s], of the pace
  if (!std::isfinite(contact.hand_speed)) return 1;
  const double fastest = std::max(arm.terms->V_WE().linear().norm() / (kShare * contact.hand_speed),
                                  arm.dq().lpNorm<Eigen::Infinity>() / kTurning);
  return std::max(kSlowest, 1 - fastest);
}

JointVector BoundedDrive::limit(const ControlContext& context, const OwnedArm& arm, const JointVector& tau) {
  JointMatrix factor;
  if ((tau.isZero(0) && !keeps()) || !cholesky_factor(arm.terms->M(), factor)) {
    *this = {};
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
  const TaskSpace& task = arm.terms->task();
  const auto held = [&](const JointVector& torque) {
    const Vector6 pull = task.J_bar.transpose().lazyProduct(torque);
    return task.floored ? Vector6(task.press() * pull) : pull;
  };
  const auto share_of = [&](const Vector6& pull) {
    return std::max(pull.head<3>().norm() / contact.spring_force,
                    pull.tail<3>().norm() / contact.spring_moment);
  };
  const auto rate_of = [&](const JointVector& ddq) {  // to the fastest allowed motions [1/s]
    const double hand = Vector3(arm.terms->J_V_WE().topRows<3>().lazyProduct(ddq)).norm();
    return std::max(hand / (kHandShare * contact.hand_speed), ddq.norm() / kJointSpeed);
  };
  const JointVector ddq = cholesky_solve(factor, tau);
  const double mobility = tau.dot(ddq);
  double rate = 0, most = 0;
  if (mobility > 0) {
    const bool known = law != nullptr && law->size() == tau.size();
    const Vector6 pull = held(tau), others = held(*arm.tau), rest = known ? held(*law) + others : others;
    rate = rate_of(ddq);
    const double light = std::min(1.0, kSteepest / rate);
    most = std::min(
        allowed_share(contact.spring_force, pull.head<3>(), others.head<3>(), rest.head<3>(), light),
        allowed_share(contact.spring_moment, pull.tail<3>(), others.tail<3>(), rest.tail<3>(), light));
    for (Eigen::Index i = 0; i < tau.size(); ++i) {
      if (!arm.model().is_prismatic(static_cast<std::size_t>(i))) continue;
      const double of_others = (*arm.tau)[i], of_rest = known ? (*law)[i] + of_others : of_others;
      most = std::min(most, allowed_share(contact.spring_force, tau[i] * Vector3::UnitX(),
                                          of_others * Vector3::UnitX(), of_rest * Vector3::UnitX(), 1));
    }
    const double drawn = most * share_of(pull);
    share_ = std::min(drawn, before + context.dt / kRise);
    if (drawn > share_) most *= share_ / drawn;
  } else if (!tau.isZero(0)) {
    return tau;
  }
  const JointVector now = most * tau;
  const std::uint32_t version = context.parameters == nullptr ? 0 : context.parameters->version();
  const bool goes_on = context.time_s - std::exchange(time_s_, context.time_s) < 1.5 * context.dt && keeps();
  changed_ = goes_on && (changed_ || version != version_);
  version_ = version;
  const Vector6 kept = goes_on ? held(last_) : Vector6(Vector6::Zero());
  // A light wrist would shake, some periods late.
  const bool of_hand =
      kept.head<3>().norm() / contact.spring_force > kept.tail<3>().norm() / contact.spring_moment;
  const bool brakes = goes_on && last_.dot(arm.dq()) < 0 && (changed_ || of_hand);
  if (brakes || changed_) {
    const bool falls = share_of(kept) > share_of(held(now));
    const double fall = (brakes ? release_pace(arm, contact) : 1) / kFall;
    // Where it rises, what turns it takes from some joints: that goes like a fall.
    const JointVector M_inv_last = cholesky_solve(factor, last_);
    const double along = falls ? 1 : std::max(1.0, now.dot(M_inv_last) / last_.dot(M_inv_last));
    const auto part_of = [&](const JointVector& way, double pace) {
      const double far = share_of(held(way));
      return far > pace * context.dt ? pace * context.dt / far : 1.0;
    };
    const JointVector rise = (along - 1) * last_, turn = now - along * last_;
    const double risen = part_of(rise, 1 / kRise), turned = part_of(turn, fall);
    if (std::min(risen, turned) < 1 && (falls || changed_)) {
      last_ += risen * rise + turned * turn;
      const JointVector ddq_kept = cholesky_solve(factor, last_);
      return share_at_speed(context, arm, last_, last_.dot(ddq_kept), rate_of(ddq_kept), 1) * last_;
    }
    changed_ = false;
  }
  last_ = now;
  if (!(mobility > 0)) return tau;
  return share_at_speed(context, arm, tau, mobility, rate, most) * tau;
}

}  // namespace multipanda
