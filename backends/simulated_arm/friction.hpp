#pragma once

#include <vector>

#include "models/robot_description.hpp"

// Friction of a joint as a smooth function of its velocity (Gaz et al., RA-L 2019):
//   tau_f(dq) = p1 / (1 + exp(-p2 (dq + p3))) - p1 / (1 + exp(-p2 p3)),
// the torque that friction takes from the motor, [N m]. It is zero at rest and grows with dq.
namespace multipanda {

double friction_torque(const JointFriction& friction, std::size_t joint, double dq);

// d tau_f / d dq >= 0 [N m s/rad].
double friction_slope(const JointFriction& friction, std::size_t joint, double dq);

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
  // inertia: of each joint alone, approximate [kg m^2] (n x 1).
  void begin(const JointVector& dq, const JointVector& inertia, double dt);
  const JointVector& constant() const { return constant_; }  // [N m] (n x 1)
  const JointVector& slope() const { return slope_; }        // [N m s/rad] (n x 1)
  void end(const JointVector& dq_after, double dt);          // presliding follows the step

 private:
  void add(Eigen::Index joint, double torque, double slope, double dq);

  FrictionLaw law_;
  JointVector dq_before_;           // at the beginning of the previous step; empty: none
  std::vector<JointVector> state_;  // of each presliding element (n x 1)
  JointVector constant_, slope_;
};

}  // namespace multipanda
