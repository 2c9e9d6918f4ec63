// The rules for commanded motion.
#include <algorithm>
#include <cmath>

#include "backends/simulated_arm/desired_motion.hpp"

namespace multipanda {
namespace {

// Tolerances of start and positions are absolute; a client may be exactly at a limit.
constexpr double kPositionSlack = 1e-6;  // [rad]
// Error of the jerk from rounding a position.
constexpr double kJointJerkSlack =
    DesiredMotion::kJointUlp / (kArmPeriod * kArmPeriod * kArmPeriod);  // [rad/s^3]
constexpr double kPoseJerkSlack =
    DesiredMotion::kPoseUlp / (kArmPeriod * kArmPeriod * kArmPeriod);  // [m/s^3, rad/s^3]

}  // namespace

// Keeps the largest relative excess of a rule.
struct DesiredMotion::Worst {
  double share = 1 + kSlack;
  int index = kNowhere;
  double value = 0, limit = 0;
  static constexpr int kNowhere = -2;
  bool found() const { return index != kNowhere; }

  // Counts only if both histories violate the rule.
  void see(int i, double exact, double published, double bound) {
    const double least = std::abs(exact) < std::abs(published) ? exact : published;
    if (std::abs(least) <= share * bound) return;
    share = std::abs(least) / bound;
    index = i;
    value = least;
    limit = std::copysign(bound, least);
  }

  // Compares a velocity with the limit of its sign; at the end of the range it is zero.
  void see_velocity(int i, double exact, double published, double lower, double upper) {
    constexpr double kStill = 1e-9;  // [rad/s]
    const double least = std::abs(exact) < std::abs(published) ? exact : published;
    see(i, exact, published, std::max(kStill, least > 0 ? upper : -lower));
  }
};

bool DesiredMotion::check_joint_positions(const JointVector& q) {
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const bool above = q[i] > limits_.q_max[i] + kPositionSlack;
    if (above || q[i] < limits_.q_min[i] - kPositionSlack) {
      report(ArmError::joint_position_limits_violation, static_cast<int>(i), q[i],
             above ? limits_.q_max[i] : limits_.q_min[i]);
      return false;
    }
  }
  return true;
}

// dq: from the history; dq_published: from the history as published.
void DesiredMotion::check_joint_command(const JointVector& q, const JointVector& dq,
                                        const JointVector& dq_published) {
  check_joint_positions(q);
  const JointVector dq_p = published_.dq.cast<double>(), ddq_before = published_.ddq.cast<double>();
  Worst velocity, acceleration, jerk;
  for (Eigen::Index i = 0; i < dq.size(); ++i) {
    const int joint = static_cast<int>(i);
    const double ddq = (dq[i] - state_.dq[i]) / kArmPeriod, ddq_p = (dq_published[i] - dq_p[i]) / kArmPeriod;
    velocity.see_velocity(joint, dq[i], dq_published[i], lower_velocity(i), upper_velocity(i));
    acceleration.see(joint, ddq, ddq_p, limits_.ddq_max[i]);
    jerk.see(joint, (ddq - state_.ddq[i]) / kArmPeriod, (ddq_p - ddq_before[i]) / kArmPeriod,
             limits_.dddq_max[i] + kJointJerkSlack);
  }
  report(ArmError::joint_motion_generator_velocity_limits_violation, velocity, acceleration, jerk);
}

// The limit at the last desired position, with the delay of a braking client (see the header).
double DesiredMotion::upper_velocity(Eigen::Index i) const {
  return std::min(limits_.dq_max[i], limits_.upper_velocity(i, state_.q[i]) + late(i));
}
double DesiredMotion::lower_velocity(Eigen::Index i) const {
  return std::max(-limits_.dq_max[i], limits_.lower_velocity(i, state_.q[i]) - late(i));
}
double DesiredMotion::late(Eigen::Index i) const {
  return limits_.deceleration.size() == 0 ? 0 : 2 * kArmPeriod * limits_.deceleration[i];
}

void DesiredMotion::check_twist(const Vector6& V, const Vector6& V_published) {
  const Vector6 A = (V - state_.V_BE_c.vector) / kArmPeriod,
                A_p = (V_published - published_.V.cast<double>()) / kArmPeriod;
  const Vector6 J = (A - state_.A_BE_c) / kArmPeriod, J_p = (A_p - published_.A.cast<double>()) / kArmPeriod;
  const CartesianLimits& c = limits_.cartesian;
  const auto worst = [](const Vector6& exact, const Vector6& published, double linear, double angular) {
    Worst worst;
    worst.see(0, exact.head<3>().norm(), published.head<3>().norm(), linear);
    worst.see(3, exact.tail<3>().norm(), published.tail<3>().norm(), angular);
    return worst;
  };
  report(ArmError::cartesian_motion_generator_velocity_limits_violation,
         worst(V, V_published, c.velocity, c.rotation_velocity),
         worst(A, A_p, c.acceleration, c.rotation_acceleration),
         worst(J, J_p, c.jerk + kPoseJerkSlack, c.rotation_jerk + kPoseJerkSlack));
}

