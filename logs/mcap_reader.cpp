#include "logs/mcap_reader.hpp"

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <set>

namespace multipanda {

using mcap::Decoder;
using mcap::Opcode;

McapScanner::McapScanner(const std::filesystem::path& path) : file_(std::fopen(path.c_str(), "rb")) {
  if (!file_) throw std::runtime_error("cannot open the log " + path.string() + ": " + std::strerror(errno));
  std::array<char, 8> magic{};
  if (std::fread(magic.data(), 1, magic.size(), file_.get()) != magic.size() ||
      std::string_view(magic.data(), magic.size()) != mcap::kMagic) {
    throw std::runtime_error(path.string() + " is not an MCAP file: its first 8 bytes are not MCAP's");
  }
  size_ = std::filesystem::file_size(path);
  offset_ = magic.size();
}

std::optional<McapScanner::Record> McapScanner::next() {
  if (complete_) return std::nullopt;
  if (auto record = next_here()) return record;
  return next_chunk();
}

// The first whole chunk after a place without a record, recognized by its content.
std::optional<McapScanner::Record> McapScanner::next_chunk() {
  const std::uint64_t start = offset_;
  std::string block(1 << 20, '\0');
  const auto seek = [&](std::uint64_t to) {
    return ::fseeko(file_.get(), static_cast<off_t>(to), SEEK_SET) == 0;
  };
  for (std::uint64_t at = start + 1; at + mcap::kRecordHead < size_;) {
    if (!seek(at)) break;
    const std::size_t got = std::fread(block.data(), 1, block.size(), file_.get());
    if (got <= mcap::kRecordHead) break;
    const std::string_view bytes(block.data(), got);
    for (std::size_t i = 0; i + mcap::kRecordHead <= got; ++i) {
      i = bytes.find(static_cast<char>(Opcode::chunk), i);
      if (i == bytes.npos || i + mcap::kRecordHead > got) break;
      const auto length = Decoder(mcap::as_bytes(bytes.substr(i + 1))).get<std::uint64_t>();
      if (length > size_ - at - i - mcap::kRecordHead) continue;
      offset_ = at + i;
      if (!seek(offset_)) break;
      const auto record = next_here();
      try {
        if (record && !mcap::decode_chunk(record->content).records.empty()) {
          ++gaps_;
          return record;
        }
      } catch (const std::runtime_error&) {  // only looks like a chunk
      }
    }
    at += got - mcap::kRecordHead + 1;  // a head may lie across two blocks
  }
  offset_ = start;
  return std::nullopt;
}

std::optional<McapScanner::Record> McapScanner::next_here() {
  std::array<std::uint8_t, mcap::kRecordHead> head{};
  if (std::fread(head.data(), 1, head.size(), file_.get()) != head.size()) return std::nullopt;
  Decoder in(head);
  const auto opcode = in.get<std::uint8_t>();
  const auto length = in.get<std::uint64_t>();
  // Opcode 0 does not exist: zeros from a block that never reached the disk.
  if (opcode == 0 || offset_ + head.size() > size_ || length > size_ - offset_ - head.size())
    return std::nullopt;
  content_.resize(static_cast<std::size_t>(length));
  if (std::fread(content_.data(), 1, content_.size(), file_.get()) != content_.size()) return std::nullopt;
  const Record record{static_cast<Opcode>(opcode), offset_, content_};
  offset_ += head.size() + length;
  if (record.opcode == Opcode::footer) {
    std::array<char, 8> magic{};
    complete_ = std::fread(magic.data(), 1, magic.size(), file_.get()) == magic.size() &&
                std::string_view(magic.data(), magic.size()) == mcap::kMagic;
    if (complete_) offset_ += magic.size();
  }
  return record;
}

std::optional<McapReader::Message> McapReader::next() {
  while (true) {
    if (auto message = next_in_chunk()) return message;
    const auto record = scanner_.next();
    if (!record) return std::nullopt;
    try {
      if (record->opcode == Opcode::chunk) {
        chunk_ = mcap::decode_chunk(record->content).records;
        chunk_offset_ = 0;
      } else if (record->opcode == Opcode::message) {  // outside of chunks: not written by this program, but
                                                       // the format allows it
        chunk_ = mcap::record(
            Opcode::message, {reinterpret_cast<const char*>(record->content.data()), record->content.size()});
        chunk_offset_ = 0;
      } else {
        take(record->opcode, record->content);
      }
    } catch (const std::runtime_error&) {
      ++damaged_;
    }
  }
}

std::string McapReader::topics_text() const {
  std::set<std::string> topics;
  for (const auto& [id, channel] : channels_) {
    const auto schema = schemas_.find(channel.schema);
    topics.insert(channel.topic + (schema == schemas_.end() ? "" : " (" + schema->second.name + ")"));
  }
  std::string text;
  for (const std::string& topic : topics) text += (text.empty() ? "" : ", ") + topic;
  return text.empty() ? "none" : text;
}

void McapReader::take(Opcode opcode, mcap::Bytes content) {
  switch (opcode) {
    case Opcode::schema: {
      mcap::Schema schema = mcap::decode_schema(content);
      schemas_.try_emplace(schema.id, std::move(schema));
      break;
    }
    case Opcode::channel: {
      mcap::Channel channel = mcap::decode_channel(content);
      channels_.try_emplace(channel.id, std::move(channel));
      break;
    }
    case Opcode::metadata:
      metadata_.push_back(mcap::decode_metadata(content));
      break;
    case Opcode::attachment:
      attachments_.push_back(mcap::decode_attachment(content));
      break;
    default:
      break;
  }
}

std::optional<McapReader::Message> McapReader::next_in_chunk() {
  const mcap::Bytes bytes = mcap::as_bytes(chunk_);
  while (chunk_offset_ < bytes.size()) {
    const std::size_t before = chunk_offset_;
    try {
      const mcap::InnerRecord record = mcap::take_record(bytes, chunk_offset_);
      if (record.opcode != Opcode::message) {
        take(record.opcode, record.content);
        continue;
      }
      const mcap::MessageHead message = mcap::decode_message(record.content);
      const auto channel = channels_.find(message.channel);
      if (channel == channels_.end()) throw std::runtime_error("MCAP: a message of an undeclared channel");
      const auto schema = schemas_.find(channel->second.schema);
      if (schema == schemas_.end()) throw std::runtime_error("MCAP: a channel of an undeclared schema");
      return Message{&channel->second, &schema->second, message.sequence,
                     static_cast<std::int64_t>(message.log_time_ns), message.data};
    } catch (const std::runtime_error&) {
      ++damaged_;
      // A record without a valid length ends the chunk: the records after it are lost.
      if (chunk_offset_ == before) chunk_offset_ = bytes.size();
    }
  }
  return std::nullopt;
}

}  // namespace multipanda
