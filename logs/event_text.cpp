#include "logs/event_text.hpp"

#include <charconv>

#include "core/state/arm_mode_name.hpp"

namespace multipanda {
namespace {

std::string joined(const std::vector<std::string>& names) {
  std::string out;
  for (const std::string& name : names) {
    if (!out.empty()) out += ", ";
    out += name;
  }
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

Pose take_pose(const double* v) { return Pose::from({v[0], v[1], v[2]}, Quaternion(v[3], v[4], v[5], v[6])); }

// Mass, center of mass and, if present, inertia (xx xy xz yy yz zz). Without inertia, the one of `before` is
// kept if mass and center are the same.
Load take_load(const double* v, bool with_inertia, const Load& before) {
  Load load;
  load.mass = v[0];
  load.p_FC = {v[1], v[2], v[3]};
  if (with_inertia) {
    load.inertia_C << v[4], v[5], v[6], v[5], v[7], v[8], v[6], v[8], v[9];
  } else if (load.mass == before.mass && load.p_FC == before.p_FC) {
    load.inertia_C = before.inertia_C;
  }
  return load;
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
      return event.index < instance.inputs.size() ? instance.inputs[event.index].name : std::string();
    default:
      return {};
  }
}

bool read_arm_config(const Event& event, ArmFrames& frames, Load& tool, Load& load) {
  // Two poses, two bodies: 7 + 7 + 4 + 4 numbers, and 6 more for each body if its inertia is included.
  if (event.kind != EventKind::arm_config || (event.size != 22 && event.size != 34)) return false;
  const bool with_inertia = event.size == 34;
  frames = {take_pose(&event.values[0]), take_pose(&event.values[7])};
  tool = take_load(&event.values[14], with_inertia, tool);
  load = take_load(&event.values[with_inertia ? 24 : 18], with_inertia, load);
  return true;
}

std::string EventText::of_switch(const Event& event) const {
  const std::string started = joined(instance_names(event.started)),
                    stopped = joined(instance_names(event.stopped));
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
    case EventKind::feature_set:
      text = item + (event.values[0] != 0 ? " on" : " off");
      break;
    case EventKind::stopped:
      text = "stop: " + joined(arms);
      break;
    case EventKind::resumed:
      text = "resume: " + joined(arms);
      break;
    case EventKind::arm_mode:
      text = joined(arms) + ": " + std::string(to_string(static_cast<ArmMode>(event.index)));
      break;
    case EventKind::intervention:
      text = joined(arms) + ": " + std::string(to_string(event.intervention));
      if (event.instance != 0xFFFF) text += " by " + instance_name(event.instance);
      break;
    default:
      break;
  }
  if (event.verdict != Verdict::accepted) text += " refused: " + std::string(to_string(event.verdict));
  return text;
}

}  // namespace multipanda
