#include "ros/adapter/controllets/mode_services.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/controllets/inputs.hpp"
#include "ros/adapter/controllets/parameter_services.hpp"
#include "runtime/request_text.hpp"

namespace multipanda::ros {

namespace {

using multipanda_msgs::srv::ListArms;
using multipanda_msgs::srv::ListFeatures;
using multipanda_msgs::srv::ResumeArms;
using multipanda_msgs::srv::SetFeatures;
using multipanda_msgs::srv::StopArms;

constexpr double kStopTimeout = 1.0;  // for a stop [s]

// Answers without the loop.
template <class S, class Make>
auto at_once(Make make) {
  return [make](const typename S::Request& request, const typename Service<S>::Reply& reply) {
    reply(make(request));
  };
}

}  // namespace

ModeServices::ModeServices(const AdapterContext& run, const std::vector<InputCodec>& codecs)
    : run_(run), codecs_(codecs) {
  const auto serve = [&]<class S>(const std::string& name, const std::string& doc,
                                  typename Service<S>::Callback callback) {
    services_.push_back(std::make_unique<Service<S>>(*run.executor, *run.node, "~/" + name,
                                                     Doc{"on request", doc}, std::move(callback)));
  };
  serve.template operator()<Switch>(
      "switch_controllets",
      "Changes which controllets run, at a cycle boundary; the first torque comes in the same cycle.",
      [this](const Switch::Request& request, const auto& reply) { switch_controllets(request, reply); });
  // With `compat: multipanda_ros2` its own types use its names.
  const bool its_names = run.options->compat != RosSection::Compat::multipanda_ros2;
  if (its_names) {
    serve.template operator()<Switch>("set_controllers",
                                      "As switch_controllets with `only: true`; the name in multipanda_ros2.",
                                      [this](Switch::Request request, const auto& reply) {
                                        request.only = true;
                                        switch_controllets(std::move(request), reply);
                                      });
  }
  for (const char* name : {"list_controllets", "get_controllers"}) {
    if (std::string(name) == "get_controllers" && !its_names) continue;
    serve.template operator()<List>(name, "All controllet instances: arms, inputs, outputs, parameters.",
                                    at_once<List>([this](const auto&) { return list_controllets(); }));
  }
  serve.template operator()<ListFeatures>(
      "list_features", "Features of one instance, or of all.",
      at_once<ListFeatures>([this](const auto& request) { return list_features(request.instance); }));
  serve.template operator()<ListArms>("list_arms", "All arms and their capabilities.",
                                      at_once<ListArms>([this](const auto&) { return list_arms(); }));
  serve.template operator()<SetFeatures>(
      "set_features", "Switches features of an instance, all in the same cycle.",
      [this](const SetFeatures::Request& request, const auto& reply) { set_features(request, reply); });
  services_.push_back(std::make_unique<Service<StopArms>>(
      *run.stops, *run.node, "~/stop",
      Doc{"on request",
          "Holds arms from the next cycle on, until resumed; with a wrong name all. Not a safety-rated "
          "stop."},
      [this](const StopArms::Request& request, const auto& reply) { stop(request, reply); }));
  serve.template operator()<ResumeArms>(
      "resume", "Ends a stop. The arms are held until a controllet is activated.",
      [this](const ResumeArms::Request& request, const auto& reply) { resume(request, reply); });
}

void ModeServices::switch_controllets(Switch::Request message, const Service<Switch>::Reply& reply) {
  const HostTime received = host_now();
  Refused refused;
  const auto request = switch_request(*run_.modes, message, refused);
  if (!request) {
    run_.count_request(false);
    return reply(refusal<Switch::Response>(refused));
  }
  request_loop(run_, {*request}, [this, request = *request, received, reply](const LoopAnswer& result) {
    run_.count_request(result.answer.accepted());
    reply(switch_response(*run_.modes, request, result.answer, received));
  });
}

void ModeServices::set_features(const SetFeatures::Request& message,
                                const Service<SetFeatures>::Reply& reply) {
  Refused refused;
  const auto requests = feature_requests(*run_.modes, message, refused);
  if (!requests) {
    run_.count_request(false);
    return reply(refusal<SetFeatures::Response>(refused));
  }
  request_loop(run_, *requests, [this, requests = *requests, reply](const LoopAnswer& result) {
    SetFeatures::Response response;
    const std::size_t bad = result.first_refused();
    response.accepted = bad == requests.size();
    const Verdict verdict = response.accepted ? Verdict::accepted : result.verdicts[bad];
    response.verdict = name_of(verdict);
    if (!response.accepted) response.reason = reason(*run_.modes, requests[bad], verdict);
    response.cycle = result.answer.cycle;
    run_.count_request(response.accepted);
    reply(response);
  });
}

void ModeServices::stop(const StopArms::Request& message, const Service<StopArms>::Reply& reply) {
  const HostTime received = host_now();
  Refused refused;
  MultimodeController* modes = run_.modes;
  const ArmSet arms = arms_named(*modes, message.arms, refused).value_or(ArmSet::all(modes->arm_count()));
  modes->stop(arms);
  run_.stops->poll_until([this, modes, arms, received, reply, wrong = refused.reason] {
    StopArms::Response response;
    if (!wrong.empty()) response.reason = wrong + ": all arms are stopped";
    response.total_s = seconds(host_now() - received);
    response.accepted = modes->stopped().contains(arms);
    if (!response.accepted && response.total_s <= kStopTimeout) return false;
    const Verdict verdict = response.accepted ? Verdict::accepted : Verdict::timeout;
    response.verdict = name_of(verdict);
    if (!response.accepted)
      response.reason =
          "no cycle ran for 1 s (is the run paused, or has it ended?); the arms stop at the next cycle";
    response.stopped = names_of(*modes, modes->stopped());
    run_.count_request(response.accepted);
    reply(response);
    return true;
  });
}

void ModeServices::resume(const ResumeArms::Request& message, const Service<ResumeArms>::Reply& reply) {
  Refused refused;
  const auto arms = arms_named(*run_.modes, message.arms, refused);
  if (!arms) {
    run_.count_request(false);
    return reply(refusal<ResumeArms::Response>(refused));
  }
  Request request{.kind = Request::Kind::resume};
  request.arms = *arms;
  request.stops = message.stops;
  request_loop(run_, {request}, [this, request, reply](const LoopAnswer& result) {
    ResumeArms::Response response;
    response.accepted = result.answer.accepted();
    response.verdict = name_of(result.answer.verdict);
    if (!response.accepted) response.reason = reason(*run_.modes, request, result.answer.verdict);
    response.cycle = result.answer.cycle;
    run_.count_request(response.accepted);
    reply(response);
  });
}

ModeServices::List::Response ModeServices::list_controllets() const {
  const MultimodeController& modes = *run_.modes;
  List::Response response;
  for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
    const Instance& instance = modes.instance(i);
    auto info = controllet_info(modes, i);
    for (const Reference& reference : instance.inputs()) {
      const InputSpec& spec = reference.spec();
      const InputCodec* codec = codec_for(codecs_, instance, spec);
      multipanda_msgs::msg::InputInfo input;
      input.name = spec.name;
      input.quantity = to_string(spec.quantity);
      input.topic = run_.node->resolve(topic_of(instance.name(), spec.name));
      input.type = codec != nullptr ? codec->message_type : message_type(spec.quantity);
      for (const InputCodec* more : more_codecs_for(codecs_, instance, spec)) {
        input.more_topics.push_back(input.topic + "/" + more->topic);
        input.more_types.push_back(more->message_type);
      }
      if (spec.quantity != Quantity::joints && spec.quantity != Quantity::scalar) {
        input.frame = spec.frame;
        input.frames.push_back(spec.frame);
        for (ArmIndex a = 0; spec.frame == kWorldFrame && a < modes.arm_count(); ++a)
          input.frames.push_back(base_frame(modes.arm_name(a)));
      }
      input.timeout = spec.timeout_s;
      input.max_speed = spec.max_speed;
      input.max_angular_speed = spec.max_angular_speed;
      input.doc = spec.doc;
      info.inputs.push_back(std::move(input));
    }
    for (const auto& spec : instance.output_specs()) {
      multipanda_msgs::msg::OutputInfo output;
      output.name = spec.name;
      output.topic = run_.node->resolve(topic_of(instance.name(), spec.name));
      output.type = spec.size == 1 ? "std_msgs/msg/Float64" : "std_msgs/msg/Float64MultiArray";
      output.size = static_cast<std::uint32_t>(spec.size);
      output.doc = spec.doc;
      info.outputs.push_back(std::move(output));
    }
    response.controllets.push_back(std::move(info));
  }
  return response;
}

