#include "runtime/live_input/request_handler.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "device/request_patience.hpp"
#include "runtime/live_input/backend_requests.hpp"
#include "runtime/live_input/reference_values.hpp"
#include "runtime/request_text.hpp"
#include "support/spelling.hpp"

namespace multipanda {
namespace {

using nlohmann::json;

constexpr double kPatience = MultimodeController::kPatience;       // for the loop's answer [s]
constexpr double kArmPatience = kRequestPatience + kRequestSlack;  // for a backend's answer [s]
constexpr double kGripperPatience = 600;                           // for the end of a gripper's motion [s]
constexpr double kFarthestSample = 10;                             // of a chunk, from now [s]
constexpr double kLongest = 86400;                                 // of a motion [s]

// Adds the keys that every request may have.
std::vector<std::string> with_common(std::vector<std::string> keys) {
  keys.insert(keys.end(), {"id", "do"});
  return keys;
}

const std::vector<std::string> kLoopRequests = {"switch", "feature", "parameter", "reference", "stop",
                                                "resume", "list",    "state",     "episode"};
const std::vector<std::string> kConnectionRequests = {"subscribe", "unsubscribe", "records",
                                                      "stream",    "stream_end",  "channels"};

std::vector<std::string> all_requests() {
  std::vector<std::string> words;
  const auto backend = backend_request_names();
  for (const auto* list : {&kLoopRequests, &backend, &kConnectionRequests}) {
    words.insert(words.end(), list->begin(), list->end());
  }
  return words;
}

}  // namespace

RequestHandler::RequestHandler(LiveInputContext run) : run_(std::move(run)), reach_(run_.models) {
  for (const auto& model : run_.models) terms_.emplace_back(model);
  run_.mounts.resize(run_.models.size());
}

std::optional<json> RequestHandler::begin(const json& request, Pending& pending) {
  const JsonFields fields(request, "request");
  const std::string word = fields.text("do");
  const JsonFields named(request, word);
  pending.received = host_now();
  if (word == "switch") return begin_switch(named, pending);
  if (word == "feature") return begin_feature(named, pending);
  if (word == "parameter") return begin_parameter(named, pending);
  if (word == "reference") return begin_reference(named, pending);
  if (word == "stop") {
    named.allow(with_common({"arms"}));
    pending.stopping = arms_in(named);
    run_.modes->stop(pending.stopping);
    return {};
  }
  if (word == "resume") {
    named.allow(with_common({"arms"}));
    Request resume{.kind = Request::Kind::resume};
    resume.arms = arms_in(named);
    return post(resume, pending);
  }
  if (word == "list" || word == "state") {
    named.allow(with_common({}));
    return word == "list" ? list() : json{{"ok", true}, {"state", state()}};
  }
  if (word == "episode") return mark_episode(named);
  if (const auto names = backend_request_names(); std::ranges::find(names, word) != names.end()) {
    begin_backend_request(word, named, pending);
    return {};
  }
  fields.refuse("unknown request '" + word.substr(0, 60) + "'" +
                name_hint(word, all_requests(), "there are none"));
}

std::optional<json> RequestHandler::begin_switch(const JsonFields& fields, Pending& pending) {
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
  return post(request, pending);
}

std::optional<json> RequestHandler::begin_feature(const JsonFields& fields, Pending& pending) {
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
  return post(request, pending);
}

std::optional<json> RequestHandler::begin_parameter(const JsonFields& fields, Pending& pending) {
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
  return post(request, pending);
}

RequestHandler::Address RequestHandler::address_in(const JsonFields& fields) const {
  Address address{.instance = instance_in(fields), .input = 0, .X_WB = {}};
  const Instance& target = run_.modes->instance(address.instance);
  const std::string name = fields.text("input");
  const std::size_t index = target.find_input(name);
  if (index == target.inputs().size()) {
    std::vector<std::string> valid;
    for (const auto& input : target.inputs()) valid.push_back(input.spec().name);
    throw RequestRefused("unknown_input", "'" + target.name() + "' has no input '" + name + "'" +
                                              name_hint(name, valid, "it has none"));
  }
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

std::optional<json> RequestHandler::begin_reference(const JsonFields& fields, Pending& pending) {
  std::vector<std::string> keys = {"controllet", "input", "frame", "duration_s", "stream"};
  for (const auto& key : reference_keys()) keys.push_back(key);
  fields.allow(with_common(keys));
  const Address address = address_in(fields);
  Instance& target = run_.modes->instance(address.instance);
  Reference& input = target.inputs()[address.input];
  std::vector<double> values = read_reference(fields, input.spec(), input.size());
  if (input.spec().quantity == Quantity::joints) {
    const ArmModel& model = model_of(address.instance, input.spec());
    if (const auto joint = joint_beyond_limit(model, values)) {
      const auto k = static_cast<Eigen::Index>(*joint);
      const std::string unit = model.is_prismatic(*joint) ? " m" : " rad";
      throw RequestRefused("out_of_bounds", "joint " + std::to_string(*joint + 1) + ": " +
                                                json(values[*joint]).dump() + unit + " is outside of " +
                                                json(model.limits().q_min[k]).dump() + " to " +
                                                json(model.limits().q_max[k]).dump() + unit);
    }
  }
  if (address.X_WB) to_world(input.spec().quantity, *address.X_WB, values);
  if (const std::string why = beyond_reach(target, input.spec(), values); !why.empty())
    throw RequestRefused("out_of_bounds", why);
  Request request{.kind = Request::Kind::set_target};
  request.instance = address.instance;
  request.index = address.input;
  Target& set_point = request.target;
  set_point.size = static_cast<std::uint8_t>(values.size());
  std::copy(values.begin(), values.end(), set_point.values.begin());
  set_point.duration_s = fields.number("duration_s", 0);
  if (!(set_point.duration_s >= 0 && set_point.duration_s <= kLongest))
    fields.expected("duration_s", "0 to 86400 seconds");
  if (!fields.boolean("stream", false)) return post(request, pending);
  // A stream goes directly to the input, which uses the newest sample at the next cycle.
  set_point.delivery = Delivery::stream;
  Verdict verdict = Verdict::not_active;
  if ((run_.modes->active() & bit(address.instance)) != 0) verdict = input.post(set_point);
  if (verdict != Verdict::accepted) return refusal(verdict, reason(*run_.modes, request, verdict));
  return json{{"ok", true}, {"streamed", true}};
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
                                           Pending& pending) {
  BackendRequest request = read_backend_request(name, fields, with_common({}));
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
    pending.answer = run_.backend->request(target, std::move(*of_gripper));
  } else {
    auto& of_arm = std::get<ArmRequest>(request);
    // A payload declared too heavy makes the arm push upwards.
    constexpr double kMostMass = 50;  // [kg]
    const auto* load = std::get_if<SetLoad>(&of_arm);
    if (load != nullptr && load->load.mass > kMostMass) fields.expected("mass_kg", "a mass of 0 to 50 kg");
    if (load != nullptr) pending.done = load_done(target, load->load.mass);
    pending.answer = run_.backend->request(target, std::move(of_arm));
  }
}

std::optional<json> RequestHandler::post(const Request& request, Pending& pending) {
  pending.request = request;
  const Verdict verdict = run_.modes->post(std::span(&request, 1), pending.ticket);
  if (verdict == Verdict::accepted) return {};
  return refusal(verdict, reason(*run_.modes, request, verdict));
}

std::optional<json> RequestHandler::poll(Pending& pending) {
  const double waited = seconds(host_now() - pending.received);
  if (pending.ticket != 0) {
    Answer answer;
    if (run_.modes->poll(pending.ticket, answer)) return answer_of(answer, pending.request);
    if (waited <= kPatience) return {};
    // Only what the loop can no longer take may be called refused.
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
        return json{{"ok", false}, {"verdict", "arm_refused"}, {"reason", answer.reason}};
      } catch (const std::future_error&) {
        return json{{"ok", false}, {"verdict", "arm_refused"}, {"reason", "the backend did not answer"}};
      }
    }
    const double patience = std::max(kArmPatience, pending.patience_s);
    if (waited <= patience) return {};
    return refusal(Verdict::pending, kRequestUnfinished);  // not "timeout": nobody can take it back
  }
  if (run_.modes->stopped().contains(pending.stopping)) {
    return json{{"ok", true},
                {"stopped", names_of(*run_.modes, pending.stopping)},
                {"stopped_after_ms", waited * 1e3}};
  }
  if (waited <= kPatience) return {};
  return refusal(Verdict::timeout,
                 "no cycle ran for 1 s: the simulation may be paused, or the run may have ended; the arms "
                 "stop at the next cycle");
}

