#include "runtime/kept_logs.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <sys/mman.h>
#include <sys/resource.h>
#include <system_error>
#include <type_traits>
#include <unistd.h>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "core/record/arm_config.hpp"
#include "logs/record_messages.hpp"

namespace multipanda {
namespace {

constexpr std::chrono::seconds kSegment{1};
constexpr std::size_t kBuffer = 64u << 10;
constexpr std::size_t kLargestSegment = 64u << 20;

enum class Kind : std::uint8_t { record, event, mark };

constexpr std::size_t kWord = sizeof(std::uint64_t), kGroup = 64;  // words

// All parts of a record, each of whole words.
void for_parts(auto& record, auto part) {
  const auto each = [&](auto&... values) { (part(std::span(&values, 1)), ...); };
  each(record.cycle, record.t, record.start, record.period_s, record.overruns, record.stages,
       record.reference_count);
  part(std::span(record.arms));
  part(std::span(record.references));
  part(std::span(record.outputs));
}

std::size_t words_of(const CycleRecord& record) {
  std::size_t bytes = 0;
  for_parts(record, [&bytes](auto values) { bytes += values.size_bytes(); });
  return bytes / kWord;
}

template <class T>
std::span<const T> one(const T& value) {
  return std::span(&value, 1);
}

}  // namespace

struct KeptLogs::Segment {
  Segment(LoopTime begin, std::vector<RecordedArm> arms) : begin(begin), arms(std::move(arms)) {}
  ~Segment() { ::close(file); }
  Segment(const Segment&) = delete;
  Segment& operator=(const Segment&) = delete;

  const LoopTime begin;
  const std::vector<RecordedArm> arms;  // as they were then
  const int file = memfd_create("multipanda-last", MFD_CLOEXEC);
  std::size_t bytes = 0;
  bool full = false;
};

KeptLogs::KeptLogs(Parts parts) : parts_(std::move(parts)), arms_(parts_.arms) {
  rlimit limit{};  // of any file: to write beyond it ends the process
  if (getrlimit(RLIMIT_FSIZE, &limit) == 0 && limit.rlim_cur < kLargestSegment)
    throw std::system_error(EFBIG, std::generic_category(), "ulimit -f");
  words_.resize(words_of(empty_record()));
  before_ = words_;
  segments_.push_back(std::make_shared<Segment>(now_, arms_));
  if (segments_.back()->file < 0) throw std::system_error(errno, std::generic_category(), "memfd_create");
  writer_ = std::jthread([this](const std::stop_token& end) { write_logs(end); });
}

CycleRecord KeptLogs::empty_record() const {
  return {parts_.layout.arms.size(), parts_.layout.max_references, parts_.layout.output_count};
}

void KeptLogs::take(const Event& event) {
  const std::lock_guard lock(mutex_);
  put(one(Kind::event));
  put(one(event));
  if (event.arm >= arms_.size()) return;
  RecordedArm& arm = arms_[event.arm];
  (void)read_arm_config(event, arm.frames, arm.tool, arm.load);
}

void KeptLogs::take(const EpisodeMark& mark) {
  const std::lock_guard lock(mutex_);
  put(one(Kind::mark));
  put(one(mark));
}

void KeptLogs::take(const CycleRecord& record) {
  const std::lock_guard lock(mutex_);
  now_ = record.t;
  if (now_ - segments_.back()->begin >= kSegment) begin_segment();
  put(one(Kind::record));
  put_changes(record);
  if (buffer_.size() >= kBuffer) flush();
  if (!due_ || now_ < *due_) return;
  due_.reset();
  next_due_ = now_ + kBefore;
  if (auto [log, answer] = begin_log(); log.empty()) parts_.report(answer.get().reason);
}

template <class T>
void KeptLogs::put(std::span<const T> values) {
  static_assert(std::is_trivially_copyable_v<T>);
  const auto bytes = std::as_bytes(values);
  buffer_.insert(buffer_.end(), bytes.data(), bytes.data() + bytes.size());
}

// A bit for each word of a group, then those that differ from the record before: most do not.
void KeptLogs::put_changes(const CycleRecord& record) {
  std::uint64_t* word = words_.data();
  for_parts(record, [&word](auto values) {
    static_assert(sizeof(values[0]) % kWord == 0);
    std::memcpy(word, values.data(), values.size_bytes());
    word += values.size_bytes() / kWord;
  });
  const std::size_t size = buffer_.size();
  buffer_.resize(size + (words_.size() + words_.size() / kGroup + 2) * kWord);
  std::byte* to = buffer_.data() + size;
  for (std::size_t begin = 0; begin < words_.size(); begin += kGroup) {
    std::byte* const mask_at = std::exchange(to, to + kWord);
    std::uint64_t mask = 0;
    for (std::size_t i = begin; i < std::min(begin + kGroup, words_.size()); ++i) {
      const std::uint64_t changed = words_[i] != before_[i] ? 1 : 0;
      std::memcpy(to, &words_[i], kWord);
      to += kWord * changed;
      mask |= changed << (i - begin);
    }
    std::memcpy(mask_at, &mask, kWord);
  }
  buffer_.resize(static_cast<std::size_t>(to - buffer_.data()));
  words_.swap(before_);
}

// What finds no place is lost with the rest of its segment, and the log names the gap.
void KeptLogs::flush() {
  Segment& segment = *segments_.back();
  segment.full = segment.full || segment.bytes + buffer_.size() > kLargestSegment ||
                 pwrite(segment.file, buffer_.data(), buffer_.size(), static_cast<off_t>(segment.bytes)) !=
                     static_cast<ssize_t>(buffer_.size());
  if (!segment.full) segment.bytes += buffer_.size();
  buffer_.clear();
}

void KeptLogs::begin_segment() {
  flush();
  std::ranges::fill(before_, 0);
  segments_.push_back(std::make_shared<Segment>(now_, arms_));
  while (now_ - segments_[1]->begin > kBefore + kAfter) segments_.pop_front();
}

void KeptLogs::fault() {
  if (!due_) due_ = std::max(now_ + kAfter, next_due_);
}

std::vector<std::filesystem::path> KeptLogs::finish() {
  if (due_) {
    if (auto [log, answer] = keep(); log.empty()) parts_.report(answer.get().reason);
  }
  writer_ = {};  // after the last job
  std::erase_if(logs_, [](const auto& log) {
    std::error_code ignored;
    return !std::filesystem::exists(log, ignored);
  });
  return logs_;
}

KeptLog KeptLogs::keep() {
  const std::lock_guard lock(mutex_);
  return begin_log();
}

KeptLog KeptLogs::begin_log() {
  const auto refuse = [](const std::string& why) {
    return KeptLog(std::filesystem::path(), refuse_request("the last 30 s are not written: " + why));
  };
  if (segments_.size() == 1 && segments_[0]->bytes == 0 && buffer_.empty())
    return refuse("nothing has happened yet");
  if (logs_.size() == kMost)
    return refuse(fmt::format("this run has written {} logs, see {}; begin another one, with --record", kMost,
                              logs_.front().parent_path().string()));
  const std::filesystem::path folder = parts_.folder();
  if (folder.empty()) return refuse("no folder for temporary files can be created");
  const auto log = folder / fmt::format("last_30_s_{}.mcap", logs_.size() + 1);
  begin_segment();  // those before it stay as they are
  auto& job = jobs_.emplace_back([this, log, segments = Segments(segments_.begin(), segments_.end() - 1)] {
    RequestAnswer result = write(log, segments);
    parts_.report(result.success ? fmt::format("the last 30 s: {}", log.string()) : result.reason);
    return result;
  });
  changed_.notify_one();
  logs_.push_back(log);
  return {log, job.get_future()};
}

void KeptLogs::write_logs(const std::stop_token& end) {
  (void)setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), 10);  // this thread's: others come first
  std::unique_lock lock(mutex_);
  while (changed_.wait(lock, end, [this] { return !jobs_.empty(); })) {
    auto job = std::move(jobs_.front());
    jobs_.pop_front();
    lock.unlock();
    job();
    job = {};
    lock.lock();
  }
}

