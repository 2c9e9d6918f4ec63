#include <algorithm>
#include <atomic>
#include <bit>
#include <cstring>
#include <stdexcept>
#include <sys/mman.h>
#include <sys/stat.h>

#include <nlohmann/json.hpp>

#include "runtime/shared_records/shared_records.hpp"

namespace multipanda {
namespace {

// Offsets in the header (docs/live_input.md).
constexpr std::size_t kTableBytesAt = 8, kBytesAt = 24, kRecordsAt = 64, kEventsAt = 80, kTableAt = 96;
constexpr std::size_t kEventTextAt = 32;
constexpr std::string_view kMagic = "mp-rec-1";

std::uint64_t word(const std::byte* at) {
  std::uint64_t value;
  std::memcpy(&value, at, sizeof(value));
  return value;
}

}  // namespace

RecordReader::RecordReader(int file) {
  struct stat status {};
  if (fstat(file, &status) != 0 || static_cast<std::size_t>(status.st_size) < kTableAt)
    throw std::runtime_error("this descriptor is not that of shared records");
  bytes_ = static_cast<std::size_t>(status.st_size);
  void* mapped = mmap(nullptr, bytes_, PROT_READ, MAP_SHARED, file, 0);
  if (mapped == MAP_FAILED) throw std::runtime_error("shared records cannot be mapped");
  memory_ = static_cast<const std::byte*>(mapped);
  try {
    const std::size_t table_bytes = word(memory_ + kTableBytesAt);
    if (std::memcmp(memory_, kMagic.data(), kMagic.size()) != 0 || word(memory_ + kBytesAt) > bytes_ ||
        table_bytes > bytes_ - kTableAt)
      throw std::runtime_error("this memory does not hold shared records");
    table_.assign(reinterpret_cast<const char*>(memory_ + kTableAt), table_bytes);
    const auto table = nlohmann::json::parse(table_);
    for (const auto& field : table.at("fields"))
      fields_.push_back({.name = field.at(0),
                         .type = field.at(1).get<std::string>().at(0),
                         .offset = field.at(2),
                         .count = field.at(3)});
    first_record_ = table.at("first_record");
    record_bytes_ = table.at("record_bytes");
    record_count_ = table.at("records");
    first_event_ = table.at("first_event");
    event_bytes_ = table.at("event_bytes");
    event_count_ = table.at("events");
  } catch (...) {
    munmap(mapped, bytes_);
    throw;
  }
}

RecordReader::~RecordReader() { munmap(const_cast<std::byte*>(memory_), bytes_); }

const RecordReader::Field* RecordReader::find(const std::string& name) const {
  const auto found = std::ranges::find(fields_, name, &Field::name);
  return found != fields_.end() ? &*found : nullptr;
}

std::uint64_t RecordReader::head(std::size_t at) const {
  return std::atomic_ref<std::uint64_t>(
             *reinterpret_cast<std::uint64_t*>(const_cast<std::byte*>(memory_ + at)))
      .load(std::memory_order_acquire);
}

std::uint64_t RecordReader::records() const { return head(kRecordsAt); }
std::uint64_t RecordReader::events() const { return head(kEventsAt); }

std::uint64_t RecordReader::oldest_record() const {
  const std::uint64_t written = records();
  return written > record_count_ ? written - record_count_ : 0;
}

std::uint64_t RecordReader::oldest_event() const {
  const std::uint64_t written = events();
  return written > event_count_ ? written - event_count_ : 0;
}

// A slot's number is 2 n + 2 while record n is complete in it.
bool RecordReader::read_slot(std::size_t at, std::uint64_t number, std::byte* to, std::size_t bytes) const {
  if (head(at) != 2 * number + 2) return false;
  std::memcpy(to, memory_ + at, bytes);
  std::atomic_thread_fence(std::memory_order_acquire);
  return head(at) == 2 * number + 2;
}

bool RecordReader::read(std::uint64_t number, Record& record) const {
  record.resize(record_bytes_);
  return read_slot(first_record_ + number % record_count_ * record_bytes_, number, record.data(),
                   record_bytes_);
}

std::optional<RecordReader::Event> RecordReader::event(std::uint64_t number) const {
  std::vector<std::byte> slot(event_bytes_);
  if (!read_slot(first_event_ + number % event_count_ * event_bytes_, number, slot.data(), event_bytes_))
    return {};
  Event event{.cycle = word(slot.data() + 8), .t = {std::bit_cast<std::int64_t>(word(slot.data() + 16))}};
  const std::size_t size = std::min<std::size_t>(word(slot.data() + 24), event_bytes_ - kEventTextAt);
  event.text.assign(reinterpret_cast<const char*>(slot.data() + kEventTextAt), size);
  return event;
}

double RecordReader::number(const Record& record, const Field& field, std::size_t k) {
  const std::uint64_t bits = word(record.data() + field.offset + 8 * k);
  if (field.type == 'f') return std::bit_cast<double>(bits);
  if (field.type == 'i') return static_cast<double>(std::bit_cast<std::int64_t>(bits));
  return static_cast<double>(bits);
}

}  // namespace multipanda
