#include "logs/recorder.hpp"

#include <chrono>
#include <csignal>
#include <ctime>
#include <limits>
#include <pthread.h>

#include "logs/record_messages.hpp"

namespace multipanda {

std::vector<std::string> RecorderStatus::missing() const {
  std::vector<std::string> out;
  if (cycles_lost > 0) {
    out.push_back(std::to_string(cycles_lost) +
                  " cycles are not in the log: the writer fell too far behind the loop");
  }
  if (events_lost > 0)
    out.push_back(std::to_string(events_lost) + " events are not in the log: too many at the same time");
  if (objects_lost > 0) {
    out.push_back("poses of objects are missing " + std::to_string(objects_lost) +
                  " times: the writer fell too far behind the loop");
  }
  if (writer.messages_lost > 0) {
    std::string text =
        std::to_string(writer.messages_lost) + " messages could not be written (" + writer.error + "):";
    for (const auto& [topic, count] : writer.lost_by_topic) text += " " + topic + " " + std::to_string(count);
    out.push_back(text);
  } else if (!writer.error.empty()) {
    out.push_back(writer.error);
  }
  return out;
}

Recorder::Recorder(const std::filesystem::path& log, const RecordLayout& layout, RecordRing& ring,
                   std::vector<RecordedArm> arms, RecorderOptions options)
    : ring_(ring),
      objects_(options.objects),
      sink_(std::make_unique<Sink>(log, layout, std::move(arms), std::move(options))) {
  status_.log = log;
  publish_status();
  thread_ = std::thread([this] { run(); });
}

Recorder::~Recorder() { (void)stop(); }

void Recorder::run() {
  pthread_setname_np(pthread_self(), "recorder");
  sigset_t all;  // the main thread handles signals
  sigfillset(&all);
  pthread_sigmask(SIG_BLOCK, &all, nullptr);
  auto published = std::chrono::steady_clock::now();
  // A paced loop's thread wakes for ten cycles at once, since waking costs more than writing one. An unpaced
  // loop fills the ring in a few of these.
  constexpr std::uint64_t kPacedCycles = 20;
  std::uint64_t cycles_before = 0;
  while (true) {
    const bool last_round = stopping_.load(std::memory_order_acquire);
    const bool any = drain();
    sink_->writer().flush_if_due();
    if (const auto now = std::chrono::steady_clock::now(); now - published > std::chrono::milliseconds(50)) {
      publish_status();
      published = now;
    }
    if (last_round) return;
    if (any) continue;
    const bool paced = sink_->cycles() - cycles_before <= kPacedCycles;
    cycles_before = sink_->cycles();
    std::this_thread::sleep_for(std::chrono::milliseconds(paced ? 10 : 1));
  }
}

// Writes events before the record of their cycle, so that the file has the order of the loop.
bool Recorder::drain() {
  bool any = false;
  while (const CycleRecord* record = ring_.ring.front()) {
    for (const Event* event = ring_.events.front(); event != nullptr && event->cycle <= record->cycle;
         event = ring_.events.front()) {
      sink_->write(*event);
      ring_.events.pop();
    }
    write_marks(record->cycle);
    write_objects(record->cycle);
    sink_->write(*record);
    ring_.ring.pop();
    sink_->writer().flush_if_due();
    any = true;
    if (sink_->cycles() % 1024 == 0) break;  // check status and stop regularly
  }
  return any;
}

void Recorder::mark(const EpisodeMark& mark) {
  const std::lock_guard lock(marks_mutex_);
  marks_.push_back(mark);
}

// Those before the record of cycle `before`.
void Recorder::write_marks(std::uint64_t before) {
  const std::lock_guard lock(marks_mutex_);
  for (; !marks_.empty() && marks_.front().cycle < before; marks_.pop_front()) sink_->write(marks_.front());
}

// The loop stores a cycle's poses before the next cycle's record, so all of them are available.
void Recorder::write_objects(std::uint64_t before) {
  if (objects_ == nullptr) return;
  while (const ObjectRing::Row* row = objects_->front(before)) {
    sink_->write(*row);
    objects_->pop();
  }
}

void Recorder::publish_status() {
  const std::lock_guard lock(status_mutex_);
  status_.cycles = sink_->cycles();
  status_.cycles_lost = ring_.dropped_records.load(std::memory_order_relaxed);
  status_.events_lost = ring_.dropped_events.load(std::memory_order_relaxed);
  if (objects_ != nullptr) status_.objects_lost = objects_->lost();
  status_.writer = sink_->writer().status();
}

RecorderStatus Recorder::status() const {
  const std::lock_guard lock(status_mutex_);
  return status_;
}

RecorderStatus Recorder::stop() {
  if (!thread_.joinable()) return status();
  stopping_.store(true, std::memory_order_release);
  thread_.join();
  while (drain()) {
  }
  while (const Event* event = ring_.events.front()) {
    sink_->write(*event);
    ring_.events.pop();
  }
  write_marks(std::numeric_limits<std::uint64_t>::max());
  write_objects(std::numeric_limits<std::uint64_t>::max());
  sink_->writer().flush();
  publish_status();
  sink_->write_missing(status());
  sink_->writer().close();
  publish_status();
  return status();
}

std::filesystem::path make_run_directory(const std::filesystem::path& directory, const std::string& scene) {
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  localtime_r(&now, &local);
  char stamp[32];
  (void)std::strftime(stamp, sizeof(stamp), "%Y-%m-%d_%H-%M-%S", &local);
  std::filesystem::path base = directory / (std::string(stamp) + "_" + scene);
  std::error_code error;
  std::filesystem::create_directories(directory, error);
  std::filesystem::path path = base;
  for (int n = 2; !error && !std::filesystem::create_directory(path, error); ++n) {
    path = base.string() + "_" + std::to_string(n);  // exists already: two runs in one second
  }
  if (error) {
    throw std::runtime_error("cannot create the folder " + path.string() + ": " + error.message() +
                             "; choose another one or make it writable");
  }
  return path;
}

}  // namespace multipanda
