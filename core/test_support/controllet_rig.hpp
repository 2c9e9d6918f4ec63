#pragma once

#include <memory>
#include <string_view>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/features/feature.hpp"

namespace multipanda::test {

using Models = std::vector<std::shared_ptr<const ArmModel>>;

// What a controllet or feature needs around it to be called: states, model terms, parameters, inputs and
// outputs, without the machinery that switches them. Every arm's state is set by the test.
class ControlletRig {
 public:
  ControlletRig(const ControlletType& type, const Models& models);
  // All arms are the feature's own, unless `own` says which (the rest is only looked at).
  ControlletRig(const FeatureType& type, const Models& models, std::vector<Obstacle> obstacles = {},
                std::vector<ArmIndex> own = {});

  void place(std::size_t arm, const JointVector& q, const JointVector& dq);
  void frames(std::size_t arm, const ArmFrames& frames);  // takes effect at the next place()
  ArmState& state(std::size_t arm) { return states_[arm]; }
  void set(std::string_view parameter, std::vector<double> values);  // now
  void approach(std::string_view parameter, std::vector<double> values);
  Reference& input(std::string_view name);
  std::vector<double> output(std::string_view name) const;

  LawResult start();
  LawResult update();         // at the same instant: the inputs stand still
  LawResult tick(double dt);  // inputs and parameters move on first
  JointVector tau(std::size_t arm) const { return tau_[arm]; }
  ModelTerms& terms(std::size_t arm) { return terms_[arm]; }
  double time() const { return time_s_; }

  // Forward dynamics by semi-implicit Euler in `substeps` per tick, torque held: M ddq = tau + tau_ext - c.
  void integrate(double dt, const std::vector<JointVector>& tau_ext, int substeps = 4);
  double kinetic_energy(std::size_t arm);

 private:
  void build(const Statement& statement, const Models& models);
  ControlContext context(double dt);

  Statement statement_;
  std::unique_ptr<Controllet> controllet_;
  std::unique_ptr<Feature> feature_;
  std::unique_ptr<ParameterSet> parameters_;
  std::vector<Reference> inputs_;
  std::vector<double> outputs_;
  std::vector<ArmState> states_;
  std::vector<ModelTerms> terms_, plant_;
  std::vector<JointVector> tau_;
  std::vector<OwnedArm> arms_, scene_arms_;
  double time_s_ = 0;
};

// A comfortable, regular configuration of TestArm::make(), and one near it.
JointVector bent(std::size_t joints);

}  // namespace multipanda::test
