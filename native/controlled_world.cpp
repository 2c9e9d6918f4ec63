#include "native/controlled_world.hpp"

#include <algorithm>
#include <array>
#include <chrono>

#include "device/arm_error.hpp"
#include "runtime/request_text.hpp"
#include "scene/build.hpp"
#include "scene/hidden_plant.hpp"
#include "support/spelling.hpp"

namespace multipanda {
namespace {

// Nobody else waits for this loop: a request may be taken much later by the clock of the computer.
constexpr double kNoPatienceNeeded = 1e6;  // [s]

void expect_size(const std::string& what, std::size_t found, std::size_t expected) {
  if (found == expected) return;
  throw std::invalid_argument(what + ": expected " + std::to_string(expected) + " numbers, found " +
                              std::to_string(found));
}

Pose pose_of(const std::string& what, const std::vector<double>& v) {
  expect_size(what, v.size(), StateRow::kPose);
  const Eigen::Quaterniond q(v[3], v[4], v[5], v[6]);
  if (!(std::abs(q.norm() - 1) < 1e-2))
    throw std::invalid_argument(what +
                                ": expected x y z and a unit quaternion w x y z, found one of length " +
                                std::to_string(q.norm()));
  Pose X;
  X.position = Vector3(v[0], v[1], v[2]);
  X.rotation = q.normalized().toRotationMatrix();
  return X;
}

// How long the answer to a motion that has ended may take to be handed over.
constexpr std::chrono::milliseconds kHandOver{100};

std::string text_of(const WorldCommand& command) { return command.what + " " + joined(command.names); }

}  // namespace

// --- begin ---

void ControlledWorld::reset(const WorldStart& start) {
  build(start);
  start_ = start;
  commands_.clear();
  waiting_.clear();
  ticket_ = 0;
  asked_.clear();
  grippers_.clear();
  gripper_answers_.clear();
  refusal_.clear();
  cycles_ = 0;
  backend_->start();
  step(1);
}

void ControlledWorld::build(const WorldStart& start) {
  Scene scene = scene_;
  scene.seed = start.seed;
  for (const auto& [name, q] : start.q_start) {
    const auto found = std::ranges::find(scene.arms, name, &SceneArm::name);
    if (found == scene.arms.end()) throw std::invalid_argument("q_start: there is no arm '" + name + "'");
    expect_size("q_start of arm '" + name + "'", q.size(), static_cast<std::size_t>(found->q_start.size()));
    std::ranges::copy(q, found->q_start.begin());
  }
  for (const auto& [name, values] : start.objects) {
    const auto found = std::ranges::find(scene.objects, name, &SceneObject::name);
    if (found == scene.objects.end() || found->fixed)
      throw std::invalid_argument("objects: there is no free object '" + name + "'");
    found->X_WO = pose_of("object '" + name + "'", values);
  }
  if (start.active) scene.timeline.clear();
  if (start.hidden) hide(scene, start.seed);
  cycle_.reset();
  backend_ = std::make_unique<MujocoBackend>(scene, MujocoOptions{.pace = Pace::unpaced, .meshes = {}});
  const CycleConfig config = build_cycle_config(scene, 0);
  std::vector<std::shared_ptr<const ArmModel>> models;
  terms_.clear();
  for (const auto& arm : config.arms) {
    models.push_back(arm.model);
    terms_.emplace_back(arm.model);
  }
  cycle_ = std::make_unique<ControlCycle>(config, registry_, *backend_);
  auto& modes = cycle_->modes();
  reach_ = std::make_unique<Reach>(models);
  for (ArmIndex i = 0; i < models.size(); ++i)
    reach_->set_end_effector(i, arm_config(scene.arms[i]).frames.X_FE);
  auto timeline = build_schedule(scene, modes);
  reach_->check(timeline, modes);
  modes.schedule(std::move(timeline));
  InstanceSet active = 0;
  if (start.active) {
    for (const auto& name : *start.active) active |= bit(instance(name));
  } else {
    active = start_set(scene, modes);
  }
  modes.activate_at_start(active);
}

// --- commands ---

void ControlledWorld::command(std::string what, std::vector<std::string> names, std::vector<double> values) {
  if (!cycle_) throw std::invalid_argument("expected reset() before the first command");
  WorldCommand one{
      .cycle = cycles_, .what = std::move(what), .names = std::move(names), .values = std::move(values)};
  execute(one);
  commands_.push_back(std::move(one));
}

void ControlledWorld::execute(const WorldCommand& command) {
  const auto& [cycle, what, names, values] = command;
  const auto arms = [&] {
    ArmSet set;
    for (const auto& name : names) set |= ArmSet::of(arm(name));
    return set;
  };
  if (what == "target" || what == "goal") return execute_target(command);
  if (what == "parameter") return execute_parameter(command);
  if (what == "switch") return execute_switch(command);
  if (what == "feature") return execute_feature(command);
  if (what.starts_with("gripper")) return execute_gripper(command);
  if (what == "stop") return cycle_->modes().stop(arms());
  if (what == "resume") return post({.kind = Request::Kind::resume, .arms = arms()});
  if (names.size() != 1) throw std::invalid_argument(what + ": expected one name");
  if (what == "user_stop") {
    expect_size(what, values.size(), 1);
    return ask(text_of(command),
               backend_->request(arm(names[0]), ArmRequest(SetUserStop{.pressed = values[0] != 0})));
  }
  if (what == "recover")
    return ask(text_of(command), backend_->request(arm(names[0]), ArmRequest(RecoverFromError{})));
  if (what == "place") {
    const PlaceObject request{.object = names[0], .X_WO = pose_of(text_of(command), values)};
    return ask(text_of(command), backend_->request(WorldRequest(request)));
  }
  if (what == "push") {
    expect_size(text_of(command), values.size(), 4);
    const PushObject request{
        .object = names[0], .f_W = Vector3(values[0], values[1], values[2]), .duration = values[3]};
    return ask(text_of(command), backend_->request(WorldRequest(request)));
  }
  throw std::invalid_argument("there is no command '" + what + "'");
}

void ControlledWorld::execute_target(const WorldCommand& command) {
  auto& modes = cycle_->modes();
  if (command.names.size() != 2)
    throw std::invalid_argument(command.what + ": expected a controllet and an input");
  const InstanceIndex index = instance(command.names[0]);
  Instance& receiver = modes.instance(index);
  const std::size_t k = receiver.find_input(command.names[1]);
  if (k == receiver.inputs().size()) {
    std::vector<std::string> valid;
    for (const auto& input : receiver.inputs()) valid.push_back(input.spec().name);
    throw std::invalid_argument("'" + receiver.name() + "' has no input '" + command.names[1] + "'" +
                                name_hint(command.names[1], valid, "it has none"));
  }
  Reference& input = receiver.inputs()[k];
  const bool goal = command.what == "goal";
  const auto values = std::span(command.values).subspan(goal && !command.values.empty() ? 1 : 0);
  expect_size(text_of(command), values.size(), input.size());
  if (const std::string why = reach_->refusal(receiver, input.spec(), values); !why.empty())
    throw CommandRefused(text_of(command) + ": " + why);
  Request request{.kind = Request::Kind::set_target};
  request.instance = index;
  request.index = static_cast<std::uint16_t>(k);
  Target& target = request.target;
  target.delivery = goal ? Delivery::goal : Delivery::stream;
  target.size = static_cast<std::uint8_t>(values.size());
  std::ranges::copy(values, target.values.begin());
  if (goal) {
    target.duration_s = command.values[0];
    return post(request);
  }
  // As a client's stream: directly to the input, which uses it in the next cycle.
  const bool active = (modes.active() & bit(index)) != 0;
  Verdict verdict = active ? input.check(target) : Verdict::not_active;
  if (verdict == Verdict::accepted) verdict = input.post(target);
  if (verdict != Verdict::accepted)
    throw CommandRefused(text_of(command) + ": " + reason(modes, request, verdict));
}

void ControlledWorld::execute_parameter(const WorldCommand& command) {
  if (command.names.size() != 2) throw std::invalid_argument("parameter: expected a controllet and a name");
  Request request{.kind = Request::Kind::set_parameter};
  request.instance = instance(command.names[0]);
  const Instance& receiver = cycle_->modes().instance(request.instance);
  const std::size_t k = receiver.find_parameter(command.names[1]);
  if (k == receiver.parameter_count())
    throw std::invalid_argument(no_such_parameter(receiver, command.names[1]));
  std::vector<double> values = command.values;
  if (values.size() == 1) values.assign(receiver.parameter_size(k), values[0]);
  expect_size(text_of(command), values.size(), receiver.parameter_size(k));
  request.index = static_cast<std::uint16_t>(k);
  request.size = static_cast<std::uint8_t>(values.size());
  std::ranges::copy(values, request.values.begin());
  // The last one of several values for one cycle counts.
  std::erase_if(waiting_, [&](const Request& other) {
    return other.kind == request.kind && other.instance == request.instance && other.index == request.index;
  });
  if (receiver.parameter(k) != values) post(request);
}

void ControlledWorld::execute_switch(const WorldCommand& command) {
  Request request{.kind = Request::Kind::switch_controllets};
  for (const auto& name : command.names) {
    if (name == "!")
      request.only = true;
    else if (name.starts_with("-"))
      request.deactivate |= bit(instance(name.substr(1)));
    else
      request.activate |= bit(instance(name));
  }
  post(request);
}

void ControlledWorld::execute_feature(const WorldCommand& command) {
  if (command.names.size() != 2) throw std::invalid_argument("feature: expected a controllet and a feature");
  expect_size(text_of(command), command.values.size(), 1);
  Request request{.kind = Request::Kind::set_feature};
  request.instance = instance(command.names[0]);
  const Instance& receiver = cycle_->modes().instance(request.instance);
  const std::size_t k = receiver.find_feature(command.names[1]);
  if (k == receiver.feature_count()) throw std::invalid_argument(no_such_feature(receiver, command.names[1]));
  request.index = static_cast<std::uint16_t>(k);
  request.on = command.values[0] != 0;
  post(request);
}

void ControlledWorld::execute_gripper(const WorldCommand& command) {
  const auto& [cycle, what, names, values] = command;
  if (names.size() != 1) throw std::invalid_argument(what + ": expected one arm");
  const ArmIndex index = arm(names[0]);
  GripperRequest request;
  std::string why;
  if (what == "gripper_grasp") {
    expect_size(text_of(command), values.size(), 4);
    const GripperGrasp grasp{.width = values[0],
                             .speed = values[1],
                             .force = values[2],
                             .tolerance_inner = values[3],
                             .tolerance_outer = values[3]};
    why = check(grasp);
    request = grasp;
  } else if (what == "gripper_move") {
    expect_size(text_of(command), values.size(), 2);
    const GripperMove move{.width = values[0], .speed = values[1]};
    why = check(move);
    request = move;
  } else if (what == "gripper_homing") {
    request = GripperHoming{};
  } else {
    throw std::invalid_argument("there is no command '" + what + "'");
  }
  if (why.empty() && !backend_->capabilities(index).has_gripper)
    why = "the arm has no gripper that moves: in a scene, write 'fingers: movable'";
  if (!why.empty()) throw CommandRefused(text_of(command) + ": " + why);
  gripper_answers_[index].clear();
  grippers_[index] = backend_->request(index, request);  // a new motion ends the one before
}

void ControlledWorld::post(const Request& request) {
  if (const Verdict verdict = cycle_->modes().check(request); verdict != Verdict::accepted)
    throw CommandRefused(reason(cycle_->modes(), request, verdict));
  waiting_.push_back(request);
}

void ControlledWorld::ask(const std::string& what, std::future<RequestAnswer> answer) {
  asked_.push_back({.what = what, .answer = std::move(answer)});
}

// --- steps ---

void ControlledWorld::step(std::uint64_t cycles) {
  if (!cycle_) throw std::invalid_argument("expected reset() before the first step");
  post_waiting();
  for (std::uint64_t k = 0; k < cycles; ++k) {
    const ArmSet due = backend_->wait();
    if (due.empty() && backend_->ended())
      throw std::runtime_error("the simulation failed: " + backend_->fault());
    cycle_->step(due);
    ++cycles_;
    if (k == 0) read_answers();
  }
}

void ControlledWorld::post_waiting() {
  posted_ = waiting_.size();
  if (waiting_.empty()) return;
  const Verdict verdict = cycle_->modes().post(waiting_, ticket_, kNoPatienceNeeded);
  if (verdict != Verdict::accepted) {
    refuse(std::to_string(posted_) + " requests of one cycle: " + std::string(to_string(verdict)));
    posted_ = 0;
  }
}

// What was asked before the cycle that has just been done.
void ControlledWorld::read_answers() {
  auto& modes = cycle_->modes();
  for (std::size_t k = 0; k < posted_; ++k) {
    Answer answer;
    if (modes.poll(ticket_ - posted_ + 1 + k, answer) && !answer.accepted())
      refuse(reason(modes, waiting_[k], answer.verdict));
  }
  waiting_.clear();
  posted_ = 0;
  // The backend has decided in that cycle; a thread of its own hands the answers over.
  for (auto& one : asked_) {
    if (const RequestAnswer answer = one.answer.get(); !answer.success)
      refuse(one.what + ": " + answer.reason);
  }
  asked_.clear();
}

void ControlledWorld::refuse(const std::string& what) {
  refusal_ += (refusal_.empty() ? "refused: " : "; ") + what;
}

// --- what there is to see ---

void ControlledWorld::write_state(double* row) const {
  const CycleData& data = cycle_->data();
  for (std::size_t i = 0; i < data.state.size(); ++i)
    layout_.write_arm(i, data.state[i], terms_[i], held(i), row);
  for (std::size_t k = 0; k < layout_.objects().size(); ++k) {
    if (const auto pose = backend_->object_pose(layout_.objects()[k].name))
      layout_.write_object(k, *pose, row);
  }
}

std::string ControlledWorld::held() const {
  std::string text;
  for (std::size_t i = 0; i < cycle_->data().state.size(); ++i) {
    if (!held(i)) continue;
    const ArmState& state = cycle_->data().state[i];
    text += (text.empty() ? "arm '" : "; arm '") + cycle_->modes().arm_name(i) + "' is held";
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

std::string ControlledWorld::gripper_answer(const std::string& name) {
  const ArmIndex index = arm(name);
  const auto motion = grippers_.find(index);
  if (motion == grippers_.end() || !motion->second.valid()) return gripper_answers_[index];
  const bool moving = cycle_->data().state[index].gripper.moving;
  const auto patience = moving ? std::chrono::milliseconds(0) : kHandOver;
  if (motion->second.wait_for(patience) == std::future_status::ready) {
    const RequestAnswer answer = motion->second.get();
    gripper_answers_[index] = answer.success ? "done" : answer.reason;
  }
  return gripper_answers_[index];
}

std::vector<std::string> ControlledWorld::active() const {
  return names_of(cycle_->modes(), cycle_->modes().active());
}

// --- save and restore ---

SavedWorld ControlledWorld::save() const {
  if (!cycle_) throw std::invalid_argument("expected reset() before save()");
  SavedWorld saved{.scene = scene_.text,
                   .start = start_,
                   .commands = commands_,
                   .cycles = cycles_,
                   .state = {},
                   .refusal = refusal_};
  saved.state.resize(layout_.size());
  write_state(saved.state.data());
  return saved;
}

void ControlledWorld::restore(const SavedWorld& saved) {
  if (saved.scene != scene_.text)
    throw std::invalid_argument("the saved world is of another scene: expected the text of '" + scene_.name +
                                "'");
  reset(saved.start);
  const auto run_to = [&](std::uint64_t cycle) {
    if (cycle < cycles_ || cycle > saved.cycles)
      throw std::invalid_argument("the saved world's commands are not in order");
    if (cycle > cycles_) step(cycle - cycles_);
  };
  for (const auto& one : saved.commands) {
    run_to(one.cycle);
    command(one.what, one.names, one.values);
  }
  run_to(saved.cycles);
  std::vector<double> state(layout_.size());
  write_state(state.data());
  if (state != saved.state)
    throw std::invalid_argument(
        "the saved world was computed with other bits: expected the same program, model files, libraries and "
        "kind of "
        "processor; save it here");
  refusal_ = saved.refusal;
}

// --- names ---

InstanceIndex ControlledWorld::instance(const std::string& name) const {
  const InstanceIndex index = cycle_->modes().find(name);
  if (index == kNoInstance) throw std::invalid_argument(no_such_controllet(cycle_->modes(), name));
  return index;
}

ArmIndex ControlledWorld::arm(const std::string& name) const {
  for (ArmIndex i = 0; i < cycle_->modes().arm_count(); ++i) {
    if (cycle_->modes().arm_name(i) == name) return i;
  }
  throw std::invalid_argument(no_such_arm(cycle_->modes(), name));
}

}  // namespace multipanda
