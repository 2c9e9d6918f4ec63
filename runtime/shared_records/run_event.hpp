#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "logs/event_text.hpp"

namespace multipanda {

// Something that happened in a run.
struct RunEvent {
  std::uint64_t cycle = 0;
  LoopTime t;
  std::string kind;  // docs/shared_records.md lists them
  std::string arm;   // empty: of no single arm
  std::string text;
};

// Makes them from everything that the loop records: none comes and goes between two looks. One thread, which
// takes events and records in the loop's order.
class RunEvents {
 public:
  // A contact begins at this force or torque and ends after kRest below kRelease of it, so that it does not
  // flicker. The figures are those from which real arms report contact (device/arm_settings.hpp).
  static constexpr double kForce = 20, kTorque = 20;  // [N], [N m] in a joint
  static constexpr double kRelease = 0.75;            // [1]
  static constexpr double kRest = 0.05;               // [s]

  explicit RunEvents(const RecordLayout& layout);

  std::vector<RunEvent> take(const Event& event);
  // `reasons`: why arms stopped themselves, by their names, where their errors begin with this record.
  std::vector<RunEvent> take(const CycleRecord& record, const std::map<std::string, std::string>& reasons);

 private:
  struct Arm {
    std::string name;
    std::size_t joints = 0;
    bool known = false;  // a record was seen
    std::uint16_t owner = 0;
    std::uint64_t errors = 0;
    bool grasped = false, in_contact = false;
    LoopTime pressed;  // last time above the release
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
