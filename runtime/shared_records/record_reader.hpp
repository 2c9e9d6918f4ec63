#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/record/record_fields.hpp"

namespace multipanda {

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
