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

// The records of an MCAP file one after the other, as far as they are whole. Needs neither index nor footer.
class McapScanner {
 public:
  // Throws std::runtime_error when the file cannot be opened or does not begin like an MCAP file.
  explicit McapScanner(const std::filesystem::path& path);

  struct Record {
    mcap::Opcode opcode;
    std::uint64_t offset;  // of its head in the file
    mcap::Bytes content;   // valid until the next call
  };
  std::optional<Record> next();  // nothing: the end, or the first record that is not whole

  bool complete() const { return complete_; }            // ended with a footer
  std::uint64_t whole_bytes() const { return offset_; }  // up to here the records are whole
  std::uint64_t file_bytes() const { return size_; }

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::unique_ptr<std::FILE, Close> file_;
  std::uint64_t size_ = 0, offset_ = 0;
  bool complete_ = false;
  std::vector<std::uint8_t> content_;
};

// Reads a log's messages in the order of the file; works on the file of a killed process up to its last whole
// chunk, and on a file that is still being written. Memory use: one chunk.
class McapReader {
 public:
  // Throws std::runtime_error when the file cannot be opened or does not begin like an MCAP file.
  explicit McapReader(const std::filesystem::path& path) : scanner_(path) {}

  struct Message {
    const mcap::Channel* channel;  // valid as long as the reader
    const mcap::Schema* schema;
    std::uint32_t sequence;  // counts the channel's messages
    std::int64_t log_time_ns;
    mcap::Bytes data;  // CDR; valid until the next call
  };
  std::optional<Message> next();

  // Those passed so far. A log's scene, versions and machine stand before its first message.
  const std::vector<mcap::Metadata>& metadata() const { return metadata_; }
  const std::vector<mcap::Attachment>& attachments() const { return attachments_; }
  const std::map<std::uint16_t, mcap::Channel>& channels() const { return channels_; }
  const std::map<std::uint16_t, mcap::Schema>& schemas() const { return schemas_; }

  // After the last message.
  bool complete() const { return scanner_.complete(); }       // false: no footer, see repair()
  std::uint64_t damaged_records() const { return damaged_; }  // skipped: unreadable inside the file
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
