#include "logs/event_text.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>

#include "core/state/arm_state.hpp"

namespace multipanda {
namespace {

constexpr std::array<std::string_view, 3> kGoalEnds = {"force_n", "torque_nm", "distance_m"};

std::string listed(const std::vector<std::string>& names) {
  std::string out;
  for (const std::string& name : names) out += (out.empty() ? "" : ", ") + name;
  return out.empty() ? "none" : out;
}

std::string numbers(const Event& event) {
  std::string out;
  for (std::size_t i = 0; i < event.size; ++i) {
    char text[32];
    out.append(i > 0 ? " " : "");
    out.append(text, std::to_chars(text, text + sizeof(text), event.values[i]).ptr);
  }
  return out;
}

}  // namespace

std::string_view to_string(EventKind kind) {
  switch (kind) {
    case EventKind::switched:
      return "switched";
    case EventKind::switch_refused:
      return "switch_refused";
    case EventKind::intervention:
      return "intervention";
    case EventKind::parameter_set:
      return "parameter_set";
    case EventKind::feature_set:
      return "feature_set";
    case EventKind::target_set:
      return "target_set";
    case EventKind::stopped:
      return "stopped";
    case EventKind::resumed:
      return "resumed";
    case EventKind::arm_config:
      return "arm_config";
    case EventKind::arm_mode:
      return "arm_mode";
    case EventKind::goal_ended:
      return "goal_ended";
  }
  return "unknown";
}

std::string EventText::instance_name(std::uint16_t index) const {
  return index < layout_.instances.size() ? layout_.instances[index].name : std::string();
}

std::string EventText::arm_name(std::uint16_t index) const {
  return index < layout_.arms.size() ? layout_.arms[index].name : std::string();
}

std::vector<std::string> EventText::arm_names(std::uint32_t bits) const {
  std::vector<std::string> out;
  for (std::size_t i = 0; i < layout_.arms.size(); ++i) {
    if ((bits >> i & 1u) != 0) out.push_back(layout_.arms[i].name);
  }
  return out;
}

std::vector<std::string> EventText::instance_names(std::uint64_t bits) const {
  std::vector<std::string> out;
  for (std::size_t i = 0; i < layout_.instances.size(); ++i) {
    if ((bits >> i & 1u) != 0) out.push_back(layout_.instances[i].name);
  }
  return out;
}

std::string EventText::item_name(const Event& event) const {
  if (event.instance >= layout_.instances.size()) return {};
  const auto& instance = layout_.instances[event.instance];
  switch (event.kind) {
    case EventKind::parameter_set:
      return event.index < instance.parameters.size() ? instance.parameters[event.index] : std::string();
    case EventKind::feature_set:
      return event.index < instance.features.size() ? instance.features[event.index] : std::string();
    case EventKind::target_set:
    case EventKind::goal_ended:
      return event.index < instance.inputs.size() ? instance.inputs[event.index].name : std::string();
    default:
      return {};
  }
}

std::string EventText::of_switch(const Event& event) const {
  const std::string started = listed(instance_names(event.started)),
                    stopped = listed(instance_names(event.stopped));
  if (event.kind != EventKind::switched) {
    return "refused (" + std::string(to_string(event.verdict)) + "): start " + started + "; stop " + stopped;
  }
  std::string text = "started " + started + "; stopped " + stopped;
  if (event.intervention != Intervention::none) {
    text += "; because of " + std::string(to_string(event.intervention)) + " by " +
            instance_name(event.instance) + " on " + arm_name(event.arm);
  }
  return text;
}

std::string EventText::of(const Event& event) const {
  if (event.kind == EventKind::switched || event.kind == EventKind::switch_refused) return of_switch(event);
  const std::string item = instance_name(event.instance) + "." + item_name(event);
  std::vector<std::string> arms = arm_names(event.arms);
  if (const std::string arm = arm_name(event.arm); !arm.empty()) arms.push_back(arm);
  std::string text;
  switch (event.kind) {
    case EventKind::parameter_set:
      text = item + " = " + numbers(event);
      break;
    case EventKind::target_set:
      text = item + " to " + numbers(event);
      break;
    case EventKind::goal_ended: {
      const auto cause = static_cast<std::size_t>(event.values[0]);
      const bool known = std::isfinite(event.values[1]);
      std::array<char, 64> values{};
      std::snprintf(values.data(), values.size(), known ? " %.3g of %.3g" : " not known", event.values[1],
                    event.values[2]);
      text =
          item + " ended by " + std::string(kGoalEnds.at(cause)) + values.data() + " (" + listed(arms) + ")";
      break;
    }
    case EventKind::feature_set:
      text = item + (event.values[0] != 0 ? " on" : " off");
      break;
    case EventKind::stopped:
      text = "stop: " + listed(arms);
      break;
    case EventKind::resumed:
      text = "resume: " + listed(arms);
      break;
    case EventKind::arm_mode:
      text = listed(arms) + ": " + std::string(to_string(static_cast<ArmMode>(event.index)));
      break;
    case EventKind::intervention:
      text = listed(arms) + ": " + std::string(to_string(event.intervention));
      if (event.instance != 0xFFFF) text += " by " + instance_name(event.instance);
      break;
    default:
      break;
  }
  if (event.verdict != Verdict::accepted) text += " refused: " + std::string(to_string(event.verdict));
  return text;
}

}  // namespace multipanda
