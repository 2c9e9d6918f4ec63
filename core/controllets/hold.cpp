#include <algorithm>
#include <array>

#include "core/controllets/builtins.hpp"
#include "core/controllets/prismatic_parameters.hpp"
#include "core/controllets/raised_spring.hpp"
#include "core/model/coupled_modes.hpp"
#include "core/types/triangular.hpp"

namespace multipanda {
namespace {

// The safe default: holds every arm that has no other owner.
//   tau = K (q_0 - q) - D dq + C dq
// q_0 [rad] is the measured position at entry; from beyond a joint limit it moves back to the limit at 0.1
// rad/s, and waits where the joint does not follow: its spring pushes with at most 10 N m there (1.3 N m at
// the wrist). K [N m/rad] is diagonal and D gives every coupled mode the damping ratio zeta or more: it is
// designed for K, but never for less than the default stiffness. Modes faster than 100 rad/s are softened to
// that, so that the hold is stable behind motors of 50 Hz and a delay of 3 ms in every pose. Closed loop
// (exact model): M ddq + D dq + K (q - q_0) = tau_ext. Soft enough to be pushed by hand; an undeclared load
// of 1 kg sinks less than 3 cm. The q_0 of a prismatic joint follows a carriage that is pushed farther than
// 60 N, or the scene's spring_force, over K: it stays there.
class Hold final : public Controllet {
 public:
  explicit Hold(ArmModels arms) : usual_(kUsualStiffness) {
    for (std::size_t i = 0; i < arms[0]->joint_count(); ++i) {
      largest_push_[i] = kUsualStiffness[i] / 30;
      if (!arms[0]->is_prismatic(i)) continue;
      slides_[i] = true;
      usual_[i] = usual_prismatic_stiffness(*arms[0], i);
      largest_push_[i] = std::min(usual_[i] / 30, ContactBounds{}.spring_force);
    }
  }

  static ControlletDescriptor descriptor() {
    return {.type = "hold",
            .doc = "Holds one arm where it is: a soft, damped joint spring. The safe default of every arm.",
            .moving_base = true,
            .parameters = spec_table<kParameterCount>(
                parameter_at<kStiffness>({.name = "stiffness_nm_per_rad",
                                          .unit = "N m/rad",
                                          .size = ParameterSpec::kPerJoint,
                                          .initial = {kUsualStiffness.begin(), kUsualStiffness.end()},
                                          .min = 20,
                                          .max = 1000,
                                          .doc = "Joint stiffness K. Fixed while the arm is stopped."}),
                parameter_at<kDampingRatio>({.name = "damping_ratio",
                                             .initial = {1.0},
                                             .min = 0.5,
                                             .max = 2,
                                             .doc = "Damping ratio zeta of every coupled mode; damping is "
                                                    "never designed for less than the default stiffness."}))};
  }

  LawResult start(ControlContext& context) override {
    entered_ = false;
    enter(context.arms[0]);
    return LawResult::ok;  // always, because there is no other fallback
  }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    enter(arm);
    if (!entered_)
      return LawResult::ok;  // no valid measurement yet: zero torque, the arm compensates its gravity
    if (context.stopped) {
      stay(arm.q(), !stopped_);
    } else {
      lead_back(arm.q(), context.parameters->values(kStiffness), kReturnSpeed * context.dt,
                context.contact.spring_force);
    }
    stopped_ = context.stopped;
    const auto K = context.parameters->values(kStiffness);
    slip(arm, K, context.contact.spring_force);
    JointVector stiffness = arm.q();
    JointVector design = stiffness;
    for (Eigen::Index i = 0; i < stiffness.size(); ++i) {
      const auto k = static_cast<std::size_t>(i);
      stiffness[i] = K[k];
      design[i] = std::max(K[k], usual_[k]);
    }
    raise(stiffness, arm.q(), context.stopped ? 0 : context.dt);
    *arm.tau = torque(arm, stiffness, design, context.parameters->number(kDampingRatio)) + arm.terms->c();
    return LawResult::ok;
  }

 private:
  enum Parameter : std::size_t { kStiffness, kDampingRatio, kParameterCount };

  // K (q_0 - q) - D dq in the modes of the coupled inertia, and not of its diagonal: with a bent elbow,
  // joints that move against each other have a tenth of it. A mode faster than kFastestMode gets the
  // stiffness and at most the damping of one at kFastestMode, because it would oscillate if the motors lag by
  // a few milliseconds (with 50 Hz and 3 ms, 110 rad/s is stable).
  JointVector torque(const OwnedArm& arm, const JointVector& stiffness, const JointVector& design,
                     double zeta) const {
    const CoupledModes<JointMatrix> modes(arm.terms->M(), JointMatrix(design.asDiagonal()));
    const JointVector omega = modes.k.cwiseSqrt();
    const JointMatrix Q = modes.L.lazyProduct(modes.U);
    const JointVector d = (2.0 * zeta * omega).cwiseMin(2.0 * kFastestMode);
    const JointMatrix D = (Q * d.asDiagonal()).lazyProduct(Q.transpose());
    const JointVector error = q_0_ + raised_.value() - arm.q(), damping = D.lazyProduct(arm.dq());
    if (omega.maxCoeff() <= kFastestMode) return stiffness.cwiseProduct(error) - damping;
    // P^T K P with P = Q^-T S Q^T, S the remaining share of each mode.
    const JointVector share = kFastestMode * omega.cwiseMax(kFastestMode).cwiseInverse();
    const JointVector in_modes = share.cwiseProduct(JointVector(Q.transpose().lazyProduct(error)));
    JointRow row = modes.U.lazyProduct(in_modes).transpose();
    divide_by_lower(modes.L, row);  // L^-T U S Q^T e
    row = stiffness.cwiseProduct(row.transpose()).transpose().eval();
    divide_by_transposed_lower(modes.L, row);
    const JointVector back = modes.U.transpose().lazyProduct(row.transpose());
    return Q.lazyProduct(JointVector(share.cwiseProduct(back))) - damping;
  }
  using JointRow = Eigen::Matrix<double, 1, Eigen::Dynamic, Eigen::RowMajor, 1, kMaxJoints>;
  static constexpr double kFastestMode = 100;  // [rad/s]

