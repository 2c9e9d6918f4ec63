#pragma once

#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/features/feature.hpp"
#include "core/modes/registry.hpp"
#include "core/modes/request.hpp"
#include "core/state/arm_condition.hpp"
#include "core/types/tick.hpp"
#include "core/types/time.hpp"

namespace multipanda {

// Configuration of one controllet instance in a scene.
struct InstanceConfig {
  struct Value {
    std::string name;  // "stiffness_n_per_m", or "joint_limits.range_rad" for a feature's parameter
    std::vector<double> values;
  };
  std::string name;                   // unique
  std::string type;                   // in the registry
  std::vector<ArmIndex> arms;         // in the controllet's order
  std::vector<ArmIndex> observes;     // arms that it reads and does not own, in the controllet's order
  std::vector<std::string> features;  // switched on from the start
  std::vector<Value> parameters;
  std::vector<InputSpec> inputs;  // overrides of timeout and speed limits, by name; usually empty
  ContactBounds contact = ContactBounds::lifted();  // scenes set their own; see docs/contact.md
};

// The data of one cycle that instances use, one element per arm of the scene.
struct ArmBlocks {
  std::span<ArmState> states;
  std::span<ModelTerms> terms;
  std::span<JointVector> tau_controllet, tau_feature;
  // World data for features. The obstacles' poses are those of this cycle; the rest is used while instances
  // are built.
  std::span<const Obstacle> obstacles = {};
  ArmSet friction_compensated = {};
  std::span<const ArmCondition> conditions = {};  // for the multimode controller; instances do not need it
  std::span<const std::optional<BaseMount>> mounts = {};  // mounts of carried arms; empty: none is carried
};

// One controllet with its parameters, references and features, bound to its arms. Built before the loop.
class Instance {
 public:
  // Throws std::invalid_argument on unknown type, feature or parameter, wrong number of arms, values
  // out of bounds, an arm that is both owned and observed.
  Instance(const InstanceConfig& config, const Registry& registry, const ArmBlocks& blocks);

  const std::string& name() const { return name_; }
  const ControlletDescriptor& descriptor() const { return descriptor_; }
  ArmSet arms() const { return arms_; }
  const std::vector<ArmIndex>& arm_list() const { return arm_list_; }
  // Arms that it reads and does not own, and those that carry its arms or stand on them.
  ArmSet observed() const { return observed_; }
  const std::vector<ArmIndex>& observed_list() const { return observed_list_; }  // those that it reads
  const ContactBounds& contact() const { return contact_; }

  // Parameters of the controllet, then of its features, in one numbering; names as in InstanceConfig::Value.
  std::size_t parameter_count() const { return parameter_names_.size(); }
  const std::vector<std::string>& parameter_names() const { return parameter_names_; }
  std::size_t find_parameter(std::string_view name) const;  // parameter_count(): unknown
  const ParameterSpec& parameter_spec(std::size_t i) const;
  std::vector<double> parameter(std::size_t i) const;  // target value; any thread except the loop's
  std::size_t parameter_size(std::size_t i) const;
  Verdict check_parameter(std::size_t i, std::span<const double> values) const;
  // Why these values exceed the arm's bounds; empty: they do not. Any thread except the loop's.
  std::string bound_text(std::size_t i, std::span<const double> values) const;

