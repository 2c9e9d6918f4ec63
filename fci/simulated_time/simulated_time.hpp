#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "arm_interface/arm_error.hpp"
#include "backends/mujoco/plant.hpp"
#include "core/cycle/backend.hpp"
#include "fci/simulated_time/timing.hpp"
#include "scene/scene.hpp"

namespace multipanda::fci {

// Statistics of one arm since the start.
struct ArmCounts {
  std::uint64_t states_sent = 0, states_lost = 0;
  std::uint64_t answers_sent = 0, answers_lost = 0, answers_late = 0, answers_used = 0;
  std::uint64_t periods_missed = 0;  // in a motion, without an answer
  int longest_miss = 0;              // consecutive ones
  std::uint64_t motions_ended = 0;   // other than on request
  double torque_rate_max = 0;        // of accepted torques, relative to the last one [N m/s]
};

// A scene's arms behind their control interface in simulated time: an event queue in whole nanoseconds holds
// the world (a step each millisecond), every arm's sending instants by a clock of its own, the network, and
// the wake-ups of the program. A Backend like FciBackend: wait() runs the events until the program wakes, and
// write() sends its torques after the time that it computes. The arms are the server's (SimulatedArm, its
// packets, its strict rule of late answers), their states and commands pass through the bytes of the control
// interface. Only sockets and clocks are replaced.
//
// One thread; as fast as the computer goes. Everything that varies is drawn from the seed, and nothing is
// measured: the same scene, seed, torques and calls give the same bits.
//
// Requests are executed while the loop waits. Modes are those of FciBackend.
class SimulatedTime final : public Backend {
 public:
  // Throws std::invalid_argument for an invalid scene or times.
  explicit SimulatedTime(const Scene& scene, SimulatedTimeOptions options = {});
  ~SimulatedTime() override;

  std::size_t arm_count() const override;
  Capabilities capabilities(ArmIndex arm) const override;
  void start() override;   // connects and starts torque control; throws std::runtime_error: an arm cannot
  void finish() override;  // holds the arms until their motions have ended
  ArmSet wait() override;
  ArmSet wait_until(HostTime deadline) override;
  bool ended() const override;  // before start(), after finish(), and if the world failed
  LoopTime now() const override;
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  std::optional<Pose> object_pose(const std::string& name) const override;
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) override;

  std::int64_t time_ns() const;  // since the world began

  // --- faults, from now on ---
  void lose_answers(ArmIndex arm, int count);  // the next `count` answers
  void delay_answers(ArmIndex arm, int count, std::int64_t by_ns);
  void lose_states(ArmIndex arm, int count);
  void pull_cable(ArmIndex arm, bool pulled);  // no datagram passes until it is plugged in again
  void raise(ArmIndex arm, ArmError error);    // a reflex, as if the arm had found this error
  void press_user_stop(ArmIndex arm, bool pressed);
  void press_guiding(ArmIndex arm, bool pressed);
  void push(ArmIndex arm, const Vector3& f_W, double duration_s);  // on the flange, world axes [N]
  enum class Stall : std::uint8_t { before_reading, before_sending };
  void stall_client(std::int64_t ns, Stall where = Stall::before_sending);  // once, in the next cycle
  // The program ends without closing, and another one must connect (Reconnect of every arm).
  void lose_client();

  // --- events of the test ---
  void at(std::int64_t time_ns, std::function<void()> what);
  // A program beside the loop, such as ros2_control's manager: called each period, late by `jitter`; a call
  // that would come before the last one ended is left out. Its own duration is `compute`.
  void every(std::int64_t period_ns, DrawnTime jitter, DrawnTime compute,
             std::function<void(std::int64_t time_ns)> what);

  // --- what happened ---
  const ArmCounts& counts(ArmIndex arm) const;
  const SimulatedArm& arm(ArmIndex i) const;  // reflex_detail(), motion_end(), settings()
  MujocoPlant& plant();

 private:
  struct Implementation;
  std::unique_ptr<Implementation> self_;
};

}  // namespace multipanda::fci
