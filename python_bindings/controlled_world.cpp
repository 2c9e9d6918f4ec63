#include "python_bindings/controlled_world.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>

#include "arm_interface/arm_error.hpp"
#include "runtime/live_input/backend_requests.hpp"
#include "runtime/live_input/request_handler.hpp"
#include "runtime/request_text.hpp"
#include "scene/hidden_plant.hpp"

namespace multipanda {

namespace {

// The caller steps this loop: by the computer's clock a request may be taken much later.
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

// How long the delivery of the answer to a finished motion may take.
constexpr std::chrono::milliseconds kHandOver{100};

// The subject of the request: "'left_cartesian', input 'pose'".
std::string about(const nlohmann::json& request) {
  std::string text;
  for (const char* key : {"controllet", "input", "name", "arm", "object"}) {
    if (!request.contains(key)) continue;
    const bool first = text.empty();
    text += (first ? "'" : std::string(", ") + key + " '") + request[key].get<std::string>() + "'";
  }
  return text.empty() ? request.at("do").get<std::string>() : text;
}

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
  moving_.clear();
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
  std::optional<WorldParts> hidden;
  if (start.hidden) {
    hide(scene, start.seed);
    hidden.emplace(scene);
  }
  const WorldParts& parts = hidden ? *hidden : parts_;
  std::unique_ptr<ControlCycle> spent = std::move(cycle_);
  if (hidden || start_.hidden) spent.reset();  // they have models of their own
  backend_ = std::make_unique<MujocoBackend>(scene, MujocoOptions{.pace = Pace::unpaced}, parts.plant);
  CycleConfig config = parts.cycle;
  config.obstacles = fixed_obstacles(scene);  // the timeline may have been left out
  std::vector<std::shared_ptr<const ArmModel>> models;
  terms_.clear();
  for (const auto& arm : config.arms) {
    models.push_back(arm.model);
    terms_.emplace_back(arm.model);
  }
  cycle_ = std::make_unique<ControlCycle>(config, registry_, *backend_, std::move(spent));
  auto& modes = cycle_->modes();
  handler_ = std::make_unique<RequestHandler>(LiveInputContext{
      .scene = scene.name, .modes = &modes, .backend = backend_.get(), .models = models, .rotations = {}});
  for (std::size_t i = 0; i < scene.arms.size(); ++i)  // as known, so that no model file is read again
    scene.arms[i].X_FE = parts.plant.arms[i].behavior.frames.X_FE;
  modes.schedule(build_schedule(scene, modes));
  InstanceSet active = 0;
  if (start.active) {
    for (const auto& name : *start.active) {
      const InstanceIndex index = modes.find(name);
      if (index == kNoInstance) throw std::invalid_argument(no_such_controllet(modes, name));
      active |= bit(index);
    }
  } else {
    active = start_set(scene, modes);
  }
  modes.activate_at_start(active);
}

// --- commands ---

void ControlledWorld::command(nlohmann::json request) {
  if (!cycle_) throw std::invalid_argument("expected reset() before the first command");
  try {
    execute(request);
  } catch (const RequestRefused& refused) {
    const bool wrong = refused.code == "malformed" || refused.code == name_of(Verdict::wrong_size) ||
                       refused.code.starts_with("unknown_");
    if (wrong) throw std::invalid_argument(refused.what());
    throw;
  }
  commands_.push_back({.cycle = cycles_, .request = std::move(request)});
}

void ControlledWorld::execute(const nlohmann::json& request) {
  const std::string word = JsonFields(request, "request").text("do");
  const JsonFields fields(request, word);
  if (word == "stop") return cycle_->modes().stop(handler_->arms_in(fields));
  if (const auto asked = handler_->read(word, fields)) return take(*asked, request);
  BackendRequest of_backend = read_backend_request(word, fields, {"do"});
  if (auto* of_world = std::get_if<WorldRequest>(&of_backend))
    return ask(request, backend_->request(std::move(*of_world)));
  const ArmIndex arm = handler_->arm(fields.text("arm"));
  if (auto* of_arm = std::get_if<ArmRequest>(&of_backend))
    return ask(request, request_arm(cycle_->modes(), *backend_, arm, std::move(*of_arm)));
  if (!backend_->capabilities(arm).has_gripper)
    refuse_now(request, "arm_refused",
               "the arm has no gripper that moves: in a scene, write 'fingers: movable'");
  gripper_answers_[arm].clear();
  const auto& asked = std::get<GripperRequest>(of_backend);
  const ArmState& now = cycle_->data().state[arm];
  const auto mode = static_cast<std::uint8_t>(now.mode);
  if (!gripper_stops(cycle_->modes(), arm, mode) && ending_of(asked, now.gripper.grasped))
    moving_[arm] = asked;
  grippers_[arm] = request_arm(cycle_->modes(), *backend_, arm, asked, mode);
}

void ControlledWorld::take(const Request& asked, const nlohmann::json& request) {
  auto& modes = cycle_->modes();
  const bool stream = asked.target.delivery == Delivery::stream;
  const Verdict verdict = stream ? modes.post_sample(asked) : modes.check(asked);
  if (verdict != Verdict::accepted) refuse_now(request, name_of(verdict), reason(modes, asked, verdict));
  if (stream) return;
  if (asked.kind == Request::Kind::set_parameter) {
    // The last one of several values for one cycle counts.
    std::erase_if(waiting_, [&](const Request& other) {
      return other.kind == asked.kind && other.instance == asked.instance && other.index == asked.index;
    });
    const auto now = modes.instance(asked.instance).parameter(asked.index);
    if (std::ranges::equal(now, std::span(asked.values).first(asked.size))) return;
  }
  waiting_.push_back(asked);
}

void ControlledWorld::refuse_now(const nlohmann::json& request, std::string_view code,
                                 const std::string& why) {
  throw RequestRefused(std::string(code), about(request) + ": " + why);
}

void ControlledWorld::ask(const nlohmann::json& request, std::future<RequestAnswer> answer) {
  asked_.push_back({.what = about(request), .answer = std::move(answer)});
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
    end_grippers();
  }
}

