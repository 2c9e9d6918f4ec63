#pragma once

#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "core/record/arm_config.hpp"

// Turns events into messages: numbers become names and sentences. Message types are the log's structs or the
// ROS ones, generated from the same definitions. The caller sets the stamps.
namespace multipanda {

std::string_view to_string(EventKind kind);

// Names of the numbers in an event; empty: none.
class EventText {
 public:
  explicit EventText(const RecordLayout& layout) : layout_(layout) {}  // the layout must outlive this object

  std::string instance_name(std::uint16_t index) const;
  std::string arm_name(std::uint16_t index) const;
  std::vector<std::string> arm_names(std::uint32_t bits) const;
  std::vector<std::string> instance_names(std::uint64_t bits) const;
  std::string item_name(const Event& event) const;  // parameter, feature or input

  // Event descriptions.
  std::string of_switch(const Event& event) const;  // switched, switch_refused
  std::string of(const Event& event) const;         // all others

  // Fills multipanda_msgs/msg/Switch from `switched` and `switch_refused`.
  template <class Message>
  void fill_switch(const Event& event, Message& out) const {
    constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
    out.cycle = event.cycle;
    out.request = event.ticket;
    out.accepted = event.kind == EventKind::switched;
    out.verdict = to_string(event.verdict);
    out.text = of_switch(event);
    out.started = instance_names(event.started);
    out.stopped = instance_names(event.stopped);
    out.kept = instance_names(event.kept);
    for (std::size_t i = 0; i < layout_.arms.size(); ++i) {
      if ((event.arms >> i & 1u) == 0) continue;
      out.arms.push_back(layout_.arms[i].name);
      const bool known = event.size >= 2 * (i + 1);
      out.torque_step_computed.push_back(known ? event.values[2 * i] : kUnknown);
      out.torque_step.push_back(known ? event.values[2 * i + 1] : kUnknown);
    }
  }

  // Fills multipanda_msgs/msg/Event from any kind.
  template <class Message>
  void fill(const Event& event, Message& out) const {
    out.cycle = event.cycle;
    out.kind = to_string(event.kind);
    out.verdict = to_string(event.verdict);
    out.request = event.ticket;
    out.arms = arm_names(event.arms);
    if (const std::string arm = arm_name(event.arm); !arm.empty()) out.arms.push_back(arm);
    out.instance = instance_name(event.instance);
    out.item = item_name(event);
    out.values.assign(event.values.begin(), event.values.begin() + event.size);
    out.text = of(event);
  }

 private:
  const RecordLayout& layout_;
};

}  // namespace multipanda