ListFeatures::Response ModeServices::list_features(const std::string& name) const {
  const MultimodeController& modes = *run_.modes;
  ListFeatures::Response response;
  for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
    const Instance& instance = modes.instance(i);
    if (!name.empty() && instance.name() != name) continue;
    for (std::size_t k = 0; k < instance.feature_count(); ++k)
      response.features.push_back(feature_info(instance, k));
  }
  return response;
}

ListArms::Response ModeServices::list_arms() const {
  const MultimodeController& modes = *run_.modes;
  ListArms::Response response;
  const ArmSet stopped = modes.stopped();
  for (ArmIndex a = 0; a < modes.arm_count(); ++a) {
    const Capabilities can = run_.backend->capabilities(a);
    multipanda_msgs::msg::ArmInfo info;
    info.name = modes.arm_name(a);
    info.model = run_.scene->arms[a].model;
    info.joint_names = joint_names(info.name, run_.models[a]->joint_count());
    info.base_frame = base_frame(info.name);
    info.end_effector_frame = info.name + "_ee";
    const InstanceIndex owner = modes.owner(a);
    info.owner = owner < modes.instance_count() ? modes.instance(owner).name() : "";
    info.stopped = stopped.contains(a);
    info.mode = modes_of_arms_[a].load(std::memory_order_relaxed);
    info.simulated = can.simulated;
    info.has_external_torque = can.has_external_torque;
    info.has_contact_truth = can.has_contact_truth;
    info.has_gripper = can.has_gripper;
    info.has_vacuum = can.has_vacuum;
    info.period = run_.backend->period();
    response.arms.push_back(std::move(info));
  }
  return response;
}

