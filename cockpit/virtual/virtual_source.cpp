#include "cockpit/virtual/virtual_source.hpp"

#include <cmath>

#include "arm_interface/arm_error.hpp"
#include "cockpit/view/scene_bodies.hpp"
#include "common/text.hpp"
#include "core/cycle/sample_state.hpp"
#include "core/record/arm_config.hpp"
#include "core/state/arm_state.hpp"
#include "fci/server/virtual_arms.hpp"
#include "runtime/live_input/backend_requests.hpp"
#include "scene/build.hpp"

namespace multipanda::cockpit {

namespace {

using nlohmann::json;

constexpr double kPausedAfter = 0.25;  // time after which the world counts as paused [s]

const std::vector<std::string> kWorldCommands = {"list",        "state",     "histogram", "stop",
                                                 "resume",      "user_stop", "recover",   "place_object",
                                                 "push_object", "reset",     "fault"};

std::vector<std::shared_ptr<const ArmModel>> models_of(const Scene& scene) {
  std::vector<std::shared_ptr<const ArmModel>> models;
  for (const SceneArm& arm : scene.arms) models.push_back(build_controller_model(arm));
  return models;
}

std::vector<ArmFrames> frames_of(const Scene& scene) {
  std::vector<ArmFrames> frames;
  for (const SceneArm& arm : scene.arms) frames.push_back(arm_config(arm).frames);
  return frames;
}

}  // namespace

VirtualSource::VirtualSource(const Scene& scene, fci::VirtualArms& arms, WorldFeed& feed)
    : scene_(scene),
      arms_(arms),
      feed_(feed),
      models_(models_of(scene)),
      shared_(scene.name, feed.layout(), models_, frames_of(scene)),
      run_events_(feed.layout()),
      records_(shared_.memory().file()),
      state_view_(scene, models_, records_.fields()),
      more_(models_.size(), {.frames = {}, .tracking_error = std::nan(""), .torque_use = std::nan("")}) {
  const auto frames = frames_of(scene);
  for (std::size_t i = 0; i < more_.size(); ++i) more_[i].frames = frames[i];
}

json VirtualSource::hello() {
  json arms = describe_arms(scene_);
  for (ArmIndex i = 0; i < arms.size(); ++i)
    arms[i].update({{"kind", "virtual"}, {"gripper", false}, {"vacuum", false}});
  std::string places;
  for (ArmIndex i = 0; i < arms_.arm_count(); ++i)
    places += (i == 0 ? "" : ", ") + arms_.names()[i] + " at " + arms_.place(i).address;
  return {{"version", MULTIPANDA_VERSION},
          {"kind", "run"},
          {"scene",
           {{"name", scene_.name},
            {"description", scene_.description},
            {"backend", "virtual arms: " + places},
            {"simulated", true},
            {"duration_s", 0},
            {"arms", arms},
            {"bodies", state_view_.bodies()}}},
          {"list", list()},
          {"state_fields", state_view_.fields()},
          {"record_fields", records_.field_list()},
          {"names", records_.names()},
          {"commands", commands()},
          {"logs", json::array()}};
}

void VirtualSource::update(HostTime now) {
  RecordRing& ring = feed_.ring();
  while (const CycleRecord* record = ring.ring.front()) {
    for (const Event* event = ring.events.front(); event != nullptr && event->cycle <= record->cycle;
         event = ring.events.front()) {
      shared_.take(*event);
      for (const RunEvent& seen : run_events_.take(*event)) shared_.take(seen);
      ring.events.pop();
    }
    shared_.take(*record, ArmSet());
    for (const RunEvent& seen : run_events_.take(*record, {})) shared_.take(seen);
    newest_ = *record;
    ring.ring.pop();
  }
  shared_.count_lost(ring.dropped_records.exchange(0), ring.dropped_events.exchange(0));
  records_.update(now);
}

std::span<const double> VirtualSource::state(HostTime now) {
  if (records_.newest().empty()) return {};
  const WorldFeed::Frames& frames = feed_.frames();
  for (std::size_t i = 0; i < more_.size(); ++i) more_[i].frames = frames[i];
  poses_.clear();
  for (std::size_t i = 0; i < feed_.objects().count(); ++i) poses_.push_back(feed_.objects().read(i));
  return state_view_.compute(records_.newest(), records_.since_s(now), more_, poses_);
}

json VirtualSource::slow_state() {
  const double since = records_.since_s(host_now());
  json arms = json::array();
  for (ArmIndex i = 0; i < newest_.arms.size(); ++i) {
    const ArmSample& sample = newest_.arms[i];
    const fci::PortStatistics port = arms_.statistics(i);
    json arm = state_of(sample, feed_.layout().arms[i].joint_count);
    arm.update({{"arm", arms_.names()[i]},
                {"controllet", "program"},
                {"stopped", static_cast<ArmMode>(sample.mode) == ArmMode::user_stopped},
                {"cures", cures_of(sample.errors)},
                {"last_intervention", ""},
                {"tracking_unit", ""},
                {"connection",
                 {{"received", port.commands_received},
                  {"lost", port.commands_lost},
                  {"late", port.commands_late},
                  {"commands_missed", port.commands_missed},
                  {"command_success_rate", sample.command_success_rate}}}});
    arms.push_back(std::move(arm));
  }
  return {{"scene", scene_.name},
          {"cycle", newest_.cycle},
          {"t_s", newest_.t.seconds()},
          {"since_cycle_s", since},
          {"paused", since > kPausedAfter},
          {"cycle_times_us", records_.cycle_times_us()},
          {"overruns", arms_.world_statistics().overruns},
          {"arms", arms}};
}

json VirtualSource::list() { return {{"version", MULTIPANDA_VERSION}, {"controllets", json::array()}}; }

// --- requests ---

std::vector<std::string> VirtualSource::commands() const { return kWorldCommands; }

bool VirtualSource::is_open(const std::string& command) const {
  return command == "list" || command == "state" || command == "histogram" || command == "stop";
}

std::variant<Reply, Later> VirtualSource::ask(const json& request, HostTime /*arrived*/) {
  const std::string word = request.at("do").get<std::string>();
  const JsonFields fields(request, word);
  if (word == "stop" || word == "resume") return press_stops(request, word == "stop");
  if (word == "list" || word == "state" || word == "histogram") {
    fields.allow({"id", "do"});
    json answer = word == "histogram" ? records_.histogram() : word == "list" ? list() : json();
    if (word == "state") answer["state"] = slow_state();
    answer["ok"] = true;
    return Reply{.answer = std::move(answer), .numbers = {}};
  }
  if (word == "fault") {
    fields.allow({"id", "do", "line"});
    const std::string said = fci::control(arms_, fields.text("line"));
    const bool done = said == "ok" || said.starts_with("words:");
    return Reply{.answer = {{"ok", done}, {"reason", said}}, .numbers = {}};
  }
  return when_all(begin(word, request), {{"ok", true}});
}

// The stop buttons of the arms.
std::variant<Reply, Later> VirtualSource::press_stops(const json& request, bool pressed) {
  const json received = host_now().ns;
  const JsonFields fields(request, pressed ? "stop" : "resume");
  ArmSet chosen = ArmSet::all(arms_.arm_count());
  json done = {{"ok", true}};
  try {
    fields.allow({"id", "do", "arms"});
    ArmSet named;
    for (const auto& name : fields.texts("arms"))
      named |= name == "all" ? chosen : ArmSet::of(arm_named(name));
    if (fields.has("arms") && !(pressed && named.empty())) chosen = named;
  } catch (const RequestRefused& wrong) {
    if (!pressed) throw;
    done["message"] = std::string(wrong.what()) + ": all arms are stopped";
  }
  Answers answers;
  for (ArmIndex arm = 0; arm < arms_.arm_count(); ++arm) {
    if (chosen.contains(arm)) answers.push_back(arms_.request(arm, SetUserStop{pressed}));
  }
  if (pressed) done["received_ns"] = received;
  return when_all(std::move(answers), std::move(done));
}

VirtualSource::Answers VirtualSource::begin(const std::string& word, const json& request) {
  const JsonFields fields(request, word);
  BackendRequest read = read_backend_request(word, fields, {"id", "do"});
  Answers answers;
  if (auto* of_world = std::get_if<WorldRequest>(&read)) {
    auto* place = std::get_if<PlaceObject>(of_world);
    if (place != nullptr && !fields.has("rpy_rad") && !fields.has("quaternion_wxyz")) {
      for (const SceneObject& object : scene_.objects) {
        if (object.name == place->object) place->X_WO.rotation = object.X_WO.rotation;
      }
    }
    answers.push_back(arms_.request(std::move(*of_world)));
  } else {
    const ArmIndex arm = arm_named(fields.text("arm"));
    answers.push_back(arms_.request(arm, std::get<ArmRequest>(std::move(read))));
  }
  return answers;
}

ArmIndex VirtualSource::arm_named(const std::string& name) const {
  if (const auto arm = arms_.find(name)) return *arm;
  throw RequestRefused("unknown_arm", "there is no arm '" + name.substr(0, 60) + "'" +
                                          name_hint(name, arms_.names(), "there is none"));
}

Later VirtualSource::when_all(Answers answers, json done) {
  auto waiting = std::make_shared<Answers>(std::move(answers));
  return [waiting, done = std::move(done)]() -> std::optional<Reply> {
    for (const auto& answer : *waiting) {
      if (answer.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return {};
    }
    json result = done;
    for (auto& answer : *waiting) {
      const RequestAnswer said = answer.get();
      if (said.success) continue;
      result = {{"ok", false}, {"verdict", "arm_refused"}, {"reason", said.reason}};
    }
    return Reply{.answer = std::move(result), .numbers = {}};
  };
}

namespace {

constexpr std::size_t kRecords = 1024;  // 1 s

RecordLayout layout_of(const Scene& scene) {
  RecordLayout layout;
  RecordLayout::Instance program;
  program.name = program.type = "program";
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    layout.arms.push_back({scene.arms[i].name, robot_of(scene.arms[i]).joint_count()});
    program.arms |= 1u << i;
  }
  layout.instances.push_back(std::move(program));
  return layout;
}

}  // namespace

WorldFeed::WorldFeed(const Scene& scene)
    : layout_(layout_of(scene)), ring_(layout_, kRecords), objects_(scene), arms_(scene.arms.size()) {}

void WorldFeed::take(const MujocoPlant& plant) {
  const auto period = static_cast<std::uint64_t>(plant.periods());
  objects_.take([&](const std::string& name) { return plant.object_pose(name); });
  CycleRecord* record = ring_.ring.back();
  if (record == nullptr) {
    ring_.dropped_records.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  record->cycle = period;
  record->t.ns = plant.periods() * kArmPeriodNs.count();
  record->start = host_now();
  record->period_s = before_.ns == 0 ? 0 : seconds(record->start - before_);
  before_ = record->start;
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    const ArmState& state = plant.arm(i).state();
    ArmSample& sample = record->arms[i];
    set_state(sample, state);
    const GripperState gripper = plant.gripper_state(i);
    sample.has_gripper = gripper.present;
    sample.gripper_grasped = gripper.grasped;
    sample.gripper_moving = gripper.moving;
    sample.gripper_width = gripper.width;
    sample.gripper_max_width = gripper.max_width;
    sample.due = true;
    sample.tau_controllet = sample.tau_cmd = sample.tau_J_d;
    watch(i, state, *record);
  }
  frames_.write(next_);
  ring_.ring.push();
}

// Events for changes of mode or frames; for a new arm, its frames.
void WorldFeed::watch(ArmIndex arm, const ArmState& state, const CycleRecord& record) {
  Arm& known = arms_[arm];
  Event event{.t = record.t, .cycle = record.cycle, .arm = static_cast<std::uint16_t>(arm)};
  if (state.mode != known.mode) {
    known.mode = state.mode;
    event.kind = EventKind::arm_mode;
    event.index = static_cast<std::uint16_t>(state.mode);
    if (!ring_.events.push(event)) ring_.dropped_events.fetch_add(1, std::memory_order_relaxed);
  }
  if (state.config_version == known.config_version) return;
  known.config_version = state.config_version;
  next_[arm] = state.frames;
  event.index = static_cast<std::uint16_t>(state.config_version);
  put_arm_config(event, state.frames, state.tool, state.load);
  if (!ring_.events.push(event)) ring_.dropped_events.fetch_add(1, std::memory_order_relaxed);
}

}  // namespace multipanda::cockpit
