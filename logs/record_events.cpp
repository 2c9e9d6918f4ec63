// The events' part of Recorder::Sink: numbers to names and sentences.
#include <limits>

#include "logs/record_messages.hpp"

namespace multipanda {
namespace {

constexpr std::uint16_t kNone = 0xFFFF;

}  // namespace

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
      if (event.arm < arms_.size()) {
        Arm& arm = arms_[event.arm];
        if (read_arm_config(event, arm.frames, arm.tool, arm.load)) write_config(arm, event.t, event.cycle);
      }
      return;
    default:
      write_other(event);
      return;
  }
}

void Recorder::Sink::write(const EpisodeMark& mark) {
  msg::Event out;
  out.stamp = to_time(mark.t.ns);
  out.cycle = mark.cycle;
  out.kind = "episode";
  out.verdict = to_string(Verdict::accepted);
  out.item = to_string(mark.kind);
  out.values = {static_cast<double>(mark.episode)};
  out.text = "episode " + std::to_string(mark.episode) + ": " + out.item;
  writer_.write(event_channel_, log_time(mark.t), out);
}

void Recorder::Sink::write_switch(const Event& event) {
  msg::Switch out;
  out.stamp = to_time(event.t.ns);
  words_.fill_switch(event, out);
  writer_.write(switch_channel_, log_time(event.t), out);
  if (event.received.ns == 0) return;  // a switch by the loop itself, without request

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
  out.arm = words_.arm_name(event.arm);
  out.instance = words_.instance_name(event.instance);
  out.joint = event.joint == kNone ? -1 : event.joint;
  out.value = event.size > 0 ? event.values[0] : kNotGiven;
  out.limit = event.size > 1 ? event.values[1] : kNotGiven;
  out.count = ++intervention_counts_[{event.arm, event.intervention}];
  writer_.write(intervention_channel_, log_time(event.t), out);
}

void Recorder::Sink::write_other(const Event& event) {
  msg::Event out;
  out.stamp = to_time(event.t.ns);
  words_.fill(event, out);
  writer_.write(event_channel_, log_time(event.t), out);
}

}  // namespace multipanda
