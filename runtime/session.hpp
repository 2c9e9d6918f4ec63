#pragma once

#include <atomic>
#include <condition_variable>
#include <exception>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "core/cycle/control_cycle.hpp"
#include "core/rt/thread_setup.hpp"
#include "logs/recorder.hpp"
#include "runtime/backends.hpp"
#include "runtime/live_input/server.hpp"
#include "runtime/live_input/state_board.hpp"
#include "runtime/reflex_watch.hpp"
#include "runtime/run_adapter.hpp"
#include "runtime/status.hpp"
#include "runtime/summary.hpp"
#include "scene/scene.hpp"

namespace multipanda {

struct SessionOptions {
  bool paced = true;                 // to the wall clock; else as fast as possible
  BackendOptions backend;            // whose arms; default: as the scene says
  std::optional<double> duration_s;  // of the loop's time; default: the scene's; 0: until stopped
  std::filesystem::path record;      // folder that gets a new folder with the log; empty: no log
  ThreadSetup thread;                // asked for, never insisted on; unpaced runs never get SCHED_FIFO
  double hold_s = 0.2;               // how long the arms are held before a stopped run ends
  std::size_t ring_cycles = 0;       // records that may wait for the disk; 0: by their size
  // Where live input is taken (docs/live_input.md); empty: nowhere. Its folder must exist.
  std::filesystem::path socket;
  // Sees every record, in order, on the relay's thread: for tests and comparisons.
  std::function<void(const CycleRecord&)> observer;
  // A way to speak to the run beside the socket (ROS); none: nullptr. Its records come within about 0.2 ms.
  MakeRunAdapter make_adapter;
  // Called between two steps on the loop's thread, to look at the world itself (a simulation's objects). What
  // it does counts as the loop's own work; it must neither block nor throw.
  std::function<void(const Tick&, const Backend&)> on_loop;
  std::uint64_t model_every = 10;  // cycles between two model summaries in the log
  // Another world than `backend` names. Its loop time must advance by its own period per step.
  std::function<std::unique_ptr<Backend>(const Scene&)> make_backend;
};

// One run of a scene: models, backend, control cycle, log, and the threads they need.
//
//   loop   steps the cycle, nothing else
//   relay  takes the loop's records, keeps the status, hands them on to the recorder
//   recorder (with a log)  writes them to disk
//
// Paced, the loop waits for nobody: what the disk cannot take in time is missing in the log, and the summary
// says so. Unpaced, it waits between two steps until there is room, so that no record is lost.
class Session {
 public:
  // Builds everything; nothing moves yet. Throws std::invalid_argument (a scene that cannot be), or
  // std::runtime_error (models, plant, log folder or socket cannot be had). `registry` must live longer.
  Session(Scene scene, const Registry& registry, SessionOptions options);
  ~Session();  // stops
  Session(const Session&) = delete;

  const Scene& scene() const { return scene_; }
  double duration_s() const { return duration_s_; }  // 0: until stopped
  Backend& backend() { return *backend_.backend; }
  const RecordLayout& layout() const { return cycle_->layout(); }  // of the records
  const std::vector<std::shared_ptr<const ArmModel>>& models() const { return models_; }
  MultimodeController& modes() { return cycle_->modes(); }               // requests while running
  const std::filesystem::path& directory() const { return directory_; }  // of this run; empty: no log

  void start();
  // All arms to hold, then the end. Any thread; more than once is once.
  void stop() { stop_asked_.store(true, std::memory_order_release); }
  // True when the loop has ended, at the latest after `timeout_s`.
  bool wait_for_end(double timeout_s);
  RunStatus status() const;
  // What drives the arms, in words: "mujoco", "left fci 172.16.0.2, right mujoco".
  const std::string& backend_description() const { return backend_.description; }

  // Waits for the loop, closes the log. Rethrows what ended the loop, if it was an exception of the backend.
  RunSummary finish();

 private:
  void build();
  void open_log();
  void run_loop();
  bool keep_on();
  bool is_over(const Tick& tick);
  void wait_for_room();
  void run_relay();
  bool relay();
  void wait_for_records();
  void explain_errors(const CycleRecord& record);
  RunSummary summary();

  const Scene scene_;
  const Registry& registry_;
  const SessionOptions options_;
  double duration_s_ = 0;
  BackendSet backend_;
  std::unique_ptr<ControlCycle> cycle_;
  std::vector<std::shared_ptr<const ArmModel>> models_;
  std::unique_ptr<StatusBoard> board_;
  StateBoard live_state_;

  std::filesystem::path directory_, log_;
  std::unique_ptr<RecordRing> log_ring_;  // relay -> recorder
  std::unique_ptr<Recorder> recorder_;
  RecorderStatus recorded_;

  // Relay thread
  std::unique_ptr<ReflexWatch> reflexes_;
  std::vector<ReflexReport> reflex_reports_;
  HostTime last_record_;  // when the newest one was taken over

  // Loop thread
  bool closing_ = false;
  LoopTime first_, close_at_;
  HostTime close_by_;  // a world that stands still must not keep a stopped run alive
  std::uint64_t first_cycle_ = 0;
  RunEnd end_ = RunEnd::backend;
  std::vector<SetupStep> setup_;
  std::exception_ptr failure_;
  std::vector<std::optional<fci::ArmStatistics>> links_at_end_;  // before the backend let go
  std::string problem_;
  HostTime begun_, ended_;

  std::unique_ptr<LiveServer> live_;     // uses all of the above
  std::unique_ptr<RunAdapter> adapter_;  // as well

  std::atomic<bool> stop_asked_{false}, loop_ended_{false};
  std::mutex end_mutex_;
  std::condition_variable end_changed_;
  std::thread loop_, relay_;
};

}  // namespace multipanda
