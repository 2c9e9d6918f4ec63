#include "logs/mcap_writer.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <unistd.h>

namespace multipanda {

McapWriter::McapWriter(const std::filesystem::path& path, const Options& options) : options_(options) {
  file_ = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (file_ < 0) {
    throw std::runtime_error("cannot create the log " + path.string() + ": " + std::strerror(errno) +
                             "; choose another folder or make this one writable");
  }
  // Tells repair() that a writer is active; released when this process ends for any reason. Without file
  // locks only that warning is lost.
  (void)!::flock(file_, LOCK_EX | LOCK_NB);
  pending_ = std::string(mcap::kMagic) + mcap::header_record("multipanda");
  append_pending_and({});
}

McapWriter::~McapWriter() { close(); }

std::uint16_t McapWriter::add_channel(std::string_view topic, std::string_view type,
                                      std::string_view definition) {
  auto schema = schema_ids_.find(type);
  if (schema == schema_ids_.end()) {
    const auto id = static_cast<std::uint16_t>(schema_ids_.size() + 1);
    schema = schema_ids_.emplace(std::string(type), id).first;
    const mcap::Schema record{id, std::string(type), "ros2msg", std::string(definition)};
    pending_ += mcap::encode(record);
    summary_.add(record);
  }
  const auto id = static_cast<std::uint16_t>(summary_.channels().size() + 1);
  const mcap::Channel record{id, schema->second, std::string(topic), "cdr", {}};
  pending_ += mcap::encode(record);
  summary_.add(record);
  return id;
}

bool McapWriter::add(const mcap::Attachment& attachment) {
  const std::string bytes = mcap::encode(attachment);
  if (!append_pending_and(bytes)) return false;
  summary_.add(attachment, status_.bytes - bytes.size(), bytes.size());
  return true;
}

bool McapWriter::add(const mcap::Metadata& metadata) {
  const std::string bytes = mcap::encode(metadata);
  if (!append_pending_and(bytes)) return false;
  summary_.add(metadata, status_.bytes - bytes.size(), bytes.size());
  return true;
}

void McapWriter::write_bytes(std::uint16_t channel, std::int64_t log_time_ns,
                             std::span<const std::uint8_t> cdr) {
  if (chunk_messages_ == 0) chunk_begin_ = std::chrono::steady_clock::now();
  const auto time = static_cast<std::uint64_t>(std::max<std::int64_t>(log_time_ns, 0));
  entries_[channel].push_back({time, chunk_.size()});
  ++chunk_messages_;

  const auto put = [this](auto value) {
    chunk_.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  put(static_cast<std::uint8_t>(mcap::Opcode::message));
  put(std::uint64_t{2 + 4 + 8 + 8 + cdr.size()});
  put(channel);
  put(sequences_[channel]++);
  put(time);  // log time
  put(time);  // publish time
  chunk_.append(reinterpret_cast<const char*>(cdr.data()), cdr.size());
  if (chunk_.size() >= options_.chunk_bytes) flush();
}

void McapWriter::flush_if_due() {
  if (chunk_messages_ > 0 && std::chrono::steady_clock::now() - chunk_begin_ >= options_.chunk_age) flush();
}

void McapWriter::flush() {
  if (chunk_messages_ == 0) return;
  if (append_chunk()) {
    status_.messages_written += chunk_messages_;
  } else {
    status_.messages_lost += chunk_messages_;
    for (const auto& [channel, messages] : entries_) {
      status_.lost_by_topic[summary_.channels().at(channel).topic] += messages.size();
    }
  }
  chunk_.clear();
  entries_.clear();
  chunk_messages_ = 0;
}

bool McapWriter::append_chunk() {
  mcap::EncodedChunk chunk;
  try {
    chunk = mcap::encode_chunk(chunk_, entries_);
  } catch (const std::runtime_error& e) {
    if (status_.error.empty()) status_.error = e.what();
    return false;
  }
  if (!append_pending_and(chunk.bytes)) return false;
  summary_.add(chunk.info, entries_, status_.bytes - chunk.bytes.size(), chunk.chunk_length,
               chunk.index_lengths);
  return true;
}

const WriterStatus& McapWriter::close() {
  if (file_ < 0) return status_;
  flush();
  append_pending_and({});
  status_.closed = pending_.empty() && append(summary_.encode_end(status_.bytes), false);
  // Returns unused reserved space. Pipes and devices refuse, but have no reserved space.
  (void)!::ftruncate(file_, static_cast<off_t>(status_.bytes));
  ::fdatasync(file_);
  if (::close(file_) != 0) fail("closing", errno);
  file_ = -1;
  return status_;
}

bool McapWriter::append_pending_and(std::string_view bytes) {
  if (pending_.empty()) return append(bytes, true);
  if (!append(pending_ + std::string(bytes), true)) return false;
  pending_.clear();
  return true;
}

// Allocates disk space up to `end`, beyond the file's current end. File systems without this function are
// asked only once; write() then reports a full disk.
bool McapWriter::reserve(std::uint64_t end) {
  rlimit limit{};
  if (::getrlimit(RLIMIT_FSIZE, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY && end > limit.rlim_cur) {
    fail("writing", EFBIG);  // avoids the signal that write() would raise
    return false;
  }
  const auto from = static_cast<off_t>(status_.bytes);
  if (::fallocate(file_, FALLOC_FL_KEEP_SIZE, from, static_cast<off_t>(end) - from) != 0 &&
      (errno == ENOSPC || errno == EDQUOT || errno == EFBIG)) {
    fail("writing", errno);
    return false;
  }
  return true;
}

bool McapWriter::append(std::string_view bytes, bool keep_reserve) {
  if (broken_ || file_ < 0) return false;
  if (bytes.empty()) return true;
  // Space for the final record of missing messages and one more chunk index.
  constexpr std::size_t kSpare = 64u << 10;
  const std::uint64_t end =
      status_.bytes + bytes.size() + (keep_reserve ? summary_.size_bound() + kSpare : 0);
  if (!reserve(end)) return false;
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n = ::write(file_, bytes.data() + done, bytes.size() - done);
    if (n > 0) {
      done += static_cast<std::size_t>(n);
    } else if (n == 0 || errno != EINTR) {
      fail("writing", n == 0 ? ENOSPC : errno);
      const auto whole = static_cast<off_t>(status_.bytes);
      broken_ = done > 0 && (::ftruncate(file_, whole) != 0 || ::lseek(file_, whole, SEEK_SET) != whole);
      return false;
    }
  }
  status_.bytes += bytes.size();
  return true;
}

void McapWriter::fail(std::string_view what, int error_number) {
  if (status_.error.empty()) status_.error = std::string(what) + " the log: " + std::strerror(error_number);
}

}  // namespace multipanda
