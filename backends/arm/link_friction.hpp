#pragma once

#include <vector>

#include "models/robot_description.hpp"

namespace multipanda {

// Friction of an arm's joints beyond their torque sensors (FrictionLaw), in motion. In a physics step it is a
// straight line in the velocity at the step's end,
//   tau_f = constant + slope dq_after,  slope >= 0,
// so that an integrator can take it implicitly: light joints stay stable whatever the law's slope.
//
// The line touches the law where the velocity would be with the acceleration of the step before; presliding
// with its state of then. Stribeck: the chord from here to there; where it would take more than half of the
// velocity in the step, the line through rest, so that it never turns a joint round. No allocation after
// construction.
class LinkFriction {
 public:
  // Throws std::invalid_argument: sizes that are not n.
  LinkFriction(FrictionLaw law, std::size_t n);

  void reset();  // presliding relaxed
  // inertia: of each joint alone, roughly [kg m^2] (n x 1).
  void begin(const JointVector& dq, const JointVector& inertia, double dt);
  const JointVector& constant() const { return constant_; }  // [N m] (n x 1)
  const JointVector& slope() const { return slope_; }        // [N m s/rad] (n x 1)
  void end(const JointVector& dq_after, double dt);          // presliding follows the step
  const JointVector& presliding_state(std::size_t element) const { return state_[element]; }  // z [rad]

 private:
  void add(Eigen::Index joint, double torque, double slope, double dq);

  FrictionLaw law_;
  JointVector dq_before_;           // at the beginning of the step before; empty: there was none
  std::vector<JointVector> state_;  // of each presliding element (n x 1)
  JointVector constant_, slope_;
};

}  // namespace multipanda
