#pragma once

#include <memory>

#include "core/safety/torque_limiter.hpp"
#include "core/state/arm_state.hpp"
#include "fci/client/posture_hold.hpp"

namespace multipanda {

// Torques that answer one arm's packets: those of a program that runs on another clock while they are recent,
// otherwise those of the arm's hold in the posture in which the program fell silent. All of them
// keep the arm's limit of the torque rate, counted from the torque in use and from the torque sent last, so
// that a lost answer is no discontinuity.
//
// The arm's thread, once per packet; nothing allocates.
class TorqueAnswer {
 public:
  static constexpr double kKept = 0.02;  // [s] a torque is repeated this long without a newer one
  static constexpr double kFade = 0.1;   // [s] from the hold back to the program's torques

  // low_pass_hz: on all torques, first order; 0: none. `scene`: limits of the arm's scene, of which the
  // tighter ones count; none: the model's.
  explicit TorqueAnswer(const std::shared_ptr<const ArmModel>& model, double low_pass_hz = 0,
                        const ArmLimits* scene = nullptr);

  // A motion begins; the arm's torque is zero.
  void begin();
  // The program's newest torque (n x 1), finite.
  void take(const JointVector& tau);
  // Holds the present posture from now on, until resume().
  void hold() { stopped_ = true; }
  // The program's later torques count again.
  void resume();

  // The answer to a packet.
  const JointVector& step(const ArmState& state) noexcept;

  bool is_holding() const { return holding_; }
  bool fell_silent() const { return silent_; }  // and was not resumed
  // While it holds: whether the arm has come to rest.
  bool is_at_rest() const { return still_ >= kStill; }

 private:
  static constexpr int kStill = 20;  // periods

  fci::PostureHold posture_;
  TorqueLimiter limiter_;
  JointVector tau_program_, tau_;
  bool has_torque_ = false;  // of the program, since begin() or resume()
  bool stopped_ = false, silent_ = false, holding_ = false;
  int age_ = 0;       // periods since the program's newest torque
  int still_ = 0;     // periods at rest
  double share_ = 1;  // of the program's torque, while it fades in
};

}  // namespace multipanda
