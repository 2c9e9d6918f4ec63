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

// State of a writer.
struct WriterStatus {
  std::uint64_t messages_written = 0;  // in complete chunks in the file
  std::uint64_t messages_lost = 0;     // their chunk, or a record that they depend on, could not be written
  std::uint64_t bytes = 0;             // size of the file
  bool closed = false;                 // index and footer are in the file
  std::string error;                   // first failure, with the operating system's text; empty: none
  std::map<std::string, std::uint64_t> lost_by_topic;
};

// Writes one MCAP file of ROS 2 messages (profile "ros2", definitions "ros2msg", data "cdr").
//
// Messages are collected in a chunk. One system call writes the chunk when it is large enough or old enough,
// so a killed process loses at most one chunk. Failures never throw: a chunk that does not fit on the disk is
// discarded, the file is cut back to its last complete record, and the next chunk tries again. Space for
// index and footer stays reserved, so that a file can be closed on a full disk.
//
// One thread at a time. Calls may wait for the disk: never call them in the control loop.
class McapWriter {
 public:
  struct Options {
    std::size_t chunk_bytes = 4u << 20;        // uncompressed
    std::chrono::milliseconds chunk_age{500};  // wall clock
  };

  // Throws std::runtime_error if the file cannot be created.
  explicit McapWriter(const std::filesystem::path& path) : McapWriter(path, Options{}) {}
  McapWriter(const std::filesystem::path& path, const Options& options);
  ~McapWriter();  // closes
  McapWriter(const McapWriter&) = delete;
  McapWriter& operator=(const McapWriter&) = delete;

  // Adds a topic for messages of type M and returns its number for write().
  template <RosMessage M>
  std::uint16_t add_channel(std::string_view topic) {
    return add_channel(topic, M::kType, M::kText);
  }
  std::uint16_t add_channel(std::string_view topic, std::string_view type, std::string_view definition);

  // Writes into the file at once; returns false on failure.
  bool add(const mcap::Attachment& attachment);
  bool add(const mcap::Metadata& metadata);

  template <RosMessage M>
  void write(std::uint16_t channel, std::int64_t log_time_ns, const M& message) {
    write_bytes(channel, log_time_ns, cdr_.write(message));
  }
  // `cdr`: one serialized message. Negative times are written as 0, since MCAP has none.
  void write_bytes(std::uint16_t channel, std::int64_t log_time_ns, std::span<const std::uint8_t> cdr);

  void flush_if_due();  // call regularly, so that the last messages of slow topics reach the file in time
  void flush();

  // Ends the chunk and writes index and footer. A second call does nothing.
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
  bool broken_ = false;  // a partial record could not be removed: nothing can be appended
  WriterStatus status_;
  mcap::Summary summary_;
  std::string pending_;  // magic, header, definitions: not yet in the file
  std::map<std::string, std::uint16_t, std::less<>> schema_ids_;
  std::map<std::uint16_t, std::uint32_t> sequences_;
  CdrWriter cdr_;

  std::string chunk_;
  mcap::ChunkIndexEntries entries_;
  std::uint64_t chunk_messages_ = 0;
  std::chrono::steady_clock::time_point chunk_begin_;
};

}  // namespace multipanda
