#include "core/controllets/set_point_blend.hpp"

#include <algorithm>

namespace multipanda {

void SetPointBlend::capture(const Pose& X_now, const Pose& X_rule) {
  const Vector6 deviation = pose_error(X_now, X_rule);
  p_dev_ = deviation.head<3>();
  r_dev_ = deviation.tail<3>();
  duration_ = std::max({kShortest, rest_to_rest_duration(p_dev_.norm(), kSpeed),
                        rest_to_rest_duration(r_dev_.norm(), kAngularSpeed)});
  t_ = 0;
  released_ = false;
}

CartesianTarget SetPointBlend::advance(const CartesianTarget& rule, double dt) {
  if (!rule.V_d.vector.isZero(0)) released_ = true;
  if (released_ && t_ < duration_) t_ = std::min(t_ + dt, duration_);
  if (t_ >= duration_) return rule;

  const double T = duration_;
  const double u = t_ / T, v = 1 - u;
  const double s = 1 - u * u * u * (10 - 15 * u + 6 * u * u);
  const double ds = -30 * u * u * v * v / T;
  const double dds = -60 * u * v * (1 - 2 * u) / (T * T);

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

}  // namespace multipanda
