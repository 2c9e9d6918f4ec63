#include "core/modes/instance.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "core/controllets/prismatic_parameters.hpp"
#include "core/types/time.hpp"

namespace multipanda {
namespace {

[[noreturn]] void refuse(const std::string& instance, const std::string& why) {
  throw std::invalid_argument("controllet '" + instance + "': " + why);
}

const ControlletType& controllet_type(const InstanceConfig& config, const Registry& registry,
                                      const ArmBlocks& blocks) {
  const ControlletType* type = registry.controllet(config.type);
  if (type == nullptr) refuse(config.name, "there is no controllet type '" + config.type + "'");
  if (config.arms.size() != type->descriptor.arms) {
    refuse(config.name, "'" + config.type + "' needs " + std::to_string(type->descriptor.arms) +
                            " arm(s), found " + std::to_string(config.arms.size()));
  }
  if (config.arms.empty()) refuse(config.name, "'" + config.type + "' owns no arm");
  if (config.observes.size() != type->descriptor.observes) {
    refuse(config.name, "'" + config.type + "' observes " + std::to_string(type->descriptor.observes) +
                            " arm(s), found " + std::to_string(config.observes.size()));
  }
  for (const auto& list : {config.arms, config.observes}) {
    for (const ArmIndex arm : list) {
      if (arm >= blocks.states.size()) refuse(config.name, "there is no arm number " + std::to_string(arm));
    }
  }
  return *type;
}

std::size_t total_size(const std::vector<OutputSpec>& outputs) {
  std::size_t n = 0;
  for (const auto& output : outputs) n += output.size;
  return n;
}

}  // namespace

Instance::Instance(const InstanceConfig& config, const Registry& registry, const ArmBlocks& blocks)
    : name_(config.name),
      descriptor_(controllet_type(config, registry, blocks).descriptor),
      arm_list_(config.arms),
      observed_list_(config.observes),
      parameters_(specs_for(descriptor_.parameters, blocks.terms[config.arms[0]].model()),
                  blocks.terms[config.arms[0]].joint_count()) {
  std::vector<std::shared_ptr<const ArmModel>> models;
  for (const ArmIndex arm : arm_list_) {
    if (arms_.contains(arm)) refuse(name_, "the same arm is listed twice");
    arms_ |= ArmSet::of(arm);
    models.push_back(blocks.terms[arm].shared_model());
    law_arms_.push_back({&blocks.states[arm], &blocks.terms[arm], &blocks.tau_controllet[arm]});
    feature_arms_.push_back({&blocks.states[arm], &blocks.terms[arm], &blocks.tau_feature[arm]});
  }
  for (const ArmIndex arm : observed_list_) {
    if (arms_.contains(arm)) refuse(name_, "it observes an arm that it owns");
    if (observed_.contains(arm)) refuse(name_, "the same observed arm is listed twice");
    observed_ |= ArmSet::of(arm);
    models.push_back(blocks.terms[arm].shared_model());
    observed_arms_.push_back({&blocks.states[arm], &blocks.terms[arm], nullptr});
  }
  see_bases(blocks);
  std::vector<std::shared_ptr<const ArmModel>> all_models;
  for (ArmIndex arm = 0; arm < blocks.states.size(); ++arm) {
    all_models.push_back(blocks.terms[arm].shared_model());
    scene_arms_.push_back({&blocks.states[arm], &blocks.terms[arm], nullptr});
  }
  const FeatureContext context{all_models, arm_list_, blocks.obstacles, blocks.friction_compensated};
  controllet_ = controllet_type(config, registry, blocks).create(models);
  bound_revolute_joints(descriptor_.parameters, *models[0], parameters_);
  controllet_->bound_parameters(parameters_);
  X_FE_.resize(arm_list_.size());
  contact_ = config.contact;
  if (!(contact_.hand_speed > 0 && contact_.spring_force > 0 && contact_.spring_moment > 0)) {
    refuse(name_, "the bounds for contact must be above zero");
  }

  for (InputSpec input : descriptor_.inputs) {
    for (const auto& change : config.inputs) {
      if (change.name != input.name) continue;
      input.timeout_s = change.timeout_s;
      input.max_speed = change.max_speed;
      input.max_angular_speed = change.max_angular_speed;
    }
    if (input.arm >= arm_list_.size())
      refuse(name_, "input '" + input.name + "' refers to an arm that the controllet does not own");
    if (input.quantity == Quantity::pose || input.quantity == Quantity::twist) {
      input.max_speed = std::min(input.max_speed, contact_.hand_speed);
    }
    const std::size_t joint_count = models[input.arm]->joint_count();
    inputs_.emplace_back(std::move(input), joint_count);
  }
  for (const auto& change : config.inputs) {
    if (find_input(change.name) == inputs_.size()) refuse(name_, "it has no input '" + change.name + "'");
  }
  parameter_names_.reserve(descriptor_.parameters.size());
  for (const auto& parameter : descriptor_.parameters) parameter_names_.push_back(parameter.name);

  law_output_count_ = total_size(descriptor_.outputs);
  std::size_t output_count = law_output_count_;
  const std::size_t joints = models[0]->joint_count();
  for (const auto& type : registry.features()) {
    features_.push_back({type.descriptor, type.create(context),
                         ParameterSet(type.descriptor.parameters, joints), output_count,
                         total_size(type.descriptor.outputs)});
    features_.back().feature->bound_parameters(features_.back().parameters);
    output_count += features_.back().output_count;
    for (const auto& parameter : type.descriptor.parameters) {
      parameter_names_.push_back(type.descriptor.type + "." + parameter.name);
    }
  }
  if (features_.size() > kMaxFeatures) refuse(name_, "too many features are registered");
  outputs_.assign(output_count, 0.0);

  for (const auto& feature : config.features) {
    const std::size_t i = find_feature(feature);
    if (i == feature_count()) refuse(name_, "there is no feature '" + feature + "'");
    if (const std::string_view why = feature_refusal(i); !why.empty()) {
      refuse(name_, "feature '" + feature + "': " + std::string(why));
    }
    switch_feature(i, true);
  }
  for (const auto& value : config.parameters) {
    const std::size_t i = find_parameter(value.name);
    if (i == parameter_count()) refuse(name_, "it has no parameter '" + value.name + "'");
    std::vector<double> values = value.values;
    if (values.size() == 1) values.resize(parameter_size(i), values[0]);  // one number for all elements
    const Verdict verdict = check_parameter(i, values);
    if (verdict != Verdict::accepted) {
      const std::string why = bound_text(i, values);
      refuse(name_, "parameter '" + value.name + "': " + std::string(to_string(verdict)) +
                        (why.empty() ? "" : "; " + why));
    }
    const auto [set, k] = locate(i);
    set->set_now(k, values);
  }
}

std::pair<const ParameterSet*, std::size_t> Instance::locate(std::size_t i) const {
  if (i < parameters_.size()) return {&parameters_, i};
  i -= parameters_.size();
  for (const auto& slot : features_) {
    if (i < slot.parameters.size()) return {&slot.parameters, i};
    i -= slot.parameters.size();
  }
  return {nullptr, 0};
}
std::pair<ParameterSet*, std::size_t> Instance::locate(std::size_t i) {
  const auto [set, k] = static_cast<const Instance*>(this)->locate(i);
  return {const_cast<ParameterSet*>(set), k};
}

std::size_t Instance::find_parameter(std::string_view name) const {
  return static_cast<std::size_t>(std::find(parameter_names_.begin(), parameter_names_.end(), name) -
                                  parameter_names_.begin());
}
const ParameterSpec& Instance::parameter_spec(std::size_t i) const {
  const auto [set, k] = locate(i);
  return set->spec(k);
}
std::vector<double> Instance::parameter(std::size_t i) const {
  const auto [set, k] = locate(i);
  return set->target(k);
}
std::size_t Instance::parameter_size(std::size_t i) const {
  const auto [set, k] = locate(i);
  return set->value_size(k);
}
Verdict Instance::check_parameter(std::size_t i, std::span<const double> values) const {
  const auto [set, k] = locate(i);
  return set == nullptr ? Verdict::unknown_parameter : set->check(k, values);
}
std::string Instance::bound_text(std::size_t i, std::span<const double> values) const {
  const auto [set, k] = locate(i);
  if (set == nullptr || set->bound_reason(k).empty()) return {};
  for (std::size_t n = 0; n < values.size() && n < set->value_size(k); ++n) {
    if (!(values[n] > set->max(k, n))) continue;
    std::array<char, 32> most{};
    std::snprintf(most.data(), most.size(), "%.3g", set->max(k, n));
    const std::string which = set->value_size(k) > 1 ? " of joint" + std::to_string(n + 1) : "";
    return "'" + set->spec(k).name + "'" + which + " must be at most " + most.data() +
           (set->spec(k).unit.empty() ? "" : " " + set->spec(k).unit) + " here: " + set->bound_reason(k);
  }
  return {};
}
void Instance::set_parameter(std::size_t i, std::span<const double> values, bool active) {
  const auto [set, k] = locate(i);
  if (active) {
    set->set(k, values);
  } else {
    set->set_now(k, values);
  }
}

std::size_t Instance::find_feature(std::string_view type) const {
  const auto it = std::find_if(features_.begin(), features_.end(),
                               [&](const auto& f) { return f.descriptor.type == type; });
  return static_cast<std::size_t>(it - features_.begin());
}
std::size_t Instance::find_input(std::string_view name) const {
  const auto it =
      std::find_if(inputs_.begin(), inputs_.end(), [&](const auto& r) { return r.spec().name == name; });
  return static_cast<std::size_t>(it - inputs_.begin());
}

std::vector<OutputSpec> Instance::output_specs() const {
  std::vector<OutputSpec> specs = descriptor_.outputs;
  for (const auto& slot : features_) {
    for (OutputSpec output : slot.descriptor.outputs) {
      output.name = slot.descriptor.type + "." + output.name;
      specs.push_back(std::move(output));
    }
  }
  return specs;
}

ControlContext Instance::context(const Tick& tick) {
  return {dt_,           tick.t.seconds(), law_arms_,
          inputs_,       &parameters_,     std::span(outputs_).first(law_output_count_),
          scene_arms_,   contact_,         stopped_,
          observed_arms_};
}

ControlContext Instance::feature_context(FeatureSlot& slot, const Tick& tick) {
  return {dt_,         tick.t.seconds(), feature_arms_,
          {},          &slot.parameters, std::span(outputs_).subspan(slot.output_offset, slot.output_count),
          scene_arms_, contact_};
}

LawResult Instance::start(const Tick& tick) try {
  served_ = {};
  dt_ = kArmPeriod;
  last_tick_ = tick.t + -kArmPeriodNs;
  parameters_.finish();
  for (std::size_t i = 0; i < law_arms_.size(); ++i) X_FE_[i] = law_arms_[i].state->frames.X_FE;
  ControlContext law = context(tick);
  controllet_->start_references(law);
  if (controllet_->start(law) != LawResult::ok) return LawResult::fault;
  for (std::size_t i = 0; i < features_.size(); ++i) {
    FeatureSlot& slot = features_[i];
    slot.parameters.finish();
    slot.fade = 0;
    if (!feature_on(i)) continue;
    ControlContext with = feature_context(slot, tick);
    if (slot.feature->start(with) != LawResult::ok) return LawResult::fault;
  }
  return LawResult::ok;
} catch (...) {
  return LawResult::fault;
}

// Arms that stand on others, and those that carry them, are for laws that say so: a pose
// that a law keeps in coordinates of a base would be wrong. A law whose carrier is lost does not know where
// its arm is: the carrier counts as observed, except by a hold, which needs no more than its own joints.
void Instance::see_bases(const ArmBlocks& blocks) {
  const ArmSet involved = arms_ | observed_;
  for (ArmIndex arm = 0; arm < blocks.mounts.size(); ++arm) {
    if (!blocks.mounts[arm]) continue;
    bases_move_ = true;
    const BaseMount& mount = *blocks.mounts[arm];
    if (!descriptor_.moving_base && (involved.contains(arm) || involved.contains(mount.carrier))) {
      refuse(name_, "'" + descriptor_.type + "' is not for an arm that stands on another one, nor for one " +
                        "that carries an arm; see docs/carried_arms.md for the types that are");
    }
    const bool needs_carrier = involved.contains(arm) && !arms_.contains(mount.carrier);
    if (needs_carrier && descriptor_.type != "hold") observed_ |= ArmSet::of(mount.carrier);
    if (arms_.contains(arm)) mounted_ |= ArmSet::of(arm);
    for (std::size_t i = 0; i < arm_list_.size(); ++i) {
      if (arm_list_[i] != mount.carrier) continue;
      law_arms_[i].carried = &blocks.terms[arm];
      law_arms_[i].carried_joint = mount.joint;
    }
  }
}

std::string_view Instance::feature_refusal(std::size_t i) const {
  if (bases_move_ && !features_[i].descriptor.moving_base)
    return "an arm of this scene stands on another one; this feature knows no base that moves; "
           "remove it";
  const Feature& feature = *features_[i].feature;
  const std::string_view why = feature.refusal();
  if (!why.empty() || descriptor_.type != "hold" || feature.start_condition().empty()) return why;
  return "a hold starts wherever the arm is, and this feature does not (near a hull around a base); remove "
         "it "
         "from the hold";
}

void Instance::switch_feature(std::size_t i, bool on) {
  const std::uint32_t bits = features_on_.load(std::memory_order_relaxed), mask = 1u << i;
  features_on_.store(on ? bits | mask : bits & ~mask, std::memory_order_relaxed);
}

LawResult Instance::set_feature(std::size_t i, bool on, bool active, const Tick& tick) try {
  FeatureSlot& slot = features_[i];
  if (on && !feature_refusal(i).empty()) return LawResult::fault;
  if (active && on && !feature_on(i)) {
    slot.parameters.finish();
    slot.fade = 0;
    ControlContext with = feature_context(slot, tick);
    if (slot.feature->start(with) != LawResult::ok) return LawResult::fault;
  }
  switch_feature(i, on);
  if (!on)
    std::fill_n(outputs_.begin() + static_cast<std::ptrdiff_t>(slot.output_offset), slot.output_count, 0.0);
  return LawResult::ok;
} catch (...) {
  return LawResult::fault;
}

bool Instance::begins_tick(ArmSet due, const Tick& tick) {
  const ArmSet mine = due & arms_;
  if (mine.empty()) return false;
  const bool begins =
      served_.empty() || served_.overlaps(mine) || seconds(tick.t - last_tick_) > 0.5 * tick.period;
  served_ = begins ? mine : served_ | mine;
  return begins;
}

// An end effector that was redefined is elsewhere, while the arm has not moved.
void Instance::carry_set_points(const Tick& tick) {
  for (std::size_t i = 0; i < law_arms_.size(); ++i) {
    const Pose& X_FE = law_arms_[i].state->frames.X_FE;
    if (X_FE.position == X_FE_[i].position && X_FE.rotation == X_FE_[i].rotation) continue;
    ControlContext law = context(tick);
    controllet_->end_effector_moved(law, i, X_FE_[i].inverse() * X_FE);
    X_FE_[i] = X_FE;
  }
}

// The arm's own hand shares the bound with what sweeps its base. The hand of an arm that stands on this one
// has the same bound.
void Instance::bound_joint_speed(Reference& input) {
  const OwnedArm& arm = law_arms_[input.spec().arm];
  ModelTerms& terms = *arm.terms;
  double greatest = contact_.hand_speed;
  if (mounted_.contains(arm_list_[input.spec().arm])) {
    const Vector6 swept = terms.V_WE().vector - Vector6(terms.J_V_WE().lazyProduct(terms.dq()));
    greatest = std::max(0.0, greatest - swept.head<3>().norm());
  }
  input.bound_hand_speed(greatest, terms.J_V_WE());
  if (arm.carried == nullptr) return;
  Jacobian J = Jacobian::Zero(6, terms.J_V_WE().cols());
  terms.point_jacobian(arm.carried_joint, arm.carried->X_WE().position, J.topRows<3>());
  input.bound_carried_speed(J);
}

Intervention Instance::update(const Tick& tick) try {
  // After missed cycles the references go on from where they were, rather than catch up in one step.
  constexpr double kLongestTick = 5;  // periods
  dt_ = std::clamp(seconds(tick.t - last_tick_), 1e-6, kLongestTick * tick.period);
  last_tick_ = tick.t;
  parameters_.advance(dt_);
  carry_set_points(tick);
  for (auto& input : inputs_) {
    if (input.spec().quantity == Quantity::joints && std::isfinite(contact_.hand_speed))
      bound_joint_speed(input);
    input.advance(dt_, tick.t.seconds());
    if (input.stale()) return Intervention::reference_stale;
  }
  // Resize: a law may have left a vector of another size.
  for (auto& arm : law_arms_) arm.tau->setZero(static_cast<Eigen::Index>(arm.model().joint_count()));
  ControlContext law = context(tick);
  return controllet_->update(law) == LawResult::ok ? Intervention::none : Intervention::controllet_fault;
} catch (...) {
  return Intervention::controllet_threw;
}

// A feature that finds its arm within reach of an obstacle or a limit when it starts would begin with a step.
LawResult Instance::update_faded(FeatureSlot& slot, ControlContext& context) {
  slot.fade = std::min(1.0, slot.fade + dt_ / ParameterSet::kRamp);
  std::array<JointVector, kMaxArms> before;
  for (std::size_t a = 0; a < feature_arms_.size(); ++a) before[a] = *feature_arms_[a].tau;
  const LawResult result = slot.feature->update(context);
  for (std::size_t a = 0; a < feature_arms_.size(); ++a) {
    JointVector& tau = *feature_arms_[a].tau;
    if (tau.size() == before[a].size())
      tau = before[a] + slot.fade * (tau - before[a]);  // others are refused
  }
  return result;
}

Intervention Instance::update_features(const Tick& tick) try {
  for (auto& arm : feature_arms_) arm.tau->setZero(static_cast<Eigen::Index>(arm.model().joint_count()));
  for (std::size_t i = 0; i < features_.size(); ++i) {
    FeatureSlot& slot = features_[i];
    if (!feature_on(i)) continue;
    slot.parameters.advance(dt_);
    ControlContext with = feature_context(slot, tick);
    const bool fades = slot.fade < 1;
    if ((fades ? update_faded(slot, with) : slot.feature->update(with)) != LawResult::ok) {
      return Intervention::controllet_fault;
    }
  }
  return Intervention::none;
} catch (...) {
  return Intervention::controllet_threw;
}

}  // namespace multipanda
