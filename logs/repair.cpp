#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <optional>
#include <stdexcept>
#include <string>
#include <sys/file.h>
#include <unistd.h>
#include <utility>

#include "logs/export.hpp"
#include "logs/mcap_format.hpp"
#include "logs/mcap_reader.hpp"

namespace multipanda {
namespace {

using mcap::Opcode;

// Lock held during repair: excludes an active writer, whose data would go into the replaced file, and a
// second repair.
class Lock {
 public:
  explicit Lock(const std::filesystem::path& path) : file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
    if (file_ < 0)
      throw std::runtime_error("cannot open the log " + path.string() + ": " + std::strerror(errno));
    if (::flock(file_, LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK) return;
    ::close(file_);
    throw std::runtime_error(path.string() + " is still being written; end that run first");
  }
  ~Lock() { ::close(file_); }
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;

 private:
  int file_;
};

// The new file; removed unless it replaces the old one.
class Replacement {
 public:
  explicit Replacement(const std::filesystem::path& target)
      : target_(target), path_(target.string() + ".repair"), file_(std::fopen(path_.c_str(), "wb")) {
    if (file_ == nullptr) fail();
  }
  ~Replacement() {
    if (file_ != nullptr) std::fclose(file_);
    if (!in_place_) std::filesystem::remove(path_, ignored_);
  }
  Replacement(const Replacement&) = delete;
  Replacement& operator=(const Replacement&) = delete;

  std::uint64_t size() const { return size_; }
  void append(std::string_view bytes) {
    if (std::fwrite(bytes.data(), 1, bytes.size(), file_) != bytes.size()) fail();
    size_ += bytes.size();
  }
  void put_in_place() {
    // The new content must be on the disk before the old name refers to it.
    if (std::fflush(file_) != 0 || ::fsync(::fileno(file_)) != 0) fail();
    std::FILE* file = std::exchange(file_, nullptr);
    if (std::fclose(file) != 0) fail();
    std::filesystem::permissions(path_, std::filesystem::status(target_).permissions(), ignored_);
    std::filesystem::rename(path_, target_);
    in_place_ = true;
  }

 private:
  [[noreturn]] void fail() const {
    const int error = errno;
    throw std::runtime_error("cannot write " + path_.string() + ": " + std::strerror(error) +
                             "; the log is unchanged. A repair needs as much free space as the log's size");
  }
  std::filesystem::path target_, path_;
  std::FILE* file_;
  std::uint64_t size_ = 0;
  bool in_place_ = false;
  std::error_code ignored_;
};

std::string_view as_text(mcap::Bytes bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// Schemas and channels may be inside a chunk (other writers do that); messages give the index.
mcap::ChunkIndexEntries index_of(std::string_view records, mcap::Summary& summary) {
  mcap::ChunkIndexEntries entries;
  const mcap::Bytes bytes = mcap::as_bytes(records);
  for (std::size_t offset = 0; offset < bytes.size();) {
    const mcap::InnerRecord record = mcap::take_record(bytes, offset);
    if (record.opcode == Opcode::schema) summary.add(mcap::decode_schema(record.content));
    if (record.opcode == Opcode::channel) summary.add(mcap::decode_channel(record.content));
    if (record.opcode == Opcode::message) {
      const mcap::MessageHead message = mcap::decode_message(record.content);
      entries[message.channel].push_back({message.log_time_ns, record.offset});
    }
  }
  return entries;
}

// What a log with footer holds; none: it has no footer.
std::optional<RepairResult> look_through(const std::filesystem::path& path) {
  RepairResult found;
  McapScanner scanner(path);
  mcap::Summary unused;
  while (const auto record = scanner.next()) {
    if (record->opcode == Opcode::message) ++found.messages;
    if (record->opcode != Opcode::chunk) continue;
    try {
      for (const auto& entries : index_of(mcap::decode_chunk(record->content).records, unused))
        found.messages += entries.second.size();
    } catch (const std::runtime_error&) {
      ++found.chunks_dropped;
    }
  }
  if (!scanner.complete()) return std::nullopt;
  found.chunks_dropped += scanner.gaps();
  return found;
}

}  // namespace

RepairResult repair_log(const std::filesystem::path& path, bool closed_stays) {
  RepairResult result;
  const Lock lock(path);
  const auto closed = look_through(path);
  if (closed && (closed_stays || closed->chunks_dropped == 0)) {
    result.was_complete = true;
    result.messages = closed->messages;
    return result;
  }

  McapScanner scanner(path);
  Replacement file(path);
  mcap::Summary summary;
  file.append(mcap::kMagic);
  bool in_data = true;
  std::uint64_t last_kept = scanner.whole_bytes();
  while (in_data) {
    const auto found = scanner.next();
    if (!found) break;
    const std::uint64_t at = file.size();
    const auto keep = [&] {
      const std::string whole = mcap::record(found->opcode, as_text(found->content));
      file.append(whole);
      return whole.size();
    };
    switch (found->opcode) {
      case Opcode::chunk: {
        mcap::EncodedChunk chunk;
        mcap::ChunkIndexEntries entries;
        try {
          const mcap::DecodedChunk decoded = mcap::decode_chunk(found->content);
          entries = index_of(decoded.records, summary);
          chunk = mcap::wrap_chunk(as_text(decoded.compressed), decoded.info, entries);
        } catch (const std::runtime_error&) {
          ++result.chunks_dropped;
          break;
        }
        file.append(chunk.bytes);
        summary.add(chunk.info, entries, at, chunk.chunk_length, chunk.index_lengths);
        break;
      }
      case Opcode::message_index:
        break;  // rebuilt with each chunk
      case Opcode::message:
        throw std::runtime_error(path.string() +
                                 " has messages outside of chunks; it was not written by this program "
                                 "and cannot be repaired");
      case Opcode::data_end:
      case Opcode::footer:
        in_data = false;
        continue;
      case Opcode::schema:
        summary.add(mcap::decode_schema(found->content));
        keep();
        break;
      case Opcode::channel:
        summary.add(mcap::decode_channel(found->content));
        keep();
        break;
      case Opcode::metadata:
        summary.add(mcap::decode_metadata(found->content), at, keep());
        break;
      case Opcode::attachment:
        summary.add(mcap::decode_attachment(found->content), at, keep());
        break;
      default:
        keep();
        break;
    }
    last_kept = scanner.whole_bytes();
  }
  if (file.size() == mcap::kMagic.size()) file.append(mcap::header_record("multipanda"));
  file.append(summary.encode_end(file.size()));
  if (!closed) result.bytes_dropped = scanner.file_bytes() - last_kept;
  result.chunks_dropped += scanner.gaps();
  result.messages = summary.messages();
  file.put_in_place();
  return result;
}

}  // namespace multipanda
