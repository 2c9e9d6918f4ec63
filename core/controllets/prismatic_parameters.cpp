#include "core/controllets/prismatic_parameters.hpp"

#include <algorithm>
#include <cmath>

#include "core/model/prismatic_joints.hpp"

namespace multipanda {
namespace {

constexpr double kFrequency = 20;  // [rad/s]

bool is_stiffness(const ParameterSpec& spec) { return spec.unit.starts_with("N m/rad"); }
bool is_damping(const ParameterSpec& spec) { return spec.unit.starts_with("N m s/rad"); }
bool has_units_of_joints(const ParameterSpec& spec) {
  return spec.size == ParameterSpec::kPerJoint && (is_stiffness(spec) || is_damping(spec));
}

double mass_of(const ArmModel& model, std::size_t joint) {
  return model.least_inertia()[static_cast<Eigen::Index>(joint)];
}

}  // namespace

double usual_prismatic_stiffness(const ArmModel& model, std::size_t joint) {
  const double stiffness = mass_of(model, joint) * kFrequency * kFrequency;
  return std::clamp(100 * std::round(stiffness / 100), 500.0, 20000.0);
}

ParameterSpec with_prismatic_joints(ParameterSpec spec) {
  if (!has_units_of_joints(spec)) return spec;
  const bool stiffness = is_stiffness(spec);
  spec.max = std::max(spec.max, stiffness ? kMostPrismaticStiffness : kMostPrismaticDamping);
  spec.unit += stiffness ? ", N/m of prismatic joints" : ", N s/m of prismatic joints";
  return spec;
}

std::vector<ParameterSpec> specs_for(const std::vector<ParameterSpec>& specs, const ArmModel& model) {
  if (!has_prismatic_joints(model)) return specs;
  std::vector<ParameterSpec> own;
  for (const ParameterSpec& spec : specs) {
    own.push_back(with_prismatic_joints(spec));
    if (!has_units_of_joints(spec)) continue;
    std::vector<double>& initial = own.back().initial;
    if (initial.size() == 1) initial.resize(model.joint_count(), initial[0]);
    for (std::size_t i = 0; i < model.joint_count(); ++i) {
      if (!model.is_prismatic(i)) continue;
      const double stiffness = usual_prismatic_stiffness(model, i);
      // Damping: critical on that stiffness.
      initial[i] = is_stiffness(spec)
                       ? stiffness
                       : std::min(2 * std::sqrt(stiffness * mass_of(model, i)), kMostPrismaticDamping);
    }
  }
  return own;
}

void bound_revolute_joints(const std::vector<ParameterSpec>& specs, const ArmModel& model,
                           ParameterSet& parameters) {
  if (!has_prismatic_joints(model)) return;
  for (std::size_t i = 0; i < specs.size(); ++i) {
    if (!has_units_of_joints(specs[i])) continue;
    std::vector<double> most;
    for (std::size_t joint = 0; joint < model.joint_count(); ++joint)
      most.push_back(model.is_prismatic(joint) ? parameters.spec(i).max : specs[i].max);
    parameters.lower_max(i, most, "the bound of a revolute joint");
  }
}

}  // namespace multipanda
