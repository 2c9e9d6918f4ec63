#pragma once

#include <cstdint>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "backends/arm/arm_error.hpp"
#include "backends/arm/arm_interface.hpp"
#include "backends/arm/arm_reply.hpp"
#include "core/cycle/backend.hpp"
#include "core/model/model_terms.hpp"
#include "core/state/arm_state.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// How a simulated arm is set up before it runs.
struct SimulatedArmConfig {
  std::shared_ptr<const ArmModel> model;  // the arm's own model: it compensates gravity by it
  ArmFrames frames;
  Load tool;            // declared end effector (beyond what the model contains)
  Load load;            // declared payload; what hangs there undeclared is not compensated
  PlantFidelity plant;  // torque tracking, delay, noise; friction belongs to the plant
  std::uint64_t seed = 1;
  double period_s = 0.001;
};

// What the user has set on the arm, and the arm's own limits of contact.
struct ArmSettings {
  ArmFrames frames;
  Load tool, load;
  JointVector joint_stiffness;    // of the arm's own joint controller [N m/rad] (n x 1)
  Vector6 cartesian_stiffness;    // of the arm's own Cartesian controller, in K [N/m, N m/rad]
  SetCollisionThresholds thresholds;  // contact and reflex
};

// What the arm's sensors see at the end of a control period, before noise.
struct PlantMeasurement {
  JointVector q, dq;     // [rad, rad/s]
  JointVector tau_link;  // mean torque on the links in the last period, gravity included [N m]
  bool has_contact_truth = false;
  Wrench F_K_W_true;  // mean over the last period, about K, world axes
};

// The arm's own behaviour: everything between its control interface and its motors, whoever simulates its
// body. Torques are commanded without gravity; the arm adds what its own model says of gravity, with the
// declared tool and load. In one control period:
//
//   take_command (or miss_command)       once: command -> delay line
//   motor_torque(q, dq, dt)              once per physics step: -> torque tracking -> + gravity -> motors
//   measure(...)                         once: sensors (+ noise) -> state()
//
// Modes: idle -(first command)-> move; any -> user_stopped (button), reflex (error), other (stopped on
// request). Outside move the arm ignores commands, brakes and holds the place where it came to rest. From
// reflex and stop only RecoverFromError leads back, to idle; from user_stopped the release of the button.
//
// All calls belong to the loop's thread, none allocates or locks, except constructor and check().
class SimulatedArm {
 public:
  // q_start: where the arm stands at rest (n x 1). Throws std::invalid_argument on sizes that do not fit.
  SimulatedArm(SimulatedArmConfig config, const JointVector& q_start);

  std::size_t joint_count() const { return model_.joint_count(); }
  const ArmState& state() const { return state_; }
  const ArmSettings& settings() const { return settings_; }
  ArmMode mode() const;

  // Back to the start: configuration, errors, noise, at rest in q. The clock and the packet counter go on.
  // For one period the arm is `recovering` and takes no command, so that whoever controls it notices.
  void reset(const JointVector& q);

  // The motion is over: from now on the arm brakes and holds by itself; the next command moves it again.
  void stop_moving();

  // The command of this period, without gravity (n x 1) [N m]. A command that is no torque is refused: the
  // arm raises an error and holds.
  void take_command(const JointVector& tau_cmd);
  // No command came. The arm repeats the last one; after kLostCommands in a row it raises an error and holds.
  void miss_command();
  static constexpr int kLostCommands = 20;

  // Torque of the motors on the joints for a physics step of dt, gravity compensation included [N m].
  const JointVector& motor_torque(const JointVector& q, const JointVector& dq, double dt);

  // Ends a period: fills state().
  void measure(const PlantMeasurement& plant);

  // Off the loop: why a request cannot be meant, or nothing.
  static std::string check(const ArmRequest& request, std::size_t joint_count);
  // A checked request. not_supported: not about the arm.
  ArmReply apply(const ArmRequest& request);

 private:
  bool takes_commands() const { return mode() == ArmMode::idle || mode() == ArmMode::move; }
  void raise(ArmError error);
  void publish_configuration();
  void count_command(bool received);
  void push_command(const JointVector& tau_cmd);
  const JointVector& hold_torque(const JointVector& q, const JointVector& dq);

  SimulatedArmConfig config_;
  ArmSettings settings_, start_settings_;
  ModelTerms model_;
  ArmState state_;
  // What the mode is made of, strongest first.
  bool user_stop_ = false;
  std::uint64_t errors_ = 0;
  bool stopped_ = false;  // by request, until recovered
  int recovering_ = 0;    // measurements left until the arm takes commands again
  bool moving_ = false;

  // Torque path
  struct Command {
    bool valid = false;  // false: none came, the arm holds by itself
    JointVector tau;
  };
  std::vector<Command> delay_line_;  // a ring of as many commands as the delay has periods
  std::size_t delay_next_ = 0;
  Command in_use_;
  JointVector last_command_, tau_wanted_, tau_tracked_, tau_motor_;

  // Holding by itself
  JointVector q_hold_, tau_hold_;
  std::uint32_t at_rest_ = 0;  // bit i: joint i has stopped and is held at q_hold_

  // Commands of the last 100 periods, newest in bit 0 of the first word
  std::uint64_t received_[2] = {0, 0};
  int periods_in_move_ = 0, missing_in_row_ = 0;

  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

}  // namespace multipanda
