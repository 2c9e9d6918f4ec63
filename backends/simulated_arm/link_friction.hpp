#pragma once

#include <vector>

#include "models/robot_description.hpp"

namespace multipanda {

// Friction of an arm's joints beyond their torque sensors (FrictionLaw), in motion. In a physics step it is
// linear in the velocity at the end of the step,
//   tau_f = constant + slope dq_after,  slope >= 0,
// so that an integrator can treat it implicitly: light joints stay stable for any slope of the law.
//
// The line is tangent to the law at the velocity extrapolated with the previous acceleration, with the
// present presliding state. For the Stribeck part it is the chord between both velocities, or the line
// through rest if the chord would take more than half of the velocity, so that friction never reverses a
// joint. No allocation after construction.
class LinkFriction {
 public:
  // Throws std::invalid_argument if a size is not n.
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
