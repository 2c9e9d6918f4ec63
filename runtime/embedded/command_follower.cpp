#include "runtime/embedded/command_follower.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/types/time.hpp"
#include "models/robot_description.hpp"

namespace multipanda {

namespace {

// The arm's echo of a command, in single precision: numbers below 4 are rounded by up to 1.2e-7. A lost
// command taken for an echo costs up to 3 kEchoed / T^3 of jerk, an unnecessary restart half of that.
constexpr double kEchoed = 2.5e-7;  // [rad, rad/s, m, 1]
// A reference faster than this share of the limit has jumped: its velocity is ignored.
constexpr double kJumpShare = 1.2;

// The nearest rotation; the arm's rotations have single precision.
Matrix3 rotation_of(const std::array<double, 16>& column_major) {
  return pose_of(column_major).quaternion().normalized().toRotationMatrix();
}

template <std::size_t A, std::size_t B>
bool echoes(const std::array<double, A>& a, const std::array<double, B>& b, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    if (!(std::abs(a[i] - b[i]) <= kEchoed)) return false;
  }
  return true;
}

// Velocity between two values; zero for a jump.
double velocity_of(double difference, double gap, const AxisLimits& limits) {
  if (gap <= 0) return 0;
  const double v = difference / gap;
  return std::abs(v) > kJumpShare * limits.velocity ? 0 : v;
}

}  // namespace

FollowerLimits FollowerLimits::of(const RobotDescription& robot, const ArmLimits* scene) {
  constexpr double kMargin = 1e-3;     // [rad] to the ends of the range
  constexpr double kEndRate = 15;      // [1/s] of the approach to an end
  constexpr double kBrakes = 0.5;      // of the acceleration, for braking towards an end
  constexpr double kBrakesTied = 0.6;  // of the deceleration that the arm expects
  FollowerLimits limits;
  JointLimits joints = robot.limits;
  if (scene != nullptr && scene->q_min.size() == joints.q_min.size()) {
    joints.q_min = joints.q_min.cwiseMax(scene->q_min).eval();
    joints.q_max = joints.q_max.cwiseMin(scene->q_max).eval();
    joints.dq_max = joints.dq_max.cwiseMin(scene->dq_max).eval();
    joints.ddq_max = joints.ddq_max.cwiseMin(scene->ddq_max).eval();
  }
  const auto& tied = robot.position_based_velocity;
  for (Eigen::Index i = 0; i < joints.q_max.size() && i < static_cast<Eigen::Index>(kMaxJoints); ++i) {
    AxisLimits& axis = limits.joints[static_cast<std::size_t>(i)];
    axis.velocity = kVelocity * joints.dq_max[i];
    axis.acceleration = kAcceleration * joints.ddq_max[i];
    axis.jerk = kJerk * joints.dddq_max[i];
    axis.catch_up = kCatchUp;
    axis.lower = joints.q_min[i] + kMargin;
    axis.upper = joints.q_max[i] - kMargin;
    axis.deceleration = kBrakes * axis.acceleration;
    axis.offset = axis.deceleration / kEndRate;
    if (tied) {
      // The velocity is zero where the arm's curve reaches zero.
      const double stop = tied->offset[i] * tied->offset[i] / (2 * tied->deceleration[i]);
      axis.lower = std::max(axis.lower, tied->q_min[i] + stop + kMargin);
      axis.upper = std::min(axis.upper, tied->q_max[i] - stop - kMargin);
      axis.deceleration = std::min(axis.deceleration, kBrakesTied * tied->deceleration[i]);
      axis.offset = std::max(axis.deceleration / kEndRate, tied->offset[i]);
    }
  }
  const CartesianLimits cartesian = robot.cartesian.value_or(CartesianLimits{.velocity = 1.7,
                                                                             .acceleration = 9,
                                                                             .jerk = 4500,
                                                                             .rotation_velocity = 2.5,
                                                                             .rotation_acceleration = 17,
                                                                             .rotation_jerk = 8500});
  const double axis = 1 / std::numbers::sqrt3;  // three axes at their limits keep that of the norm
  limits.linear = {.velocity = axis * kCartesianVelocity * cartesian.velocity,
                   .acceleration = axis * kCartesianAcceleration * cartesian.acceleration,
                   .jerk = axis * kCartesianJerk * cartesian.jerk,
                   .catch_up = axis * kCatchUpLinear};
  limits.angular = {.velocity = axis * kCartesianVelocity * cartesian.rotation_velocity,
                    .acceleration = axis * kCartesianAcceleration * cartesian.rotation_acceleration,
                    .jerk = axis * kCartesianJerk * cartesian.rotation_jerk,
                    .catch_up = axis * kCatchUpAngular};
  return limits;
}

