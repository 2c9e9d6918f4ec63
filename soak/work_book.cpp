#include "soak/work_book.hpp"

#include <cmath>

namespace multipanda {

void WorkBook::arm_period(const JointVector& q, const JointVector* tau) {
  if (arm_commanded_) arm_ += tau_arm_.dot(q - q_arm_);
  arm_commanded_ = tau != nullptr;
  if (arm_commanded_) tau_arm_ = *tau;
  q_arm_ = q;
}

void WorkBook::state(const JointVector& q, const JointVector& tau_in_use, bool seen, bool counts) {
  if (counts && tau_program_.size() == q.size()) {
    // Over a gap the torque changed on the way: its mean is the best guess.
    const JointVector tau = seen ? tau_program_ : JointVector(0.5 * (tau_program_ + tau_in_use));
    const double work = tau.dot(q - q_program_);
    program_ += work;
    if (!seen) unseen_ += std::abs((tau_in_use - tau_program_).dot(q - q_program_));
  }
  q_program_ = q;
  tau_program_ = tau_in_use;
}

}  // namespace multipanda
