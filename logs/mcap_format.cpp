#include "logs/mcap_format.hpp"

#include <algorithm>
#include <bit>
#include <memory>

#include <zstd.h>

namespace multipanda::mcap {

static_assert(std::endian::native == std::endian::little, "MCAP is written in the machine's own byte order");

Encoder& Encoder::map(const StringMap& map) {
  Encoder inner;
  for (const auto& [key, value] : map) inner.text(key).text(value);
  return text(inner.bytes());
}

std::string Decoder::text() {
  const Bytes bytes = take(get<std::uint32_t>());
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

StringMap Decoder::map() {
  Decoder inner(take(get<std::uint32_t>()));
  StringMap map;
  while (!inner.rest().empty()) {
    std::string key = inner.text();
    map[std::move(key)] = inner.text();
  }
  return map;
}

std::string record(Opcode opcode, std::string_view content) {
  Encoder out;
  out.put(static_cast<std::uint8_t>(opcode)).put(std::uint64_t{content.size()}).raw(content);
  return std::string(out.bytes());
}

std::string header_record(std::string_view library) {
  return record(Opcode::header, Encoder().text("ros2").text(library).bytes());
}

namespace {

// The lines of a message definition without comments and extra space.
std::string without_comments(std::string_view text) {
  std::string out;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = text.substr(0, std::min(end, text.find('#')));
    text.remove_prefix(std::min(end + 1, text.size()));
    const std::size_t begin = out.size();
    for (const char c : line) {
      if (c != ' ' && c != '\t' && c != '\r') {
        out += c;
      } else if (out.size() > begin && out.back() != ' ') {
        out += ' ';
      }
    }
    if (out.size() > begin && out.back() == ' ') out.pop_back();
    if (out.size() > begin) out += '\n';
  }
  return out;
}

}  // namespace

bool same_definition(const Schema& schema, std::string_view definition) {
  return schema.text == definition || without_comments(schema.text) == without_comments(definition);
}

std::string encode(const Schema& s) {
  return record(Opcode::schema, Encoder().put(s.id).text(s.name).text(s.encoding).text(s.text).bytes());
}

std::string encode(const Channel& c) {
  return record(Opcode::channel,
                Encoder().put(c.id).put(c.schema).text(c.topic).text(c.encoding).map(c.metadata).bytes());
}

std::string encode(const Attachment& a) {
  Encoder out;
  out.put(a.log_time_ns).put(a.create_time_ns).text(a.name).text(a.media_type);
  out.put(std::uint64_t{a.data.size()}).raw(a.data).put(std::uint32_t{0});  // no CRC
  return record(Opcode::attachment, out.bytes());
}

std::string encode(const Metadata& m) {
  return record(Opcode::metadata, Encoder().text(m.name).map(m.values).bytes());
}

Schema decode_schema(Bytes content) {
  Decoder in(content);
  Schema s;
  s.id = in.get<std::uint16_t>();
  s.name = in.text();
  s.encoding = in.text();
  s.text = in.text();
  return s;
}

Channel decode_channel(Bytes content) {
  Decoder in(content);
  Channel c;
  c.id = in.get<std::uint16_t>();
  c.schema = in.get<std::uint16_t>();
  c.topic = in.text();
  c.encoding = in.text();
  c.metadata = in.map();
  return c;
}

Attachment decode_attachment(Bytes content) {
  Decoder in(content);
  Attachment a;
  a.log_time_ns = in.get<std::uint64_t>();
  a.create_time_ns = in.get<std::uint64_t>();
  a.name = in.text();
  a.media_type = in.text();
  const Bytes data = in.take(in.get<std::uint64_t>());
  a.data.assign(reinterpret_cast<const char*>(data.data()), data.size());
  return a;
}

Metadata decode_metadata(Bytes content) {
  Decoder in(content);
  Metadata m;
  m.name = in.text();
  m.values = in.map();
  return m;
}

InnerRecord take_record(Bytes chunk, std::size_t& offset) {
  Decoder in(chunk.subspan(offset));
  const auto opcode = static_cast<Opcode>(in.get<std::uint8_t>());
  const Bytes content = in.take(in.get<std::uint64_t>());
  const InnerRecord record{opcode, offset, content};
  offset += kRecordHead + content.size();
  return record;
}

MessageHead decode_message(Bytes content) {
  Decoder in(content);
  MessageHead m;
  m.channel = in.get<std::uint16_t>();
  m.sequence = in.get<std::uint32_t>();
  m.log_time_ns = in.get<std::uint64_t>();
  in.get<std::uint64_t>();  // publish time
  m.data = in.rest();
  return m;
}

EncodedChunk wrap_chunk(std::string_view compressed, const ChunkInfo& info,
                        const ChunkIndexEntries& entries) {
  EncodedChunk chunk;
  chunk.info = info;
  Encoder head;
  head.put(info.start_ns).put(info.end_ns).put(info.uncompressed_size).put(std::uint32_t{0});
  head.text(info.compression).put(info.compressed_size).raw(compressed);
  chunk.bytes = record(Opcode::chunk, head.bytes());
  chunk.chunk_length = chunk.bytes.size();
  for (const auto& [channel, messages] : entries) {
    Encoder index;
    index.put(channel).put(static_cast<std::uint32_t>(messages.size() * 16));
    for (const IndexEntry& entry : messages) index.put(entry.log_time_ns).put(entry.offset);
    const std::string bytes = record(Opcode::message_index, index.bytes());
    chunk.index_lengths.push_back(bytes.size());
    chunk.bytes += bytes;
  }
  return chunk;
}

EncodedChunk encode_chunk(std::string_view records, const ChunkIndexEntries& entries) {
  ChunkInfo info;
  info.compression = "zstd";
  info.uncompressed_size = records.size();
  bool first = true;
  for (const auto& [channel, messages] : entries) {
    for (const IndexEntry& entry : messages) {
      info.start_ns = first ? entry.log_time_ns : std::min(info.start_ns, entry.log_time_ns);
      info.end_ns = std::max(info.end_ns, entry.log_time_ns);
      first = false;
    }
  }

  const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(), &ZSTD_freeCCtx);
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel,
                         1);  // fast: an unpaced loop runs up to 20 times faster than real time
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 1);
  std::string compressed(ZSTD_compressBound(records.size()), '\0');
  const std::size_t size =
      ZSTD_compress2(context.get(), compressed.data(), compressed.size(), records.data(), records.size());
  if (ZSTD_isError(size) != 0) throw std::runtime_error(std::string("zstd: ") + ZSTD_getErrorName(size));
  compressed.resize(size);
  info.compressed_size = size;
  return wrap_chunk(compressed, info, entries);
}

