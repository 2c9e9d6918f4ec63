#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "core/model/arm_model.hpp"
#include "core/model/base_mount.hpp"
#include "core/record/cycle_record.hpp"
#include "core/state/arm_state.hpp"
#include "logs/log_choice.hpp"
#include "logs/mcap_writer.hpp"
#include "logs/object_ring.hpp"

namespace multipanda {

// Additional data of an arm for the model summary.
struct RecordedArm {
  std::shared_ptr<const ArmModel> model;  // none: no model summary for this arm
  ArmFrames frames;                       // at the start; changes come as events
  Load tool, load;
  std::optional<BaseMount> mount = {};  // of an arm that stands on another one
};

struct RecorderOptions {
  LogEvery every;
  // Added to loop times; 0 in simulation, so that equal runs give equal logs.
  std::int64_t log_time_offset_ns = 0;
  std::map<std::string, std::string> info;    // into the metadata record "run": scene, seed, versions, ...
  std::vector<mcap::Attachment> attachments;  // scene file, ...
  ObjectRing* objects = nullptr;              // must outlive the recorder; none: no poses of objects
  McapWriter::Options writer;
};

struct RecorderStatus {
  std::filesystem::path log;
  std::uint64_t cycles = 0;       // cycle records taken
  std::uint64_t cycles_lost = 0;  // records that the loop could not store: the writer was too far behind
  std::uint64_t events_lost = 0;
  std::uint64_t objects_lost = 0;  // how often the loop could not store the objects' poses
  WriterStatus writer;
  // One sentence each; empty: nothing is missing.
  std::vector<std::string> missing() const;
};

// Takes the loop's records from a RecordRing and writes them as a log, on its own thread. It may fall behind,
// fail or stall without delaying the loop. Topics and messages: docs/logs.md.
class Recorder {
 public:
  // Creates the file and starts the thread. Throws std::runtime_error if the file cannot be created,
  // and std::invalid_argument unless `arms` has one element per arm of the layout. `ring` must
  // outlive this object.
  Recorder(const std::filesystem::path& log, const RecordLayout& layout, RecordRing& ring,
           std::vector<RecordedArm> arms, RecorderOptions options);
  ~Recorder();  // stops
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  // Any thread but the loop's, because it may wait. Written after the record of its cycle.
  void mark(const EpisodeMark& mark);

  // Any thread but the loop's. At most about 50 ms old during recording.
  RecorderStatus status() const;

  // Writes what remains in the ring and closes the file. Call after the loop has ended, from one thread only.
  RecorderStatus stop();

  class Sink;  // record_messages.hpp

 private:
  void run();
  bool drain();
  void write_marks(std::uint64_t before);
  void write_objects(std::uint64_t before);
  void publish_status();

  RecordRing& ring_;
  ObjectRing* objects_;
  std::unique_ptr<Sink> sink_;
  mutable std::mutex status_mutex_;
  RecorderStatus status_;
  std::mutex marks_mutex_;
  std::deque<EpisodeMark> marks_;  // not yet written
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

// Creates a new folder DIRECTORY/<date>_<time>_<scene>, with a number added if it exists. Throws
// std::runtime_error if it cannot be created.
std::filesystem::path make_run_directory(const std::filesystem::path& directory, const std::string& scene);

}  // namespace multipanda
