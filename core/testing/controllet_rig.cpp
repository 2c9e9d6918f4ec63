#include "core/testing/controllet_rig.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include <Eigen/Cholesky>

#include "core/controllets/prismatic_parameters.hpp"

namespace multipanda::test {

ControlletRig::ControlletRig(const ControlletType& type, const Models& models) {
  build(type.descriptor, models);
  controllet_ = type.create(models);
  controllet_->bound_parameters(*parameters_);
}
ControlletRig::ControlletRig(const FeatureType& type, const Models& models, std::vector<Obstacle> obstacles,
                             std::vector<ArmIndex> own)
    : obstacles_(std::move(obstacles)) {
  build(type.descriptor, models);
  if (own.empty()) {
    for (ArmIndex arm = 0; arm < models.size(); ++arm) own.push_back(arm);
  }
  std::vector<OwnedArm> owned;
  for (const ArmIndex arm : own) owned.push_back(arms_[arm]);
  arms_ = owned;
  feature_ = type.create(FeatureContext{models, own, obstacles_, {}});
  feature_->bound_parameters(*parameters_);
}

void ControlletRig::build(const ControlletDescriptor& descriptor, const Models& models) {
  descriptor_ = descriptor;
  parameters_ =
      std::make_unique<ParameterSet>(specs_for(descriptor.parameters, *models[0]), models[0]->joint_count());
  bound_revolute_joints(descriptor.parameters, *models[0], *parameters_);
  for (const auto& input : descriptor.inputs) inputs_.emplace_back(input, models[input.arm]->joint_count());
  std::size_t outputs = 0;
  for (const auto& output : descriptor.outputs) outputs += output.size;
  outputs_.assign(outputs, 0);
  states_.resize(models.size());
  for (std::size_t i = 0; i < models.size(); ++i) {
    terms_.emplace_back(models[i]);
    plant_.emplace_back(models[i]);
    tau_.push_back(joint_constant(models[i]->joint_count(), 0));
  }
  for (std::size_t i = 0; i < models.size(); ++i) {
    arms_.push_back({&states_[i], &terms_[i], &tau_[i]});
    scene_arms_.push_back({&states_[i], &terms_[i], nullptr});
    if (i + descriptor.observes >= models.size()) {
      observed_.push_back(scene_arms_.back());
      arms_.pop_back();
    }
    place(i, bent(models[i]->joint_count()), tau_[i]);
  }
}

void ControlletRig::place(std::size_t arm, const JointVector& q, const JointVector& dq) {
  states_[arm].q = q;
  states_[arm].dq = dq;
  terms_[arm].update(states_[arm]);
}
void ControlletRig::frames(std::size_t arm, const ArmFrames& frames) {
  states_[arm].frames = frames;
  ++states_[arm].config_version;
}

void ControlletRig::redefine(std::size_t arm, const Pose& X) {
  ArmFrames redefined = states_[arm].frames;
  redefined.X_FE = redefined.X_FE * X;
  frames(arm, redefined);
  place(arm, states_[arm].q, states_[arm].dq);
  if (arm >= arms_.size()) return;  // only observed
  ControlContext now = context(0.001);
  controllet_->end_effector_moved(now, arm, X);
}

void ControlletRig::set(std::string_view parameter, std::vector<double> values) {
  const std::size_t i = parameters_->find(parameter);
  if (i == parameters_->size()) throw std::invalid_argument("no parameter " + std::string(parameter));
  if (values.size() == 1) values.resize(parameters_->value_size(i), values[0]);
  if (parameters_->check(i, values) != Verdict::accepted) throw std::invalid_argument("refused value");
  parameters_->set_now(i, values);
}
void ControlletRig::approach(std::string_view parameter, std::vector<double> values) {
  parameters_->set(parameters_->find(parameter), values);
}

void ControlletRig::bound(const ContactBounds& contact) {
  contact_ = contact;
  for (auto& input : inputs_) {
    if (input.spec().quantity == Quantity::pose)
      input.limit_speed(std::min(input.spec().max_speed, contact.hand_speed));
  }
}

Reference& ControlletRig::input(std::string_view name) {
  for (auto& input : inputs_) {
    if (input.spec().name == name) return input;
  }
  throw std::invalid_argument("no input " + std::string(name));
}
std::vector<double> ControlletRig::output(std::string_view name) const {
  auto at = outputs_.begin();
  for (const auto& spec : descriptor_.outputs) {
    const auto end = at + static_cast<std::ptrdiff_t>(spec.size);
    if (spec.name == name) return {at, end};
    at = end;
  }
  throw std::invalid_argument("no output " + std::string(name));
}

ControlContext ControlletRig::context(double dt) {
  return {dt, time_s_, arms_, inputs_, parameters_.get(), outputs_, scene_arms_, contact_, false, observed_};
}

LawResult ControlletRig::start() {
  ControlContext now = context(0.001);
  if (feature_) return feature_->start(now);
  controllet_->start_references(now);
  return controllet_->start(now);
}
LawResult ControlletRig::update() {
  for (auto& tau : tau_) tau.setZero();
  ControlContext now = context(1e-9);
  return feature_ ? feature_->update(now) : controllet_->update(now);
}
LawResult ControlletRig::tick(double dt) {
  time_s_ += dt;
  parameters_->advance(dt);
  for (auto& input : inputs_) input.advance(dt, time_s_);
  for (auto& tau : tau_) tau.setZero();
  ControlContext now = context(dt);
  return feature_ ? feature_->update(now) : controllet_->update(now);
}

void ControlletRig::integrate(double dt, const std::vector<JointVector>& tau_ext, int substeps) {
  const double h = dt / substeps;
  for (std::size_t i = 0; i < states_.size(); ++i) {
    JointVector q = states_[i].q, dq = states_[i].dq;
    for (int k = 0; k < substeps; ++k) {
      plant_[i].update(q, dq);
      const JointVector drive = tau_[i] + tau_ext[i] - plant_[i].c();
      dq += h * Eigen::LLT<JointMatrix>(plant_[i].M()).solve(drive);
      q += h * dq;
    }
    place(i, q, dq);
  }
}
double ControlletRig::kinetic_energy(std::size_t arm) {
  const JointVector& dq = states_[arm].dq;
  return 0.5 * dq.dot(terms_[arm].M() * dq);
}

JointVector bent(std::size_t joints) {
  JointVector q = joint_constant(joints, 0);
  for (Eigen::Index i = 0; i < q.size(); ++i) q[i] = (i % 2 == 0 ? 0.3 : -0.9) + 0.1 * static_cast<double>(i);
  return q;
}

}  // namespace multipanda::test