// --- streams ---

StreamChannel RequestHandler::open_channel(const json& request) const {
  const JsonFields fields(request, "stream");
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
  if (channel.received > 0 && packet.sequence <= channel.last) {
    ++channel.late;
    return false;
  }
  if (channel.received > 0) channel.lost += packet.sequence - channel.last - 1;
  channel.last = packet.sequence;
  channel.client_time_ns = packet.client_time_ns;
  ++channel.received;
  if (age_s <= run_.modes->instance(channel.instance).inputs()[channel.input].spec().timeout_s) return true;
  ++channel.expired;
  channel.verdict = Verdict::timeout;
  discard(channel);  // what was to replace the queued samples is lost: silence, not the old ones
  return false;
}

// Of what the input does not know itself; changes the values to the input's frame.
Verdict RequestHandler::check_sample(const StreamChannel& channel, std::span<double> values) {
  const Instance& instance = run_.modes->instance(channel.instance);
  const InputSpec& input = instance.inputs()[channel.input].spec();
  if (input.quantity == Quantity::joints && joint_beyond_limit(model_of(channel.instance, input), values))
    return Verdict::out_of_bounds;
  if (channel.X_WB) to_world(input.quantity, *channel.X_WB, values);
  return beyond_reach(instance, input, values).empty() ? Verdict::accepted : Verdict::out_of_bounds;
}

