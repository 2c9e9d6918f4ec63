#pragma once

#include <atomic>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "arm_interface/command_success.hpp"
#include "core/cycle/backend.hpp"
#include "core/safety/torque_limiter.hpp"
#include "fci/client/arm_connection.hpp"
#include "fci/client/arm_mode.hpp"
#include "fci/client/arm_packet.hpp"
#include "fci/client/fci_backend.hpp"
#include "fci/client/posture_hold.hpp"

namespace multipanda::fci {

// One arm of FciBackend: its connection, its commander (the thread for TCP), and its interface to the loop.
// Loop and commander share only atomics and a triple buffer of states.
class ArmDriver {
 public:
  ArmDriver(FciArmConfig config, const FciOptions& options);
  ~ArmDriver();  // closes after the current request
  ArmDriver(const ArmDriver&) = delete;

  // --- any thread; executed by the commander, in order, but a stop of the motion next ---
  std::future<RequestAnswer> prepare();  // connects, checks and configures the arm
  std::future<RequestAnswer> begin();    // starts torque control
  std::future<RequestAnswer> leave(
      bool finished);  // closes; a motion that still runs is stopped, at once unless it was finished
  std::future<RequestAnswer> request(ArmRequest request);
  std::future<RequestAnswer> request(GripperRequest request);

  const FciArmConfig& config() const { return config_; }
  Capabilities capabilities() const;
  ConnectionStatistics statistics() const { return link_.statistics(); }
  ArmIdentity identity() const;

  // --- loop ---
  int udp_file() const { return link_.udp_file(); }
  void receive() noexcept;
  bool is_unread() const { return unread_; }  // a state not yet read by the loop
  void mark_read() { unread_ = false; }
  const RobotState& newest() const noexcept { return link_.newest(); }
  // Whether the arm is connected and configured.
  bool takes_part() const { return phase() >= Phase::stopped; }
  ArmMode mode(HostTime now) const noexcept;
  void fill(HostTime now, ArmState& state) noexcept;
  // Requests another kind of motion; none: the arm holds itself. The commander starts it.
  void request_motion(ArmMotion motion) noexcept;
  ArmMotion motion() const noexcept { return motion_.load(std::memory_order_acquire); }  // started last
  // Answers newest() in a motion other than torque. The command is sent unchecked.
  void command(RobotCommand& command) noexcept;
  // The answer to newest(), if the arm is in `move`. An invalid torque is not sent and stops the motion.
  void command(const JointVector& tau_cmd) noexcept;
  // The answer to newest() while no loop runs: holds the arm where it was at the first of these calls since
  // release(). `last`: as the last command of the motion.
  void hold(bool last) noexcept;
  void release() noexcept {
    posture_.release();
    held_packets_ = 0;
  }
  void forget_motion() noexcept {  // no torque was sent yet
    release();
    commanded_ = refused_ = false;
  }
  int held_packets() const noexcept { return held_packets_; }  // answered by hold() since release()

 private:
  using Phase = ArmPhase;
  using Work = std::function<RequestAnswer()>;
  struct Task {
    Work work;
    std::promise<RequestAnswer> promise;
    HostTime posted;
    bool ages = false;  // refused after FciOptions::request_patience_s, and after a gap (GapWatch)
    BeginBy begin_by = {};
  };
  Phase phase() const { return phase_.load(std::memory_order_acquire); }
  void enter(Phase phase) { phase_.store(phase, std::memory_order_release); }

  // Loop
  const JointVector& limited(const JointVector& tau) noexcept;
  void send_torque(const JointVector& tau) noexcept;
  void refuse_motion(const char* why) noexcept;

