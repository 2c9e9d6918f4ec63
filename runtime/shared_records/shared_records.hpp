#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/model/model_terms.hpp"
#include "core/record/record_fields.hpp"
#include "core/types/arm_set.hpp"
#include "runtime/shared_records/run_event.hpp"
#include "runtime/shared_records/sealed_memory.hpp"

namespace multipanda {

// The newest records and events of a run in memory that other processes map and read
// (docs/live_input.md). Only the thread that takes the loop's records writes; the loop does not touch this
// memory, so readers cannot affect it. The writer never waits. A reader copies a record and checks by its
// number whether it was overwritten meanwhile.
class SharedRecords {
 public:
  static constexpr std::size_t kRecords = 2048;  // 2 s at 1 kHz
  static constexpr std::size_t kEvents = 2048;
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

}  // namespace multipanda
