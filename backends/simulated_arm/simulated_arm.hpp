#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "arm_interface/arm_error.hpp"
#include "arm_interface/arm_interface.hpp"
#include "arm_interface/arm_settings.hpp"
#include "backends/simulated_arm/contact_monitor.hpp"
#include "backends/simulated_arm/desired_motion.hpp"
#include "backends/simulated_arm/internal_controllers.hpp"
#include "backends/simulated_arm/measured_limits.hpp"
#include "backends/simulated_arm/request_box.hpp"
#include "backends/simulated_arm/self_collision.hpp"
#include "core/cycle/backend.hpp"
#include "core/model/model_terms.hpp"
#include "core/state/arm_state.hpp"
#include "core/state/load_ramp.hpp"
#include "core/types/joints.hpp"
#include "core/types/time.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// The joint sensors of a Franka arm, modeled on states that two Pandas and a Franka Research 3 sent
// (docs/like_a_real_arm.md):
//
//   tau_J            + an offset that the seed draws, + noise, on a grid
//   theta            q + tau_J / K, on a grid; q is the link's
//   dq, dtheta       through a first-order low-pass of 50 Hz: 3 ms late
//
// Loop thread; only the constructor allocates.
class ArmSensors {
 public:
  static constexpr double kVelocityFilter = 50;                      // [Hz]
  static constexpr double kStiff = 14250, kLessStiff = 9000;         // K of joints 1 to 4, others [N m/rad]
  static constexpr double kTorqueGrid = 0.0238, kFineGrid = 0.0064;  // of tau_J, the same joints [N m]

  // `own`: the torque sensor of an individual arm, which has its own offset and noise.
  ArmSensors(std::size_t joint_count, std::uint64_t seed, bool own);

  // The same noise again, at rest.
  void reset();
  // Turns true q, dq, tau_J of a period of `dt` into measured ones.
  void show(ArmState& state, double dt);
  const JointVector& theta() const { return theta_; }    // [rad] (n x 1)
  const JointVector& dtheta() const { return dtheta_; }  // [rad/s] (n x 1)

 private:
  std::uint64_t seed_;
  bool own_;
  bool begun_ = false;
  JointVector offset_, dq_, theta_, dtheta_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

// Friction on the link side of the torque sensors, which therefore measure it, as found on the same arms.
// None for other arms, of which nothing is known.
std::optional<FrictionLaw> usual_link_friction(const RobotDescription& robot);

// Configuration of a simulated arm.
struct SimulatedArmConfig {
  std::shared_ptr<const ArmModel> model;  // the arm's own model, used for gravity compensation
  ArmFrames frames;
  Load tool;            // declared end effector (beyond what the model contains)
  Load load;            // declared payload; an undeclared load is not compensated
  PlantFidelity plant;  // torque tracking, delay, noise; friction belongs to the plant
  std::uint64_t seed = 1;
  double period_s = kArmPeriod;
  // Set at the start; none: default_settings().
  std::optional<SetCollisionThresholds> thresholds;
  std::optional<JointVector> joint_stiffness;  // [N m/rad] (n x 1)
  std::optional<Vector6> cartesian_stiffness;  // in K [N/m, N m/rad]
  // Values of this individual arm in place of the fidelity's tracking, delay and noise on tau; none:
  // the fidelity's.
  std::optional<Actuation> actuation;
  std::optional<TorqueSensor> torque_sensor;
  Transmission transmission = {};
  // The rotors' contribution to joint inertia known to the arm's own controllers [kg m^2] (n x 1);
  // empty: none.
  JointVector rotor_inertia = {};
  std::optional<JointFriction> friction;  // joint friction known to the arm's own controllers
  MotionLimits motion_limits;             // of the control interface: MotionLimits::of(robot)
  bool real_sensors = false;              // sensors and estimate of external torques as real arms have them
  int recovery_periods = 0;               // that recovery from an error takes at least
  MassExcess hand_excess = {};            // counted by that estimate
  std::shared_ptr<const ArmModel> estimating_model = {};  // of that estimate; null: `model`
  std::optional<WorkspaceBox> workspace;  // of the end effector's origin, in B; none: not checked
};

// Sensor values at the end of a control period, before noise.
struct PlantMeasurement {
  JointVector q, dq;     // [rad, rad/s]
  JointVector tau_link;  // mean torque on the links in the last period, gravity included [N m]
  bool has_contact_truth = false;
  Wrench F_K_W_true;  // mean over the last period, about K, world axes
};

// The arm's own behavior: everything between its control interface and its motors, for any simulator of its
// body. Torques are commanded without gravity; the arm adds gravity from its own model, with the declared
// tool and load. In one control period:
//
//   take_command (or miss_command)       once: checks, desired motion; torque -> delay line
//   motor_torque(q, dq, dt)              once per physics step: -> torque tracking -> + gravity -> motors
//   measure(...)                         once: sensors (+ noise), estimated forces, checks -> state()
//
// Modes: idle -(start_motion)-> move -(finished, stop_motion)-> idle; any -> user_stopped (button), reflex
// (error), other (StopMotion request); idle -> guiding (buttons). Outside move the arm ignores commands,
// brakes and holds the place where it came to rest; in guiding it gives way. From reflex and other only
// RecoverFromError leads back, to idle, over recovering while the arm brakes or its recovery takes time; from
// user_stopped and guiding, the release of the button leads back.
//
// What raises an error: docs/simulation.md. An error ends the motion in the period in which it is found;
// the next state shows mode, errors and reflex_reason together. A state shows every motion before what the
// arm measures can end it: libfranka names no reason for the end of one that it has not seen.
//
// All calls belong to the loop's thread, none allocates or locks, except constructor and check().
class SimulatedArm {
 public:
  // q_start: initial rest position (n x 1). Throws std::invalid_argument for inconsistent sizes.
  SimulatedArm(SimulatedArmConfig config, const JointVector& q_start);

