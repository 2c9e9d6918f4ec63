#pragma once

#include <memory>
#include <string_view>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/features/feature.hpp"

namespace multipanda::test {

using Models = std::vector<std::shared_ptr<const ArmModel>>;

// Test fixture for one controllet or feature: provides states, model terms, parameters, inputs and outputs
// without the multimode controller. The test sets the state of every arm.
class ControlletRig {
 public:
  // The last models are those of the arms that it observes.
  ControlletRig(const ControlletType& type, const Models& models);
  // The feature owns all arms, or those in `own`.
  ControlletRig(const FeatureType& type, const Models& models, std::vector<Obstacle> obstacles = {},
                std::vector<ArmIndex> own = {});

  void place(std::size_t arm, const JointVector& q, const JointVector& dq);
  void place_obstacle(std::size_t i, const Pose& X_WO) { obstacles_[i].X_WO = X_WO; }
  void frames(std::size_t arm, const ArmFrames& frames);  // takes effect at the next place()
  void redefine(std::size_t arm, const Pose& X);          // while the law runs: E_new = E_old X
  ArmState& state(std::size_t arm) { return states_[arm]; }
  void set(std::string_view parameter, std::vector<double> values);  // now
  void approach(std::string_view parameter, std::vector<double> values);
  void bound(const ContactBounds& contact);  // of the law, and of the speed of its pose inputs
  Reference& input(std::string_view name);
  std::string_view start_condition() const { return feature_->start_condition(); }  // of a feature
  std::vector<double> output(std::string_view name) const;
  const std::vector<double>& outputs() const { return outputs_; }
  const ParameterSet& parameters() const { return *parameters_; }

  LawResult start();
  LawResult update();         // at the same instant, without advancing the inputs
  LawResult tick(double dt);  // advances inputs and parameters first
  JointVector tau(std::size_t arm) const { return tau_[arm]; }
  ModelTerms& terms(std::size_t arm) { return terms_[arm]; }
  double time() const { return time_s_; }

  // Forward dynamics by semi-implicit Euler in `substeps` per tick, torque held: M ddq = tau + tau_ext - c.
  void integrate(double dt, const std::vector<JointVector>& tau_ext, int substeps = 4);
  double kinetic_energy(std::size_t arm);

 private:
  void build(const ControlletDescriptor& descriptor, const Models& models);
  ControlContext context(double dt);

  ControlletDescriptor descriptor_;
  std::vector<Obstacle> obstacles_;
  std::unique_ptr<Controllet> controllet_;
  std::unique_ptr<Feature> feature_;
  std::unique_ptr<ParameterSet> parameters_;
  std::vector<Reference> inputs_;
  std::vector<double> outputs_;
  std::vector<ArmState> states_;
  std::vector<ModelTerms> terms_, plant_;
  std::vector<JointVector> tau_;
  std::vector<OwnedArm> arms_, scene_arms_, observed_;
  double time_s_ = 0;
  ContactBounds contact_ = ContactBounds::lifted();
};

// A regular configuration of TestArm::make().
JointVector bent(std::size_t joints);

}  // namespace multipanda::test
