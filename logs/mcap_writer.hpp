#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <string_view>

#include "logs/cdr.hpp"
#include "logs/mcap_format.hpp"

namespace multipanda {

// What became of what was given to a writer so far.
struct WriterStatus {
  std::uint64_t messages_written = 0;  // in whole chunks in the file
  std::uint64_t messages_lost = 0;     // their chunk, or something they need, could not be written
  std::uint64_t bytes = 0;             // size of the file
  bool closed = false;                 // index and footer are in the file
  std::string error;                   // first failure, with the operating system's words; empty: none
  std::map<std::string, std::uint64_t> lost_by_topic;
};

// Writes one MCAP file of ROS 2 messages (profile "ros2", definitions "ros2msg", data "cdr").
//
// Messages are gathered in a chunk, which goes into the file by one system call when it is large enough or
// old enough: a killed process loses at most the chunk it was gathering. Failures never throw: a chunk that
// does not fit on the disk is given up whole, the file is cut back to its last whole record, and the next
// chunk tries again. Room for index and footer is kept reserved, so that a file can be closed on a full disk.
//
// One thread at a time. Calls may wait for the disk: never call them in the control loop.
class McapWriter {
 public:
  struct Options {
    std::size_t chunk_bytes = 4u << 20;        // uncompressed
    std::chrono::milliseconds chunk_age{500};  // wall clock
  };

  // Throws std::runtime_error when the file cannot be created.
  explicit McapWriter(const std::filesystem::path& path) : McapWriter(path, Options{}) {}
  McapWriter(const std::filesystem::path& path, const Options& options);
  ~McapWriter();  // closes
  McapWriter(const McapWriter&) = delete;
  McapWriter& operator=(const McapWriter&) = delete;

  // A topic for messages of type M; the result is its number for write().
  template <RosMessage M>
  std::uint16_t add_channel(std::string_view topic) {
    return add_channel(topic, M::kType, M::kText);
  }
  std::uint16_t add_channel(std::string_view topic, std::string_view type, std::string_view definition);

  // Into the file at once; false when that failed.
  bool add(const mcap::Attachment& attachment);
  bool add(const mcap::Metadata& metadata);

  template <RosMessage M>
  void write(std::uint16_t channel, std::int64_t log_time_ns, const M& message) {
    write_bytes(channel, log_time_ns, cdr_.write(message));
  }
  // `cdr`: one serialized message. Negative times are written as 0, MCAP has none.
  void write_bytes(std::uint16_t channel, std::int64_t log_time_ns, std::span<const std::uint8_t> cdr);

  void
  flush_if_due();  // call now and then, so that the last messages of a quiet stream reach the file in time
  void flush();

  // Ends the chunk, writes index and footer. Safe to call twice.
  const WriterStatus& close();
  const WriterStatus& status() const { return status_; }

 private:
  bool append(std::string_view bytes, bool keep_reserve);
  bool reserve(std::uint64_t end);
  void fail(std::string_view what, int error_number);
  bool append_chunk();
  bool append_pending_and(std::string_view bytes);

  Options options_;
  int file_ = -1;
  bool broken_ = false;  // a partial record could not be cut off: nothing more can follow it
  WriterStatus status_;
  mcap::Summary summary_;
  std::string pending_;  // magic, header, definitions: not in the file yet
  std::map<std::string, std::uint16_t, std::less<>> schema_ids_;
  std::map<std::uint16_t, std::uint32_t> sequences_;
  CdrWriter cdr_;

  std::string chunk_;
  mcap::ChunkIndexEntries entries_;
  std::uint64_t chunk_messages_ = 0;
  std::chrono::steady_clock::time_point chunk_begin_;
};

}  // namespace multipanda
