#pragma once

#include <atomic>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "core/cycle/backend.hpp"
#include "fci/client/arm_link.hpp"
#include "fci/client/arm_packet.hpp"
#include "fci/client/fci_backend.hpp"

namespace multipanda::fci {

// One arm of FciBackend: its connection, its commander (the thread that talks TCP), and what the loop knows
// of it. Loop and commander share atomics and a triple buffer of states, nothing else.
class ArmDriver {
 public:
  ArmDriver(FciArmConfig config, const FciOptions& options);
  ~ArmDriver();  // closes after the request under way
  ArmDriver(const ArmDriver&) = delete;

  // --- any thread; carried out by the commander, in order ---
  std::future<ArmAnswer> prepare();  // connect, check, tell the configuration
  std::future<ArmAnswer> begin();    // torque control; the states will show it
  std::future<ArmAnswer> leave(
      bool finished);  // closes; a motion that still runs is stopped, at once unless it was finished
  std::future<ArmAnswer> request(ArmRequest request);

  const FciArmConfig& config() const { return config_; }
  Capabilities capabilities() const;
  ArmStatistics statistics() const { return link_.statistics(); }
  ArmIdentity identity() const;

  // --- loop ---
  int udp_file() const { return link_.udp_file(); }
  void receive() noexcept;
  bool is_unread() const { return unread_; }  // a state that the loop has not had yet
  void mark_read() { unread_ = false; }
  const RobotState& newest() const noexcept { return link_.newest(); }
  // Has a connection that is set up: its states can be waited for.
  bool takes_part() const { return phase() >= Phase::stopped; }
  ArmMode mode(HostTime now) const noexcept;
  void fill(HostTime now, ArmState& state) noexcept;
  // Another kind of motion, from now on; none: the arm holds itself. The commander sees to it.
  void want(ArmMotion motion) noexcept;
  ArmMotion motion() const noexcept { return motion_.load(std::memory_order_acquire); }  // begun last
  // The answer to newest() in a motion that is not torque. What it contains is the caller's.
  void command(RobotCommand& command) noexcept;
  // The answer to newest(), if the arm is in `move`. What is no torque is not sent: the motion is stopped.
  void command(const JointVector& tau_cmd) noexcept;
  // The same torque again, as the motion's last command.
  void command_finish() noexcept;

 private:
  enum class Phase : std::uint8_t {
    offline,
    preparing,  // connected, not yet set up
    stopped,    // set up, no motion
    starting,   // a motion is being started
    running     // the arm has agreed to a motion, and no end was reported
  };
  using Work = std::function<ArmAnswer()>;
  struct Task {
    Work work;
    std::promise<ArmAnswer> promise;
  };
  Phase phase() const { return phase_.load(std::memory_order_acquire); }
  void enter(Phase phase) { phase_.store(phase, std::memory_order_release); }

  // Commander
  std::future<ArmAnswer> post(Work work);
  void run();
  bool do_next_task();
  void watch();
  ArmAnswer guarded(const Work& work);
  void lost(const std::string& why);
  void connect_and_configure();
  void connect_end_effector();
  void check_model();
  void configure();
  void check_end_effector(const RobotState& state);
  void start_wanted_motion();
  void change_motion();
  void set_frames(const ArmFrames& frames);
  void set_load(const Load& load);
  void apply(const ArmRequest& request);
  void apply_beside_motion(const ArmRequest& request);
  ArmAnswer recover();
  ArmAnswer reconnect();
  ArmAnswer stop();
  void say(const std::string& text) const;
  [[noreturn]] void refuse(const std::string& text) const;
  std::string call(const char* word) const;  // "`multipanda ctl recover left`"

  const FciArmConfig config_;
  const FciOptions& options_;
  ArmLink link_;
  std::unique_ptr<EndEffector> end_effector_;
  std::atomic<bool> end_effector_connected_{false};
  std::atomic<Phase> phase_{Phase::offline};
  std::atomic<bool> stop_wanted_{false};            // by the loop
  std::atomic<ArmMotion> wanted_;                   // by the loop
  std::atomic<ArmMotion> motion_{ArmMotion::none};  // begun last, by the commander
  ArmMotion handled_;                               // commander: the last of wanted_ that it saw to

  mutable std::mutex mutex_;  // never the loop's
  std::deque<Task> tasks_;
  ArmIdentity identity_;
  bool ending_ = false;
  int wake_ = -1;  // an eventfd

  // Loop
  ArmPacket packet_;
  RobotCommand command_;
  bool unread_ = false;
  bool commanded_ = false;  // torques were sent in the motion that runs
  bool refused_ = false;    // a command was no torque; until the motion has ended
  std::array<double, 7> sent_{};

  std::thread thread_;
};

}  // namespace multipanda::fci
