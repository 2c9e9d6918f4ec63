#include "core/modes/instance.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
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

using Models = std::vector<std::shared_ptr<const ArmModel>>;

Models models_of(const ArmBlocks& blocks, std::span<const ArmIndex> arms,
                 std::span<const ArmIndex> observed) {
  Models models;
  for (const auto& list : {arms, observed}) {
    for (const ArmIndex arm : list) models.push_back(blocks.terms[arm].shared_model());
  }
  return models;
}

Models models_of_scene(const ArmBlocks& blocks) {
  Models models;
  for (const ModelTerms& terms : blocks.terms) models.push_back(terms.shared_model());
  return models;
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
  const Models models = models_of(blocks, arm_list_, observed_list_), all_models = models_of_scene(blocks);
  for (const ArmIndex arm : arm_list_) {
    if (arms_.contains(arm)) refuse(name_, "the same arm is listed twice");
    arms_ |= ArmSet::of(arm);
    law_arms_.push_back({&blocks.states[arm], &blocks.terms[arm], &blocks.tau_controllet[arm]});
    feature_arms_.push_back({&blocks.states[arm], &blocks.terms[arm], &blocks.tau_feature[arm]});
  }
  for (const ArmIndex arm : observed_list_) {
    if (arms_.contains(arm)) refuse(name_, "it observes an arm that it owns");
    if (observed_.contains(arm)) refuse(name_, "the same observed arm is listed twice");
    observed_ |= ArmSet::of(arm);
    observed_arms_.push_back({&blocks.states[arm], &blocks.terms[arm], nullptr});
  }
  see_bases(blocks);
  for (ArmIndex arm = 0; arm < blocks.states.size(); ++arm) {
    JointVector* of_controllet = arms_.contains(arm) ? &blocks.tau_controllet[arm] : nullptr;
    scene_arms_.push_back({&blocks.states[arm], &blocks.terms[arm], of_controllet});
  }
  const FeatureContext context{all_models, arm_list_, blocks.obstacles, blocks.friction_compensated};
  for (const auto& model : models) model->least_inertia();  // looked up once, not in the loop
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
    const ArmModel& model = *models[input.arm];
    inputs_.emplace_back(std::move(input), model.joint_count(), model.joint_range());
    goals_.push_back({.until = {}, .goal = {}, .arms = std::vector<WatchedGoal::Start>(arm_list_.size())});
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
  for (std::size_t i = 0; i < parameter_count(); ++i) {
    const std::vector<double> values = parameter(i);
    configured_.insert(configured_.end(), values.begin(), values.end());
  }
  configured_features_ = features_on_;
}