  std::size_t feature_count() const { return features_.size(); }
  const ControlletDescriptor& feature_descriptor(std::size_t i) const { return features_[i].descriptor; }
  std::size_t find_feature(std::string_view type) const;  // feature_count(): unknown
  // Why the feature cannot be switched on here in any state; empty: it can.
  std::string_view feature_refusal(std::size_t i) const;
  std::string_view start_condition(std::size_t feature) const {
    return features_[feature].feature->start_condition();
  }
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
  // If `active`, parameters approach their values and features start; otherwise both are only stored.
  void set_parameter(std::size_t i, std::span<const double> values, bool active);
  LawResult set_feature(std::size_t i, bool on, bool active, const Tick& tick);
  void set_stopped(bool stopped) { stopped_ = stopped; }  // its arm, of a hold
  // Ends of the newest goal of an input, from the arms' present state on. False: it needs the force of an
  // arm, which is unknown.
  bool watch_goal(std::size_t input, const Target& goal, const GoalEnd& until);
  // Before update(): ends a goal whose end condition is met. Returns whether there was one.
  struct EndedGoal {
    std::size_t input = 0, arm = 0;  // arm: index in the list of its arms
    GoalEnd::Cause cause = GoalEnd::force;
    double measured = 0, limit = 0;  // not a number: the force is not known any more
  };
  bool end_goal(EndedGoal& ended);
  // Starts the references at the measured state, then the controllet and its features. fault: refused,
  // or an exception.
  LawResult start(const Tick& tick);
  // Returns whether this step begins a new tick of the group. The arms of a group deliver their packets at
  // different times. The group ticks on the packet of one arm; each other arm receives the torque of that
  // tick on its own packet, unless that comes more than half a period later: then the group ticks again, on
  // this packet, and the first arm receives the torque of that tick.
  bool begins_tick(ArmSet due, const Tick& tick);
  // Returns the reason to deactivate it, or none. Fills tau_controllet of its arms.
  Intervention update(const Tick& tick);
  // Fills tau_feature of its arms.
  Intervention update_features(const Tick& tick);

 private:
  struct FeatureSlot {
    ControlletDescriptor descriptor;
    std::unique_ptr<Feature> feature;
    ParameterSet parameters;
    std::size_t output_offset = 0, output_count = 0;
    // Share of its torque that acts: grows to 1 within ParameterSet::kRamp after each start, and falls to 0
    // after it was switched off.
    double fade = 0;
  };
  struct WatchedGoal {
    GoalEnd until;
    std::array<double, kMaxTargetValues> goal{};
    struct Start {
      Wrench F_K_W;
      Vector3 p_WE;
    };
    std::vector<Start> arms;  // of the instance
  };
  LawResult update_faded(FeatureSlot& slot, ControlContext& context, double goal);
  Intervention run_features(const Tick& tick);
  void clear_outputs(FeatureSlot& slot);
  void keep_still(const Tick& tick);
  void switch_feature(std::size_t i, bool on);
  bool there(const WatchedGoal& goal, const Reference& input) const;
  bool has_ended(const WatchedGoal& goal, EndedGoal& ended) const;
  void see_bases(const ArmBlocks& blocks);
  void bound_joint_speed(Reference& input);
  void bound_points(Reference& input);
  void carry_set_points(const Tick& tick);
  ControlContext context(const Tick& tick);
  ControlContext feature_context(FeatureSlot& slot, const Tick& tick);
  std::pair<ParameterSet*, std::size_t> locate(std::size_t i);
  std::pair<const ParameterSet*, std::size_t> locate(std::size_t i) const;

  std::string name_;
  ControlletDescriptor descriptor_;
  ArmSet arms_, observed_;
  std::vector<ArmIndex> arm_list_, observed_list_;
  std::unique_ptr<Controllet> controllet_;
  ParameterSet parameters_;
  std::vector<Reference> inputs_;
  std::vector<WatchedGoal> goals_;  // of the inputs
  std::vector<FeatureSlot> features_;
  std::atomic<std::uint32_t> features_on_{0};  // bit i: feature i; written by the loop (or before it)
  std::vector<std::string> parameter_names_;
  std::vector<double> outputs_;
  std::size_t law_output_count_ = 0;
  std::vector<OwnedArm> law_arms_, feature_arms_, scene_arms_, observed_arms_;
  ArmSet mounted_;           // its arms that stand on others
  bool bases_move_ = false;  // an arm of the scene stands on another one
  ContactBounds contact_;
  bool stopped_ = false;
  // Torque of a hold's features when its arm was stopped: it remains, and fades out after a resume.
  double still_share_ = 0;  // 1 while it is stopped
  double lets_go_ = 0;      // 1 while a feature lets go, then fades
  JointVector still_tau_;   // (n x 1) [N m]
  ArmState at_rest_;
  std::vector<Pose> X_FE_;  // end effectors of the set-points
  ArmSet served_;           // arms that received the torque of the current tick
  LoopTime last_tick_;
  double dt_ = kArmPeriod;  // of the current tick
};

}  // namespace multipanda