RequestAnswer KeptLogs::write(const std::filesystem::path& log, const Segments& segments) const {
  try {
    RecorderOptions options = parts_.options();
    options.writer.chunk_bytes = 1u << 20;  // less memory
    Recorder::Sink sink(log, parts_.layout, segments.front()->arms, std::move(options));
    CycleRecord record = empty_record();
    for (const auto& segment : segments) {
      std::vector<std::byte> bytes(segment->bytes);
      if (pread(segment->file, bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
        throw std::system_error(errno, std::generic_category(), "memory");
      std::vector<std::uint64_t> words(words_of(record));
      const std::byte* from = bytes.data();
      const auto get = [&from](auto values) {
        std::memcpy(values.data(), from, values.size_bytes());
        from += values.size_bytes();
      };
      const auto get_one = [&get]<class T>(T value) {
        get(std::span(&value, 1));
        return value;
      };
      while (from != bytes.data() + bytes.size()) {
        switch (get_one(Kind{})) {
          case Kind::record:
            for (std::size_t begin = 0; begin < words.size(); begin += kGroup) {
              const auto mask = get_one(std::uint64_t{});
              for (std::size_t i = begin; i < std::min(begin + kGroup, words.size()); ++i)
                if ((mask >> (i - begin) & 1) != 0) words[i] = get_one(std::uint64_t{});
            }
            for_parts(record, [word = words.data()](auto values) mutable {
              std::memcpy(values.data(), word, values.size_bytes());
              word += values.size_bytes() / kWord;
            });
            sink.write(record);
            break;
          case Kind::event:
            sink.write(get_one(Event{}));
            break;
          case Kind::mark:
            sink.write(get_one(EpisodeMark{}));
        }
      }
    }
    sink.writer().flush();
    RecorderStatus status{.log = log, .cycles = sink.cycles(), .writer = sink.writer().status()};
    sink.write_missing(status);
    status.writer = sink.writer().close();
    if (status.writer.messages_written == 0) std::filesystem::remove(log);
    if (status.missing().empty() && status.writer.closed) return {.success = true, .reason = {}};
    return {.success = false,
            .reason = fmt::format("{} is incomplete: {}", log.string(), fmt::join(status.missing(), "; "))};
  } catch (const std::exception& error) {
    return {.success = false, .reason = fmt::format("the last 30 s are not written: {}", error.what())};
  }
}

}  // namespace multipanda