void Instance::renew(const Registry& registry, const ArmBlocks& blocks) {
  if (!used_) return;
  used_ = stopped_ = false;
  const Models models = models_of(blocks, arm_list_, observed_list_), all_models = models_of_scene(blocks);
  const FeatureContext context{all_models, arm_list_, blocks.obstacles, blocks.friction_compensated};
  controllet_ = registry.controllet(descriptor_.type)->create(models);
  for (Reference& input : inputs_) {
    const ArmModel& model = *models[input.spec().arm];
    input = Reference(input.spec(), model.joint_count(), model.joint_range());
  }
  for (std::size_t i = 0; i < features_.size(); ++i) {
    FeatureSlot& slot = features_[i];
    if (slot.used) slot.feature = registry.features()[i].create(context);
    slot.used = false;
    slot.fade = 0;
  }
  std::size_t first = 0;
  for (std::size_t i = 0; i < parameter_count(); first += parameter_size(i++)) {
    const auto [set, k] = locate(i);
    set->set_now(k, std::span(configured_).subspan(first, parameter_size(i)));
  }
  features_on_ = configured_features_;
  std::ranges::fill(outputs_, 0.0);
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
  used_ = true;
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

bool Instance::watch_goal(std::size_t input, const Target& goal, const GoalEnd& until) {
  const auto feels = [](const OwnedArm& arm) { return arm.state->has_wrench_estimate; };
  if (until.feels() && !std::ranges::all_of(law_arms_, feels)) return false;
  WatchedGoal& watched = goals_[input];
  watched.until = until;
  if (!until.set()) return true;
  watched.goal = goal.values;
  for (std::size_t i = 0; i < law_arms_.size(); ++i)
    watched.arms[i] = {law_arms_[i].state->F_K_W_est, law_arms_[i].terms->X_WE().position};
  return true;
}

// The set-point rests at the goal: what happens from now on does not end it.
bool Instance::there(const WatchedGoal& watched, const Reference& input) const {
  constexpr double kNear = 1e-9;  // [m], [rad]
  const auto& goal = watched.goal;
  if (input.spec().quantity == Quantity::joints) {
    const Eigen::Map<const Eigen::VectorXd> q(goal.data(), input.joints().size());
    return (q - input.joints()).lpNorm<Eigen::Infinity>() < kNear;
  }
  const Pose X = Pose::from({goal[0], goal[1], goal[2]}, Quaternion(goal[3], goal[4], goal[5], goal[6]));
  return pose_error(X, input.pose()).norm() < kNear;
}

bool Instance::has_ended(const WatchedGoal& watched, EndedGoal& ended) const {
  for (std::size_t i = 0; i < law_arms_.size(); ++i) {
    const ArmState& state = *law_arms_[i].state;
    const Wrench& before = watched.arms[i].F_K_W;
    double force = (state.F_K_W_est.force() - before.force()).norm();
    double moment = (state.F_K_W_est.torque() - before.torque()).norm();
    if (!state.has_wrench_estimate) force = moment = std::numeric_limits<double>::quiet_NaN();
    const std::array measured{force, moment,
                              (law_arms_[i].terms->X_WE().position - watched.arms[i].p_WE).norm()};
    for (std::size_t cause = 0; cause < GoalEnd::count_; ++cause) {
      const double limit = watched.until.limits[cause];
      if (!(limit < GoalEnd::kNever) || measured[cause] < limit) continue;
      ended.arm = i;
      ended.cause = static_cast<GoalEnd::Cause>(cause);
      ended.measured = measured[cause];
      ended.limit = limit;
      return true;
    }
  }
  return false;
}

bool Instance::end_goal(EndedGoal& ended) {
  constexpr double kBraking = 0.05;  // braking distance of the set-point over its velocity [s]
  for (std::size_t k = 0; k < inputs_.size(); ++k) {
    WatchedGoal& watched = goals_[k];
    if (!watched.until.set()) continue;
    Reference& input = inputs_[k];
    if (input.streaming() || there(watched, input)) watched.until = {};
    if (!watched.until.set() || !has_ended(watched, ended)) continue;
    ended.input = k;
    watched.until = {};
    Target rest;
    if (input.spec().quantity == Quantity::joints) {
      const JointVector q = input.joints() + kBraking * input.joint_velocity();
      rest.set({q.data(), static_cast<std::size_t>(q.size())});
    } else {
      Pose X = input.pose();
      X.position += kBraking * input.twist().linear();
      X.rotation = exp_rotation(kBraking * input.twist().angular()) * X.rotation;
      rest = pose_target(X);
    }
    input.set(rest);
    return true;
  }
  return false;
}

LawResult Instance::start(const Tick& tick) try {
  used_ = true;
  for (WatchedGoal& goal : goals_) goal.until = {};
  served_ = {};
  dt_ = kArmPeriod;
  last_tick_ = tick.t + -kArmPeriodNs;
  still_share_ = stopped_ ? 1 : 0;
  lets_go_ = 0;
  still_tau_.setZero(static_cast<Eigen::Index>(law_arms_[0].model().joint_count()));
  parameters_.finish();
  for (std::size_t i = 0; i < law_arms_.size(); ++i) X_FE_[i] = law_arms_[i].state->frames.X_FE;
  ControlContext law = context(tick);
  controllet_->start_references(law);
  if (controllet_->start(law) != LawResult::ok) return LawResult::fault;
  for (std::size_t i = 0; i < features_.size(); ++i) {
    FeatureSlot& slot = features_[i];
    slot.parameters.finish();
    slot.fade = 0;
    if (!feature_on(i)) {
      clear_outputs(slot);
      continue;
    }
    ControlContext with = feature_context(slot, tick);
    slot.used = true;
    if (slot.feature->start(with) != LawResult::ok) return LawResult::fault;
  }
  return LawResult::ok;
} catch (...) {
  return LawResult::fault;
}

// Carried arms and their carriers need laws that declare support for them: a pose that a law keeps in
// coordinates of a base would be wrong. A law whose carrier is lost does not know where its arm is, and a
// carrier sweeps its carried arm, which a stop must leave in place: each counts as observed by the laws of
// the other, except by a hold, which needs only its own joints.
void Instance::see_bases(const ArmBlocks& blocks) {
  const ArmSet involved = arms_ | observed_;
  for (ArmIndex arm = 0; arm < blocks.mounts.size(); ++arm) {
    if (!blocks.mounts[arm]) continue;
    bases_move_ = true;
    const BaseMount& mount = *blocks.mounts[arm];
    if (!descriptor_.moving_base && (involved.contains(arm) || involved.contains(mount.carrier))) {
      refuse(name_, "'" + descriptor_.type + "' is not for an arm that stands on another one, nor for one " +
                        "that carries an arm; see docs/models.md for the types that are");
    }
    if (descriptor_.type != "hold") {
      if (involved.contains(arm)) observed_ |= ArmSet::of(mount.carrier) - arms_;
      if (arms_.contains(mount.carrier)) observed_ |= ArmSet::of(arm) - arms_;
    }
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
    return "an arm of this scene stands on another one; this feature does not support a moving base; remove "
           "it";
  const Feature& feature = *features_[i].feature;
  const std::string_view why = feature.refusal();
  if (!why.empty() || descriptor_.type != "hold" || feature.start_condition().empty()) return why;
  return "a hold must be able to start anywhere, and this feature cannot start near a hull around a base; "
         "remove it from the hold";
}

void Instance::switch_feature(std::size_t i, bool on) {
  const std::uint32_t bits = features_on_.load(std::memory_order_relaxed), mask = 1u << i;
  features_on_.store(on ? bits | mask : bits & ~mask, std::memory_order_relaxed);
}

LawResult Instance::set_feature(std::size_t i, bool on, bool active, const Tick& tick) try {
  used_ = true;
  FeatureSlot& slot = features_[i];
  if (on && !feature_refusal(i).empty()) return LawResult::fault;
  if (active && on && !feature_on(i)) {
    if (slot.fade == 0) slot.parameters.finish();
    ControlContext with = feature_context(slot, tick);
    slot.used = true;
    if (slot.feature->start(with) != LawResult::ok) return LawResult::fault;
  }
  switch_feature(i, on);
  if (!on && !active) clear_outputs(slot);
  return LawResult::ok;
} catch (...) {
  return LawResult::fault;
}

void Instance::clear_outputs(FeatureSlot& slot) {
  slot.fade = 0;
  std::fill_n(outputs_.begin() + static_cast<std::ptrdiff_t>(slot.output_offset), slot.output_count, 0.0);
}

bool Instance::begins_tick(ArmSet due, const Tick& tick) {
  const ArmSet mine = due & arms_;
  if (mine.empty()) return false;
  const bool begins =
      served_.empty() || served_.overlaps(mine) || seconds(tick.t - last_tick_) > 0.5 * tick.period;
  served_ = begins ? mine : served_ | mine;
  return begins;
}

// A redefined end effector is elsewhere, although the arm has not moved.
void Instance::carry_set_points(const Tick& tick) {
  for (std::size_t i = 0; i < law_arms_.size(); ++i) {
    const Pose& X_FE = law_arms_[i].state->frames.X_FE;
    if (X_FE.position == X_FE_[i].position && X_FE.rotation == X_FE_[i].rotation) continue;
    ControlContext law = context(tick);
    controllet_->end_effector_moved(law, i, X_FE_[i].inverse() * X_FE);
    X_FE_[i] = X_FE;
  }
}

// The arm's own hand shares the bound with the motion of its base. The hand of a carried arm has the
// same bound.
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

// Flange and tool have the same bound as the end effector, wherever that is: they are as hard.
void Instance::bound_points(Reference& input) {
  const InputSpec& spec = input.spec();
  double farthest = 0;
  Reference::Points points;
  std::size_t count = 0;
  for (std::size_t i = 0; i < law_arms_.size(); ++i) {
    ModelTerms& terms = *law_arms_[i].terms;
    for (const Vector3& p : terms.points_from_hand()) {
      farthest = std::max(farthest, p.norm());
      if ((i != spec.arm && !spec.common) || count == points.size()) continue;
      points[count++] = spec.quantity == Quantity::pose ? Vector3(terms.X_WE().rotation.transpose() * p) : p;
    }
  }
  input.bound_points(contact_.hand_speed, std::span(points).first(count), farthest);
}

Intervention Instance::update(const Tick& tick) try {
  // After missed cycles the references continue from their last value, without catching up in one step.
  constexpr double kLongestTick = 5;  // periods
  dt_ = std::clamp(seconds(tick.t - last_tick_), 1e-6, kLongestTick * tick.period);
  last_tick_ = tick.t;
  parameters_.advance(dt_);
  carry_set_points(tick);
  for (auto& input : inputs_) {
    const Quantity quantity = input.spec().quantity;
    if (std::isfinite(contact_.hand_speed) && (quantity == Quantity::joints || quantity == Quantity::pose)) {
      bound_points(input);
      if (quantity == Quantity::joints) bound_joint_speed(input);
    }
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

namespace {

// What is let go is damped, the more the faster it is, until kSettles later: springs that a feature had bent
// far may snap back. What features drive is not.
constexpr double kReleaseBrake = 20, kSettles = 1, kDrives = 0.05;  // [1/s] times the inertia, [s]

// The pace, up to 1, at which a feature lets go of arms that it pressed, since the springs of the law pull
// them back: the slower, the faster they already move. The speeds are those at which a set-point returns
// after a raised stiffness (core/controllets/raised_spring.hpp).
double letting_go(std::span<OwnedArm> arms, const ContactBounds& contact) {
  constexpr double kShare = 0.4, kTurning = 0.5, kSlowest = 0.05;  // of its speed, [rad/s], of the pace
  if (!std::isfinite(contact.hand_speed)) return 1;
  double fastest = 0;
  for (const OwnedArm& arm : arms) {
    fastest = std::max({fastest, arm.terms->V_WE().linear().norm() / (kShare * contact.hand_speed),
                        arm.dq().lpNorm<Eigen::Infinity>() / kTurning});
  }
  return std::max(kSlowest, 1 - fastest);
}

}  // namespace

// A feature whose arm is already within range of an obstacle or limit would start with a step, and one that
// holds its arm back would end with one.
LawResult Instance::update_faded(FeatureSlot& slot, ControlContext& context, double goal) {
  const double step = dt_ / ParameterSet::kRamp;
  slot.fade = std::clamp(goal, slot.fade - letting_go(law_arms_, contact_) * step, slot.fade + step);
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

Intervention Instance::run_features(const Tick& tick) {
  const bool press =
      std::ranges::any_of(feature_arms_, [](const OwnedArm& arm) { return !arm.tau->isZero(0); });
  const bool yields = std::ranges::any_of(feature_arms_, [](const OwnedArm& arm) {
    return arm.tau->size() == arm.dq().size() && arm.tau->dot(arm.dq()) < 0;
  });
  const double pace = press ? letting_go(law_arms_, contact_) : 1;
  for (auto& arm : feature_arms_) arm.tau->setZero(static_cast<Eigen::Index>(arm.model().joint_count()));
  lets_go_ = std::max(0.0, lets_go_ - dt_ / (yields ? kSettles : kDrives));
  for (std::size_t i = 0; i < features_.size(); ++i) {
    FeatureSlot& slot = features_[i];
    const bool on = feature_on(i);
    if (!on && slot.fade == 0) continue;
    const std::uint64_t version = slot.parameters.version();
    slot.parameters.advance(pace * dt_);
    if (yields && (!on || slot.parameters.version() != version)) lets_go_ = 1;
    ControlContext with = feature_context(slot, tick);
    const double goal = on ? 1 : 0;
    const LawResult result = slot.fade != goal ? update_faded(slot, with, goal) : slot.feature->update(with);
    if (!on && (slot.fade == 0 || result != LawResult::ok)) clear_outputs(slot);
    if (on && result != LawResult::ok) return Intervention::controllet_fault;
  }
  for (OwnedArm& arm : feature_arms_) {
    if (lets_go_ > 0 && pace < 1 && arm.tau->size() == arm.dq().size())
      *arm.tau -= lets_go_ * (1 - pace) * kReleaseBrake * arm.terms->M().lazyProduct(arm.dq());
  }
  return Intervention::none;
}

// A hold has one arm. Keeps the torque of its features at rest, where only potentials act, as far as the
// spring opposes it: the rest would move the arm.
void Instance::keep_still(const Tick& tick) {
  OwnedArm &law = law_arms_[0], &feature = feature_arms_[0], &shown = scene_arms_[arm_list_[0]];
  const ArmState* measured = law.state;
  const auto show = [&](const ArmState* state) { law.state = feature.state = shown.state = state; };
  const JointVector held = *law.tau;
  at_rest_ = *measured;
  at_rest_.dq.setZero();
  show(&at_rest_);
  bool known = false;
  try {
    ControlContext with = context(tick);
    known = controllet_->update(with) == LawResult::ok && run_features(tick) == Intervention::none &&
            feature.tau->size() == held.size();
  } catch (...) {  // a feature, which throws again where that is reported
    known = false;
  }
  show(measured);
  const JointVector carried = law.terms->c() - *law.tau;
  *law.tau = held;
  still_tau_ *= still_share_;
  if (known) still_tau_ += *feature.tau;
  still_tau_ = still_tau_.cwiseMax(carried.cwiseMin(0)).cwiseMin(carried.cwiseMax(0)).eval();
  if (!still_tau_.allFinite()) still_tau_.setZero();
  still_share_ = 1;
}

// While its arm is stopped, the features of a hold only compute their outputs. Afterwards they fade in, and
// their torque at the stop fades out.
Intervention Instance::update_features(const Tick& tick) try {
  if (stopped_ && still_share_ < 1) keep_still(tick);
  const Intervention found = run_features(tick);
  if (still_share_ == 0) return found;
  JointVector& tau = *feature_arms_[0].tau;
  if (stopped_) {
    tau.setZero(still_tau_.size());
    for (FeatureSlot& slot : features_) slot.fade = 0;
  } else {
    still_share_ = std::max(0.0, still_share_ - dt_ / ParameterSet::kRamp);
  }
  if (tau.size() == still_tau_.size()) tau += still_share_ * still_tau_;
  return stopped_ ? Intervention::none : found;
} catch (...) {
  return Intervention::controllet_threw;
}

}  // namespace multipanda
