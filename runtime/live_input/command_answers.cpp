#include "arm_interface/arm_error.hpp"
#include "core/controllets/goal_parameters.hpp"
#include "core/state/arm_state.hpp"
#include "runtime/live_input/backend_requests.hpp"
#include "runtime/live_input/request_handler.hpp"
#include "runtime/request_text.hpp"

// Answers of the request handler: results, refusals, the list of controllets, the state.
namespace multipanda {
namespace {

using nlohmann::json;

double milliseconds(HostTime from, HostTime to) { return seconds(to - from) * 1e3; }

}  // namespace

json RequestHandler::refusal(Verdict verdict, const std::string& why) const {
  return {{"ok", false}, {"verdict", name_of(verdict)}, {"reason", why}};
}

json RequestHandler::answer_of(const Answer& answer, const Request& request) const {
  json out = answer.accepted()
                 ? json{{"ok", true}, {"verdict", "accepted"}}
                 : refusal(answer.verdict, reason(*run_.modes, request, answer.verdict, answer.rule));
  out["cycle"] = answer.cycle;
  out["t_s"] = answer.t.seconds();
  out["times_ms"] = {{"received_to_taken", milliseconds(answer.received, answer.taken)},
                     {"taken_to_first_torque", milliseconds(answer.taken, answer.first_torque)},
                     {"received_to_first_torque", milliseconds(answer.received, answer.first_torque)}};
  if (answer.kind != Request::Kind::switch_controllets || !answer.accepted()) return out;
  out["started"] = names_of(*run_.modes, answer.plan.start);
  out["stopped"] = names_of(*run_.modes, answer.plan.stop);
  out["kept"] = names_of(*run_.modes, answer.plan.keep);
  json& steps = out["torque_steps"] = json::array();
  for (ArmIndex a = 0; a < run_.modes->arm_count(); ++a) {
    bool handed_over = false;
    for (InstanceIndex i = 0; i < run_.modes->instance_count(); ++i) {
      handed_over =
          handed_over || ((answer.plan.start & bit(i)) != 0 && run_.modes->instance(i).arms().contains(a));
    }
    if (!handed_over) continue;
    steps.push_back({{"arm", run_.modes->arm_name(a)},
                     {"computed_nm", answer.step_requested[a]},
                     {"sent_nm", answer.step_sent[a]}});
  }
  return out;
}

// The load that the arm carries, as figures and as a sentence; none if its limit is unknown.
json RequestHandler::load_done(ArmIndex arm, double payload) const {
  if (arm >= run_.flanges.size()) return json::object();
  const FlangeLoad& flange = run_.flanges[arm];
  const double carried = flange.hand_and_tool + payload;
  json load{{"payload_kg", payload}, {"hand_and_tool_kg", flange.hand_and_tool}, {"carried_kg", carried}};
  if (flange.rated) load["rated_kg"] = *flange.rated;
  if (const auto most = flange.most()) {
    load["allowed_kg"] = *most;
    load["remaining_kg"] = *most - carried;
  }
  return {{"load", std::move(load)},
          {"message", run_.modes->arm_name(arm) + ": " + load_text(flange, payload)}};
}

json RequestHandler::describe(const StreamChannel& channel) const {
  const Instance& target = run_.modes->instance(channel.instance);
  return {{"controllet", target.name()},
          {"input", target.inputs()[channel.input].spec().name},
          {"received", channel.received},
          {"lost", channel.lost},
          {"late", channel.late},
          {"late_samples", target.inputs()[channel.input].late() - channel.late_before},
          {"refused", channel.refused},
          {"expired", channel.expired},
          {"sequence", channel.last},
          {"client_time_ns", channel.client_time_ns},
          {"verdict", name_of(channel.verdict)},
          {"reason", channel.reason}};
}

json RequestHandler::list() const {
  const MultimodeController& modes = *run_.modes;
  const InstanceSet active = modes.active();
  json arms = json::array(), controllets = json::array();
  for (ArmIndex a = 0; a < modes.arm_count(); ++a) {
    const ArmModel& model = *run_.models[a];
    const Quaternion q = model.X_WB().quaternion();
    const Vector3& p = model.X_WB().position;
    arms.push_back({{"name", modes.arm_name(a)},
                    {"joints", model.joint_count()},
                    {"home_rad", std::vector<double>(model.q_home().begin(), model.q_home().end())},
                    {"base_position_m", {p.x(), p.y(), p.z()}},
                    {"base_quaternion_wxyz", {q.w(), q.x(), q.y(), q.z()}}});
    // Omitted for carried arms: a client that takes a base for fixed would send poses to the wrong place.
    if (const auto& mount = run_.mounts[a]) {
      arms.back()["base_on"] = {{"arm", modes.arm_name(mount->carrier)}, {"joint", mount->joint + 1}};
      arms.back().erase("base_position_m");
      arms.back().erase("base_quaternion_wxyz");
    }
  }
  for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
    const Instance& instance = modes.instance(i);
    json inputs = json::array(), parameters = json::array(), features = json::array();
    for (const Reference& input : instance.inputs()) {
      const InputSpec& spec = input.spec();
      inputs.push_back({{"name", spec.name},
                        {"quantity", to_string(spec.quantity)},
                        {"keys", keys_of(spec.quantity).keys},
                        {"values", input.size()},
                        {"frame", spec.frame},
                        {"arm", modes.arm_name(instance.arm_list()[spec.arm])},
                        {"timeout_s", spec.timeout_s},
                        {"max_speed", spec.max_speed},
                        {"max_angular_speed", spec.max_angular_speed},
                        {"doc", spec.doc}});
    }
    for (std::size_t k = 0; k < instance.parameter_count(); ++k) {
      const ParameterSpec& spec = instance.parameter_spec(k);
      json parameter = {{"name", instance.parameter_names()[k]},
                        {"value", instance.parameter(k)},
                        {"moves", acts_as_goal(spec) || is_stiffness(spec)},
                        {"doc", spec.doc}};
      if (spec.choices.empty()) {
        parameter.update({{"unit", spec.unit}, {"min", spec.min}, {"max", spec.max}});
      } else {
        const auto chosen = static_cast<std::size_t>(instance.parameter(k)[0] + 0.5);
        parameter.update({{"choices", spec.choices}, {"value", spec.choices.at(chosen)}});
      }
      parameters.push_back(std::move(parameter));
    }
    for (std::size_t k = 0; k < instance.feature_count(); ++k) {
      features.push_back({{"name", instance.feature_descriptor(k).type},
                          {"on", instance.feature_on(k)},
                          {"doc", instance.feature_descriptor(k).doc},
                          {"refusal", instance.feature_refusal(k)}});
    }
    json names = json::array();
    for (const ArmIndex a : instance.arm_list()) names.push_back(modes.arm_name(a));
    controllets.push_back({{"name", instance.name()},
                           {"type", instance.descriptor().type},
                           {"doc", instance.descriptor().doc},
                           {"arms", names},
                           {"active", (active & bit(i)) != 0},
                           {"inputs", inputs},
                           {"parameters", parameters},
                           {"features", features}});
  }
  return {{"ok", true},
          {"version", MULTIPANDA_VERSION},
          {"scene", run_.scene},
          {"arms", arms},
          {"controllets", controllets}};
}