  std::size_t joint_count() const { return model_.joint_count(); }
  const ArmModel& model() const { return model_.model(); }
  // Both as of the last measure() (and of apply() for mode and errors).
  const ArmState& state() const { return state_; }
  const InterfaceState& interface() const { return interface_; }
  bool estimates_forces() const { return sensors_.has_value(); }  // its state then has tau_ext_hat, F_K_W_est
  const ArmSettings& settings() const { return settings_; }
  ArmMode mode() const;
  std::uint64_t errors() const { return errors_; }  // active now; bit i: error i
  // The first error of the last reflex; kept until the next motion begins.
  const ReflexDetail& reflex_detail() const { return reflex_; }

  // Back to the start: configuration, errors, noise, at rest in q. The clock and the packet counter continue.
  // For one period the arm is `recovering` and accepts no command, so that its controller notices.
  void reset(const JointVector& q);

  // --- Motions ---
  // The next state shows it, if it was started. Commands are counted from the first one on.
  MotionStart start_motion(const MotionRequest& request);
  // Ends a motion as preempted: the arm brakes and holds. No effect without a motion.
  void stop_motion();
  const MotionRequest& motion() const { return motion_; }  // that runs, or ran last
  std::uint64_t motions_ended() const { return motions_ended_; }
  MotionEnd motion_end() const { return motion_end_; }  // of the last motion that ended; none: none has

  // The command of this period for the running motion; ignored without one. An invalid command (NaN,
  // infinity, wrong size) or one that violates a limit raises an error.
  void take_command(const InterfaceCommand& command);
  // The same for torques only [N m] (n x 1): an idle arm starts {external, none} automatically.
  void take_command(const JointVector& tau_cmd);
  // Before take_command: a torque replaced by a newer command of the same period. Rate checks treat both as
  // if each had its own period.
  void count_replaced(const InterfaceCommand& command);
  // No command arrived: torque is held, desired motion extrapolated with constant acceleration; after
  // kLostCommands in a row an error. Not in asynchronous motion, which needs none.
  void miss_command();
  static constexpr int kLostCommands = 20;
  // The commanded torque that acts from now on; nullptr: the arm's own.
  const JointVector* torque_in_use() const { return moving_ && in_use_.valid ? &in_use_.tau : nullptr; }

  // --- The plant ---
  // Torque of the motors on the joints for a physics step of dt, gravity compensation included [N m].
  const JointVector& motor_torque(const JointVector& q, const JointVector& dq, double dt);
  // Ends a period: fills state() and interface().
  void measure(const PlantMeasurement& plant);
  // Shows the newest command's desired motion in interface() now: for an arm whose clock differs from the
  // plant's, which may send two states between two measurements.
  void publish_desired();

