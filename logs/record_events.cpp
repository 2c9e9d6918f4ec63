// The events' half of Recorder::Sink: numbers to names and sentences.
#include <charconv>
#include <limits>

#include "logs/record_messages.hpp"

namespace multipanda {
namespace {

constexpr std::uint16_t kNone = 0xFFFF;

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

std::string_view mode_name(std::uint16_t mode) {
  switch (static_cast<ArmMode>(mode)) {
    case ArmMode::other:
      return "other";
    case ArmMode::idle:
      return "idle";
    case ArmMode::move:
      return "move";
    case ArmMode::guiding:
      return "guiding";
    case ArmMode::reflex:
      return "reflex";
    case ArmMode::user_stopped:
      return "user stopped";
    case ArmMode::recovering:
      return "recovering";
    case ArmMode::disconnected:
      return "disconnected";
  }
  return "unknown";
}

Pose take_pose(const double* v) { return Pose::from({v[0], v[1], v[2]}, Quaternion(v[3], v[4], v[5], v[6])); }

// Mass, centre of mass and, where given, inertia (xx xy xz yy yz zz). Without it, that of `before` if it is
// the same body.
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

std::string Recorder::Sink::instance_name(std::uint16_t index) const {
  return index < layout_.instances.size() ? layout_.instances[index].name : std::string();
}

std::string Recorder::Sink::arm_name(std::uint16_t index) const {
  return index < layout_.arms.size() ? layout_.arms[index].name : std::string();
}

std::vector<std::string> Recorder::Sink::arm_names(std::uint32_t bits) const {
  std::vector<std::string> out;
  for (std::size_t i = 0; i < layout_.arms.size(); ++i) {
    if ((bits >> i & 1u) != 0) out.push_back(layout_.arms[i].name);
  }
  return out;
}

std::vector<std::string> Recorder::Sink::instance_names(std::uint64_t bits) const {
  std::vector<std::string> out;
  for (std::size_t i = 0; i < layout_.instances.size(); ++i) {
    if ((bits >> i & 1u) != 0) out.push_back(layout_.instances[i].name);
  }
  return out;
}

std::string Recorder::Sink::item_name(const Event& event) const {
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

void Recorder::Sink::write(const Event& event) {
  switch (event.kind) {
    case EventKind::switched:
    case EventKind::switch_refused:
      write_switch(event);
      return;
    case EventKind::intervention:
      write_intervention(event);
      return;
    case EventKind::arm_config:
      // Two poses, two bodies: 7 + 7 + 4 + 4 numbers, 6 more for each body where its inertia is given.
      if (event.arm < arms_.size() && (event.size == 22 || event.size == 34)) {
        Arm& arm = arms_[event.arm];
        const bool with_inertia = event.size == 34;
        arm.frames = {take_pose(&event.values[0]), take_pose(&event.values[7])};
        arm.tool = take_load(&event.values[14], with_inertia, arm.tool);
        arm.load = take_load(&event.values[with_inertia ? 24 : 18], with_inertia, arm.load);
        write_config(arm, event.t, event.cycle);
      }
      return;
    default:
      write_other(event);
      return;
  }
}

void Recorder::Sink::write_switch(const Event& event) {
  msg::Switch out;
  out.stamp = to_time(event.t.ns);
  out.cycle = event.cycle;
  out.request = event.ticket;
  out.accepted = event.kind == EventKind::switched;
  out.verdict = to_string(event.verdict);
  out.started = instance_names(event.started);
  out.stopped = instance_names(event.stopped);
  out.kept = instance_names(event.kept);
  if (out.accepted) {
    out.text = "started " + joined(out.started) + "; stopped " + joined(out.stopped);
    if (event.intervention != Intervention::none) {
      out.text += "; because of " + std::string(to_string(event.intervention)) + " by " +
                  instance_name(event.instance) + " on " + arm_name(event.arm);
    }
  } else {
    out.text =
        "refused (" + out.verdict + "): start " + joined(out.started) + "; stop " + joined(out.stopped);
  }
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    if ((event.arms >> i & 1u) == 0) continue;
    out.arms.push_back(arms_[i].name);
    const bool known = event.size >= 2 * (i + 1);
    constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
    out.torque_step_wanted.push_back(known ? event.values[2 * i] : kUnknown);
    out.torque_step.push_back(known ? event.values[2 * i + 1] : kUnknown);
  }
  writer_.write(switch_channel_, log_time(event.t), out);
  if (event.received.ns == 0) return;  // the loop's own doing: nobody waited for it

  msg::SwitchTiming timing;
  timing.stamp = out.stamp;
  timing.cycle = event.cycle;
  timing.request = event.ticket;
  timing.waiting = seconds(event.taken - event.received);
  timing.computing = seconds(event.first_torque - event.taken);
  timing.total = seconds(event.first_torque - event.received);
  writer_.write(switch_timing_channel_, log_time(event.t), timing);
}

void Recorder::Sink::write_intervention(const Event& event) {
  constexpr double kNotGiven = std::numeric_limits<double>::quiet_NaN();
  msg::Intervention out;
  out.stamp = to_time(event.t.ns);
  out.cycle = event.cycle;
  out.code = to_string(event.intervention);
  out.arm = arm_name(event.arm);
  out.instance = instance_name(event.instance);
  out.joint = event.joint == kNone ? -1 : event.joint;
  out.value = event.size > 0 ? event.values[0] : kNotGiven;
  out.limit = event.size > 1 ? event.values[1] : kNotGiven;
  out.count = ++intervention_counts_[{event.arm, event.intervention}];
  writer_.write(intervention_channel_, log_time(event.t), out);
}

void Recorder::Sink::write_other(const Event& event) {
  msg::Event out;
  out.stamp = to_time(event.t.ns);
  out.cycle = event.cycle;
  out.kind = to_string(event.kind);
  out.verdict = to_string(event.verdict);
  out.request = event.ticket;
  out.arms = arm_names(event.arms);
  if (event.arm != kNone) out.arms.push_back(arm_name(event.arm));
  out.instance = instance_name(event.instance);
  out.item = item_name(event);
  out.values.assign(event.values.begin(), event.values.begin() + event.size);
  const std::string item = out.instance + "." + out.item;
  switch (event.kind) {
    case EventKind::parameter_set:
      out.text = item + " = " + numbers(event);
      break;
    case EventKind::target_set:
      out.text = item + " to " + numbers(event);
      break;
    case EventKind::feature_set:
      out.text = item + (event.values[0] != 0 ? " on" : " off");
      break;
    case EventKind::stopped:
      out.text = "stop: " + joined(out.arms);
      break;
    case EventKind::resumed:
      out.text = "resume: " + joined(out.arms);
      break;
    case EventKind::arm_mode:
      out.text = joined(out.arms) + ": " + std::string(mode_name(event.index));
      break;
    default:
      break;
  }
  if (event.verdict != Verdict::accepted) out.text += " refused: " + out.verdict;
  writer_.write(event_channel_, log_time(event.t), out);
}

}  // namespace multipanda