  // Return speed of a joint beyond its limits: a stiffness times the whole distance would throw it.
  static constexpr double kReturnSpeed = 0.1, kReturnAcceleration = 5;  // [rad/s], [rad/s^2]; [m/s], [m/s^2]
  static constexpr std::array<double, kMaxJoints> kUsualStiffness = {300, 300, 300, 300, 120, 80, 40, 40,
                                                                     40,  40,  40,  40,  40,  40, 40, 40};

  // `force`: the contact bound of carriages.
  void lead_back(const JointVector& q, std::span<const double> K, double reach, double force) {
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      const double step = std::clamp(q_end_[i] - q_0_[i], -reach, reach), lead = q_0_[i] - q[i];
      const auto k = static_cast<std::size_t>(i);
      const double most = slides_[k] ? std::min(largest_push_[k], force) : largest_push_[k];
      if (step * lead > 0 && K[k] * std::abs(lead) > most) continue;
      q_0_[i] += step;
    }
  }

  // A carriage resists with no more than the bounds for contact, stopped or not, and stays where it was
  // pushed: with K times the distance, tens of kilograms would swing back at the person who pushed them aside
  // to get free. Its damping is not reduced. No carriage carries weight (weight_on_an_axis()), so none sinks.
  void slip(const OwnedArm& arm, std::span<const double> K, double force) {
    const auto& limits = arm.model().limits();
    for (Eigen::Index i = 0; i < q_0_.size(); ++i) {
      const auto k = static_cast<std::size_t>(i);
      if (!slides_[k]) continue;
      const double lead = std::min(force, ContactBounds{}.spring_force) / K[k], q = arm.q()[i];
      const double kept = std::clamp(q_0_[i], q - lead, q + lead);
      if (kept == q_0_[i]) continue;
      q_0_[i] = kept;
      q_end_[i] = std::clamp(kept, limits.q_min[i], limits.q_max[i]);
    }
  }

  // A stopped arm does not move. If q_0 was ahead of a returning joint, it waits there. Elsewhere the
  // distance that a raised stiffness left stays, since it supports the load of the arm.
  void stay(const JointVector& q, bool just_stopped) {
    if (!just_stopped) return;
    JointVector by = JointVector::Zero(q.size());
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      if ((q_end_[i] - q_0_[i]) * (q_0_[i] - q[i]) <= 0) continue;
      q_0_[i] = q[i];
      by[i] = -raised_.value()[i];
    }
    raised_.shift(by);
  }

  // A hold often starts because of an invalid measurement. It holds the first valid one.
  void enter(const OwnedArm& arm) {
    if (entered_ || !arm.q().allFinite()) return;
    const auto& limits = arm.model().limits();
    q_0_ = arm.q();
    q_end_ = q_0_.cwiseMax(limits.q_min).cwiseMin(limits.q_max);
    K_before_.resize(0);
    raised_.start(q_0_.size());
    farthest_ = raised_.value();
    entered_ = true;
  }

  // Where K rises, q_0 jumps towards the arm so that the torque does not change (raised_spring.hpp), and then
  // returns: otherwise a light arm that sags under an undeclared load would be thrown up. Until it has
  // returned it jumps no closer than the first time, or a stiffness that goes up and down would let the load
  // sink without end. Carriages slip. A stopped arm does not move.
  void raise(const JointVector& K, const JointVector& q, double dt) {
    if (dt > 0) raised_.advance(JointVector::Zero(q.size()), kReturnSpeed, kReturnAcceleration, dt);
    const bool rises = K_before_.size() == K.size() && (K_before_.array() < K.array()).any();
    first_rise_ = rises && (first_rise_ || raised_.none());  // a rise takes many ticks
    if (rises) {
      const JointVector share = JointVector::Ones(K.size()) - K_before_.cwiseQuotient(K).cwiseMin(1.0);
      JointVector near = raised_.value() - share.cwiseProduct(q_0_ + raised_.value() - q);
      for (Eigen::Index i = 0; i < K.size(); ++i)
        if (slides_[static_cast<std::size_t>(i)]) near[i] = 0;
      if (first_rise_) farthest_ = near.cwiseAbs();
      raised_.shift(near.cwiseMin(farthest_).cwiseMax(-farthest_) - raised_.value());
    }
    K_before_ = K;
  }

  std::array<double, kMaxJoints> usual_;  // default stiffness [N m/rad], [N/m]
  // Largest push of a returning joint on an obstacle, perhaps a person: q_0 then waits. For a revolute joint
  // more than damping at kReturnSpeed and friction need [N m], [N].
  std::array<double, kMaxJoints> largest_push_{};
  std::array<bool, kMaxJoints> slides_{};
  JointVector q_0_, q_end_, K_before_, farthest_;
  ReturningOffset raised_;  // of q_0, since K rose
  bool entered_ = false, stopped_ = false, first_rise_ = false;
};

}  // namespace

ControlletType hold_controllet() { return controllet_type<Hold>(); }

}  // namespace multipanda