  // --- Requests, buttons, faults ---
  // A request that passed check_request().
  ArmReply apply(const ArmRequest& request);
  // The buttons for guiding by hand: pressed, an idle arm yields; a motion is ended as by the user stop.
  void press_guiding(bool pressed);
  // Raises this error as if found now.
  void raise(ArmError error) { raise(ReflexDetail{.error = error}); }
  // For tests that move the plant where no real arm can be: measured limits, contacts and the torque rate are
  // not checked. Invalid commands are still refused.
  void watch(bool on) { watching_ = on; }
  // The first torque of a motion is compared only with the torque of the arm's own hold, not with zero. Which
  // one real arms use is unknown.
  void count_own_torque(bool on) { counts_own_torque_ = on; }

 private:
  void raise(const ReflexDetail& detail, MotionEnd how = MotionEnd::reflex);
  ArmReply set_load(const Load& load);
  bool take_torque(const JointVector& tau_cmd);
  void follow(const InterfaceCommand* command);
  void fail_command(MotionStep step);
  void clear_errors();
  bool is_at_rest() const;
  void end_motion(MotionEnd how);
  void publish_configuration();
  void count_command(bool received);
  void push_command(const JointVector& tau_cmd);
  const JointVector& hold_torque(const JointVector& q, const JointVector& dq);
  const JointVector& guided_torque(const JointVector& q, const JointVector& dq);
  const JointVector& follow_torque();
  void add_ripple(const JointVector& q);
  void configure_model();
  void update_model(const JointVector& q, const JointVector& dq);
  void sense(const PlantMeasurement& plant);
  void watch_measurement();
  void publish_condition();
  void publish_interface();
  void publish_report();

  SimulatedArmConfig config_;
  ArmSettings settings_, start_settings_;
  LoadRamp load_;  // the part of the declared load that is active
  ModelTerms model_;
  std::optional<ModelTerms> estimating_;  // SimulatedArmConfig::estimating_model
  ArmState state_;
  InterfaceState interface_;
  // The conditions that determine the mode, strongest first.
  bool user_stop_ = false;
  std::uint64_t errors_ = 0;
  bool stopped_ = false;  // by request, until recovered
  int recovering_ = 0;    // measurements left until the arm takes commands again
  bool braking_ = false;  // recovered from an error, and not yet at rest
  bool guiding_ = false;  // buttons pressed
  bool watching_ = true;

  // The motion that runs
  bool moving_ = false;
  MotionRequest motion_;
  bool commanded_ = false;  // its first command has arrived
  DesiredMotion desired_;
  InternalControllers controllers_;
  bool follow_due_ = false;  // the internal controller's torque of this period is still to be computed
  std::uint64_t motions_ended_ = 0;
  MotionEnd motion_end_ = MotionEnd::none;
  ReflexDetail reflex_;
  std::uint64_t reflex_reason_ = 0;

  // Checks
  TorqueRateCheck torque_rate_;
  bool counts_own_torque_ = false;
  MeasuredLimits measured_limits_;
  SelfCollision self_collision_;
  ContactMonitor contact_;

  // Torque path
  struct Command {
    bool valid = false;  // false: none arrived, the arm holds by itself
    JointVector tau;
  };
  // A ring of as many commands as the delay has periods, rounded up. In the newest period only the share
  // delay_fraction_ still uses the older of two commands, or the arm's own torque if there is none.
  std::vector<Command> delay_line_;
  double delay_fraction_ = 0, own_share_ = 0;
  std::size_t delay_next_ = 0;
  Command in_use_;
  JointVector last_command_, tau_desired_, tau_follow_, tau_tracked_, tau_motor_;
  JointVector tau_shown_;  // at the torque sensors, before noise
  JointVector q_motor_;    // at the position sensors, before noise

  // Holding by itself
  JointVector q_hold_, tau_hold_;
  std::uint32_t at_rest_ = 0;  // bit i: joint i has stopped and is held at q_hold_
  double braking_s_ = 0;       // since at_rest_ was cleared
  bool hold_changed_ = true;   // q_hold_ or the frames changed since the desired motion was set
  Pose X_WE_guided_;           // pose when the guiding buttons were pressed

  // Commands of the last 100 periods, newest in bit 0 of the first word
  std::uint64_t received_[2] = {0, 0};
  int periods_in_move_ = 0, missing_in_row_ = 0;

  std::optional<ArmSensors> sensors_;  // as real ones
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

}  // namespace multipanda
