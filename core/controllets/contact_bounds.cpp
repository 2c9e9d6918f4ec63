#include "core/controllets/contact_bounds.hpp"

#include <algorithm>
#include <cmath>

namespace multipanda {
namespace {

// The speed at which the pull reaches zero, over the greatest speed of a set-point: an undisturbed hand at
// that speed keeps a third of the pull for friction and undeclared loads.
constexpr double kPullEnds = 1.5;
// Largest slope of the force over speed [N s/m]: it acts like damping, and with some periods of delay a
// larger one would shake a light hand. The usual bounds need 160, those of a reduced run 200.
constexpr double kSteepest = 300;

double share_of(double size, double greatest) {
  constexpr double kMost = 1e6;  // where nothing is allowed
  if (!(size > 0)) return 0;
  return greatest > size / kMost ? size / greatest : kMost;
}

double along(const Vector3& direction, double size, const Vector3& x) {
  return size > 0 ? std::max(0.0, direction.dot(x) / size) : 0;
}

// The largest allowed force along a pull.
double greatest_force(const ContactBounds& bounds, const Vector3& pull, double size, const Vector3& damping,
                      const Vector3& v) {
  const double speed = along(pull, size, v), opposing = along(pull, size, damping);
  if (!(speed > 0) || !std::isfinite(bounds.spring_force + bounds.hand_speed))
    return bounds.spring_force + opposing;
  return force_at_speed(bounds, speed) + opposing * std::min(1.0, bounds.hand_speed / speed);
}

}  // namespace

double force_at_speed(const ContactBounds& bounds, double speed) {
  if (!(speed > 0) || !std::isfinite(bounds.spring_force + bounds.hand_speed)) return bounds.spring_force;
  const double end = std::max(kPullEnds * bounds.hand_speed, bounds.spring_force / kSteepest);
  const double left = std::max(0.0, 1 - speed / end);
  return bounds.spring_force * left;
}

ContactBounds tighter(const ContactBounds& a, const ContactBounds& b) {
  return {std::min(a.hand_speed, b.hand_speed), std::min(a.spring_force, b.spring_force),
          std::min(a.spring_moment, b.spring_moment)};
}

BoundedPull bound_pull(const ContactBounds& bounds, const Vector6& pull, const Vector6& damping,
                       const Vector3& v) {
  const double force = pull.head<3>().norm(), moment = pull.tail<3>().norm();
  return {share_of(force, greatest_force(bounds, pull.head<3>(), force, damping.head<3>(), v)),
          share_of(moment, bounds.spring_moment + along(pull.tail<3>(), moment, damping.tail<3>()))};
}

double strain_of(const Vector6& spring, const ContactBounds& bounds) {
  const BoundedPull pull = bound_pull(tighter(bounds, {}), spring, Vector6::Zero(), Vector3::Zero());
  return std::max(pull.force_share, pull.moment_share);
}

Vector6 BoundedPull::remaining(const Vector6& pull) const {
  Vector6 left = pull;
  if (force_share > 1) left.head<3>() /= force_share;
  if (moment_share > 1) left.tail<3>() /= moment_share;
  return left;
}

double BoundedPull::factor() const { return 1.0 / std::max({1.0, force_share, moment_share}); }

double largest_share(const Vector3& base, const Vector3& extra, double limit) {
  if ((base + extra).squaredNorm() <= limit * limit) return 1;
  const double a = extra.squaredNorm(), b = base.dot(extra);
  const double c = std::min(0.0, base.squaredNorm() - limit * limit);
  return a > 0 ? std::clamp((-b + std::sqrt(b * b - a * c)) / a, 0.0, 1.0) : 1;
}

double left_beside(const Vector3& across, double limit) {
  return std::sqrt(std::max(0.0, limit * limit - across.squaredNorm()));
}

double carriage_share(const ContactBounds& bounds, const ArmModel& model, const JointVector& pull,
                      const JointVector& damping, const JointVector& dq) {
  double most = 0;
  for (std::size_t i = 0; i < model.joint_count(); ++i) {
    if (!model.is_prismatic(i)) continue;
    const auto k = static_cast<Eigen::Index>(i);
    Vector6 along = Vector6::Zero(), damps = Vector6::Zero();
    along[0] = pull[k];
    damps[0] = damping[k];
    most = std::max(most, bound_pull(bounds, along, damps, dq[k] * Vector3::UnitX()).force_share);
  }
  return most;
}

double carriage_strain(const ContactBounds& bounds, const ArmModel& model, const JointVector& spring) {
  const JointVector none = JointVector::Zero(spring.size());
  return carriage_share(tighter(bounds, {}), model, spring, none, none);
}

}  // namespace multipanda