void ModeServices::take(const CycleRecord& record) {
  for (std::size_t a = 0; a < record.arms.size(); ++a)
    modes_of_arms_[a].store(record.arms[a].mode, std::memory_order_relaxed);
}

namespace {

bool add(const MultimodeController& modes, const std::vector<std::string>& names, InstanceSet& set,
         Refused& refused) {
  for (const auto& name : names) {
    const InstanceIndex i = modes.find(name);
    if (i == kNoInstance) {
      refused = {"unknown_instance", no_such_controllet(modes, name)};
      return false;
    }
    set |= bit(i);
  }
  return true;
}

std::vector<std::string> feature_parameters(const Instance& instance, const std::string& feature) {
  std::vector<std::string> names;
  for (const auto& name : instance.parameter_names()) {
    if (name.starts_with(feature + ".")) names.push_back(instance.name() + "." + name);
  }
  return names;
}

}  // namespace

std::optional<Request> switch_request(const MultimodeController& modes,
                                      const multipanda_msgs::srv::SwitchControllets::Request& message,
                                      Refused& refused) {
  Request request{.kind = Request::Kind::switch_controllets};
  request.only = message.only;
  if (!add(modes, message.activate, request.activate, refused) ||
      !add(modes, message.deactivate, request.deactivate, refused)) {
    return {};
  }
  if (request.activate == 0 && request.deactivate == 0 && !request.only) {
    refused = {"malformed",
               "switches nothing; expected 'activate' or 'deactivate' with names of controllets"};
    return {};
  }
  if (const InstanceSet both = request.activate & request.deactivate; both != 0) {
    refused = {"malformed", "'" + names_of(modes, both).front() + "' is in activate and in deactivate"};
    return {};
  }
  return request;
}

