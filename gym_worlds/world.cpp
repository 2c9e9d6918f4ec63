#include "gym_worlds/world.hpp"

#include <algorithm>
#include <stdexcept>

#include "device/arm_error.hpp"
#include "scene/build.hpp"
#include "scene/hidden_plant.hpp"

namespace multipanda {

void LearningWorld::reset(std::uint64_t seed, bool hidden, const double* q_start, const double* object_poses,
                          const std::vector<std::string>& objects, const std::vector<std::string>& active) {
  Scene scene = scene_;
  scene.seed = seed;
  for (auto& arm : scene.arms) {
    for (auto& angle : arm.q_start) angle = *q_start++;
  }
  for (std::size_t k = 0; k < objects.size(); ++k) {
    const double* pose = object_poses + k * kObjectNumbers;
    for (auto& object : scene.objects) {
      if (object.name != objects[k]) continue;
      object.X_WO.position = Vector3(pose[0], pose[1], pose[2]);
      object.X_WO.rotation =
          Eigen::Quaterniond(pose[3], pose[4], pose[5], pose[6]).normalized().toRotationMatrix();
    }
  }
  if (hidden) hide(scene, seed);
  cycle_.reset();
  answers_.clear();
  backend_ = std::make_unique<MujocoBackend>(scene, MujocoOptions{.pace = Pace::unpaced, .meshes = {}});
  CycleConfig config = build_cycle_config(scene, 0);
  terms_.clear();
  for (const auto& arm : config.arms) terms_.emplace_back(arm.model);
  cycle_ = std::make_unique<ControlCycle>(config, registry_, *backend_);
  InstanceSet start = 0;
  for (const auto& name : active) {
    const InstanceIndex i = cycle_->modes().find(name);
    if (i == kNoInstance) throw std::invalid_argument("no controllet '" + name + "'");
    start |= bit(i);
  }
  cycle_->modes().activate_at_start(start);
  waiting_.clear();
  sent_.clear();
  grippers_.clear();
  refusal_.clear();
  backend_->start();
  step(1);
}

void LearningWorld::target(const std::string& controllet, const std::string& input, const double* values,
                           std::size_t count) {
  const InstanceIndex index = cycle_->modes().find(controllet);
  if (index == kNoInstance) throw std::invalid_argument("no controllet '" + controllet + "'");
  auto& instance = cycle_->modes().instance(index);
  const auto& inputs = instance.descriptor().inputs;
  std::size_t k = 0;
  while (k < inputs.size() && inputs[k].name != input) ++k;
  if (k == inputs.size()) throw std::invalid_argument(controllet + " has no input '" + input + "'");
  Target target;
  target.delivery = Delivery::stream;
  target.size = static_cast<std::uint8_t>(count);
  std::copy(values, values + count, target.values.begin());
  // As a client's stream: directly to the input, which uses it at the next cycle.
  const bool active = (cycle_->modes().active() & bit(index)) != 0;
  Verdict verdict = active ? instance.inputs()[k].check(target) : Verdict::not_active;
  if (verdict == Verdict::accepted) verdict = instance.inputs()[k].post(target);
  if (verdict != Verdict::accepted) refusal_ = "refused: " + std::string(to_string(verdict));
}

void LearningWorld::parameter(const std::string& controllet, const std::string& name, const double* values,
                              std::size_t count) {
  Request request;
  request.kind = Request::Kind::set_parameter;
  request.instance = cycle_->modes().find(controllet);
  if (request.instance == kNoInstance) throw std::invalid_argument("no controllet '" + controllet + "'");
  auto& instance = cycle_->modes().instance(request.instance);
  const std::size_t k = instance.find_parameter(name);
  if (k == instance.parameter_count())
    throw std::invalid_argument(controllet + " has no parameter '" + name + "'");
  std::vector<double> all(values, values + count);
  auto& sent = sent_[{request.instance, k}];
  if (sent == all) return;
  sent = all;
  if (count == 1) all.assign(instance.parameter_size(k), values[0]);
  request.index = static_cast<std::uint16_t>(k);
  request.size = static_cast<std::uint8_t>(all.size());
  std::copy(all.begin(), all.end(), request.values.begin());
  add(request);
}

void LearningWorld::add(Request request) { waiting_.push_back(request); }

void LearningWorld::gripper(std::size_t arm, double width, double force) {
  auto& sent = grippers_[arm];
  if (sent == std::pair(width, force)) return;
  sent = {width, force};
  if (force > 0)
    answers_.push_back(backend_->request(arm, GripperRequest(GripperGrasp{.width = width, .force = force})));
  else
    answers_.push_back(backend_->request(arm, GripperRequest(GripperMove{.width = width})));
}

void LearningWorld::user_stop(std::size_t arm) {
  answers_.push_back(backend_->request(arm, ArmRequest(SetUserStop{.pressed = true})));
}

void LearningWorld::step(std::size_t cycles) {
  std::uint64_t ticket = 0;
  if (!waiting_.empty()) {
    const Verdict verdict = cycle_->modes().post(waiting_, ticket, 1e6);
    if (verdict != Verdict::accepted) refusal_ = std::string("refused: ") + std::string(to_string(verdict));
  }
  for (std::size_t k = 0; k < cycles; ++k) {
    const ArmSet due = backend_->wait();
    if (due.empty() && backend_->ended()) {
      refusal_ = "the simulation failed: " + backend_->fault();
      break;
    }
    cycle_->step(due);
    if (k == 0 && ticket != 0) {
      Answer answer;
      for (std::uint64_t one = ticket - waiting_.size() + 1; one <= ticket; ++one) {
        if (cycle_->modes().poll(one, answer) && !answer.accepted())
          refusal_ = std::string("refused: ") + std::string(to_string(answer.verdict));
      }
    }
  }
  waiting_.clear();
}

void LearningWorld::write_state(double* arms, double* objects, const std::vector<std::string>& names) const {
  const CycleData& data = cycle_->data();
  for (std::size_t i = 0; i < data.state.size(); ++i, arms += kArmNumbers) {
    const ArmState& state = data.state[i];
    const auto n = static_cast<std::size_t>(state.q.size());
    std::copy(state.q.data(), state.q.data() + n, arms);
    std::copy(state.dq.data(), state.dq.data() + n, arms + 7);
    terms_[i].update(state);
    const Pose& X = terms_[i].X_WE();
    const Eigen::Quaterniond q(X.rotation);
    const double pose[] = {X.position.x(), X.position.y(), X.position.z(), q.w(), q.x(), q.y(), q.z()};
    std::copy(pose, pose + 7, arms + 14);
    for (Eigen::Index k = 0; k < 3; ++k) {
      arms[21 + k] = state.F_K_W_est.force()[k];
      arms[24 + k] = state.F_K_W_est.torque()[k];
      arms[27 + k] = state.F_K_W_true.force()[k];
      arms[30 + k] = state.F_K_W_true.torque()[k];
    }
    arms[33] = state.gripper.width;
    arms[34] = state.gripper.grasped ? 1 : 0;
  }
  for (const auto& name : names) {
    const auto pose = backend_->object_pose(name);
    if (!pose) throw std::invalid_argument("no free object '" + name + "'");
    const Eigen::Quaterniond q(pose->rotation);
    const double numbers[] = {
        pose->position.x(), pose->position.y(), pose->position.z(), q.w(), q.x(), q.y(), q.z()};
    objects = std::copy(numbers, numbers + 7, objects);
  }
}

bool LearningWorld::stopped() const {
  if (!refusal_.empty()) return true;
  for (std::size_t i = 0; i < cycle_->data().state.size(); ++i) {
    if (cycle_->modes().owner(i) == static_cast<InstanceIndex>(i)) return true;
  }
  return false;
}

std::string LearningWorld::reason() const {
  std::string text = refusal_;
  for (std::size_t i = 0; i < cycle_->data().state.size(); ++i) {
    if (cycle_->modes().owner(i) != static_cast<InstanceIndex>(i)) continue;
    const ArmState& state = cycle_->data().state[i];
    text += (text.empty() ? "arm '" : "; arm '") + scene_.arms[i].name + "' is held";
    if (state.mode == ArmMode::reflex) text += ", reflex";
    if (state.mode == ArmMode::user_stopped) text += ", user stop";
    if (state.errors != 0) text += ": " + error_names(state.errors);
    for (std::size_t rule = 1; rule < static_cast<std::size_t>(Intervention::count_); ++rule) {
      const auto code = static_cast<Intervention>(rule);
      if (code == Intervention::torque_clamped || code == Intervention::torque_rate_clamped) continue;
      if (cycle_->safety().counted(i, code) > 0) text += ", " + std::string(to_string(code));
    }
  }
  return text;
}

}  // namespace multipanda
