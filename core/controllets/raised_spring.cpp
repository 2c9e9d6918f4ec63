#include "core/controllets/raised_spring.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "core/types/carriage_speed.hpp"

namespace multipanda {
namespace {

constexpr double kUsualSpeed = ContactBounds{}.hand_speed;
constexpr double kFeeding = 0.5;  // in which the feed-forward of acceleration ends or returns [s]

// The share of a speed that is within the greatest.
double share_within(double speed, double most) { return speed > most ? most / speed : 1; }

// The error, in the new axes, with the same spring force as before; no component larger than before.
Vector6 kept_error(const ImpedanceGains& before, const ImpedanceGains& now, const Matrix3& R_d,
                   const Vector6& error) {
  const Matrix3 axes = now.axes_at(R_d);
  const TaskStiffness K = before.stiffness(R_d);
  const auto kept = [&](const Matrix3& K_before, const Vector3& k, const Vector3& e) {
    const Vector3 force = axes.transpose() * (K_before * e);
    Vector3 along = axes.transpose() * e;
    bool rises = false;
    for (Eigen::Index i = 0; i < 3; ++i) {
      if (!(k[i] * std::abs(along[i]) > std::abs(force[i]) * (1 + 1e-12))) continue;
      along[i] = force[i] / k[i];
      rises = true;
    }
    return rises ? Vector3(axes * along) : e;
  };
  Vector6 e;
  e << kept(K.translation, now.translational_stiffness, error.head<3>()),
      kept(K.rotation, now.rotational_stiffness, error.tail<3>());
  return e;
}

}  // namespace

void ReturningOffset::start(Eigen::Index coordinates, Resistance::Waits waits) {
  value_ = JointVector::Zero(coordinates);
  motion_.start(coordinates);
  resistance_.start(coordinates, waits);
  none_ = true;
}

void ReturningOffset::shift(const JointVector& by) {
  if (by.isZero(0)) return;
  value_ += by;
  none_ = false;
}

void ReturningOffset::go(const JointVector& velocity) {
  if (velocity == motion_.velocity()) return;
  motion_.go(velocity);
  none_ = false;
}

void ReturningOffset::advance(const JointVector& behind, double speed, double acceleration, double dt) {
  if (none_) return;
  const Eigen::Index n = value_.size();
  // The jerk lets it brake without passing its end (following_motion.hpp).
  const FollowingLimits limits{0, n, speed, acceleration, FollowingMotion::kPole * acceleration};
  const JointVector back = motion_.desired(-value_, JointVector::Zero(n), limits, resistance_, dt);
  motion_.advance(back - behind, limits, dt);
  value_ += dt * motion_.velocity();
  constexpr double kThere = 1e-7, kRests = 1e-5;  // what is left then is less than a sensor resolves
  if (value_.norm() < kThere && motion_.velocity().norm() < kRests) start(n, resistance_.waits());
}

void ReturningOffset::resist(const JointVector& pull, double share, double dt) {
  if (!none_) resistance_.update(pull, share, dt);
}

double farthest_point(ModelTerms& terms) {
  double farthest = 0;
  for (const Vector3& p : terms.points_from_hand()) farthest = std::max(farthest, p.norm());
  return farthest;
}

RaisedSpring::RaisedSpring() {
  position_.start(3);
  rotation_.start(3);
}

CartesianTarget RaisedSpring::follow(const ImpedanceGains& asked, const CartesianTarget& rule,
                                     ModelTerms& terms, double dt) {
  const std::optional<ImpedanceGains> before = changed(asked);
  if (none() && !before) return rule;
  const Pose X_FE = terms.X_WF().inverse() * terms.X_WE();
  if (!rotation_.none() && (X_FE.position - X_FE_.position).norm() > 1e-9) {
    // A redefined end effector carries the seen set-point as it does the rule's.
    const Vector3 p = rule.X_W_d.rotation * X_FE.rotation.transpose() * (X_FE.position - X_FE_.position);
    position_.shift(exp_rotation(rotation_.value()) * p - p);
  }
  X_FE_ = X_FE;
  come_back(rule.V_d.vector, asked.contact.hand_speed, farthest_point(terms), dt);
  CartesianTarget target = seen(rule);
  if (before) {
    ImpedanceGains was = *before, is = asked;
    was.soften(rule.X_W_d.rotation, terms);
    is.soften(rule.X_W_d.rotation, terms);
    raise(was, is, rule, terms.X_WE(), target);
  }
  return target;
}

void RaisedSpring::resist(const Vector6& pull, double force_share, double moment_share, double dt) {
  position_.resist(pull.head<3>(), force_share, dt);
  rotation_.resist(pull.tail<3>(), moment_share, dt);
}

std::optional<ImpedanceGains> RaisedSpring::changed(const ImpedanceGains& asked) {
  if (before_ && before_->translational_stiffness == asked.translational_stiffness &&
      before_->rotational_stiffness == asked.rotational_stiffness && before_->axes == asked.axes) {
    return std::nullopt;
  }
  return std::exchange(before_, asked);
}

void RaisedSpring::come_back(const Vector6& V_rule, double hand_speed, double lever, double dt) {
  if (none()) return;
  const bool is_back = position_.none() && rotation_.none();
  fed_ = std::clamp(fed_ + (is_back ? dt : -dt) / kFeeding, 0.0, 1.0);
  const double most = std::min(hand_speed, kUsualSpeed), together = ReturningOffset::kTogether * hand_speed;
  const double share_of_rule =
      share_within(V_rule.head<3>().norm() + lever * V_rule.tail<3>().norm(), together);
  const Vector6 V = share_of_rule * V_rule, behind = V_rule - V;
  const double turned = lever * V.tail<3>().norm();
  const auto speed_of = [](const ReturningOffset& offset, double speed) {
    return Vector3(-speed * Vector3(offset.value()).normalized());
  };
  const double speed = ReturningOffset::kShare * most;
  const double share =
      largest_share(V.head<3>(), speed_of(position_, speed), std::max(0.0, together - turned));
  position_.advance(behind.head<3>(), share * speed, ReturningOffset::kSlides, dt);
  double turning = ReturningOffset::kTurning * most / kUsualSpeed;
  if (lever > 0 && std::isfinite(hand_speed)) {
    const double left = together - turned - (V_rule.head<3>() + Vector3(position_.velocity())).norm();
    turning = std::min(turning, std::max(0.0, left) / lever);
  }
  const Vector3 turns_behind = inverse_left_jacobian(-Vector3(rotation_.value())) * behind.tail<3>();
  rotation_.advance(turns_behind, turning, ReturningOffset::kTurns, dt);
}

CartesianTarget RaisedSpring::seen(const CartesianTarget& rule) const {
  if (none()) return rule;
  const Vector3 r = rotation_.value(), dr = rotation_.velocity();
  const Matrix3 R = exp_rotation(r), J = left_jacobian(r);
  const Vector3 omega = R * rule.V_d.angular(), own = J * dr;
  CartesianTarget target = rule;
  target.X_W_d.position += Vector3(position_.value());
  target.X_W_d.rotation = R * rule.X_W_d.rotation;
  target.V_d.linear() += Vector3(position_.velocity());
  target.V_d.angular() = omega + own;
  target.A_d.linear() += Vector3(position_.acceleration());
  target.A_d.angular() = R * rule.A_d.angular() + own.cross(omega) + J * Vector3(rotation_.acceleration()) +
                         left_jacobian_rate(r, dr);
  target.A_d.vector *= fed_;
  return target;
}

void RaisedSpring::raise(const ImpedanceGains& before, const ImpedanceGains& now, const CartesianTarget& rule,
                         const Pose& X, CartesianTarget& seen) {
  const Matrix3& R_d = rule.X_W_d.rotation;
  const Vector6 error = pose_error(seen.X_W_d, X);
  const Vector6 kept = kept_error(before, now, R_d, error);
  if (kept == error) return;
  const Twist V_d = before.led(seen, R_d).V_d;
  position_.shift(kept.head<3>() - error.head<3>());
  seen.X_W_d.position = X.position + kept.head<3>();
  if (kept.tail<3>() != error.tail<3>()) {
    seen.X_W_d.rotation = exp_rotation(kept.tail<3>()) * X.rotation;
    rotation_.shift(log_rotation(seen.X_W_d.rotation * R_d.transpose()) - Vector3(rotation_.value()));
  }
  if (before.leads()) return;
  // Nor does the set-point of an axis that had no stiffness set off at once.
  const Vector3 r = rotation_.value();
  position_.go(V_d.linear() - rule.V_d.linear());
  rotation_.go(inverse_left_jacobian(r) * (V_d.angular() - exp_rotation(r) * rule.V_d.angular()));
  fed_ = 0;
  seen.V_d = V_d;
  seen.A_d.vector.setZero();
}

Vector6 RaisedSpring::raise(const ImpedanceGains& before, const ImpedanceGains& now, const Matrix3& R_d,
                            const Vector6& error) {
  const Vector6 kept = kept_error(before, now, R_d, error);
  position_.shift(kept.head<3>() - error.head<3>());
  rotation_.shift(kept.tail<3>() - error.tail<3>());
  return kept;
}

Vector6 RaisedSpring::offset() const {
  Vector6 x;
  x << position_.value(), rotation_.value();
  return x;
}

void RaisedSpring::put(const Vector6& offset) {
  position_.shift(offset.head<3>() - Vector3(position_.value()));
  rotation_.shift(offset.tail<3>() - Vector3(rotation_.value()));
}

Vector6 RaisedSpring::velocity() const {
  Vector6 v;
  v << position_.velocity(), rotation_.velocity();
  return v;
}

JointTarget RaisedJoints::follow(const JointVector& stiffness, const JointTarget& rule,
                                 const ContactBounds& contact, OwnedArm& arm, double dt) {
  const Eigen::Index n = stiffness.size();
  if (before_.size() == 0) {
    before_ = stiffness;
    offset_.start(n, Resistance::Waits::all);
  }
  const bool same = before_ == stiffness;
  if (same && offset_.none()) return rule;
  if (!offset_.none()) {
    const Jacobian& J = arm.terms->J_V_WE();
    const JointVector way = -offset_.value().normalized();
    const auto [flange, tool] = arm.terms->points_from_hand();
    const std::array<Vector3, 3> points = {Vector3::Zero(), flange, tool};
    const Vector6 back = J.lazyProduct(way), ruled = J.lazyProduct(rule.dq_d);
    const auto at = [](const Vector6& V, const Vector3& p) -> Vector3 {
      return V.head<3>() + V.tail<3>().cross(p);
    };
    double reach = carriage_speed(J, way), fastest = carriage_speed(J, rule.dq_d), share = 1;
    for (const Vector3& p : points) {
      reach = std::max(reach, at(back, p).norm());
      fastest = std::max(fastest, at(ruled, p).norm());
    }
    const double together = ReturningOffset::kTogether * contact.hand_speed;
    const double share_of_rule = share_within(fastest, together);
    const double most = std::min(contact.hand_speed, kUsualSpeed);
    const double speed =
        std::min(ReturningOffset::kTurning, ReturningOffset::kShare * most / std::max(1e-9, reach));
    for (const Vector3& p : points) {
      share = std::min(share, largest_share(share_of_rule * at(ruled, p), speed * at(back, p), together));
    }
    offset_.advance((1 - share_of_rule) * rule.dq_d, share * speed, ReturningOffset::kJoints, dt);
  }
  if (!same) {
    // First the stiffnesses that fall, then those that rise: K e' = K_fallen e, all softened.
    const JointMatrix M = mass_with_motors(*arm.terms);
    JointMatrix fallen = before_.cwiseMin(stiffness).asDiagonal(), K = stiffness.asDiagonal(), L;
    soften(M, fallen);
    soften(M, K);
    constexpr double kTiny = 1e-6;  // [N m/rad]: a joint without stiffness keeps its error
    const JointVector error = rule.q_d + offset_.value() - arm.q();
    if (cholesky_factor<JointMatrix>(K + kTiny * JointMatrix::Identity(n, n), L) &&
        (before_.array() < stiffness.array()).any()) {
      offset_.shift(cholesky_solve(L, JointVector((fallen - K).lazyProduct(error))));
    }
    before_ = stiffness;
  }
  if (offset_.none()) return rule;
  return {rule.q_d + offset_.value(), rule.dq_d + offset_.velocity(), rule.ddq_d + offset_.acceleration()};
}

}  // namespace multipanda
