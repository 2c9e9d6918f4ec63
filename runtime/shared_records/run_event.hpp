#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "logs/event_text.hpp"

namespace multipanda {

// An event in a run.
struct RunEvent {
  std::uint64_t cycle = 0;
  LoopTime t;
  std::string kind;  // docs/live_input.md lists them
  std::string arm;   // empty: no single arm
  std::string text;
};

// Derives events from all records, so that none is missed between two polls. One thread, which takes events
// and records in the loop's order.
class RunEvents {
 public:
  // A contact begins at this force or torque and ends when it is below kRelease of it for kRest, to avoid
  // flicker. These are the thresholds at which real arms report contact (arm_interface/arm_settings.hpp).
  static constexpr double kForce = 20, kTorque = 20;  // [N], [N m] in a joint
  static constexpr double kRelease = 0.75;            // [1]
  static constexpr double kRest = 0.05;               // [s]

  explicit RunEvents(const RecordLayout& layout);

  std::vector<RunEvent> take(const Event& event);
  // `reasons`: by arm name, why arms stopped themselves with errors that begin in this record.
  std::vector<RunEvent> take(const CycleRecord& record, const std::map<std::string, std::string>& reasons);

 private:
  struct Arm {
    std::string name;
    std::size_t joints = 0;
    bool known = false;  // a record was seen
    std::uint16_t owner = 0;
    std::uint64_t errors = 0;
    bool grasped = false, in_contact = false;
    LoopTime pressed;  // last time above the release threshold
  };

  void add(std::vector<RunEvent>& out, const CycleRecord& record, const Arm& arm, const char* kind,
           std::string text) const;
  void watch_contact(std::vector<RunEvent>& out, const CycleRecord& record, Arm& arm,
                     const ArmSample& sample) const;

  const RecordLayout layout_;
  EventText words_{layout_};
  std::vector<Arm> arms_;
};

}  // namespace multipanda
