#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/features/feature.hpp"
#include "core/modes/registry.hpp"
#include "core/modes/request.hpp"
#include "core/types/tick.hpp"

namespace multipanda {

// What a scene says about one controllet instance.
struct InstanceConfig {
  struct Value {
    std::string name;  // "stiffness_n_per_m", or "joint_limits.range_rad" for a feature's parameter
    std::vector<double> values;
  };
  std::string name;                   // unique
  std::string type;                   // in the registry
  std::vector<ArmIndex> arms;         // in the controllet's order
  std::vector<std::string> features;  // switched on from the start
  std::vector<Value> parameters;
  std::vector<InputSpec> inputs;  // overrides of timeout and speed limits, by name; usually empty
};

// The blocks of one cycle that instances work on, one element per arm of the scene.
struct ArmBlocks {
  std::span<ArmState> states;
  std::span<ModelTerms> terms;
  std::span<JointVector> tau_controllet, tau_feature;
  // What features may know of the world; used while instances are built.
  std::span<const Obstacle> obstacles = {};
  ArmSet friction_compensated = {};
};

// One controllet with its parameters, references and features, bound to its arms. Built before the loop.
class Instance {
 public:
  // Throws std::invalid_argument on unknown type, feature or parameter, wrong number of arms, values out of
  // bounds.
  Instance(const InstanceConfig& config, const Registry& registry, const ArmBlocks& blocks);

  const std::string& name() const { return name_; }
  const Statement& statement() const { return statement_; }
  ArmSet arms() const { return arms_; }
  const std::vector<ArmIndex>& arm_list() const { return arm_list_; }

  // Parameters of the controllet, then of its features, in one numbering; names as in InstanceConfig::Value.
  std::size_t parameter_count() const { return parameter_names_.size(); }
  const std::vector<std::string>& parameter_names() const { return parameter_names_; }
  std::size_t find_parameter(std::string_view name) const;  // parameter_count(): unknown
  const ParameterSpec& parameter_spec(std::size_t i) const;
  std::vector<double> parameter(std::size_t i) const;  // value aimed at; any thread but the loop's
  std::size_t parameter_size(std::size_t i) const;
  Verdict check_parameter(std::size_t i, std::span<const double> values) const;

  std::size_t feature_count() const { return features_.size(); }
  const Statement& feature_statement(std::size_t i) const { return features_[i].statement; }
  std::size_t find_feature(std::string_view type) const;  // feature_count(): unknown
  std::string_view feature_refusal(std::size_t i) const { return features_[i].feature->refusal(); }
  bool feature_on(std::size_t i) const {
    return (features_on_.load(std::memory_order_relaxed) >> i & 1u) != 0;
  }

  std::span<Reference> inputs() { return inputs_; }
  std::span<const Reference> inputs() const { return inputs_; }
  std::size_t find_input(std::string_view name) const;  // inputs().size(): unknown

  std::span<const double> outputs() const {
    return outputs_;
  }  // controllet's, then the features'; loop thread
  std::vector<OutputSpec> output_specs() const;

  // --- loop thread ---
  // `active`: does it run? Then parameters are approached and features start; else both are just noted.
  void set_parameter(std::size_t i, std::span<const double> values, bool active);
  LawResult set_feature(std::size_t i, bool on, bool active, const Tick& tick);
  // References at the measured state, then controllet and features start. fault: refused (an exception
  // counts).
  LawResult start(const Tick& tick);
  // Does this step begin a new tick of the group? The arms of a group deliver their packets apart; the group
  // ticks on its first arm's packet, the others get that tick's torque on their own.
  bool begins_tick(ArmSet due);
  // Why it must not go on, or none. Fills tau_controllet of its arms.
  Intervention update(const Tick& tick);
  // Fills tau_feature of its arms.
  Intervention update_features(const Tick& tick);

 private:
  struct FeatureSlot {
    Statement statement;
    std::unique_ptr<Feature> feature;
    ParameterSet parameters;
    std::size_t output_offset = 0, output_count = 0;
  };
  void switch_feature(std::size_t i, bool on);
  ControlContext context(const Tick& tick);
  ControlContext feature_context(FeatureSlot& slot, const Tick& tick);
  std::pair<ParameterSet*, std::size_t> locate(std::size_t i);
  std::pair<const ParameterSet*, std::size_t> locate(std::size_t i) const;

  std::string name_;
  Statement statement_;
  ArmSet arms_;
  std::vector<ArmIndex> arm_list_;
  std::unique_ptr<Controllet> controllet_;
  ParameterSet parameters_;
  std::vector<Reference> inputs_;
  std::vector<FeatureSlot> features_;
  std::atomic<std::uint32_t> features_on_{0};  // bit i: feature i; written by the loop (or before it)
  std::vector<std::string> parameter_names_;
  std::vector<double> outputs_;
  std::size_t law_output_count_ = 0;
  std::vector<OwnedArm> law_arms_, feature_arms_, scene_arms_;
  ArmSet served_;  // arms that have had the present tick's torque
  LoopTime last_tick_;
  double dt_ = 0.001;  // of the present tick
};

}  // namespace multipanda
