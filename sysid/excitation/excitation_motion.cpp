#include "sysid/excitation/excitation_motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "core/geometry/shape.hpp"
#include "models/arm_source.hpp"

namespace multipanda {
namespace {

template <typename Motion, typename Visit>
void for_coefficients(Motion& motion, Visit&& visit) {
  const auto n = static_cast<std::size_t>(motion.q_start.size());
  const auto each = [&](auto& values) {
    for (std::size_t i = 0; i < n; ++i) visit(values[i]);
  };
  for (auto& value : motion.q_start) visit(value);
  each(motion.series.sine);
  each(motion.series.rise);
  for (std::size_t k = 0; k < motion.series.harmonic_count; ++k) {
    each(motion.series.harmonics[k].sine);
    each(motion.series.harmonics[k].rise);
  }
}

enum Kind : std::size_t { kPosition, kVelocity, kAcceleration, kJerk, kTorque, kSelf, kRoom };
constexpr std::array<const char*, 7> kNames{"position", "velocity",       "acceleration", "jerk",
                                            "torque",   "self-collision", "workspace"};
constexpr double kReachRadius = 0.05;
constexpr double kSoft = 0.05;  // violation of a distance that counts as much as exceeding a limit twofold
                                // [m]

// The object on the flange, as a capsule of the last body. It is checked against all bodies but the last
// links and the hand.
void add_reach(ArmModelSource& source, const RobotDescription& robot, double reach) {
  if (reach <= kReachRadius) return;
  const Pose X_JF = robot.flange.pose();
  CollisionShape tool{
      .name = "reach",
      .joint = static_cast<int>(robot.joint_count()) - 1,
      .shape = ConvexShape::capsule(X_JF.position, X_JF * Vector3(0, 0, reach - kReachRadius), kReachRadius),
      .X_JS = {}};
  const std::size_t index = source.collision_shapes.size();
  for (std::size_t i = 0; i < index; ++i) {
    if (source.collision_shapes[i].joint < tool.joint - 2) source.self_pairs.emplace_back(i, index);
  }
  source.collision_shapes.push_back(std::move(tool));
}

}  // namespace

ExcitationMotion::Sample ExcitationMotion::at(double t) const {
  QuinticSegment::Sample sums;
  const auto n = q_start.size();
  for (Eigen::Index i = 0; i < n; ++i) sums.position[static_cast<std::size_t>(i)] = q_start[i];
  series.add(t, static_cast<std::size_t>(n), sums);
  Sample sample{JointVector(n), JointVector(n), JointVector(n)};
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    sample.q[i] = sums.position[k];
    sample.dq[i] = sums.velocity[k];
    sample.ddq[i] = sums.acceleration[k];
  }
  return sample;
}

Eigen::VectorXd coefficients_of(const ExcitationMotion& motion) {
  Eigen::VectorXd x(motion.q_start.size() * static_cast<Eigen::Index>(1 + 2 * motion.parts()));
  Eigen::Index at = 0;
  for_coefficients(motion, [&](double value) { x[at++] = value; });
  return x;
}

ExcitationMotion with_coefficients(const ExcitationMotion& shape, const Eigen::VectorXd& x) {
  ExcitationMotion motion = shape;
  Eigen::Index at = 0;
  for_coefficients(motion, [&](double& value) { value = x[at++]; });
  return motion;
}

MotionCheck::MotionCheck(const RobotDescription& robot, bool hand, const ExcitationLimits& limits)
    : robot_(robot), limits_(limits) {
  const auto n = static_cast<Eigen::Index>(robot.joint_count());
  for (const JointVector* vector : {&robot.limits.q_min, &robot.limits.dq_max, &robot.limits.ddq_max,
                                    &robot.limits.dddq_max, &robot.limits.tau_max}) {
    if (vector->size() != n) {
      throw std::invalid_argument("robot '" + robot.name +
                                  "' lacks limits of position, velocity, acceleration, jerk or torque; an "
                                  "excitation must respect all of them: add them to the model file");
    }
  }
  q_low_ = robot.limits.q_min.array() + limits.position_margin;
  q_high_ = robot.limits.q_max.array() - limits.position_margin;
  ArmModelSource source = arm_model_source(robot, {}, hand && robot.hand);
  add_reach(source, robot, limits.reach);
  model_ = std::make_shared<const ArmModel>(std::move(source));
  terms_ = std::make_unique<ModelTerms>(model_);
  Load load;
  load.mass = limits.payload;
  load.p_FC = Vector3(0, 0, 0.5 * limits.reach);
  load.inertia_C = Matrix3::Identity() * 1e-3;
  ArmFrames frames;
  terms_->set_config(frames, limits.payload > 0 ? load : Load{}, {});
  X_.resize(robot.joint_count() + 1);
}

