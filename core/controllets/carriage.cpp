#include "core/controllets/carriage.hpp"

#include <algorithm>

namespace multipanda {

double carriage_share(const ContactBounds& bounds, const ArmModel& model, const JointVector& pull,
                      const JointVector& damping, const JointVector& dq) {
  double most = 0;
  for (std::size_t i = 0; i < model.joint_count(); ++i) {
    if (!model.is_prismatic(i)) continue;
    const auto k = static_cast<Eigen::Index>(i);
    Vector6 along = Vector6::Zero(), damps = Vector6::Zero();
    along[0] = pull[k];
    damps[0] = damping[k];
    most = std::max(most, bound_pull(bounds, along, damps, dq[k] * Vector3::UnitX()).force_share);
  }
  return most;
}

double carriage_strain(const ContactBounds& bounds, const ArmModel& model, const JointVector& spring) {
  const JointVector none = JointVector::Zero(spring.size());
  return carriage_share(tighter(bounds, {}), model, spring, none, none);
}

}  // namespace multipanda