std::optional<std::vector<Request>> feature_requests(
    const MultimodeController& modes, const multipanda_msgs::srv::SetFeatures::Request& message,
    Refused& refused) {
  const InstanceIndex i = modes.find(message.instance);
  if (i == kNoInstance) {
    refused = {"unknown_instance", no_such_controllet(modes, message.instance)};
    return {};
  }
  if (message.features.empty() || message.features.size() != message.on.size()) {
    refused = {"malformed", fmt::format("{} features with {} values of 'on'; expected one value per feature",
                                        message.features.size(), message.on.size())};
    return {};
  }
  const Instance& instance = modes.instance(i);
  std::vector<Request> requests;
  for (std::size_t k = 0; k < message.features.size(); ++k) {
    const std::size_t index = instance.find_feature(message.features[k]);
    if (index == instance.feature_count()) {
      refused = {"unknown_feature", no_such_feature(instance, message.features[k])};
      return {};
    }
    Request request{.kind = Request::Kind::set_feature};
    request.instance = i;
    request.index = static_cast<std::uint16_t>(index);
    request.on = message.on[k];
    requests.push_back(request);
  }
  return requests;
}

std::optional<ArmSet> arms_named(const MultimodeController& modes, const std::vector<std::string>& names,
                                 Refused& refused) {
  if (names.empty()) return ArmSet::all(modes.arm_count());
  const auto all = names_of(modes, ArmSet::all(modes.arm_count()));
  ArmSet arms;
  for (const auto& name : names) {
    const auto found = std::find(all.begin(), all.end(), name);
    if (found == all.end()) {
      refused = {"unknown_arm", no_such_arm(modes, name)};
      return {};
    }
    arms |= ArmSet::of(static_cast<ArmIndex>(found - all.begin()));
  }
  return arms;
}

multipanda_msgs::srv::SwitchControllets::Response switch_response(const MultimodeController& modes,
                                                                  const Request& request,
                                                                  const Answer& answer, HostTime received) {
  multipanda_msgs::srv::SwitchControllets::Response response;
  response.accepted = answer.accepted();
  response.verdict = name_of(answer.verdict);
  if (!answer.accepted()) {
    response.reason = reason(modes, request, answer.verdict, answer.rule);
    response.cycle = answer.cycle;
    return response;
  }
  response.started = names_of(modes, answer.plan.start);
  response.stopped = names_of(modes, answer.plan.stop);
  response.kept = names_of(modes, answer.plan.keep);
  response.cycle = answer.cycle;
  response.waiting_s = seconds(answer.taken - received);
  response.computing_s = seconds(answer.first_torque - answer.taken);
  response.total_s = seconds(answer.first_torque - received);
  response.first_torque_ns = answer.first_torque.ns;
  for (ArmIndex a = 0; a < modes.arm_count(); ++a) {
    for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
      if ((answer.plan.start & bit(i)) == 0 || !modes.instance(i).arms().contains(a)) continue;
      response.arms.push_back(modes.arm_name(a));
      response.torque_step.push_back(answer.step_sent[a]);
      break;
    }
  }
  return response;
}

multipanda_msgs::msg::FeatureInfo feature_info(const Instance& instance, std::size_t feature) {
  multipanda_msgs::msg::FeatureInfo info;
  const ControlletDescriptor& descriptor = instance.feature_descriptor(feature);
  info.instance = instance.name();
  info.name = descriptor.type;
  info.doc = descriptor.doc;
  info.on = instance.feature_on(feature);
  info.refusal = std::string(instance.feature_refusal(feature));
  info.parameters = feature_parameters(instance, descriptor.type);
  return info;
}

multipanda_msgs::msg::ControlletInfo controllet_info(const MultimodeController& modes, InstanceIndex i) {
  const Instance& instance = modes.instance(i);
  multipanda_msgs::msg::ControlletInfo info;
  info.name = instance.name();
  info.type = instance.descriptor().type;
  info.doc = instance.descriptor().doc;
  for (const ArmIndex a : instance.arm_list()) info.arms.push_back(modes.arm_name(a));
  info.active = (modes.active() & bit(i)) != 0;
  for (const auto& name : instance.parameter_names()) info.parameters.push_back(instance.name() + "." + name);
  for (std::size_t k = 0; k < instance.feature_count(); ++k)
    info.features.push_back(instance.feature_descriptor(k).type);
  return info;
}

}  // namespace multipanda::ros