void CommandFollower::begin(FollowedMotion motion) {
  motion_ = motion;
  begun_ = false;
  unknown_ = 0;
  axes_ = {};
  resume();
}

void CommandFollower::resume() {
  track_.clear();
  stopped_ = false;
  silent_ = 0;
}

void CommandFollower::push(std::int64_t stamp_ns, std::span<const double> values) {
  if (stopped_) return;
  track_.push(stamp_ns, values);
  silent_ = 0;
}

bool CommandFollower::is_at_rest() const {
  return std::all_of(axes_.begin(), axes_.begin() + static_cast<std::ptrdiff_t>(axes()),
                     [](const AxisState& axis) { return std::abs(axis.v) < 1e-3 && std::abs(axis.a) < 0.5; });
}

// Whether the arm continues from the last command: its packet shows that one, or an earlier one while the
// last is in transit. Otherwise commands were lost, and the arm has extrapolated.
bool CommandFollower::shows_sent(const DesiredMotionState& desired) {
  if (!begun_) return false;
  for (std::size_t age = 0; age < sent_.size(); ++age) {
    const auto& sent = sent_[age];
    const bool shown = motion_ == FollowedMotion::joint_position   ? echoes(sent, desired.q_d, joints_)
                       : motion_ == FollowedMotion::joint_velocity ? echoes(sent, desired.dq_d, joints_)
                       : motion_ == FollowedMotion::cartesian_pose ? echoes(sent, desired.O_T_EE_c, 16)
                                                                   : echoes(sent, desired.O_dP_EE_c, 6);
    if (!shown) continue;
    // A command that differs from its neighbors reveals the arm's lag. An unexpectedly old one is the
    // extrapolation of a constant motion.
    if (lag_known_ && static_cast<int>(age) > lag_) break;
    if (!lag_known_ && age + 1 < sent_.size() && !echoes(sent, sent_[age + 1], sent.size())) {
      lag_ = static_cast<int>(age);
      lag_known_ = true;
    }
    unknown_ = 0;
    return true;
  }
  // With lagging packets, the next command was sent before a loss could be seen.
  if (++unknown_ <= lag_) return true;
  unknown_ = 0;
  return false;
}

// The motion continued by the next command: the last one sent, or the published motion, extrapolated with its
// acceleration to the packet that the command answers.
void CommandFollower::take_base(const DesiredMotionState& desired) {
  const bool known = shows_sent(desired);
  if (motion_ == FollowedMotion::joint_velocity) {
    for (std::size_t i = 0; i < joints_; ++i) axes_[i].x = desired.q_d[i];
  }
  if (known) return;
  if (!is_cartesian()) {
    for (std::size_t i = 0; i < joints_; ++i) axes_[i] = {desired.q_d[i], desired.dq_d[i], desired.ddq_d[i]};
  } else {
    rotation_ = rotation_of(desired.O_T_EE_c);
    for (std::size_t i = 0; i < 6; ++i) {
      axes_[i] = {i < 3 ? desired.O_T_EE_c[12 + i] : 0, desired.O_dP_EE_c[i], desired.O_ddP_EE_c[i]};
    }
  }
  for (int k = 0; k < lag_; ++k) {
    for (std::size_t i = 0; i < axes(); ++i) {
      axes_[i].v += kArmPeriod * axes_[i].a;
      axes_[i].x += kArmPeriod * axes_[i].v;
    }
    if (is_cartesian()) turn();
  }
}

void CommandFollower::step(const DesiredMotionState& desired, InterfaceCommand& command) noexcept {
  take_base(desired);
  track_.advance();
  if (kArmPeriod * ++silent_ > kSilence && !track_.empty()) stopped_ = true;
  if (!follows()) {
    halt();
  } else if (motion_ == FollowedMotion::cartesian_pose) {
    follow_pose(track_.place());
  } else {
    follow_joints(track_.place());
  }
  send(command);
  if (!begun_) sent_.fill(sent_.front());
  begun_ = true;
}