  // Commander
  std::future<RequestAnswer> post(Work work) { return post({std::move(work), {}, host_now()}); }
  std::future<RequestAnswer> post(Task task, bool next = false);
  void run();
  bool do_next_task();
  void watch();
  RequestAnswer guarded(const Work& work);
  void lost(const std::string& why);
  void connect_and_configure();
  void connect_end_effector();
  void check_model();
  bool configure();
  void send_settings();
  std::string in_reflex(const RobotState& state) const;
  void check_end_effector(const RobotState& state);
  void start_requested_motion(bool loop_runs = true);
  void change_motion();
  void set_frames(const ArmFrames& frames);
  void set_load(const Load& load);
  void confirm_load(const Load& load);
  void apply(const ArmRequest& request);
  // Each sets the value on the arm and stores the accepted one.
  void set(const SetLoad& request);
  void set(const SetFrames& request);
  void set(const SetJointStiffness& request);
  void set(const SetCartesianStiffness& request);
  void set(const SetCollisionThresholds& request);
  void set(const SetGuidingMode& request);
  void set(const auto&) {}  // request() has handled it
  void remember(const char* changed);
  void send_load();
  std::string unknown_load() const;
  void apply_beside_motion(const ArmRequest& request);
  void start_motion_of(HostTime asked);
  RequestAnswer recover(HostTime asked);
  RequestAnswer reconnect(HostTime asked);
  RequestAnswer stop();
  void notify(const std::string& text) const;
  [[noreturn]] void refuse(const std::string& text) const;
  std::string ctl_command(const char* word) const;  // "`multipanda ctl recover left`"

  // Sent at the start and after each reconnection: the scene's settings and later changes by requests, which
  // an arm loses when switched off.
  struct Settings {
    explicit Settings(const FciArmConfig& scene)
        : frames(scene.frames),
          load(scene.load),
          joint_stiffness(scene.joint_stiffness),
          cartesian_stiffness(scene.cartesian_stiffness),
          thresholds(scene.thresholds) {}
    bool has_changed(const char* name) const { return changed.find(name) != std::string::npos; }
    ArmFrames frames;
    Load load;
    std::optional<JointVector> joint_stiffness;
    std::optional<Vector6> cartesian_stiffness;
    std::optional<SetCollisionThresholds> thresholds;
    std::string changed;  // names of settings changed by requests
  };

  const FciArmConfig config_;
  const FciOptions& options_;
  Settings settings_;             // commander
  bool load_is_unknown_ = false;  // commander: no motion starts until a request has set the load
  ArmConnection link_;
  std::unique_ptr<EndEffector> end_effector_;
  std::atomic<bool> end_effector_connected_{false};
  std::atomic<Phase> phase_{Phase::offline};
  std::atomic<const char*> stop_requested_{nullptr};  // set by the loop: why
  // Since when a motion waits for the loop's first torque; 0: not any more, or no loop runs.
  static constexpr std::int64_t kUnanswered = -1;  // while it starts
  std::atomic<std::int64_t> running_ns_{0};
  std::atomic<std::int64_t> stopped_ns_{0};         // time of the last request to stop its motion
  std::atomic<double> low_success_{1};              // set by the loop: share to be reported; 1: none
  std::atomic<ArmMotion> requested_motion_;         // set by the loop
  std::atomic<ArmMotion> motion_{ArmMotion::none};  // motion started last; set by the commander
  ArmMotion handled_motion_;                        // commander: the last handled request
  bool configured_ = false;                         // commander: false if connecting found a reflex
  bool left_ = false;                               // commander: no loop answers the arm any more

  mutable std::mutex mutex_;  // never locked by the loop
  std::deque<Task> tasks_;
  ArmIdentity identity_;
  bool ending_ = false;
  int wake_ = -1;  // an eventfd

  // Loop
  ArmPacket packet_;
  RobotCommand command_;
  bool unread_ = false;
  bool commanded_ = false;  // torques were sent in the running motion
  bool refused_ = false;    // torques are not sent any more, until the motion has ended
  TorqueLimiter limiter_;   // for hold() and a motion's first torque; with FciArmConfig::limit_rate for all
  CommandSuccess success_;
  PostureHold posture_;
  int held_packets_ = 0;

  std::thread thread_;
};

}  // namespace multipanda::fci
