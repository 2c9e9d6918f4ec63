#include <algorithm>
#include <numeric>

#include "logs/mcap_format.hpp"

namespace multipanda::mcap {

void Summary::add(const Attachment& a, std::uint64_t offset, std::uint64_t length) {
  Encoder out;
  out.put(offset).put(length).put(a.log_time_ns).put(a.create_time_ns).put(std::uint64_t{a.data.size()});
  out.text(a.name).text(a.media_type);
  attachment_indexes_ += record(Opcode::attachment_index, out.bytes());
  ++attachment_count_;
}

void Summary::add(const Metadata& m, std::uint64_t offset, std::uint64_t length) {
  metadata_indexes_ += record(Opcode::metadata_index, Encoder().put(offset).put(length).text(m.name).bytes());
  ++metadata_count_;
}

void Summary::add(const ChunkInfo& chunk, const ChunkIndexEntries& entries, std::uint64_t offset,
                  std::uint64_t chunk_length, const std::vector<std::uint64_t>& index_lengths) {
  Encoder index_offsets;
  std::uint64_t at = offset + chunk_length;
  std::size_t i = 0;
  const bool first = messages_ == 0;
  for (const auto& [channel, messages] : entries) {
    index_offsets.put(channel).put(at);
    at += index_lengths.at(i++);
    channel_messages_[channel] += messages.size();
    messages_ += messages.size();
  }
  Encoder out;
  out.put(chunk.start_ns).put(chunk.end_ns).put(offset).put(chunk_length).text(index_offsets.bytes());
  out.put(at - offset - chunk_length).text(chunk.compression);
  out.put(chunk.compressed_size).put(chunk.uncompressed_size);
  chunk_indexes_ += record(Opcode::chunk_index, out.bytes());
  ++chunk_count_;
  start_ns_ = first ? chunk.start_ns : std::min(start_ns_, chunk.start_ns);
  end_ns_ = std::max(end_ns_, chunk.end_ns);
}

std::string Summary::encode_end(std::uint64_t offset) const {
  std::string out = record(Opcode::data_end, Encoder().put(std::uint32_t{0}).bytes());
  const std::uint64_t summary_start = offset + out.size();

  std::string offsets;
  const auto group = [&](Opcode opcode, const std::string& records) {
    if (records.empty()) return;
    Encoder entry;
    entry.put(static_cast<std::uint8_t>(opcode)).put(std::uint64_t{offset + out.size()});
    entry.put(std::uint64_t{records.size()});
    offsets += record(Opcode::summary_offset, entry.bytes());
    out += records;
  };
  std::string schemas, channels;
  for (const auto& [id, schema] : schemas_) schemas += encode(schema);
  for (const auto& [id, channel] : channels_) channels += encode(channel);

  Encoder counts, statistics;
  for (const auto& [channel, count] : channel_messages_) counts.put(channel).put(count);
  statistics.put(messages_).put(static_cast<std::uint16_t>(schemas_.size()));
  statistics.put(static_cast<std::uint32_t>(channels_.size())).put(attachment_count_).put(metadata_count_);
  statistics.put(chunk_count_).put(start_ns_).put(end_ns_).text(counts.bytes());

  group(Opcode::schema, schemas);
  group(Opcode::channel, channels);
  group(Opcode::statistics, record(Opcode::statistics, statistics.bytes()));
  group(Opcode::chunk_index, chunk_indexes_);
  group(Opcode::attachment_index, attachment_indexes_);
  group(Opcode::metadata_index, metadata_indexes_);

  const std::uint64_t offsets_start = offset + out.size();
  out += offsets;
  Encoder footer;
  footer.put(summary_start).put(offsets_start).put(std::uint32_t{0});
  out += record(Opcode::footer, footer.bytes());
  out += kMagic;
  return out;
}

std::size_t Summary::size_bound() const { return encode_end(0).size(); }

}  // namespace multipanda::mcap