json RequestHandler::state() {
  const MultimodeController& modes = *run_.modes;
  run_.latest->copy(snapshot_);
  json arms = json::array();
  const std::uint32_t stops = modes.stops();
  const ArmSet stopped = modes.stopped();
  for (ArmIndex a = 0; a < modes.arm_count() && snapshot_.cycle != 0; ++a) {
    const ArmSample& sample = snapshot_.arms[a].sample;
    const auto n = static_cast<Eigen::Index>(run_.models[a]->joint_count());
    terms_[a].set_config(snapshot_.arms[a].frames, {}, {});
    const Eigen::Map<const Eigen::VectorXd> q(sample.q.data(), n), dq(sample.dq.data(), n);
    terms_[a].update(q, dq);
  }
  for (ArmIndex a = 0; a < modes.arm_count() && snapshot_.cycle != 0; ++a) {
    const auto& [sample, frames, last_intervention, removed_by, stop_reason, success] = snapshot_.arms[a];
    if (const auto& mount = run_.mounts[a]) terms_[a].stand_on(terms_[mount->carrier], *mount);
    const auto pose = terms_[a].X_WE().values();
    json arm = state_of(sample, run_.models[a]->joint_count());
    arm.update(
        {{"arm", modes.arm_name(a)},
         {"controllet", sample.owner < modes.instance_count() ? modes.instance(sample.owner).name() : ""},
         {"stopped", stopped.contains(a)},
         {"position_m", std::span(pose).first(3)},
         {"quaternion_wxyz", std::span(pose).last(4)},
         {"last_intervention", last_intervention},
         {"removed_by", rule_name(removed_by)}});
    if (!stop_reason.empty()) arm["reason"] = stop_reason;
    if (const auto packets = run_.backend->connection(a)) {
      arm["connection"] = {{"received", packets->received},
                           {"lost", packets->lost},
                           {"late", packets->superseded},
                           {"commands_missed", success.missed()},
                           {"command_success_rate", sample.command_success_rate}};
    }
    arms.push_back(std::move(arm));
  }
  json objects = json::object();
  for (std::size_t i = 0; run_.objects != nullptr && i < run_.objects->count(); ++i) {
    const auto X_WO = run_.objects->read(i);
    if (!X_WO) continue;
    const auto pose = X_WO->values();
    objects[run_.objects->name(i)] = {{"position_m", std::span(pose).first(3)},
                                      {"quaternion_wxyz", std::span(pose).last(4)}};
  }
  return {{"scene", run_.scene},
          {"objects", objects},
          {"cycle", snapshot_.cycle},
          {"t_s", snapshot_.t.seconds()},
          {"since_cycle_s", snapshot_.cycle == 0 ? 0.0 : seconds(host_now() - snapshot_.start)},
          {"rate_hz", snapshot_.rate_hz},
          {"cycle_us", snapshot_.cycle_us},
          {"overruns", snapshot_.overruns},
          {"stops", stops},
          {"arms", arms}};
}

}  // namespace multipanda