MotionCheck::Uses MotionCheck::measure(const ExcitationMotion::Sample& s, const JointVector& jerk) const {
  Uses uses{};
  const auto note = [&](Kind kind, double use, double value, std::size_t part) {
    if (use > uses[kind].use) uses[kind] = {use, value, part};
  };
  const auto& own = robot_.limits;
  terms_->update(s.q, s.dq);
  const JointVector tau = terms_->M() * s.ddq + terms_->c() + terms_->g();
  for (Eigen::Index i = 0; i < s.q.size(); ++i) {
    const auto joint = static_cast<std::size_t>(i);
    const double middle = 0.5 * (q_low_[i] + q_high_[i]), half = 0.5 * (q_high_[i] - q_low_[i]);
    note(kPosition, std::abs(s.q[i] - middle) / half, s.q[i], joint);
    double fastest = own.dq_max[i];
    if (const auto& law = robot_.position_based_velocity) {
      const double room = s.dq[i] > 0 ? law->q_max[i] - s.q[i] : s.q[i] - law->q_min[i];
      fastest = std::min(fastest, std::max(0.05, std::sqrt(2 * law->deceleration[i] * std::max(0.0, room)) -
                                                     law->offset[i]));
    }
    note(kVelocity, std::abs(s.dq[i]) / (limits_.velocity_share * fastest), s.dq[i], joint);
    note(kAcceleration, std::abs(s.ddq[i]) / (limits_.acceleration_share * own.ddq_max[i]), s.ddq[i], joint);
    note(kJerk, std::abs(jerk[i]) / (limits_.jerk_share * own.dddq_max[i]), jerk[i], joint);
    note(kTorque, std::abs(tau[i]) / (limits_.torque_share * own.tau_max[i]), tau[i], joint);
    X_[joint + 1] = terms_->X_WJ(joint);
  }
  const auto& shapes = model_->collision_shapes();
  const auto X_of = [&](const CollisionShape& shape) {
    return X_[static_cast<std::size_t>(shape.joint + 1)] * shape.X_JS;
  };
  for (std::size_t k = 0; k < model_->self_pairs().size(); ++k) {
    const auto& [a, b] = model_->self_pairs()[k];
    const Pose X_a = X_of(shapes[a]), X_b = X_of(shapes[b]);
    const Closest closest =
        closest_capsules(X_a * shapes[a].shape.p0, X_a * shapes[a].shape.p1, shapes[a].shape.radius,
                         X_b * shapes[b].shape.p0, X_b * shapes[b].shape.p1, shapes[b].shape.radius);
    note(kSelf, 1 + (limits_.self_distance - closest.distance) / kSoft, closest.distance, k);
  }
  for (std::size_t k = 0; k < shapes.size(); ++k) {
    if (shapes[k].joint < 1) continue;  // the base and the link that turns on it do not move away
    const Pose X = X_of(shapes[k]);
    for (const Vector3& end : {Vector3(X * shapes[k].shape.p0), Vector3(X * shapes[k].shape.p1)}) {
      for (Eigen::Index axis = 0; axis < 3; ++axis) {
        const double room = std::min(end[axis] - limits_.room_min[axis], limits_.room_max[axis] - end[axis]) -
                            shapes[k].shape.radius;
        note(kRoom, 1 - room / kSoft, room, k);
      }
    }
  }
  return uses;
}

double MotionCheck::excess(const ExcitationMotion::Sample& sample, const JointVector& jerk) const {
  double sum = 0;
  for (const Worst& worst : measure(sample, jerk)) sum += std::pow(std::max(0.0, worst.use - 1), 2);
  return sum;
}

std::vector<LimitUse> MotionCheck::use(const ExcitationMotion& motion, double step) const {
  std::array<Worst, kKinds> most{};
  std::array<double, kKinds> when{};
  const auto count = static_cast<std::size_t>(std::ceil(motion.duration() / step));
  for (std::size_t k = 0; k <= count; ++k) {
    const double t = std::min(static_cast<double>(k) * step, motion.duration());
    constexpr double h = 5e-4;
    const JointVector jerk = (motion.at(t + h).ddq - motion.at(t - h).ddq) / (2 * h);
    const Uses uses = measure(motion.at(t), jerk);
    for (std::size_t i = 0; i < kKinds; ++i) {
      if (uses[i].use <= most[i].use) continue;
      most[i] = uses[i];
      when[i] = t;
    }
  }
  std::vector<LimitUse> result;
  for (std::size_t i = 0; i < kKinds; ++i) {
    result.push_back({kNames[i], most[i].use, words(i, most[i], when[i])});
  }
  return result;
}

std::string MotionCheck::words(std::size_t kind, const Worst& worst, double t) const {
  constexpr std::array<const char*, 5> kUnits{"rad", "rad/s", "rad/s^2", "rad/s^3", "N m"};
  const auto& shapes = model_->collision_shapes();
  if (kind < kUnits.size()) {
    return fmt::format("joint {}: {:.4g} {} at {:.2f} s", worst.part + 1, worst.value, kUnits[kind], t);
  }
  if (worst.use <= 0) return "no pair near";
  if (kind == kSelf) {
    const auto& [a, b] = model_->self_pairs()[worst.part];
    return fmt::format("{} and {}: {:.0f} mm at {:.2f} s", shapes[a].name, shapes[b].name, 1e3 * worst.value,
                       t);
  }
  return fmt::format("{}: {:.0f} mm inside the workspace at {:.2f} s", shapes[worst.part].name,
                     1e3 * worst.value, t);
}

}  // namespace multipanda
