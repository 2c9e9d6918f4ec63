#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/model/arm_model.hpp"
#include "core/record/cycle_record.hpp"
#include "core/state/arm_state.hpp"
#include "logs/mcap_writer.hpp"

namespace multipanda {

// What the recorder knows of an arm beyond its name, for the model summary.
struct RecordedArm {
  std::shared_ptr<const ArmModel> model;  // none: no model summary of this arm
  ArmFrames frames;                       // at the start; changes come as events
  Load tool, load;
};

struct RecorderOptions {
  std::uint64_t model_every = 10;  // cycles between two model summaries; 0: none
  std::int64_t log_time_offset_ns =
      0;  // added to loop times; 0 in simulation, so that equal runs give equal logs
  std::map<std::string, std::string> info;    // into the metadata record "run": scene, seed, versions, ...
  std::vector<mcap::Attachment> attachments;  // scene file, ...
  McapWriter::Options writer;
};

struct RecorderStatus {
  std::filesystem::path log;
  std::uint64_t cycles = 0;       // cycle records taken
  std::uint64_t cycles_lost = 0;  // that the loop could not leave: the writer was too far behind
  std::uint64_t events_lost = 0;
  WriterStatus writer;
  // For people, one sentence each; empty: nothing is missing.
  std::vector<std::string> missing() const;
};

// Takes what the loop leaves in a RecordRing and writes it as a log, on a thread of its own. It may fall
// behind, fail or stand still: the loop never waits for it. Topics and messages: docs/logs.md.
class Recorder {
 public:
  // Creates the file, starts the thread. Throws std::runtime_error when the file cannot be created, and
  // std::invalid_argument when `arms` does not have an element per arm of the layout. `ring` must live
  // longer.
  Recorder(const std::filesystem::path& log, const RecordLayout& layout, RecordRing& ring,
           std::vector<RecordedArm> arms, RecorderOptions options);
  ~Recorder();  // stops
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  // Any thread but the loop's. At most about 50 ms old while the recording goes on.
  RecorderStatus status() const;

  // Takes what is left in the ring, closes the file. Call when the loop has ended; not from two threads at
  // once.
  RecorderStatus stop();

 private:
  class Sink;
  void run();
  bool drain();
  void publish_status();

  RecordRing& ring_;
  std::unique_ptr<Sink> sink_;
  mutable std::mutex status_mutex_;
  RecorderStatus status_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

// A new folder DIRECTORY/<date>_<time>_<scene>, with a number behind it if there is one already. Throws
// std::runtime_error when it cannot be created.
std::filesystem::path make_run_directory(const std::filesystem::path& directory, const std::string& scene);

}  // namespace multipanda
