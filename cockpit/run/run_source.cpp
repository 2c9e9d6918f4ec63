#include "cockpit/run/run_source.hpp"

#include <algorithm>
#include <cmath>

#include "cockpit/view/scene_text.hpp"
#include "runtime/live_input/backend_requests.hpp"

namespace multipanda::cockpit {
namespace {

using nlohmann::json;

constexpr double kStill = 0.25;  // the loop stands still [s]
constexpr std::chrono::milliseconds kStatusPeriod{100};

const std::vector<std::string> kCommands = {"list",      "state", "switch", "feature", "parameter",
                                            "reference", "stop",  "resume", "episode", "histogram"};

int file_of(const LiveInputContext& input) {
  if (input.records == nullptr)
    throw std::runtime_error("this run shares no records, so a cockpit cannot show it: see its messages");
  return input.records->memory().file();
}

}  // namespace

RunSource::RunSource(Session& session, ObjectPoses* objects)
    : session_(session),
      objects_(objects),
      input_(session.live_input()),
      handler_(input_),
      records_(file_of(input_)),
      view_(session.scene(), session.models(), records_.fields()),
      moved_(session.modes()),
      more_(session.models().size()) {}

json RunSource::hello() {
  const Scene& scene = session_.scene();
  json arms = describe_arms(scene);
  bool simulated = true;
  for (ArmIndex i = 0; i < arms.size(); ++i) {
    const Capabilities can = session_.backend().capabilities(i);
    simulated = simulated && can.simulated;
    const bool connected = session_.backend().connection(i).has_value();
    arms[i].update({{"kind", !connected      ? "simulated"
                             : can.simulated ? "virtual"
                                             : "real"},
                    {"gripper", can.has_gripper},
                    {"vacuum", can.has_vacuum}});
  }
  json list = handler_.list();
  list.erase("ok");
  return {{"version", list["version"]},
          {"kind", "run"},
          {"scene",
           {{"name", scene.name},
            {"description", scene.description},
            {"backend", session_.backend_description()},
            {"simulated", simulated},
            {"duration_s", session_.duration_s()},
            {"arms", arms},
            {"bodies", view_.bodies()}}},
          {"list", list},
          {"state_fields", view_.fields()},
          {"record_fields", records_.field_list()},
          {"names", records_.names()},
          {"commands", commands()},
          {"logs", json::array()}};
}

void RunSource::update(HostTime now) {
  records_.update(now, [this](const json& event) {
    const std::string kind = event.value("kind", "");
    if (kind == "parameter_set" || kind == "feature_set" || kind == "switched" || kind == "controllet")
      ++list_version_;
  });
  look_at_status(now);
}

void RunSource::look_at_status(HostTime now) {
  if (now.ns < next_status_.ns) return;
  next_status_ = {now.ns + std::chrono::nanoseconds(kStatusPeriod).count()};
  status_ = session_.status();
  input_.latest->copy(snapshot_);
  for (std::size_t i = 0; i < more_.size() && i < status_.arms.size(); ++i) {
    if (i < snapshot_.arms.size()) more_[i].frames = snapshot_.arms[i].frames;
    more_[i].tracking_error = status_.arms[i].tracking_error.value_or(std::nan(""));
    more_[i].torque_use = status_.arms[i].torque_use;
  }
}

std::span<const double> RunSource::state(HostTime now) {
  if (records_.newest().empty()) return {};
  if (objects_ != nullptr) objects_->read(poses_);
  return view_.compute(records_.newest(), records_.since_s(now), more_, poses_);
}

json RunSource::slow_state() {
  json state = handler_.state();
  state["paused"] = records_.still_s(host_now()) > kStill;
  state["cycle_times_us"] = records_.cycle_times_us();
  for (std::size_t i = 0; i < state["arms"].size(); ++i) {
    json& arm = state["arms"][i];
    arm["cures"] = cures_of(arm["errors"].get<std::uint64_t>());
    if (i < status_.arms.size()) arm["tracking_unit"] = status_.arms[i].tracking_unit;
  }
  return state;
}

json RunSource::list() {
  json list = handler_.list();
  list.erase("ok");
  return list;
}

// --- requests ---

std::vector<std::string> RunSource::commands() const {
  std::vector<std::string> all = kCommands;
  const auto backend = backend_request_names();
  all.insert(all.end(), backend.begin(), backend.end());
  return all;
}

bool RunSource::is_open(const std::string& command) const {
  return command == "list" || command == "state" || command == "histogram" || command == "stop";
}

bool RunSource::moves(const std::string& command) const { return command == "reference"; }

std::variant<Reply, Later> RunSource::ask(const json& request) {
  const std::string word = request.at("do").get<std::string>();
  if (word == "histogram") return Reply{.answer = records_.histogram(), .numbers = {}};
  auto pending = std::make_shared<RequestHandler::Pending>();
  const HostTime received = host_now();
  auto at_once = handler_.begin(request, *pending);
  const bool accepted = !at_once || at_once->value("ok", false);
  if (word == "reference" && accepted) note_moved(request, pending->ticket);
  const auto finish = [word, received](json answer) {
    if (word == "stop") answer["received_ns"] = received.ns;
    return Reply{.answer = std::move(answer), .numbers = {}};
  };
  if (at_once) return finish(std::move(*at_once));
  return Later([this, pending, finish]() -> std::optional<Reply> {
    auto done = handler_.poll(*pending);
    if (!done) return {};
    return finish(std::move(*done));
  });
}

void RunSource::note_moved(const json& request, std::uint64_t ticket) {
  MultimodeController& modes = session_.modes();
  const InstanceIndex instance = modes.find(request.at("controllet").get<std::string>());
  moved_.add(instance, modes.instance(instance).find_input(request.at("input").get<std::string>()));
  if (ticket != 0) moved_.add_ticket(ticket);
}

void RunSource::come_to_rest(bool hold) { moved_.come_to_rest(records_.reader(), hold); }

}  // namespace multipanda::cockpit
