#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/model/model_terms.hpp"
#include "core/record/cycle_record.hpp"
#include "core/record/record_fields.hpp"
#include "core/types/arm_set.hpp"
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

// Memory that this process writes and that others, with its descriptor, can only read. Seals fix its size and
// prevent later writable mappings: no reader can change the contents or truncate the memory. All pages are
// allocated from the start, so that no write waits for one.
class SealedMemory {
 public:
  // `name`: shown in /proc. Throws std::runtime_error, for example on a kernel before 5.1.
  SealedMemory(const std::string& name, std::size_t bytes);
  ~SealedMemory();
  SealedMemory(const SealedMemory&) = delete;
  SealedMemory& operator=(const SealedMemory&) = delete;

  std::byte* data() const { return data_; }
  std::size_t size() const { return size_; }
  int file() const { return file_; }  // descriptor to pass on

 private:
  int file_ = -1;
  std::byte* data_ = nullptr;
  std::size_t size_;
};

// The newest records and events of a run in memory that other processes map and read
// (docs/live_input.md). Only the thread that takes the loop's records writes; the loop does not touch this
// memory, so readers cannot affect it. The writer never waits. A reader copies a record and checks by its
// number whether it was overwritten meanwhile.
class SharedRecords {
 public:
  static constexpr std::size_t kRecords = 2048;  // 2 s at 1 kHz
  static constexpr std::size_t kEvents = 512;
  static constexpr std::size_t kEventBytes = 1024;

  // `frames`: of each arm at the start; changes come as events. `mounts`: per arm, for arms carried by
  // another one; empty: none. Throws std::runtime_error if memory is not available.
  SharedRecords(const std::string& scene, const RecordLayout& layout,
                const std::vector<std::shared_ptr<const ArmModel>>& models,
                const std::vector<ArmFrames>& frames,
                const std::vector<std::optional<BaseMount>>& mounts = {});

  // --- the writing thread ---
  // Before the record of its cycle.
  void take(const Event& event);
  // `stopped`: arms until they are resumed.
  void take(const CycleRecord& record, ArmSet stopped);
  void take(const RunEvent& event);
  void count_lost(std::uint64_t records, std::uint64_t events);  // dropped by the loop

  // --- any thread ---
  const SealedMemory& memory() const { return *memory_; }
  const std::string& table() const { return table_; }  // JSON: the fields, and names for numbers
  const std::string& hash() const { return hash_; }    // of the table, 16 digits

 private:
  // At the start of the memory; all numbers little-endian.
  struct Header {
    char magic[8];
    std::uint64_t table_bytes, table_hash, bytes;
    std::uint64_t reserved[4];
    std::uint64_t records, records_lost, events, events_lost;  // so far
  };
  struct Reference {
    std::size_t offset = 0, size = 0;  // in the record
  };
  struct Arm {
    std::size_t joints = 0;
    ModelTerms terms;
    ArmAddition more;
  };

  void lay_out(const RecordLayout& layout);
  void write_table(const std::string& scene, const RecordLayout& layout);
  Header& header() const { return *reinterpret_cast<Header*>(memory_->data()); }
  std::byte* record_at(std::uint64_t number) const;
  std::byte* event_at(std::uint64_t number) const;

  std::vector<RecordField> fields_;
  std::size_t record_bytes_ = 0, outputs_at_ = 0, output_count_ = 0, first_record_ = 0, first_event_ = 0;
  std::vector<std::vector<Reference>> references_;  // by instance and input
  std::vector<Arm> arms_;
  std::vector<std::optional<BaseMount>> mounts_;  // per arm
  std::string table_, hash_;
  std::unique_ptr<SealedMemory> memory_;
  std::uint64_t records_ = 0, events_ = 0;  // written
};

// Reads a run's shared records (docs/live_input.md) from their descriptor, in any process. It never waits and
// does not affect the writer.
class RecordReader {
 public:
  using Field = RecordField;
  struct Event {
    std::uint64_t cycle = 0;
    LoopTime t;
    std::string text;  // JSON
  };
  using Record = std::vector<std::byte>;

  // Maps the memory. Throws std::runtime_error if it does not hold shared records.
  explicit RecordReader(int file);
  ~RecordReader();
  RecordReader(const RecordReader&) = delete;
  RecordReader& operator=(const RecordReader&) = delete;

  const std::string& table() const { return table_; }  // JSON
  const std::vector<Field>& fields() const { return fields_; }
  const Field* find(const std::string& name) const;  // nullptr: there is none

  std::uint64_t records() const;  // written so far
  std::uint64_t events() const;
  std::uint64_t oldest_record() const;  // still available, or being overwritten
  std::uint64_t oldest_event() const;
  // Returns false if it is not available yet, or overwritten.
  bool read(std::uint64_t number, Record& record) const;
  std::optional<Event> event(std::uint64_t number) const;

  static double number(const Record& record, const Field& field, std::size_t k = 0);

 private:
  bool read_slot(std::size_t at, std::uint64_t number, std::byte* to, std::size_t bytes) const;
  std::uint64_t head(std::size_t at) const;

  const std::byte* memory_ = nullptr;
  std::size_t bytes_ = 0;
  std::string table_;
  std::vector<Field> fields_;
  std::size_t first_record_ = 0, record_bytes_ = 0, record_count_ = 0;
  std::size_t first_event_ = 0, event_bytes_ = 0, event_count_ = 0;
};

}  // namespace multipanda
