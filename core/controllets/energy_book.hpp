#pragma once

#include <array>

#include "core/types/joints.hpp"

namespace multipanda {

// The parts of a torque that a passive law keeps apart.
enum TorquePart : std::size_t {
  kSpringPart,        // s J^T K_c x~
  kDampingPart,       // -J^T D_c V, without the set-point's velocity
  kFeedforwardPart,   // s J^T (D_c V_d + n D_z v_d,n + Lambda A_d)
  kNullSpacePart,     // springs and dampers of the null space
  kCoriolisPart,      // C dq
  kForcePart,         // J^T F_f'
  kForceDampingPart,  // -J^T n D_z v_n
  kTorqueParts
};

// Work of every part of the torque over the period just gone: the torque was held over it, so that
// tau_part^T (q_now - q_before) is the work itself, not an estimate of it. (Where the plant is slower than
// the command it is the work of the command.) Loop thread, no allocation.
class EnergyBook {
 public:
  void start(const JointVector& q);
  // Closes the period that ends at q. `tau_in_use`: torque that the arm had in command, features and limits
  // included; its difference to the sum of the parts is booked as work of others.
  void close(const JointVector& q, const JointVector& tau_in_use);
  // Opens the next period.
  void open(TorquePart part, const JointVector& tau) { tau_[part] = tau; }
  JointVector sum() const;

  double work(TorquePart part) const { return work_[part]; }  // [J]
  double work_of_others() const { return others_; }           // [J]

 private:
  std::array<JointVector, kTorqueParts> tau_;
  std::array<double, kTorqueParts> work_{};
  double others_ = 0;
  JointVector q_;
};

}  // namespace multipanda
