#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
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
#include "runtime/error_report.hpp"
#include "runtime/kept_logs.hpp"
#include "runtime/live_input/latest_state.hpp"
#include "runtime/live_input/server.hpp"
#include "runtime/object_poses.hpp"
#include "runtime/run_adapter.hpp"
#include "runtime/run_monitor.hpp"
#include "runtime/shared_records/shared_records.hpp"
#include "runtime/summary.hpp"
#include "scene/scene.hpp"

namespace multipanda {

struct SessionOptions {
  bool paced = true;                 // in real time; otherwise as fast as possible
  BackendOptions backend;            // kinds of arms; default: as in the scene
  std::optional<double> duration_s;  // loop time; default: the scene's; 0: until stopped
  std::filesystem::path record;      // folder in which a new folder with the log is created; empty: no log
  ThreadSetup thread;                // requested, not required; unpaced runs never use SCHED_FIFO
  double hold_s = 0.2;               // time in hold before a stopped run ends
  std::size_t ring_cycles = 0;       // capacity for records that wait for the disk; 0: chosen by their size
  // Socket of live input (docs/live_input.md); empty: none. Its folder must exist.
  std::filesystem::path socket;
  std::filesystem::path second_socket;  // taken if a live process has `socket`; empty: refused
  bool share_records = false;           // even without a socket, for other clients (live_input())
  // Called with every record in order on the relay thread, for tests and comparisons.
  std::function<void(const CycleRecord&)> observer;
  // Adapter next to the socket (ROS); may be empty. It receives records within about 0.2 ms.
  MakeRunAdapter make_adapter;
  // Called between two steps on the loop's thread, to read the world (objects of a simulation). It must
  // neither block nor throw.
  std::function<void(const Tick&, const Backend&)> on_loop;
  LogEvery log_every;     // how often each kind of data is logged
  bool keep_last = true;  // a paced run without a log keeps its last 30 s (KeptLogs)
  // Whether scenes with carried arms are run (docs/models.md). Programs that require fixed bases leave it
  // false; such scenes are then refused.
  bool moving_bases = false;
  // Replaces the backend. Its loop time must advance by its own period per step.
  std::function<std::unique_ptr<Backend>(const Scene&)> make_backend;
};

// One run of a scene: models, backend, control cycle, log, and the threads they need.
//
//   loop   steps the cycle, nothing else
//   relay  takes the loop's records, updates the status, passes them to the recorder
//   recorder (with a log)  writes them to disk
//
// A paced loop never waits: records that the disk is too slow for are missing in the log, and the summary
// lists them. An unpaced loop waits between two steps for space, so that no record is lost.
class Session {
 public:
  // Builds everything; nothing moves yet. Throws std::invalid_argument (invalid scene) or std::runtime_error
  // (models, plant, log folder or socket not available). `registry` must outlive the session.
  Session(Scene scene, const Registry& registry, SessionOptions options);
  ~Session();  // stops
  Session(const Session&) = delete;

  const Scene& scene() const { return scene_; }
  const Registry& registry() const { return registry_; }
  double duration_s() const { return duration_s_; }  // 0: until stopped
  Backend& backend() { return *backend_.backend; }
  const RecordLayout& layout() const { return cycle_->layout(); }  // of the records
  const std::vector<std::shared_ptr<const ArmModel>>& models() const { return models_; }
  MultimodeController& modes() { return cycle_->modes(); }               // requests while running
  const std::filesystem::path& directory() const { return directory_; }  // of this run; empty: no log
  KeptLog keep();  // of the last 30 s, or the run's own; any thread
  // For further clients (the cockpit), on their own threads, until finish() is called. With share_records or
  // a socket.
  LiveInputContext live_input() { return live_context_; }
  std::filesystem::path socket() const { return live_ ? live_->path() : std::filesystem::path(); }

  void start();
  // Holds all arms, then ends the run. Any thread; idempotent.
  void stop() { stop_requested_.store(true, std::memory_order_release); }
  // True once the loop has ended; returns after at most `timeout_s`.
  bool wait_for_end(double timeout_s);
  RunStatus status() const;
  // The rule that took the arm from its last controllet (LatestState); none: a request did.
  Intervention removed_by(ArmIndex arm) const;
  // Backends of the arms: "mujoco", or "left fci 172.16.0.2, right mujoco".
  const std::string& backend_description() const { return backend_.description; }