void DesiredMotion::check_elbow(double elbow) {
  const double v = (elbow - state_.elbow_c[0]) / kArmPeriod,
               v_p = (elbow - static_cast<double>(published_.elbow)) / kArmPeriod;
  const double a = (v - state_.delbow_c[0]) / kArmPeriod,
               a_p = (v_p - static_cast<double>(published_.delbow)) / kArmPeriod;
  const double j = (a - state_.ddelbow_c[0]) / kArmPeriod,
               j_p = (a_p - static_cast<double>(published_.ddelbow)) / kArmPeriod;
  const CartesianLimits& c = limits_.cartesian;
  Worst worst;
  if (c.elbow_velocity > 0) worst.see(-1, v, v_p, c.elbow_velocity);
  if (c.elbow_acceleration > 0) worst.see(-1, a, a_p, c.elbow_acceleration);
  if (c.elbow_jerk > 0) worst.see(-1, j, j_p, c.elbow_jerk + kJointJerkSlack);
  if (elbow > limits_.q_max[2] + kPositionSlack || elbow < limits_.q_min[2] - kPositionSlack) {
    worst.index = -1;
    worst.value = elbow;
    worst.limit = elbow > 0 ? limits_.q_max[2] : limits_.q_min[2];
  }
  report(ArmError::cartesian_motion_generator_elbow_limit_violation, worst);
}

void DesiredMotion::check_solution(const InverseKinematics::Solution& solution, const JointVector& dq,
                                   const JointVector& dq_published, const JointVector& ddq_published) {
  check_joint_positions(solution.q);
  Worst velocity, acceleration, jerk;
  for (Eigen::Index i = 0; i < dq.size(); ++i) {
    const int joint = static_cast<int>(i);
    const double ddq = (dq[i] - state_.dq[i]) / kArmPeriod;
    velocity.see_velocity(joint, dq[i], dq_published[i], lower_velocity(i), upper_velocity(i));
    acceleration.see(joint, ddq, ddq_published[i], limits_.ddq_max[i]);
    jerk.see(joint, (ddq - state_.ddq[i]) / kArmPeriod,
             (ddq_published[i] - static_cast<double>(published_.ddq[i])) / kArmPeriod,
             limits_.dddq_max[i] + kJointJerkSlack);
  }
  if (!solution.met && !velocity.found()) {
    // Out of reach: the joints would exceed all limits.
    Eigen::Index joint = 0;
    dq.cwiseAbs().maxCoeff(&joint);
    velocity.index = static_cast<int>(joint);
    velocity.value = dq[joint];
    velocity.limit = limits_.dq_max[joint];
  }
  report(ArmError::cartesian_motion_generator_joint_velocity_limits_violation, velocity);
  report(ArmError::cartesian_motion_generator_joint_velocity_discontinuity, acceleration);
  report(ArmError::cartesian_motion_generator_joint_acceleration_discontinuity, jerk);
}

void DesiredMotion::report(ArmError error, int index, double value, double limit) {
  if (violations_.count == violations_.of.size()) return;
  violations_.of[violations_.count++] = {
      .error = error, .index = static_cast<std::int8_t>(index), .value = value, .limit = limit};
}
void DesiredMotion::report(ArmError error, const Worst& worst) {
  if (worst.found()) report(error, worst.index, worst.value, worst.limit);
}

// As reported of real arms (docs/like_a_real_arm.md): a step does not raise the velocity flag, and a step of
// a commanded velocity does not raise the acceleration flag either.
void DesiredMotion::report(ArmError of_velocity, const Worst& velocity, const Worst& acceleration,
                           const Worst& jerk) {
  const auto next = [of_velocity](int k) {  // the flags of acceleration and jerk follow it
    return static_cast<ArmError>(static_cast<int>(of_velocity) + k);
  };
  const bool by_velocity =
      generator_ == MotionGenerator::joint_velocity || generator_ == MotionGenerator::cartesian_velocity;
  if (!acceleration.found() && !jerk.found()) report(of_velocity, velocity);
  if (!by_velocity || !jerk.found()) report(next(1), acceleration);
  report(next(2), jerk);
}

}  // namespace multipanda