DecodedChunk decode_chunk(Bytes content) {
  Decoder in(content);
  DecodedChunk chunk;
  chunk.info.start_ns = in.get<std::uint64_t>();
  chunk.info.end_ns = in.get<std::uint64_t>();
  chunk.info.uncompressed_size = in.get<std::uint64_t>();
  in.get<std::uint32_t>();  // CRC: 0 in our files, since zstd has its own
  chunk.info.compression = in.text();
  chunk.info.compressed_size = in.get<std::uint64_t>();
  chunk.compressed = in.take(chunk.info.compressed_size);
  if (chunk.info.compression.empty()) {
    chunk.records.assign(reinterpret_cast<const char*>(chunk.compressed.data()), chunk.compressed.size());
  } else if (chunk.info.compression == "zstd") {
    // A damaged size must not request all memory: zstd expands by at most about 2^15.
    if (chunk.info.uncompressed_size >> 15 > chunk.info.compressed_size + 1) {
      throw std::runtime_error("MCAP: implausible size of a chunk");
    }
    chunk.records.resize(static_cast<std::size_t>(chunk.info.uncompressed_size));
    const std::size_t size = ZSTD_decompress(chunk.records.data(), chunk.records.size(),
                                             chunk.compressed.data(), chunk.compressed.size());
    if (ZSTD_isError(size) != 0) throw std::runtime_error(std::string("zstd: ") + ZSTD_getErrorName(size));
    chunk.records.resize(size);
  } else {
    throw std::runtime_error("MCAP: compression '" + chunk.info.compression +
                             "' is not supported, only zstd");
  }
  if (chunk.records.size() != chunk.info.uncompressed_size) {
    throw std::runtime_error("MCAP: a chunk is shorter than its stated size");
  }
  return chunk;
}

}  // namespace multipanda::mcap
