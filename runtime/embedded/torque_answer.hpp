#pragma once

#include <memory>

#include "core/safety/torque_limiter.hpp"
#include "core/state/arm_state.hpp"
#include "fci/client/posture_hold.hpp"

namespace multipanda {

// Torques that answer one arm's packets: those of a program that runs on another clock while they are recent,
// otherwise those of the arm's hold (PostureHold: the law of `hold_controllet` without its loop) in the
// posture in which the program fell silent. All keep the arm's torque-rate limit relative to both the torque
// in use and the torque sent last, so that a lost answer causes no discontinuity.
//
// The arm's thread, once per packet; nothing allocates.
class TorqueAnswer {
 public:
  static constexpr double kKept = 0.02;  // a torque is repeated at most this long [s]
  static constexpr double kFade = 0.1;   // [s] from the hold back to the program's torques

  // low_pass_hz: on all torques, first order; 0: none. `scene`: limits of the arm's scene, of which the
  // tighter ones apply; none: the model's.
  explicit TorqueAnswer(const std::shared_ptr<const ArmModel>& model, double low_pass_hz = 0,
                        const ArmLimits* scene = nullptr);

  // A motion begins; the arm's torque is zero.
  void begin();
  // The program's newest torque (n x 1), finite.
  void take(const JointVector& tau);
  // Holds the present posture from now on, until resume().
  void hold() { stopped_ = true; }
  // Uses the program's later torques again.
  void resume();

  // The answer to a packet.
  const JointVector& step(const ArmState& state) noexcept;

  bool is_holding() const { return holding_; }
  bool fell_silent() const { return silent_; }  // silent and not resumed
  // While holding: whether the arm is at rest.
  bool is_at_rest() const { return still_ >= kStill; }

 private:
  static constexpr int kStill = 20;  // periods

  fci::PostureHold posture_;
  TorqueLimiter limiter_;
  JointVector tau_program_, tau_;
  bool has_torque_ = false;  // from the program, since begin() or resume()
  bool stopped_ = false, silent_ = false, holding_ = false;
  int age_ = 0;       // periods since the program's newest torque
  int still_ = 0;     // periods at rest
  double share_ = 1;  // weight of the program's torque while it fades in
};

}  // namespace multipanda
