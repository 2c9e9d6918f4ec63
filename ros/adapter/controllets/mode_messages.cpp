#include "ros/adapter/controllets/mode_messages.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "runtime/request_text.hpp"

namespace multipanda::ros {
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