void RequestHandler::deliver(const StreamPacket& packet, StreamChannel& channel, double age_s) {
  if (!begin_packet(packet, channel, age_s)) return;
  Reference& input = run_.modes->instance(channel.instance).inputs()[channel.input];
  Target target;
  target.delivery = Delivery::stream;
  target.size = static_cast<std::uint8_t>(packet.count);
  target.values = packet.values;
  const bool active = (run_.modes->active() & bit(channel.instance)) != 0;
  channel.verdict = active ? input.check(target) : Verdict::not_active;
  if (channel.verdict == Verdict::accepted)
    channel.verdict = check_sample(channel, std::span(target.values.data(), packet.count));
  if (channel.verdict == Verdict::accepted) channel.verdict = input.post(target);
  if (channel.verdict == Verdict::accepted) return;
  ++channel.refused;
  discard(channel);
}

void RequestHandler::deliver(const ChunkPacket& packet, StreamChannel& channel, double age_s) {
  if (!begin_packet(packet.head, channel, age_s)) return;
  Reference& input = run_.modes->instance(channel.instance).inputs()[channel.input];
  Chunk chunk = packet.chunk;
  run_.latest->copy(snapshot_);
  const bool active = (run_.modes->active() & bit(channel.instance)) != 0;
  channel.verdict = active ? input.check(chunk) : Verdict::not_active;
  if (channel.verdict == Verdict::accepted &&
      chunk.times_s[chunk.count - 1u] > snapshot_.t.seconds() + kFarthestSample)
    channel.verdict = Verdict::out_of_bounds;
  for (std::size_t k = 0; k < chunk.count && channel.verdict == Verdict::accepted; ++k)
    channel.verdict = check_sample(channel, std::span(chunk.values[k].data(), chunk.size));
  std::uint64_t number = 0;
  if (channel.verdict == Verdict::accepted) channel.verdict = input.post(chunk, number);
  if (channel.verdict == Verdict::accepted) {
    channel.chunk = number;
    return;
  }
  ++channel.refused;
  discard(channel);
}

void RequestHandler::discard(StreamChannel& channel) {
  run_.modes->instance(channel.instance).inputs()[channel.input].discard(channel.chunk);
  channel.chunk = 0;
}

// A new end effector is looked up only where the known one is too short.
std::string RequestHandler::beyond_reach(const Instance& instance, const InputSpec& input,
                                         std::span<const double> values) {
  std::string why = reach_.refusal(instance, input, values);
  if (why.empty() && reach_known_) return {};
  run_.latest->copy(snapshot_);
  if (snapshot_.cycle == 0) return {};
  reach_known_ = true;
  for (ArmIndex arm = 0; arm < snapshot_.arms.size(); ++arm) {
    if (!run_.mounts[arm]) reach_.set_end_effector(arm, snapshot_.arms[arm].frames.X_FE);
  }
  return reach_.refusal(instance, input, values);
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

const ArmModel& RequestHandler::model_of(InstanceIndex i, const InputSpec& input) const {
  return *run_.models[run_.modes->instance(i).arm_list()[input.arm]];
}

}  // namespace multipanda