  // Waits for the loop and closes the log. Rethrows an exception that ended the loop.
  RunSummary finish();

 private:
  void build();
  void open_log();
  void keep_last();
  std::vector<RecordedArm> recorded_arms() const;
  RecorderOptions recorder_options() const;
  void open_live_input();
  void offer_stops();
  void share_records();
  void run_loop();
  void leave_arms_safe() noexcept;
  bool keep_on();
  bool is_over(const Tick& tick);
  void wait_for_room();
  void run_relay();
  bool relay();
  void wait_for_records();
  void relay_marks();
  void relay(const Event& event);
  void relay(const CycleRecord& record);
  void log(const CycleRecord& record);
  void pass_waiting();
  std::vector<ReflexReport> explain_errors(const CycleRecord& record);
  RunSummary summary();

  const Scene scene_;
  const Registry& registry_;
  const SessionOptions options_;
  double duration_s_ = 0;
  BackendSet backend_;
  std::unique_ptr<ControlCycle> cycle_;
  std::vector<std::shared_ptr<const ArmModel>> models_;
  std::vector<std::optional<BaseMount>> mounts_;  // per arm
  std::mutex early_news_mutex_;
  std::vector<std::string> early_news_;  // reported by the backend before the monitor existed
  std::unique_ptr<RunMonitor> monitor_;
  LatestState latest_;
  std::unique_ptr<SharedRecords> shared_;  // with live input; none: not available on this computer
  LiveInputContext live_context_;

  std::filesystem::path directory_, log_;
  std::unique_ptr<RecordRing> log_ring_;  // relay -> recorder
  std::deque<CycleRecord> waiting_;       // the relay's, for that ring
  std::size_t most_waiting_ = 0;
  std::unique_ptr<ObjectPoses> poses_;   // loop -> clients
  std::unique_ptr<ObjectRing> objects_;  // loop -> recorder; none: no free objects
  std::unique_ptr<Recorder> recorder_;
  RecorderStatus recorded_;

  // Relay thread
  std::optional<RunEvents> events_;  // events to share
  std::unique_ptr<ReflexWatch> reflexes_;
  std::vector<ReflexReport> reflex_reports_;
  std::unique_ptr<KeptLogs> kept_;
  std::vector<std::filesystem::path> kept_logs_;
  HostTime last_record_;            // start of the newest record's cycle
  std::uint64_t last_cycle_ = 0;    // of that record
  std::uint64_t records_lost_ = 0;  // dropped by the loop

  // Loop thread
  bool closing_ = false;
  LoopTime first_, close_at_;
  HostTime close_by_;  // ends a stopped run if the world is paused
  std::uint64_t first_cycle_ = 0;
  RunEnd end_ = RunEnd::backend;
  std::vector<SetupStep> setup_;
  std::exception_ptr failure_;
  std::vector<std::optional<ConnectionStatistics>> connections_at_end_;  // before the backend was finished
  std::string problem_;
  HostTime started_, ended_;

  std::mutex marks_mutex_;
  std::vector<EpisodeMark> marks_;  // from live input, not yet relayed

  std::unique_ptr<LiveServer> live_;     // uses all of the above
  std::unique_ptr<RunAdapter> adapter_;  // uses all of the above

  std::atomic<bool> stop_requested_{false}, loop_ended_{false};
  std::mutex end_mutex_;
  std::condition_variable end_changed_;
  std::thread loop_, relay_;
};

// Displays the sessions of a command in sequence: the cockpit.
class SessionViewer {
 public:
  virtual ~SessionViewer() = default;
  virtual void prepare(SessionOptions& options) = 0;  // sets the options that it needs
  virtual void show(Session& session) = 0;            // before its start
  virtual void end() = 0;                             // before the session is destroyed; idempotent
};

// Shows a session for as long as this exists.
class Viewed {
 public:
  Viewed(SessionViewer* viewer, Session& session) : viewer_(viewer) {
    if (viewer_ != nullptr) viewer_->show(session);
  }
  ~Viewed() {
    if (viewer_ != nullptr) viewer_->end();
  }
  Viewed(const Viewed&) = delete;

 private:
  SessionViewer* viewer_;
};

}  // namespace multipanda
