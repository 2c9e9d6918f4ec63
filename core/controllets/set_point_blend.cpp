#include "core/controllets/set_point_blend.hpp"

#include <algorithm>

namespace multipanda {

namespace {

double duration_of(const Vector3& p, const Vector3& r, double top_speed) {
  return std::max({SetPointBlend::kShortest,
                   rest_to_rest_duration(p.norm(), std::min(SetPointBlend::kSpeed, top_speed)),
                   rest_to_rest_duration(r.norm(), SetPointBlend::kAngularSpeed)});
}

}  // namespace

void SetPointBlend::capture(const Pose& X_now, const Pose& X_rule, double hand_speed) {
  const Vector6 deviation = pose_error(X_now, X_rule);
  p_dev_ = deviation.head<3>();
  r_dev_ = deviation.tail<3>();
  duration_ = duration_of(p_dev_, r_dev_, kShare * hand_speed);
  t_ = 0;
  released_ = false;
}

namespace {

// From 1 to 0 in the time T, with its derivatives.
struct Fading {
  Fading(double t, double T) {
    const double u = t / T, v = 1 - u;
    s = 1 - u * u * u * (10 - 15 * u + 6 * u * u);
    ds = -30 * u * u * v * v / T;
    dds = -60 * u * v * (1 - 2 * u) / (T * T);
  }
  double s, ds, dds;
};

}  // namespace

CartesianTarget SetPointBlend::advance(const CartesianTarget& rule, double dt) {
  if (!rule.V_d.vector.isZero(0)) released_ = true;
  if (released_ && t_ < duration_) t_ = std::min(t_ + dt, duration_);
  if (t_ >= duration_) return rule;
  const auto [s, ds, dds] = Fading(t_, duration_);

  const Matrix3 R_dev = exp_rotation(s * r_dev_);
  const Vector3 omega = R_dev * rule.V_d.angular();
  CartesianTarget out;
  out.X_W_d = {R_dev * rule.X_W_d.rotation, rule.X_W_d.position + s * p_dev_};
  out.V_d.linear() = rule.V_d.linear() + ds * p_dev_;
  out.V_d.angular() = omega + ds * r_dev_;
  out.A_d.linear() = rule.A_d.linear() + dds * p_dev_;
  out.A_d.angular() = R_dev * rule.A_d.angular() + (ds * r_dev_).cross(omega) + dds * r_dev_;
  return out;
}

void SetPointShift::add(const Pose& X, double hand_speed) {
  const double s = t_ < duration_ ? Fading(t_, duration_).s : 0;
  const Pose sum = Pose{exp_rotation(s * r_), s * p_} * X;
  p_ = sum.position;
  r_ = log_rotation(sum.rotation);
  duration_ = duration_of(p_, r_, kShare * hand_speed);
  t_ = 0;
  released_ = false;
}

CartesianTarget SetPointShift::advance(const CartesianTarget& rule, double dt) {
  if (!rule.V_d.vector.isZero(0)) released_ = true;
  if (released_ && t_ < duration_) t_ = std::min(t_ + dt, duration_);
  if (t_ >= duration_) return rule;
  const auto [s, ds, dds] = Fading(t_, duration_);

  const Matrix3& R = rule.X_W_d.rotation;
  const Vector3 omega = rule.V_d.angular(), alpha = rule.A_d.angular();
  const Vector3 arm = R * (s * p_), slide = R * (ds * p_), turn = R * (ds * r_);
  CartesianTarget out;
  out.X_W_d = {R * exp_rotation(s * r_), rule.X_W_d.position + arm};
  out.V_d.linear() = rule.V_d.linear() + omega.cross(arm) + slide;
  out.V_d.angular() = omega + turn;
  out.A_d.linear() = rule.A_d.linear() + alpha.cross(arm) + omega.cross(omega.cross(arm)) +
                     2 * omega.cross(slide) + R * (dds * p_);
  out.A_d.angular() = alpha + omega.cross(turn) + R * (dds * r_);
  return out;
}

}  // namespace multipanda
