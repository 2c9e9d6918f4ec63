#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <map>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

// The parts of the MCAP container format (mcap.dev/spec) that writer, reader and repair share. A file is:
// magic, records, magic. A record is: opcode u8, length u64, content. Integers are little-endian. Strings
// have a u32 length; maps and arrays have a u32 length in bytes.
namespace multipanda::mcap {

inline constexpr std::string_view kMagic{"\x89MCAP0\r\n", 8};
inline constexpr std::size_t kRecordHead = 9;  // opcode and length

enum class Opcode : std::uint8_t {
  header = 0x01,
  footer = 0x02,
  schema = 0x03,
  channel = 0x04,
  message = 0x05,
  chunk = 0x06,
  message_index = 0x07,
  chunk_index = 0x08,
  attachment = 0x09,
  attachment_index = 0x0a,
  statistics = 0x0b,
  metadata = 0x0c,
  metadata_index = 0x0d,
  summary_offset = 0x0e,
  data_end = 0x0f,
};

using Bytes = std::span<const std::uint8_t>;
using StringMap = std::map<std::string, std::string>;

struct Schema {
  std::uint16_t id = 0;  // from 1
  std::string name;      // "package/msg/Name"
  std::string encoding;  // "ros2msg"
  std::string text;
  bool operator==(const Schema&) const = default;
};

// Whether the schema's fields and constants are those of `definition`; comments and blank lines do not count.
bool same_definition(const Schema& schema, std::string_view definition);

struct Channel {
  std::uint16_t id = 0;
  std::uint16_t schema = 0;
  std::string topic;
  std::string encoding;  // "cdr"
  StringMap metadata;
  bool operator==(const Channel&) const = default;
};

struct Attachment {
  std::uint64_t log_time_ns = 0;
  std::uint64_t create_time_ns = 0;
  std::string name;
  std::string media_type;
  std::string data;
};

struct Metadata {
  std::string name;
  StringMap values;
};

// Appends MCAP's primitives to a string of bytes.
class Encoder {
 public:
  template <typename T>
  Encoder& put(T value) {
    static_assert(std::is_unsigned_v<T>);
    out_.append(reinterpret_cast<const char*>(&value), sizeof(T));
    return *this;
  }
  Encoder& text(std::string_view s) {
    put(static_cast<std::uint32_t>(s.size()));
    out_.append(s);
    return *this;
  }
  Encoder& raw(std::string_view s) {
    out_.append(s);
    return *this;
  }
  Encoder& map(const StringMap& map);

  std::string_view bytes() const { return out_; }

 private:
  std::string out_;
};

// Takes MCAP's primitives from bytes. Throws std::runtime_error if they end too early.
class Decoder {
 public:
  explicit Decoder(Bytes bytes) : bytes_(bytes) {}

  template <typename T>
  T get() {
    T value;
    std::memcpy(&value, take(sizeof(T)).data(), sizeof(T));
    return value;
  }
  std::string text();
  StringMap map();
  Bytes take(std::uint64_t size) {
    if (size > bytes_.size()) throw std::runtime_error("MCAP: a record ends inside a field");
    const Bytes taken = bytes_.first(static_cast<std::size_t>(size));
    bytes_ = bytes_.subspan(taken.size());
    return taken;
  }
  Bytes rest() const { return bytes_; }

 private:
  Bytes bytes_;
};

// Complete records, including the head.
std::string record(Opcode opcode, std::string_view content);
std::string header_record(std::string_view library);
std::string encode(const Schema& schema);
std::string encode(const Channel& channel);
std::string encode(const Attachment& attachment);
std::string encode(const Metadata& metadata);

// Contents, without the head.
Schema decode_schema(Bytes content);
Channel decode_channel(Bytes content);
Attachment decode_attachment(Bytes content);
Metadata decode_metadata(Bytes content);

// The positions of the messages in one chunk, for its message index records.
struct IndexEntry {
  std::uint64_t log_time_ns = 0;
  std::uint64_t offset = 0;  // of the message record within the uncompressed chunk
};
using ChunkIndexEntries = std::map<std::uint16_t, std::vector<IndexEntry>>;  // by channel

// An entry of the summary about a chunk in the file.
struct ChunkInfo {
  std::uint64_t start_ns = 0, end_ns = 0;
  std::uint64_t compressed_size = 0, uncompressed_size = 0;
  std::string compression;
};

// One of the consecutive records in a chunk.
struct InnerRecord {
  Opcode opcode;
  std::uint64_t offset;  // of its head in the chunk
  Bytes content;
};
// Takes the record at `offset` of `chunk` and advances `offset`. Throws std::runtime_error if the record is
// not complete.
InnerRecord take_record(Bytes chunk, std::size_t& offset);

struct MessageHead {
  std::uint16_t channel = 0;
  std::uint32_t sequence = 0;
  std::uint64_t log_time_ns = 0;
  Bytes data;
};
MessageHead decode_message(Bytes content);

inline Bytes as_bytes(std::string_view s) {
  return {reinterpret_cast<const std::uint8_t*>(s.data()), s.size()};
}

// Collects the content of the footer's summary while records are appended to a file. Each function takes the
// file offset at which the record begins.
class Summary {
 public:
  void add(const Schema& schema) { schemas_[schema.id] = schema; }
  void add(const Channel& channel) { channels_[channel.id] = channel; }
  void add(const Attachment& attachment, std::uint64_t offset, std::uint64_t length);
  void add(const Metadata& metadata, std::uint64_t offset, std::uint64_t length);
  // `chunk_length`: of the chunk record; `index_lengths`: of each message index record, in the
  // order of `entries`.
  void add(const ChunkInfo& chunk, const ChunkIndexEntries& entries, std::uint64_t offset,
           std::uint64_t chunk_length, const std::vector<std::uint64_t>& index_lengths);

  // Data end, summary, footer and closing magic for a file whose records end at `offset`.
  std::string encode_end(std::uint64_t offset) const;
  // Upper bound of encode_end().size(): the space to keep free on the disk.
  std::size_t size_bound() const;

  std::uint64_t messages() const { return messages_; }
  const std::map<std::uint16_t, Schema>& schemas() const { return schemas_; }
  const std::map<std::uint16_t, Channel>& channels() const { return channels_; }

 private:
  std::map<std::uint16_t, Schema> schemas_;
  std::map<std::uint16_t, Channel> channels_;
  std::string chunk_indexes_, attachment_indexes_, metadata_indexes_;  // encoded records
  std::uint32_t chunk_count_ = 0, attachment_count_ = 0, metadata_count_ = 0;
  std::map<std::uint16_t, std::uint64_t> channel_messages_;
  std::uint64_t messages_ = 0, start_ns_ = 0, end_ns_ = 0;
};

// A chunk record followed by its message index records, ready to be appended.
struct EncodedChunk {
  std::string bytes;
  ChunkInfo info;
  std::uint64_t chunk_length = 0;
  std::vector<std::uint64_t> index_lengths;
};
// `records`: the messages' records; compressed with zstd, whose checksum protects the content.
EncodedChunk encode_chunk(std::string_view records, const ChunkIndexEntries& entries);
// The same for content that is already compressed (repair).
EncodedChunk wrap_chunk(std::string_view compressed, const ChunkInfo& info, const ChunkIndexEntries& entries);

// The records inside a chunk record's content. Throws std::runtime_error if they are damaged or the
// compression is unknown.
struct DecodedChunk {
  ChunkInfo info;
  Bytes compressed;  // within the record's content
  std::string records;
};
DecodedChunk decode_chunk(Bytes content);

}  // namespace multipanda::mcap
