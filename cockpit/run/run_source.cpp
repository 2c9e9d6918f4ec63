#include "cockpit/run/run_source.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "cockpit/view/scene_bodies.hpp"
#include "common/text.hpp"
#include "core/controllets/goal_parameters.hpp"
#include "runtime/live_input/backend_requests.hpp"
#include "runtime/request_text.hpp"

namespace multipanda::cockpit {
namespace {

using nlohmann::json;

constexpr double kStill = 0.25;  // the loop has stalled [s]
constexpr std::chrono::milliseconds kStatusPeriod{100};

const std::vector<std::string> kCommands = {"list",      "state", "switch", "feature", "parameter",
                                            "reference", "stop",  "resume", "episode", "histogram"};

int file_of(const LiveInputContext& input) {
  if (input.records == nullptr)
    throw std::runtime_error("this run shares no records, so a cockpit cannot show it: see its messages");
  return input.records->memory().file();
}

}  // namespace

RunSource::RunSource(Session& session)
    : session_(session),
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
  (void)look_at_stops();
}

std::string RunSource::look_at_stops() {
  std::string refused;
  std::erase_if(stopping_, [&](auto& entry) {
    auto& [arm, answer] = entry;
    if (answer.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return false;
    const RequestAnswer said = answer.get();
    if (said.success) return true;
    const std::string& name = session_.modes().arm_name(arm);
    not_stopped_[arm] = "the gripper of " + name + " may still move, it did not stop: " + said.reason;
    refused += (refused.empty() ? "" : "; ") + not_stopped_[arm];
    return true;
  });
  return refused;
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
  poses_.clear();
  for (std::size_t i = 0; input_.objects != nullptr && i < input_.objects->count(); ++i)
    poses_.push_back(input_.objects->read(i));
  return view_.compute(records_.newest(), records_.since_s(now), more_, poses_);
}

json RunSource::slow_state() {
  json state = handler_.state();
  state["paused"] = records_.still_s(host_now()) > kStill;
  state["cycle_times_us"] = records_.cycle_times_us();
  for (std::size_t i = 0; i < state["arms"].size(); ++i) {
    json& arm = state["arms"][i];
    arm["cures"] = cures_of(arm["errors"].get<std::uint64_t>());
    if (const auto found = not_stopped_.find(i); found != not_stopped_.end()) {
      const std::string other = arm.value("reason", "");
      arm["reason"] = other.empty() ? found->second : other + "; " + found->second;
    }
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

bool RunSource::moves(const json& request) const {
  const std::string word = request.at("do").get<std::string>();
  const JsonFields fields(request, word);
  if (const auto asked = handler_.read(word, fields)) return moves(*asked);
  const auto names = backend_request_names();
  return std::ranges::find(names, word) != names.end() &&
         multipanda::moves(read_backend_request(word, fields, with_common({})));
}

bool RunSource::moves(const Request& request) const {
  switch (request.kind) {
    case Request::Kind::switch_controllets:
      return !handler_.only_holds(request);
    case Request::Kind::set_parameter:
      return moves_parameter(request);
    case Request::Kind::set_feature:
    case Request::Kind::set_target:
      return true;
    case Request::Kind::resume:
      return false;
  }
  return true;
}

// Softer is never farther.
bool RunSource::moves_parameter(const Request& request) const {
  const Instance& instance = session_.modes().instance(request.instance);
  const ParameterSpec& spec = instance.parameter_spec(request.index);
  if (!is_stiffness(spec)) return acts_as_goal(spec);
  const auto now = instance.parameter(request.index);
  for (std::size_t k = 0; k < now.size(); ++k) {
    if (request.values[std::min<std::size_t>(k, request.size - 1)] > now[k]) return true;
  }
  return false;
}

std::variant<Reply, Later> RunSource::ask(const json& request, HostTime arrived) {
  const std::string word = request.at("do").get<std::string>();
  if (word == "histogram") return Reply{.answer = records_.histogram(), .numbers = {}};
  // No request of a closed page begins.
  const std::shared_ptr<RequestHandler::Pending> pending(new RequestHandler::Pending,
                                                         [this](RequestHandler::Pending* gone) {
                                                           handler_.abandon(*gone);
                                                           delete gone;
                                                         });
  const HostTime received = host_now();
  auto at_once = handler_.begin(request, *pending, arrived);
  const bool accepted = !at_once || at_once->value("ok", false);
  if (accepted && moves(request)) note_moved(request, pending);
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

void RunSource::note_moved(const json& request, const std::shared_ptr<RequestHandler::Pending>& pending) {
  const MultimodeController& modes = session_.modes();
  const auto note = [&](InstanceIndex instance) {
    if (instance >= modes.arm_count()) moved_.add_change(instance, records_.reader().records());
  };
  const std::string word = request.at("do").get<std::string>();
  const auto asked = handler_.read(word, JsonFields(request, word));
  if (pending->ticket != 0) moved_.add_ticket(pending->ticket);
  if (!asked) {
    const ArmIndex arm = handler_.arm(request.at("arm").get<std::string>());
    if (word == "gripper" || word == "vacuum") {
      not_stopped_.erase(arm);
      gripping_.emplace_back(arm, pending);
    } else {
      note(modes.owner(arm));
    }
  } else if (asked->kind == Request::Kind::set_target) {
    moved_.add(asked->instance, asked->index);
    const Quantity quantity = modes.instance(asked->instance).inputs()[asked->index].spec().quantity;
    if (quantity == Quantity::scalar) note(asked->instance);  // what it moves is unknown
  } else if (asked->kind == Request::Kind::switch_controllets) {
    for_each(asked->activate, note);
  } else {
    note(asked->instance);
  }
}

std::string RunSource::come_to_rest(bool hold) {
  for (const auto& [arm, pending] : std::exchange(gripping_, {})) {
    if (auto stop = handler_.abandon(*pending); stop.valid()) stopping_.emplace_back(arm, std::move(stop));
  }
  const InstanceSet ended = moved_.come_to_rest(records_.reader(), hold);
  const std::string refused = look_at_stops();
  if (ended == 0) return refused;
  return (refused.empty() ? "" : refused + "; ") + "it was released before the arms had rested for 0.3 s: " +
         joined(names_of(session_.modes(), ended), ", ") + " has ended, the arms are held";
}

}  // namespace multipanda::cockpit
