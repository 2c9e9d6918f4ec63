#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "core/rt/spsc_ring.hpp"
#include "core/state/arm_sample.hpp"
#include "core/types/capacity.hpp"
#include "core/types/codes.hpp"
#include "core/types/time.hpp"

// Records of the loop: one per cycle, and one event per change, as plain numbers in preallocated slots. Names
// are stored once (RecordLayout); the reader composes the text.
namespace multipanda {

struct ReferenceSample {
  std::uint16_t instance = 0;
  std::uint8_t input = 0;
  std::uint8_t size = 0;
  bool streaming = false;
  std::array<double, kMaxTargetValues> values{}, rates{};
};

// Durations of the stages of one cycle [ns].
struct StageTimes {
  std::int32_t read = 0, controllets = 0, features = 0, safety = 0, write = 0, total = 0;
};

struct CycleRecord {
  std::uint64_t cycle = 0;
  LoopTime t;
  HostTime start;              // of the cycle, on this computer's clock
  double period_s = 0;         // since the previous cycle
  std::uint64_t overruns = 0;  // so far
  StageTimes stages;
  std::vector<ArmSample> arms;              // all arms of the scene
  std::vector<ReferenceSample> references;  // capacity; the first `reference_count` are valid
  std::size_t reference_count = 0;
  std::vector<double> outputs;  // of every instance, at RecordLayout's offsets; NaN where not active

  CycleRecord() = default;
  CycleRecord(std::size_t arm_count, std::size_t max_references, std::size_t output_count)
      : arms(arm_count), references(max_references), outputs(output_count) {}
};

// An event of one cycle.
enum class EventKind : std::uint8_t {
  switched,  // instances started/stopped: one event per switch
  switch_refused,
  intervention,   // value a: measured, b: limit
  parameter_set,  // index: parameter; values: new values
  feature_set,    // index: feature; values[0]: 1 on, 0 off
  target_set,     // index: input; values: target (goals only; streams are in the references)
  stopped,        // arms
  resumed,        // arms
  // index: version; values: X_FE (7), X_EK (7), then of tool and load: mass, center, inertia xx xy xz yy yz
  // zz (10 each)
  arm_config,
  arm_mode,    // index: new mode
  goal_ended,  // index: input; values: cause (GoalEnd::Cause), measured, limit
};

struct Event {
  EventKind kind = EventKind::switched;
  Intervention intervention = Intervention::none;
  Verdict verdict = Verdict::accepted;
  LoopTime t;
  std::uint64_t cycle = 0;
  std::uint64_t ticket = 0;         // request that it answers; 0: caused by the loop
  std::uint16_t instance = 0xFFFF;  // 0xFFFF: none
  std::uint16_t arm = 0xFFFF;       // 0xFFFF: none
  std::uint16_t index = 0xFFFF;
  std::uint16_t joint = 0xFFFF;
  std::uint32_t arms = 0;                            // ArmSet bits
  std::uint64_t started = 0, stopped = 0, kept = 0;  // instance bits
  HostTime received, taken, first_torque;            // of a switch
  std::uint8_t size = 0;
  std::array<double, 34> values{};  // switched: torque step per arm [N m], largest joint
};

// Keeps the rule that took an arm from its last controllet, whatever acts on its hold afterwards; none: it
// has one, or a request took it. The first instances are the arms' holds.
inline void note_removal(const Event& event, std::size_t arm, Intervention& removed_by) {
  if (event.kind != EventKind::switched || ((event.started | event.stopped) >> arm & 1) == 0) return;
  removed_by = (event.started >> arm & 1) != 0 ? event.intervention : Intervention::none;
}

// Names of the recorded numbers; fixed before the loop starts.
struct RecordLayout {
  struct Arm {
    std::string name;
    std::size_t joint_count = 0;
  };
  struct Input {
    std::string name, quantity, frame;
  };
  struct Output {
    std::string name;
    std::size_t offset = 0, size = 0;  // in CycleRecord::outputs
  };
  struct Instance {
    std::string name, type;
    std::uint32_t arms = 0;  // ArmSet bits
    std::vector<Input> inputs;
    std::vector<std::string> parameters;
    std::vector<std::string> features;
    std::vector<Output> outputs;
  };
  std::vector<Arm> arms;
  std::vector<Instance> instances;
  std::size_t output_count = 0;
  std::size_t max_references = 0;
};

// From the loop to the writer. If the writer falls behind, the loop drops records, counts them and continues.
class RecordRing {
 public:
  RecordRing(const RecordLayout& layout, std::size_t capacity)
      : ring(capacity, CycleRecord(layout.arms.size(), layout.max_references, layout.output_count)),
        events(4096) {}

  SpscRing<CycleRecord> ring;
  SpscRing<Event> events;
  std::atomic<std::uint64_t> dropped_records{0}, dropped_events{0};  // written by the loop
};

}  // namespace multipanda
