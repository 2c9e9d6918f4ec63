#include "core/controllets/ufic_axes.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/controllets/axis_force.hpp"

namespace multipanda {

SpecsAt<ParameterSpec, 0, kUficAxesParameterCount> ufic_axes_parameters() {
  return {spec_table<kUficAxesParameterCount>(
      group_at<kFirstForceAxis>(axis_selection_parameters()),
      parameter_at<kMomentIntegral>({.name = "moment_integral_per_s",
                                     .unit = "1/s",
                                     .initial = {2},
                                     .max = 50,
                                     .doc = "Gain I of moments; lower, since rotations are softer."}),
      parameter_at<kMomentLimit>({.name = "moment_integral_limit_nm",
                                  .unit = "N m",
                                  .initial = {3},
                                  .max = 5,
                                  .doc = "Limit of the integral part of a moment."}),
      parameter_at<kMomentThreshold>({.name = "moment_threshold_nm",
                                      .unit = "N m",
                                      .initial = {kMomentThresholdNm},
                                      .min = 0.1,
                                      .max = 10,
                                      .doc = kMomentThresholdDoc}),
      parameter_at<kMomentReach>({.name = "phi_max_rad",
                                  .unit = "rad",
                                  .initial = {0.1},
                                  .min = 0.01,
                                  .max = 1,
                                  .doc = "Width of gamma for moments, as d_max_m for forces."}))};
}

void UficAxes::Axis::start() {
  detector.start();
  loop.start();
  room.start();
  contact.reset(false);
  touched = false;
  gamma = pushed = borne = 0;
}

void UficAxes::start() {
  for (Axis& axis : axis_) {
    axis.start();
    axis.selection.reset(false);
    axis.sign = 1;
  }
  all_.reset(false);
  sigma_.setZero();
  F_.setZero();
  inertia_.setOnes();
  frame_ = 0;
  R_.setIdentity();
  R_EF_.setIdentity();
}

void UficAxes::select(const ParameterSet& parameters, std::size_t first, const Matrix3& R_WE, double dt) {
  if (!any()) {
    frame_ = parameters.choice(first + kForceFrame);
    R_EF_.setIdentity();
  }
  R_ = frame_ == 0 ? Matrix3(Matrix3::Identity()) : Matrix3(R_WE * R_EF_);
  bool some = false;
  for (std::size_t i = 0; i < 6; ++i) {
    Axis& axis = axis_[i];
    const bool on =
        parameters.flag(first + kFirstForceAxis + i) && frame_ == parameters.choice(first + kForceFrame);
    some = some || parameters.flag(first + kFirstForceAxis + i);
    const double sigma = axis.selection.towards(on, dt);
    if (sigma <= 0) axis.start();
    sigma_[static_cast<Eigen::Index>(i)] = sigma;
  }
  all_.towards(some, dt);
}

void UficAxes::end_effector_moved(const Pose& X) {
  R_EF_ = X.rotation.transpose() * R_EF_;  // selected axes do not turn with the definition
  for (Axis& axis : axis_) axis.touched_at = axis.touched_at * X;
  for (std::size_t i = 3; i < 6; ++i) axis_[i].start();  // moments about another point: no contact yet
}

void UficAxes::bear(const Matrix6& mobility) {
  if (!any()) return;
  Matrix6 turn = Matrix6::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = R_;
  inertia_ = borne_inertias(turn.transpose() * mobility * turn, sigma_);
}

Vector3 UficAxes::damped(const Vector3& v, double damping) const {
  const Vector3 D = (kDamping * inertia_.head<3>()).cwiseMin(damping);
  return R_ * Vector3((R_.transpose() * v).cwiseProduct(sigma_.head<3>()).cwiseProduct(D));
}

Vector6 UficAxes::in_frame(const Vector6& x) const {
  Vector6 y;
  y << R_.transpose() * x.head<3>(), R_.transpose() * x.tail<3>();
  return y;
}

Vector6 UficAxes::in_world(const Vector6& y) const {
  Vector6 x;
  x << R_ * y.head<3>(), R_ * y.tail<3>();
  return x;
}

// `shape`: gamma of the place where it is now.
double UficAxes::update(std::size_t i, const ForceGains& gains, double threshold, double doubt, double shape,
                        const Limits& limits, ValveLaw law, const Instant& now, double dt) {
  const auto k = static_cast<Eigen::Index>(i);
  Axis& axis = axis_[i];
  const double least = (i >= 3 ? kMomentAxis : kForceAxis).least;
  if (axis.contact.value() <= 0 && axis.sign * now.F_d[k] < -least) {
    axis.start();  // f is 0 here, and comes back with gamma
    axis.sign = -axis.sign;
  }
  const double desired = std::max(0.0, axis.sign * now.F_d[k]), estimated = axis.sign * now.F_hat[k];
  if (axis.detector.update(estimated, threshold, dt, doubt)) {
    axis.touched = true;
    axis.touched_at = now.X_WE;
  }
  // Decreases at once, increases at the rate of a fade.
  axis.gamma = std::min(axis.detector.in_contact() ? 1.0
                        : axis.touched             ? shape
                                                   : 0.0,
                        axis.gamma + dt / Fade::kDuration);
  const double speed = axis.sign * now.V[k];
  // The environment does not support the part taken over by the impedance.
  const double borne = axis.pushed + std::min(0.0, axis.sign * now.pull[k]);
  const bool slow = std::abs(speed)<limits.slow, withstands = borne> 0.5 * limits.unfelt;
  axis.borne += !slow ? -dt / kGivingWay : withstands ? dt / kBearing : -dt / kBearing;
  axis.borne = std::clamp(axis.borne, 0.0, 1.0);
  const double most =
      std::min(limits.room, limits.unfelt + axis.borne * std::max(0.0, axis.detector.force()));
  // While the valve is closed the integral does not grow.
  const double w = axis.contact.towards(axis.detector.in_contact(), dt) * axis.gamma * now.alpha_f;
  const double f = axis.loop.update(gains, desired, estimated, w, dt, most);
  // The valve damps no more than D_z may: D_c is that of an axis whose neighbors are held.
  const double damping = std::min(now.D(k, k), kDamping * inertia_[k]);
  const double rho = force_share(law, axis.gamma, now.alpha_f, speed,
                                 incoming_speed_for(f, axis.gamma, now.alpha_f, damping));
  axis.pushed = sigma_[k] * rho * f;  // an axis resists the acting force, not the part held back by the valve
  return axis.sign * axis.pushed;
}

Vector6 UficAxes::update(const ForceSettings& settings, ValveLaw law, double reach,
                         const ParameterSet& parameters, std::size_t first, const Instant& world, double dt) {
  if (!any()) {
    F_.setZero();
    return F_;
  }
  Matrix6 turn = Matrix6::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = R_.transpose();
  const Matrix6 D = turn * world.D * turn.transpose();
  const Instant now{
      in_frame(world.F_d), in_frame(world.F_hat), in_frame(world.V), in_frame(world.pull), D, world.X_WE,
      world.alpha_f,       world.bounds,          world.turning,     world.turning_doubt};
  ForceGains moments = settings.gains;
  moments.integral_per_s = parameters.number(first + kMomentIntegral);
  moments.integral_limit_n = parameters.number(first + kMomentLimit);
  moments.may_pull = false;
  moments.derivative_s = 0;  // of an estimated moment on a light wrist it is mostly noise
  ForceGains forces = settings.gains;
  forces.may_pull = false;
  Vector6 F = Vector6::Zero();
  for (std::size_t i = 0; i < 6; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    if (sigma_[k] <= 0) continue;
    Axis& axis = axis_[i];
    const bool moment = i >= 3;
    const Eigen::Index begin = moment ? 3 : 0;
    const double bound = moment ? now.bounds.spring_moment : now.bounds.spring_force;
    // Pulls of the impedance and of the other axes at a right angle to it reduce the bound, and so does the
    // pull of the impedance along it.
    Vector3 across = now.pull.segment<3>(begin) + F_.segment<3>(begin);
    across[k - begin] = 0;
    const double left = left_beside(across, bound) - std::max(0.0, axis.sign * now.pull[k]);
    const double steepest = kSteepest * inertia_[k];
    const AxisKind& kind = moment ? kMomentAxis : kForceAxis;
    // All axes of a kind together respect its speed.
    const double parts = std::sqrt(std::max(1.0, sigma_.segment<3>(begin).sum()));
    const double limit = (moment ? kTurnLimit : now.bounds.hand_speed) / parts;
    // The force allowed without reaction ends at 1.5 times the limit, or at kTopTurning, but never falls more
    // steeply than allowed.
    const double falls = moment ? (kTopTurning / kTurnLimit - 0.5) * limit : limit;
    const Limits limits{
        .room = std::min(axis.room.update(left, bound, dt), kind.most + 2 * std::abs(now.F_d[k])),
        .unfelt = steepest * falls,
        .slow = 0.5 * limit};
    double shape = contact_shape((now.X_WE.position - axis.touched_at.position).norm(), reach);
    if (moment) {
      const double turned = log_rotation(now.X_WE.rotation * axis.touched_at.rotation.transpose()).norm();
      shape *= contact_shape(turned, parameters.number(first + kMomentReach));
    }
    const double f = moment ? update(i, moments, parameters.number(first + kMomentThreshold) + now.turning,
                                     now.turning_doubt, shape, limits, law, now, dt)
                            : update(i, forces, settings.contact_threshold, settings.contact_doubt, shape,
                                     limits, law, now, dt);
    // f contains sigma, and so does its slope: fading axes that share a joint share its bound, too.
    F[k] = f * share_at_axis_speed(f, f < 0 ? -now.V[k] : now.V[k], limit, sigma_[k] * steepest);
  }
  F.head<3>() *= largest_share(now.pull.head<3>(), F.head<3>(), now.bounds.spring_force);
  F.tail<3>() *= largest_share(now.pull.tail<3>(), F.tail<3>(), now.bounds.spring_moment);
  F_ = F;
  return in_world(F_);
}

}  // namespace multipanda