void CommandFollower::halt() {
  for (std::size_t i = 0; i < axes(); ++i) follow_velocity(limits(i), 0, axes_[i]);
}

// Joint positions, and velocities of joints and of the end effector.
void CommandFollower::follow_joints(const SampleTrack::Place& place) {
  const double kept = kept_velocity(place.beyond), distance = kept_distance(place.beyond);
  for (std::size_t i = 0; i < axes(); ++i) {
    const double from = place.from->values[i], to = place.to->values[i];
    const double value = from + place.share * (to - from);
    if (motion_ == FollowedMotion::joint_position) {
      const double v = velocity_of(to - from, place.gap, limits(i));
      follow_position(limits(i), value + distance * v, kept * v, axes_[i]);
    } else {
      follow_velocity(limits(i), kept * value, axes_[i]);
    }
  }
}

void CommandFollower::follow_pose(const SampleTrack::Place& place) {
  const Matrix3 R_from = rotation_of(place.from->values), R_to = rotation_of(place.to->values);
  const Vector3 turn = log_rotation(R_to * R_from.transpose());
  const Vector3 from = pose_of(place.from->values).position;
  const Vector3 way = pose_of(place.to->values).position - from;
  const double kept = kept_velocity(place.beyond), distance = kept_distance(place.beyond);
  Vector3 v, w;
  for (Eigen::Index i = 0; i < 3; ++i) {
    v[i] = velocity_of(way[i], place.gap, limits_.linear);
    w[i] = velocity_of(turn[i], place.gap, limits_.angular);
  }
  const Vector3 p = from + place.share * way + distance * v;
  const Matrix3 R = exp_rotation(place.share * turn + distance * w) * R_from;
  const Vector3 error = log_rotation(R * rotation_.transpose());
  for (std::size_t i = 0; i < 3; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    follow_position(limits_.linear, p[k], kept * v[k], axes_[i]);
    // Remaining rotation about each axis of the base.
    AxisState& axis = axes_[3 + i];
    axis.x = 0;
    follow_position(limits_.angular, error[k], kept * w[k], axis);
  }
}

// Advances the rotation by one period.
void CommandFollower::turn() {
  const Vector3 w(axes_[3].v, axes_[4].v, axes_[5].v);
  rotation_ = Quaternion(Matrix3(exp_rotation(kArmPeriod * w) * rotation_)).normalized().toRotationMatrix();
}

void CommandFollower::send(InterfaceCommand& command) {
  std::rotate(sent_.begin(), sent_.end() - 1, sent_.end());
  auto& sent = sent_.front();
  switch (motion_) {
    case FollowedMotion::joint_position:
    case FollowedMotion::joint_velocity:
      for (std::size_t i = 0; i < joints_; ++i) {
        const bool positions = motion_ == FollowedMotion::joint_position;
        sent[i] = positions ? axes_[i].x : axes_[i].v;
        (positions ? command.q_c : command.dq_c)[static_cast<Eigen::Index>(i)] = sent[i];
      }
      break;
    case FollowedMotion::cartesian_pose: {
      turn();
      Eigen::Map<Eigen::Matrix4d> T(sent.data());
      T.setIdentity();
      T.topLeftCorner<3, 3>() = rotation_;
      T.topRightCorner<3, 1>() << axes_[0].x, axes_[1].x, axes_[2].x;
      command.O_T_EE_c = sent;
      break;
    }
    case FollowedMotion::cartesian_velocity:
      for (std::size_t i = 0; i < 6; ++i) {
        sent[i] = axes_[i].v;
        command.O_dP_EE_c[static_cast<Eigen::Index>(i)] = sent[i];
      }
      break;
  }
}

