#include "runtime/live_input/request_handler.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include <fmt/format.h>

#include "arm_interface/arm_interface.hpp"
#include "common/text.hpp"
#include "core/types/gap_watch.hpp"
#include "runtime/live_input/backend_requests.hpp"
#include "runtime/request_text.hpp"

namespace multipanda {
namespace {

using nlohmann::json;

constexpr double kPatience = MultimodeController::kPatience;       // for the loop's answer [s]
constexpr double kArmPatience = kRequestPatience + kRequestSlack;  // for a backend's answer [s]
constexpr double kGripperPatience = 600;                           // for the end of a gripper's motion [s]
constexpr double kFarthestSample = 10;                             // of a chunk, from now [s]

const std::vector<std::string> kLoopRequests = {"switch", "feature", "parameter", "reference", "stop",
                                                "resume", "list",    "state",     "episode",   "keep"};
const std::vector<std::string> kConnectionRequests = {"subscribe",  "unsubscribe", "records", "stream",
                                                      "stream_end", "channels",    "lead"};

std::vector<std::string> all_requests() {
  std::vector<std::string> words;
  const auto backend = backend_request_names();
  for (const auto* list : {&kLoopRequests, &backend, &kConnectionRequests}) {
    words.insert(words.end(), list->begin(), list->end());
  }
  return words;
}

}  // namespace

void end_or_stop(MultimodeController& modes, InstanceSet instances) {
  constexpr double kAnyTime = 1e6;  // [s]
  const Request request{.kind = Request::Kind::switch_controllets, .deactivate = instances};
  std::uint64_t ticket = 0;
  if (modes.post(std::span(&request, 1), ticket, kAnyTime) == Verdict::accepted) return;
  for_each(instances, [&](InstanceIndex i) { modes.stop(modes.instance(i).arms()); });
}

RequestHandler::RequestHandler(LiveInputContext run) : run_(std::move(run)) {
  for (const auto& model : run_.models) terms_.emplace_back(model);
  run_.mounts.resize(run_.models.size());
  const std::lock_guard lock(run_.followed->mutex);
  run_.followed->grippers.resize(run_.modes->arm_count());
}

void RequestHandler::begin_stop(const json& request, Pending& pending) {
  const JsonFields fields(request, "stop");
  try {
    pending.stopping = arms_in(fields);
    fields.allow(with_common({"arms"}));
  } catch (const std::exception& error) {
    pending.stopping = ArmSet::all(run_.modes->arm_count());
    pending.wrong = error.what();
  }
  run_.modes->stop(pending.stopping);
}

// The latest time at which the request may begin: as long as its sender waits, or a default.
void RequestHandler::keep_patience(const JsonFields& fields, HostTime not_before, Pending& pending) {
  constexpr double kSendersPatience = 10, kAhead = 1, kLongest = 86400;  // [s]
  double patience = fields.has("asked_ns") ? kSendersPatience : kPatience;
  HostTime& asked = pending.asked;
  if (fields.has("patience_s")) {
    patience = fields.number("patience_s");
    if (!(patience > 0 && patience <= kLongest)) fields.expected("patience_s", "above 0 to 86400 seconds");
  }
  if (fields.has("asked_ns")) {
    if (!fields.at("asked_ns").is_number_integer()) fields.expected("asked_ns", "a whole number");
    asked.ns = fields.at("asked_ns").get<std::int64_t>();
    if (asked.ns < 0 || seconds(asked - pending.received) > kAhead)
      fields.expected("asked_ns", "this computer's CLOCK_MONOTONIC (see 'now_ns' of the answers)");
  }
  if (asked < not_before) throw RequestRefused(std::string(name_of(Verdict::timeout)), kStalled);
  *pending.begin_by = asked.ns + static_cast<std::int64_t>(1e9 * patience);
  if (pending.received.ns <= *pending.begin_by) return;
  throw RequestRefused(std::string(name_of(Verdict::timeout)),
                       fmt::format("the request is {:.1f} s old, its sender waits for {:g} s, and it is not "
                                   "executed: look at the arms, then send it again",
                                   seconds(pending.received - asked), patience));
}

void RequestHandler::check_whose_arms(const JsonFields& fields) const {
  if (run_.stops_only)
    fields.refuse("this program commands its arms by itself; it accepts only 'stop', 'state' and 'list'");
}

std::future<RequestAnswer> RequestHandler::abandon(Pending& pending) {
  if (pending.ticket != 0 && only_holds(pending.request)) return {};
  *pending.begin_by = 0;
  if (pending.ticket != 0) (void)run_.modes->withdraw(pending.ticket);
  const auto moving = std::exchange(pending.moving, {});
  const bool moves = moving && pending.answer.valid() &&
                     pending.answer.wait_for(std::chrono::seconds(0)) != std::future_status::ready;
  if (!moves) return {};
  return run_.backend->request(pending.arm, *ending_of(*moving, false));
}

bool RequestHandler::only_holds(const Request& request) const {
  return request.kind == Request::Kind::switch_controllets &&
         (request.activate >> run_.modes->arm_count()) == 0;
}

bool RequestHandler::only_holds(const json& request) const {
  if (!request.is_object() || request.value("do", json()) != "switch") return false;
  try {
    return only_holds(read_switch(JsonFields(request, "switch")));
  } catch (const RequestRefused&) {
    return false;
  }
}

std::optional<json> RequestHandler::begin(const json& request, Pending& pending, HostTime arrived,
                                          HostTime not_before) {
  pending.received = host_now();
  pending.asked = arrived;
  if (is_stop(request)) {
    begin_stop(request, pending);
    return {};
  }
  const JsonFields fields(request, "request");
  const std::string word = fields.text("do");
  const JsonFields named(request, word);
  if (word != "list" && word != "state") check_whose_arms(named);
  if (const auto names = backend_request_names(); std::ranges::find(names, word) != names.end()) {
    begin_backend_request(word, named, not_before, pending);
    return {};
  }
  if (word != "list" && word != "state") keep_patience(named, not_before, pending);
  if (const auto asked = read(word, named)) {
    if (asked->target.delivery != Delivery::stream) return post(*asked, pending);
    const Reference& input = run_.modes->instance(asked->instance).inputs()[asked->index];
    const bool late = seconds(pending.received - pending.asked) > input.spec().timeout_s;
    const Verdict verdict = late ? Verdict::timeout : run_.modes->post_sample(*asked);
    if (verdict != Verdict::accepted) return refusal(verdict, reason(*run_.modes, *asked, verdict));
    return json{{"ok", true}, {"streamed", true}};
  }
  if (word == "list" || word == "state") {
    named.allow(with_common({}));
    return word == "list" ? list() : json{{"ok", true}, {"state", state()}};
  }
  if (word == "episode") return mark_episode(named);
  if (word == "keep") {
    constexpr double kSlowDisk = 60;  // [s]
    named.allow(with_common({}));
    if (!run_.keep) fields.refuse("this run keeps no records");
    auto [log, answer] = run_.keep();
    pending.done = {{"log", log.string()}};
    pending.answer = std::move(answer);
    pending.patience_s = kSlowDisk;
    return {};
  }
  fields.refuse("unknown request '" + word.substr(0, 60) + "'" +
                name_hint(word, all_requests(), "there are none"));
}

std::optional<Request> RequestHandler::read(const std::string& word, const JsonFields& fields) const {
  if (word == "switch") return read_switch(fields);
  if (word == "feature") return read_feature(fields);
  if (word == "parameter") return read_parameter(fields);
  if (word == "reference") return read_reference(fields);
  if (word != "resume") return {};
  fields.allow(with_common({"arms", "stops"}));
  Request resume{.kind = Request::Kind::resume};
  resume.arms = arms_in(fields);
  if (fields.has("stops")) {
    const json& stops = fields.at("stops");
    if (!stops.is_number_unsigned() || stops.get<std::uint64_t>() >= Request::kEveryStop)
      fields.expected("stops", "the whole number of this name in the state");
    resume.stops = stops.get<std::uint32_t>();
  }
  return resume;
}

Request RequestHandler::read_switch(const JsonFields& fields) const {
  fields.allow(with_common({"activate", "deactivate", "only"}));
  Request request{.kind = Request::Kind::switch_controllets};
  for (const auto& name : fields.texts("activate")) request.activate |= bit(instance(name));
  for (const auto& name : fields.texts("deactivate")) request.deactivate |= bit(instance(name));
  request.only = fields.boolean("only", false);
  if (request.activate == 0 && request.deactivate == 0 && !request.only) {
    fields.refuse("switches nothing; expected 'activate' or 'deactivate' with names of controllets");
  }
  if (const InstanceSet both = request.activate & request.deactivate; both != 0) {
    fields.refuse("'" + names_of(*run_.modes, both).front() + "' is in activate and in deactivate");
  }
  return request;
}

Request RequestHandler::read_feature(const JsonFields& fields) const {
  fields.allow(with_common({"controllet", "name", "on"}));
  Request request{.kind = Request::Kind::set_feature};
  request.instance = instance_in(fields);
  const Instance& target = run_.modes->instance(request.instance);
  const std::string name = fields.text("name");
  const std::size_t index = target.find_feature(name);
  if (index == target.feature_count()) {
    throw RequestRefused("unknown_feature", no_such_feature(target, name));
  }
  request.index = static_cast<std::uint16_t>(index);
  request.on = fields.boolean("on", true);
  return request;
}

Request RequestHandler::read_parameter(const JsonFields& fields) const {
  fields.allow(with_common({"controllet", "name", "value"}));
  Request request{.kind = Request::Kind::set_parameter};
  request.instance = instance_in(fields);
  const Instance& target = run_.modes->instance(request.instance);
  const std::string name = fields.text("name");
  const std::size_t index = target.find_parameter(name);
  if (index == target.parameter_count()) {
    throw RequestRefused("unknown_parameter", no_such_parameter(target, name));
  }
  request.index = static_cast<std::uint16_t>(index);
  const ParameterSpec& spec = target.parameter_spec(index);
  const std::size_t size = target.parameter_size(index);
  const json& value = fields.at("value");
  request.size = static_cast<std::uint8_t>(size);
  if (!spec.choices.empty()) {  // by name; true and false are names as well
    const std::string word = value.is_boolean()  ? (value.get<bool>() ? "true" : "false")
                             : value.is_string() ? value.get<std::string>()
                                                 : std::string();
    const auto choice = std::find(spec.choices.begin(), spec.choices.end(), word);
    if (choice == spec.choices.end()) fields.expected("value", joined(spec.choices, " or "));
    request.values[0] = static_cast<double>(choice - spec.choices.begin());
  } else if (value.is_number()) {  // one value for all
    std::fill_n(request.values.begin(), size, value.get<double>());
  } else if (size == 1) {
    fields.expected("value", "a number");
  } else {
    const auto numbers = fields.numbers("value", size);
    std::copy(numbers.begin(), numbers.end(), request.values.begin());
  }
  return request;
}

InstanceSet RequestHandler::read_lead(const JsonFields& fields) const {
  check_whose_arms(fields);
  fields.allow(with_common({"controllets", "silence_s"}));
  InstanceSet leads = 0;
  for (const auto& name : fields.texts("controllets")) {
    if (const InstanceIndex index = run_.modes->find(name); index != kNoInstance) leads |= bit(index);
  }
  return leads;
}

RequestHandler::Address RequestHandler::address_in(const JsonFields& fields) const {
  Address address{.instance = instance_in(fields), .input = 0, .X_WB = {}};
  const Instance& target = run_.modes->instance(address.instance);
  const std::string name = fields.text("input");
  const std::size_t index = target.find_input(name);
  if (index == target.inputs().size()) throw RequestRefused("unknown_input", no_such_input(target, name));
  address.input = static_cast<std::uint16_t>(index);
  const InputSpec& spec = target.inputs()[index].spec();
  if (!fields.has("frame")) return address;
  const std::string frame = fields.text("frame");
  if (spec.quantity == Quantity::joints || spec.quantity == Quantity::scalar) {
    fields.refuse("a " + std::string(to_string(spec.quantity)) + " input has no frame; leave 'frame' out");
  }
  if (frame == spec.frame) return address;
  std::vector<std::string> valid{spec.frame};
  for (ArmIndex a = 0; spec.frame == "world" && a < run_.modes->arm_count(); ++a) {
    const std::string base = run_.modes->arm_name(a) + "_base";
    if (run_.mounts[a]) {
      if (frame == base)
        fields.refuse("'" + frame + "' moves with arm '" + run_.modes->arm_name(run_.mounts[a]->carrier) +
                      "', on which its arm stands; give the values in the world");
      continue;
    }
    valid.push_back(base);
    if (frame == base) address.X_WB = run_.models[a]->X_WB();
  }
  if (!address.X_WB)
    fields.refuse("there is no frame '" + frame + "'" + name_hint(frame, valid, "there is none"));
  return address;
}

Request RequestHandler::read_reference(const JsonFields& fields) const {
  std::vector<std::string> keys = {"controllet", "input", "frame", "duration_s", "stream", "until"};
  for (const auto& key : reference_keys()) keys.push_back(key);
  fields.allow(with_common(keys));
  const Address address = address_in(fields);
  const InputSpec& input = run_.modes->instance(address.instance).inputs()[address.input].spec();
  Request request{.kind = Request::Kind::set_target};
  request.instance = address.instance;
  request.index = address.input;
  request.target.set(multipanda::read_reference(fields, input));
  if (address.X_WB) request.target.to_world(input.quantity, *address.X_WB);
  request.target.duration_s = fields.number("duration_s", 0);
  if (fields.boolean("stream", false)) request.target.delivery = Delivery::stream;
  if (fields.has("until")) request.until = read_until(fields, request);
  return request;
}

GoalEnd RequestHandler::read_until(const JsonFields& fields, const Request& request) const {
  const Instance& target = run_.modes->instance(request.instance);
  const InputSpec& input = target.inputs()[request.index].spec();
  const bool place = input.quantity == Quantity::pose || input.quantity == Quantity::joints;
  if (!place || request.target.delivery != Delivery::goal)
    fields.refuse("only a goal for a pose or joints has an 'until'");
  const JsonFields ends = fields.section("until");
  static const std::vector<std::string> kKeys = {"force_n", "torque_nm", "distance_m"};
  ends.allow(kKeys);
  GoalEnd until;
  for (std::size_t cause = 0; cause < kKeys.size(); ++cause) {
    if (!ends.has(kKeys[cause])) continue;
    until.limits[cause] = ends.number(kKeys[cause]);
    if (!(until.limits[cause] > 0 && until.limits[cause] <= Reference::kGreatest))
      ends.expected(kKeys[cause], "a number above 0, at most 1000");
  }
  if (!until.set()) ends.refuse("is empty; expected " + joined(kKeys, " or "));
  LatestState::Snapshot now;
  run_.latest->copy(now);
  for (const ArmIndex arm : target.arm_list()) {
    if (until.feels() && now.cycle != 0 && !now.arms[arm].sample.has_wrench_estimate)
      throw RequestRefused(std::string(name_of(Verdict::arm_not_ready)),
                           "the force of arm '" + run_.modes->arm_name(arm) +
                               "' is not known here; leave 'force_n' and 'torque_nm' out");
  }
  return until;
}

// An episode is begun once and judged once; afterwards it can still be discarded.
json RequestHandler::mark_episode(const JsonFields& fields) {
  fields.allow(with_common({"mark"}));
  const auto& marks = episode_marks();
  const auto found = std::ranges::find(marks, fields.text("mark"));
  if (found == marks.end()) fields.expected("mark", joined(marks, ", "));
  if (!run_.mark) fields.refuse("this run keeps no episodes");
  EpisodeCount& count = *run_.episodes;
  const std::lock_guard lock(count.mutex);
  EpisodeMark mark{.kind = static_cast<EpisodeMark::Kind>(found - marks.begin()), .episode = count.episode};
  const std::string number = std::to_string(count.episode);
  const bool discard = mark.kind == EpisodeMark::Kind::discard;
  if (mark.kind == EpisodeMark::Kind::start) {
    if (count.open) fields.refuse("episode " + number + " is not over: mark success, failure or discard");
    ++mark.episode;
  } else if (!count.open && !(discard && count.episode > 0)) {
    fields.refuse("no episode has begun: mark its start first");
  }
  run_.latest->copy(snapshot_);
  mark.cycle = snapshot_.cycle;
  mark.t = snapshot_.t;
  count.episode = mark.episode;
  count.open = mark.kind == EpisodeMark::Kind::start;
  run_.mark(mark);
  return {{"ok", true}, {"episode", mark.episode}, {"cycle", mark.cycle}, {"t_s", mark.t.seconds()}};
}

void RequestHandler::begin_backend_request(const std::string& name, const JsonFields& fields,
                                           HostTime not_before, Pending& pending) {
  BackendRequest request = read_backend_request(name, fields, with_common({}));
  if (!ends_motion(request)) keep_patience(fields, not_before, pending);
  std::visit([&](auto& asked) { asked.begin_by = pending.begin_by; }, request);
  // This thread may have stalled since it took the request; the backend's own watch begins with it.
  if (!ends_motion(request) && host_now() - pending.received > GapWatch::kLongest)
    throw RequestRefused(std::string(name_of(Verdict::timeout)), kStalled);
  if (auto* of_world = std::get_if<WorldRequest>(&request)) {
    auto* place = std::get_if<PlaceObject>(of_world);
    if (place != nullptr && !fields.has("rpy_rad") && !fields.has("quaternion_wxyz")) {
      // Without an orientation the object keeps the one of the scene; the backend refuses unknown objects.
      const auto known = run_.rotations.find(place->object);
      if (known != run_.rotations.end()) place->X_WO.rotation = known->second;
    }
    constexpr double kSlowestStep = 10 * kArmPeriod;
    if (const auto* step = std::get_if<StepSimulation>(of_world))
      pending.patience_s = kSlowestStep * step->periods;
    pending.answer = run_.backend->request(std::move(*of_world));
    return;
  }
  const ArmIndex target = arm(fields.text("arm"));
  if (auto* of_gripper = std::get_if<GripperRequest>(&request)) {
    pending.patience_s = kGripperPatience;
    pending.arm = target;
    run_.latest->copy(snapshot_);
    take_gripper(target, *of_gripper, pending);
    const ArmSample& sample = snapshot_.arms[target].sample;
    if (ending_of(*of_gripper, sample.gripper_grasped)) pending.moving = *of_gripper;
    pending.answer = request_arm(*run_.modes, *run_.backend, target, std::move(*of_gripper), sample.mode);
  } else {
    auto& of_arm = std::get<ArmRequest>(request);
    const auto* load = std::get_if<SetLoad>(&of_arm);
    if (load != nullptr) pending.done = load_done(target, load->load.mass);
    pending.answer = request_arm(*run_.modes, *run_.backend, target, std::move(of_arm));
  }
}

std::string RequestHandler::halted(ArmIndex arm) const {
  if (snapshot_.cycle == 0) return {};
  const auto mode = static_cast<ArmMode>(snapshot_.arms[arm].sample.mode);
  const bool halts = mode == ArmMode::user_stopped || mode == ArmMode::reflex;
  return halts ? std::string(to_string(mode)) : std::string();
}

// A refusal changes nothing: the client that is followed stays the same, and its end still counts.
void RequestHandler::take_gripper(ArmIndex arm, const GripperRequest& request, Pending& pending) {
  const std::lock_guard lock(run_.followed->mutex);
  Followed::Gripper& gripper = run_.followed->grippers[arm];
  const HostTime now = host_now();
  const bool ends = ends_motion(BackendRequest(request)), own = gripper.client == pending.client;
  const ArmSample& sample = snapshot_.arms[arm].sample;
  if (gripper.refuses(request, pending.client, sample.has_gripper ? sample.gripper_width : 1e9, now))
    throw RequestRefused("arm_refused", Followed::refusal(run_.modes->arm_name(arm)));
  const auto* follow = ends ? nullptr : std::get_if<GripperFollow>(&request);
  if (auto why = check(request); !ends && !why.empty()) {
    if (follow == nullptr) return;  // refused next
    throw RequestRefused("arm_refused", why);
  }
  if (follow != nullptr) return take_width(arm, *follow, gripper, pending);
  gripper.end(now, !own || std::holds_alternative<GripperStop>(request));
}

// A width is not older than its silence.
void RequestHandler::take_width(ArmIndex arm, const GripperFollow& follow, Followed::Gripper& gripper,
                                Pending& pending) {
  const HostTime now = host_now();
  const auto silence_ns = static_cast<std::int64_t>(1e9 * follow.silence);
  const HostTime until{now.ns + silence_ns};
  const HostTime pause{now.ns + std::max(silence_ns, Followed::kShortestPause)};
  const std::string why = halted(arm);
  const bool stopped = run_.modes->stopped().contains(arm);
  const auto found = gripper.paused.find(pending.client);
  const bool paused = found != gripper.paused.end() && now < found->second;
  if ((stopped || paused || !why.empty()) && pending.client != nullptr)
    gripper.paused[pending.client] = pause;
  if (stopped) return;  // refused next
  if (!why.empty())
    throw RequestRefused("arm_refused", "arm '" + run_.modes->arm_name(arm) + "' is " + why +
                                            ", and its gripper cannot follow widths: release or recover it");
  if (paused)
    throw RequestRefused(
        "arm_refused",
        fmt::format("this stream of widths was ended by a stop or by someone else: the gripper "
                    "of arm '{}' follows it again once it has paused for {:g} s",
                    run_.modes->arm_name(arm), seconds(pause - now)));
  *pending.begin_by = std::min(pending.begin_by->load(), pending.asked.ns + silence_ns);
  if (now.ns > *pending.begin_by)
    throw RequestRefused(
        std::string(name_of(Verdict::timeout)),
        fmt::format("the width is {:.1f} s old, longer than 'silence_s', and is not followed",
                    seconds(now - pending.asked)));
  gripper.paused.erase(pending.client);
  gripper.client = pending.client;
  gripper.until = until;
  gripper.pause = pause;
}

void RequestHandler::end_following(const void* client) {
  const std::lock_guard lock(run_.followed->mutex);
  const HostTime now = host_now();
  const ArmSet stopped = run_.modes->stopped();
  auto& grippers = run_.followed->grippers;
  const auto follows = [&](const Followed::Gripper& gripper) { return now < gripper.until; };
  if (std::ranges::any_of(grippers, follows)) run_.latest->copy(snapshot_);
  for (ArmIndex arm = 0; arm < grippers.size(); ++arm) {
    Followed::Gripper& gripper = grippers[arm];
    const bool halts = (stopped - held_).contains(arm) || (follows(gripper) && !halted(arm).empty());
    if (client != nullptr) gripper.paused.erase(client);
    if (client != nullptr ? gripper.client != client : !halts) continue;
    gripper.end(now, client == nullptr);
    if (client != nullptr) gripper.client = nullptr;
    (void)run_.backend->request(arm, GripperRequest(GripperFollow{}));
  }
  if (client == nullptr) held_ = stopped;
}

std::optional<json> RequestHandler::post(const Request& request, Pending& pending) {
  pending.request = request;
  const double left = 1e-9 * static_cast<double>(*pending.begin_by - pending.received.ns);
  const Verdict verdict =
      run_.modes->post(std::span(&request, 1), pending.ticket, std::min(kPatience, left), pending.asked);
  if (verdict == Verdict::accepted) return {};
  return refusal(verdict, reason(*run_.modes, request, verdict));
}

std::optional<json> RequestHandler::poll(Pending& pending) {
  const double waited = seconds(host_now() - pending.received);
  if (pending.ticket != 0) {
    Answer answer;
    if (run_.modes->poll(pending.ticket, answer)) return answer_of(answer, pending.request);
    if (waited <= kPatience) return {};
    // Report a refusal only for requests that the loop can no longer take.
    if (run_.modes->withdraw(pending.ticket))
      return refusal(Verdict::timeout, reason(*run_.modes, pending.request, Verdict::timeout));
    if (waited <= kPatience + MultimodeController::kAnswerPatience) return {};
    return refusal(Verdict::pending, reason(*run_.modes, pending.request, Verdict::pending));
  }
  if (pending.answer.valid()) {
    if (pending.answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready) {
      try {
        const RequestAnswer answer = pending.answer.get();
        if (answer.success) {
          json answered{{"ok", true}};
          if (pending.done.is_object()) answered.update(pending.done);
          return answered;
        }
        const char* verdict = pending.done.contains("log") ? "failed" : "arm_refused";
        return json{{"ok", false}, {"verdict", verdict}, {"reason", answer.reason}};
      } catch (const std::future_error&) {
        return json{{"ok", false}, {"verdict", "arm_refused"}, {"reason", "the backend did not answer"}};
      }
    }
    if (pending.moving) {
      const ArmSample sample = run_.latest->sample(pending.arm);
      if (gripper_stops(*run_.modes, pending.arm, sample.mode)) {
        if (auto ending = ending_of(*std::exchange(pending.moving, {}), sample.gripper_grasped))
          (void)run_.backend->request(pending.arm, std::move(*ending));
      }
    }
    const double patience = std::max(kArmPatience, pending.patience_s);
    if (waited <= patience) return {};
    return refusal(Verdict::pending, kRequestUnfinished);  // not "timeout": it cannot be withdrawn
  }
  if (run_.modes->stopped().contains(pending.stopping)) {
    json stopped{{"ok", true},
                 {"stopped", names_of(*run_.modes, pending.stopping)},
                 {"stopped_after_ms", waited * 1e3}};
    if (!pending.wrong.empty()) stopped["message"] = pending.wrong + ": all arms are stopped";
    return stopped;
  }
  if (waited <= kPatience) return {};
  return refusal(Verdict::timeout,
                 "no cycle ran for 1 s: the simulation may be paused, or the run may have ended; the arms "
                 "stop at the next cycle");
}

// --- streams ---

StreamChannel RequestHandler::open_channel(const json& request) const {
  const JsonFields fields(request, "stream");
  check_whose_arms(fields);
  fields.allow(with_common({"controllet", "input", "frame"}));
  const Address address = address_in(fields);
  StreamChannel channel;
  channel.instance = address.instance;
  channel.input = address.input;
  channel.X_WB = address.X_WB;
  channel.late_before = run_.modes->instance(address.instance).inputs()[address.input].late();
  return channel;
}

// Counts a packet. False if it is not to be used.
bool RequestHandler::begin_packet(const StreamPacket& packet, StreamChannel& channel, double age_s) {
  // Numbers continue at 0 after the largest one.
  const auto ahead = static_cast<std::int64_t>(packet.sequence - channel.last);
  if (channel.received > 0 && ahead <= 0) {
    ++channel.late;
    return false;
  }
  if (channel.received > 0) channel.lost += static_cast<std::uint64_t>(ahead) - 1;
  channel.last = packet.sequence;
  channel.client_time_ns = packet.client_time_ns;
  ++channel.received;
  if (age_s <= run_.modes->instance(channel.instance).inputs()[channel.input].spec().timeout_s) return true;
  ++channel.expired;
  channel.verdict = Verdict::timeout;
  discard(channel);  // the replacement of the queued samples is lost: silence, not the old ones
  return false;
}

Request RequestHandler::sample_of(const StreamChannel& channel, Target target) const {
  Request sample{.kind = Request::Kind::set_target};
  sample.instance = channel.instance;
  sample.index = channel.input;
  sample.target = target;
  sample.target.delivery = Delivery::stream;
  const Quantity quantity = run_.modes->instance(channel.instance).inputs()[channel.input].spec().quantity;
  if (channel.X_WB) sample.target.to_world(quantity, *channel.X_WB);
  return sample;
}

void RequestHandler::conclude(Verdict verdict, const Request& sample, StreamChannel& channel) {
  channel.verdict = verdict;
  if (verdict == Verdict::accepted) return;
  ++channel.refused;
  channel.reason = reason(*run_.modes, sample, verdict);
  discard(channel);
}

void RequestHandler::deliver(const StreamPacket& packet, StreamChannel& channel, double age_s) {
  if (!begin_packet(packet, channel, age_s)) return;
  Target target;
  target.size = static_cast<std::uint8_t>(packet.count);
  target.values = packet.values;
  const Request sample = sample_of(channel, target);
  conclude(run_.modes->post_sample(sample), sample, channel);
}

void RequestHandler::deliver(const ChunkPacket& packet, StreamChannel& channel, double age_s) {
  if (!begin_packet(packet.head, channel, age_s)) return;
  Reference& input = run_.modes->instance(channel.instance).inputs()[channel.input];
  Chunk chunk = packet.chunk;
  Request sample = sample_of(channel, {});
  const bool fits = chunk.count > 0 && chunk.count <= Chunk::kMostSamples;
  Verdict verdict = fits ? Verdict::accepted : Verdict::wrong_size;
  for (std::size_t k = 0; k < chunk.count && verdict == Verdict::accepted; ++k) {
    sample = sample_of(channel, chunk.sample(k));
    chunk.values[k] = sample.target.values;
    verdict = run_.modes->check_sample(sample);
  }
  run_.latest->copy(snapshot_);
  if (verdict == Verdict::accepted &&
      chunk.times_s[chunk.count - 1u] > snapshot_.t.seconds() + kFarthestSample)
    verdict = Verdict::out_of_bounds;
  std::uint64_t number = 0;
  if (verdict == Verdict::accepted) verdict = input.post(chunk, number);
  conclude(verdict, sample, channel);
  if (verdict == Verdict::accepted) channel.chunk = number;
}

void RequestHandler::discard(StreamChannel& channel) {
  run_.modes->instance(channel.instance).inputs()[channel.input].discard(channel.chunk);
  channel.chunk = 0;
}

// --- names ---

InstanceIndex RequestHandler::instance(const std::string& name) const {
  const InstanceIndex index = run_.modes->find(name);
  if (index != kNoInstance) return index;
  throw RequestRefused("unknown_instance", no_such_controllet(*run_.modes, name));
}

InstanceIndex RequestHandler::instance_in(const JsonFields& fields) const {
  return instance(fields.text("controllet"));
}

ArmIndex RequestHandler::arm(const std::string& name) const {
  for (ArmIndex a = 0; a < run_.modes->arm_count(); ++a) {
    if (run_.modes->arm_name(a) == name) return a;
  }
  throw RequestRefused("unknown_arm", no_such_arm(*run_.modes, name));
}

ArmSet RequestHandler::arms_in(const JsonFields& fields) const {
  const auto names = fields.texts("arms");
  if (!fields.has("arms") || names == std::vector<std::string>{"all"})
    return ArmSet::all(run_.modes->arm_count());
  if (names.empty()) fields.expected("arms", "names of arms, or \"all\"");
  ArmSet arms;
  for (const auto& name : names) arms |= ArmSet::of(arm(name));
  return arms;
}

}  // namespace multipanda
