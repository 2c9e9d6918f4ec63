#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "logs/mcap_format.hpp"

namespace multipanda {

// The records of an MCAP file in order, as far as they are complete. Needs neither index nor footer. Where a
// record's head is damaged, the next whole chunk follows.
class McapScanner {
 public:
  // Throws std::runtime_error if the file cannot be opened or does not start like an MCAP file.
  explicit McapScanner(const std::filesystem::path& path);

  struct Record {
    mcap::Opcode opcode;
    std::uint64_t offset;  // of its head in the file
    mcap::Bytes content;   // valid until the next call
  };
  std::optional<Record> next();  // none: nothing whole is left

  bool complete() const { return complete_; }            // ended with a footer
  std::uint64_t whole_bytes() const { return offset_; }  // size of the complete records
  std::uint64_t file_bytes() const { return size_; }
  std::uint64_t gaps() const { return gaps_; }  // places that were skipped

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::optional<Record> next_here();
  std::optional<Record> next_chunk();
  std::unique_ptr<std::FILE, Close> file_;
  std::uint64_t size_ = 0, offset_ = 0, gaps_ = 0;
  bool complete_ = false;
  std::vector<std::uint8_t> content_;
};

// Whether `schema` is that of message M. Throws std::runtime_error if it has M's name but other fields: the
// log comes from another version.
template <typename M>
bool holds(const mcap::Schema& schema) {
  if (schema.name != M::kType) return false;
  if (mcap::same_definition(schema, M::kText)) return true;
  throw std::runtime_error(
      "the log defines " + schema.name +
      " with fields that differ from this program's: read it with the version that wrote it (the "
      "log's metadata names it)");
}

// Reads a log's messages in the order of the file. Also reads the file of a killed process up to its last
// complete chunk, and a file that is still being written. Memory use: one chunk.
class McapReader {
 public:
  // Throws std::runtime_error if the file cannot be opened or does not start like an MCAP file.
  explicit McapReader(const std::filesystem::path& path) : scanner_(path) {}

  struct Message {
    const mcap::Channel* channel;  // valid as long as the reader
    const mcap::Schema* schema;
    std::uint32_t sequence;  // counts the channel's messages
    std::int64_t log_time_ns;
    mcap::Bytes data;  // CDR; valid until the next call
  };
  std::optional<Message> next();

  // Those read so far. A log's scene, versions and machine precede its first message.
  const std::vector<mcap::Metadata>& metadata() const { return metadata_; }
  const std::vector<mcap::Attachment>& attachments() const { return attachments_; }
  const std::map<std::uint16_t, mcap::Channel>& channels() const { return channels_; }
  const std::map<std::uint16_t, mcap::Schema>& schemas() const { return schemas_; }
  // "/joints (sensor_msgs/msg/JointState), /tf (...)" or "none".
  std::string topics_text() const;

  // Valid after the last message.
  bool complete() const { return scanner_.complete(); }  // false: no footer, see repair()
  // Skipped because unreadable: records, chunks, gaps between them.
  std::uint64_t damaged_records() const { return damaged_ + scanner_.gaps(); }
  std::uint64_t missing_bytes() const {
    return scanner_.file_bytes() - scanner_.whole_bytes();
  }  // at the end

 private:
  void take(mcap::Opcode opcode, mcap::Bytes content);
  std::optional<Message> next_in_chunk();

  McapScanner scanner_;
  std::map<std::uint16_t, mcap::Schema> schemas_;
  std::map<std::uint16_t, mcap::Channel> channels_;
  std::vector<mcap::Metadata> metadata_;
  std::vector<mcap::Attachment> attachments_;
  std::string chunk_;
  std::size_t chunk_offset_ = 0;
  std::uint64_t damaged_ = 0;
};

}  // namespace multipanda