// A stop of an arm ends its gripper's motion. Only what the loop sees decides: a restored world agrees.
void ControlledWorld::end_grippers() {
  for (auto& [arm, moving] : moving_) {
    const ArmState& now = cycle_->data().state[arm];
    if (!moving || !gripper_stops(cycle_->modes(), arm, static_cast<std::uint8_t>(now.mode))) continue;
    const auto ending = ending_of(*moving, now.gripper.grasped);
    if (ending && !now.gripper.moving && !std::holds_alternative<GripperFollow>(*ending)) continue;
    if (ending) (void)backend_->request(arm, *ending);
    moving.reset();
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

// Requests from before the cycle that has just ended.
void ControlledWorld::read_answers() {
  auto& modes = cycle_->modes();
  for (std::size_t k = 0; k < posted_; ++k) {
    Answer answer;
    if (modes.poll(ticket_ - posted_ + 1 + k, answer) && !answer.accepted())
      refuse(reason(modes, waiting_[k], answer.verdict));
  }
  waiting_.clear();
  posted_ = 0;
  // The backend has decided in that cycle; a separate thread delivers the answers.
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
  for (std::size_t i = 0; i < terms_.size(); ++i) {
    ArmSample sample;
    cycle_->take_sample(i, sample);
    terms_[i].update(cycle_->data().state[i]);
    layout_.write_arm(i, sample, terms_[i].X_WE(), held(i), row);
  }
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
  const ArmIndex index = handler_->arm(name);
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
    command(one.request);
  }
  run_to(saved.cycles);
  std::vector<double> state(layout_.size());
  write_state(state.data());
  const auto same = [](double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); };
  if (!std::ranges::equal(state, saved.state, same))
    throw std::invalid_argument(
        "the saved world differs in its last bits: expected the same program, model files, libraries and "
        "kind of "
        "processor; save it here");
  refusal_ = saved.refusal;
}

namespace {

using Json = nlohmann::json;

constexpr const char* kFormat = "multipanda world 2";

}  // namespace

std::vector<std::uint8_t> SavedWorld::pack() const {
  Json told = Json::array();
  for (const auto& one : commands) told.push_back({one.cycle, one.request});
  const Json all{{"format", kFormat},
                 {"scene", scene},
                 {"seed", start.seed},
                 {"hidden", start.hidden},
                 {"q_start", start.q_start},
                 {"objects", start.objects},
                 {"active", start.active ? Json(*start.active) : Json()},
                 {"commands", told},
                 {"cycles", cycles},
                 {"state", state},
                 {"refusal", refusal}};
  return Json::to_cbor(all);
}

SavedWorld SavedWorld::unpack(const std::uint8_t* bytes, std::size_t size) {
  try {
    const Json all = Json::from_cbor(bytes, bytes + size);
    if (all.at("format") != kFormat) throw std::invalid_argument(all.at("format").get<std::string>());
    SavedWorld saved;
    all.at("scene").get_to(saved.scene);
    all.at("seed").get_to(saved.start.seed);
    all.at("hidden").get_to(saved.start.hidden);
    all.at("q_start").get_to(saved.start.q_start);
    all.at("objects").get_to(saved.start.objects);
    if (const Json& active = all.at("active"); !active.is_null())
      saved.start.active = active.get<std::vector<std::string>>();
    for (const auto& one : all.at("commands")) saved.commands.push_back({one.at(0), one.at(1)});
    all.at("cycles").get_to(saved.cycles);
    all.at("state").get_to(saved.state);
    all.at("refusal").get_to(saved.refusal);
    return saved;
  } catch (const std::exception& error) {
    throw std::invalid_argument(std::string("expected what save() returned (") + kFormat +
                                "), found other bytes: " + error.what());
  }
}

StateRow::StateRow(const Scene& scene) {
  for (const auto& arm : scene.arms) {
    const auto joints = static_cast<std::size_t>(arm.q_start.size());
    FieldList list(8 * size_);
    visit_sample(list, ArmSample{}, joints);
    list.add("X_WE", 'f', kPose);
    list.add("gripper", 'f', 3);
    list.add("held", 'f', 1);
    arms_.push_back({.name = arm.name, .joints = joints, .first = size_, .fields = std::move(list.fields())});
    size_ = list.offset() / 8;
  }
  for (const auto& object : scene.objects) {
    if (object.fixed) continue;
    objects_.push_back({.name = object.name, .first = size_});
    size_ += kPose;
  }
}

void StateRow::write_arm(std::size_t arm, const ArmSample& sample, const Pose& X_WE, bool held,
                         double* row) const {
  NumberWriter to(row + arms_[arm].first);
  visit_sample(to, sample, arms_[arm].joints);
  to.many("X_WE", std::span<const double>(X_WE.values()), true);
  const std::array<double, 3> gripper{sample.gripper_width, sample.gripper_grasped ? 1.0 : 0.0,
                                      sample.gripper_moving ? 1.0 : 0.0};
  to.many("gripper", std::span<const double>(gripper), true);
  to.one("held", held, true);
}

void StateRow::write_object(std::size_t object, const Pose& X_WO, double* row) const {
  std::ranges::copy(X_WO.values(), row + objects_[object].first);
}

}  // namespace multipanda