namespace {

// A cascade: position -> velocity -> acceleration -> jerk. Its gains place all poles of the sampled system
//   a += T j,  v += T a,  x += T v
// at exp(-kFollowerBandwidth T).
struct Gains {
  double position = 0, velocity = 0, acceleration = 0;  // [1/s]
};

Gains position_gains() {
  const double m = 1 - std::exp(-kFollowerBandwidth * kArmPeriod);
  // The characteristic polynomial in p = z - 1 is p^3 + T k3 p^2 + T^2 k2 p (1 + p) + T^3 k1 (1 + p)^2.
  const double k1 = m * m * m / (kArmPeriod * kArmPeriod * kArmPeriod);
  const double k2 = (3 * m * m - 2 * m * m * m) / (kArmPeriod * kArmPeriod);
  const double k3 = (3 * m - 3 * m * m + m * m * m) / kArmPeriod;
  return {k1 / k2, k2 / k3, k3};
}

Gains velocity_gains() {
  const double m = 1 - std::exp(-kFollowerBandwidth * kArmPeriod);
  // p^2 + T k2 p + T^2 k1 (1 + p)
  const double k1 = m * m / (kArmPeriod * kArmPeriod), k2 = (2 * m - m * m) / kArmPeriod;
  return {0, k1 / k2, k2};
}

const Gains kPositionGains = position_gains(), kVelocityGains = velocity_gains();

// The rate at which an error is reduced so that it reaches zero with a rate of change of at most `most`:
// linear near zero, a square root beyond.
double braked(double error, double gain, double most) {
  const double size = std::abs(error), linear = most / (gain * gain);
  if (size <= linear) return gain * error;
  return std::copysign(std::sqrt(2 * most * (size - linear / 2)), error);
}

// Towards an end of the range: the largest velocity at the distance d.
double towards_end(const AxisLimits& limits, double d) {
  if (d <= 0) return 0;
  return std::min(limits.velocity,
                  std::sqrt(2 * limits.deceleration * d + limits.offset * limits.offset) - limits.offset);
}

// The largest acceleration towards an end: approaches the velocity `most` and then follows its curve. The
// acceleration changes by at most the largest jerk along the way.
double towards_velocity(const AxisLimits& limits, double most, double v) {
  const double rate = limits.jerk / (limits.acceleration + limits.deceleration);
  const bool braking = most < limits.velocity && v > 0;
  const double slope = braking ? -limits.deceleration * v / (v + limits.offset) : 0;
  return std::min(limits.acceleration, rate * (most - v) + slope);
}

void advance_axis(const AxisLimits& limits, const Gains& gains, double v_d, AxisState& s) {
  const double above = towards_end(limits, limits.upper - s.x),
               below = towards_end(limits, s.x - limits.lower);
  v_d = std::clamp(v_d, -below, above);
  const double a_d = std::clamp(braked(v_d - s.v, gains.velocity, 0.5 * limits.jerk), -limits.acceleration,
                                limits.acceleration);
  const double step = kArmPeriod * limits.jerk;
  double a = s.a + std::clamp(kArmPeriod * gains.acceleration * (a_d - s.a), -step, step);
  a = std::min(a, towards_velocity(limits, above, s.v));
  a = std::max(a, -towards_velocity(limits, below, -s.v));
  // The jerk limit takes precedence: a larger jerk stops the arm at once.
  s.a = std::clamp(a, s.a - step, s.a + step);
  s.v += kArmPeriod * s.a;
  s.x += kArmPeriod * s.v;
}

}  // namespace

double upper_velocity(const AxisLimits& limits, double x) noexcept {
  return towards_end(limits, limits.upper - x);
}
double lower_velocity(const AxisLimits& limits, double x) noexcept {
  return -towards_end(limits, x - limits.lower);
}

void follow_position(const AxisLimits& limits, double x_d, double v_d, AxisState& state) noexcept {
  // Beyond an end, the reference may lead back, but the end alone causes no motion. The velocity of an
  // unreachable reference is ignored.
  const double within = std::clamp(x_d, std::min(limits.lower, state.x), std::max(limits.upper, state.x));
  v_d = within == x_d ? std::clamp(v_d, -limits.velocity, limits.velocity) : 0;
  x_d = within;
  const double error = x_d - kArmPeriod * v_d - state.x;
  const double more = std::clamp(braked(error, kPositionGains.position, 0.5 * limits.acceleration),
                                 -limits.catch_up, limits.catch_up);
  advance_axis(limits, kPositionGains, v_d + more, state);
}

void follow_velocity(const AxisLimits& limits, double v_d, AxisState& state) noexcept {
  advance_axis(limits, kVelocityGains, std::clamp(v_d, -limits.velocity, limits.velocity), state);
}

}  // namespace multipanda
