#pragma once

// Accuracy of the estimated forces: arms in MuJoCo under known forces, with the observer as in the control
// cycle. Used by forces_test and by force_figures, which prints the figures of docs/results/control.md.
#include <deque>
#include <functional>
#include <string>
#include <vector>

#include "backends/mujoco/testing/test_scenes.hpp"
#include "core/state/external_force.hpp"

namespace multipanda::test {

// Scenes in which only the given forces act on arms that hold or move with a simple law.
class ForceRig {
 public:
  explicit ForceRig(const Scene& scene);

  // Wrench on the arm at its stiffness frame K, world axes; stays until changed.
  void push(std::size_t arm, const Wrench& F_on_arm_K_W) { push_[arm] = F_on_arm_K_W; }
  // Torque for the next period: acceleration ddq_d, springs and dampers about q_d, dq_d at 20 rad/s, and a
  // wrench at K, world axes, that the arm should exert.
  void follow(std::size_t arm, const JointVector& q_d, const JointVector& dq_d, const JointVector& ddq_d,
              const Wrench& F_K_W = {});
  void hold(std::size_t arm, const JointVector& q_d, const Wrench& F_K_W = {});
  // Springs and dampers at K in world axes instead: which hold an object between two arms.
  void hold_pose(std::size_t arm, const Pose& X_WK_d, const Wrench& F_K_W);
  // Advances one period, then updates the estimates.
  void step();

  const ArmState& state(std::size_t arm) const { return states_[arm]; }
  ModelTerms& terms(std::size_t arm) { return terms_[arm]; }
  Loop& loop() { return loop_; }

 private:
  void apply_pushes();

  Loop loop_;
  std::vector<ModelTerms> terms_;
  std::deque<ExternalForceObserver> observers_;
  std::vector<ArmState> states_;  // with estimates
  std::vector<Wrench> push_;
};

// Errors of an estimate over a time window: [N] or [N m].
struct ErrorFigures {
  double bias = 0;  // length of the mean
  double rms = 0;
  double max = 0;
};
struct WrenchError {
  ErrorFigures force, torque;
  void take_worse(const WrenchError& other);
};

// The arms of all measurements: bare; hand, on a wall; hand, tool and declared payload, turned;
// the same with K far off the end effector.
struct NamedArm {
  std::string name;
  SceneArm arm;
};
std::vector<NamedArm> measured_arms();

// Each of the following is one case; the error is the worst of all directions in the last half second.
WrenchError error_under_pushes(const SceneArm& arm, const PlantFidelity& plant);  // 6 forces, 6 moments
WrenchError error_with_payload(const SceneArm& arm, bool declared, const PlantFidelity& plant);
WrenchError error_pressing(const SceneArm& arm,
                           const PlantFidelity& plant);   // against the true contact force
WrenchError error_squeezing(const PlantFidelity& plant);  // against the true contact force
WrenchError error_in_motion(const SceneArm& arm, const PlantFidelity& plant);  // all joints to 1 rad/s

// Estimate of a force of 10 N at K, 10 N sin(2 pi f t): gain and lag of the estimate.
struct Response {
  double gain = 0, lag_s = 0;
};
Response response_to_sine(double frequency_hz, const PlantFidelity& plant);
// Periods from a step of 10 N at K until the estimate has 63.2 % and 99 % of it, interpolated [s].
struct StepResponse {
  double to_63_s = 0, to_99_s = 0, overshoot = 0;
};
StepResponse response_to_step(const PlantFidelity& plant);

}  // namespace multipanda::test
