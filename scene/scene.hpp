#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/model/arm_model.hpp"
#include "core/model/base_mount.hpp"
#include "core/modes/instance.hpp"
#include "core/safety/safety.hpp"
#include "core/state/arm_state.hpp"
#include "core/state/force_sensor.hpp"
#include "core/types/spatial.hpp"
#include "yaml_reader/config_error.hpp"

// A scene file (YAML, docs/scene_reference.md) as checked data in SI units. Models, plant, control cycle and
// log are built from it.
namespace multipanda {

struct RobotDescription;

// Deviations of the plant from rigid bodies with perfect torques. Two named sets: ideal, realistic.
struct PlantFidelity {
  std::string name = "ideal";
  bool joint_friction = false;     // from the table of the robot model
  double torque_bandwidth_hz = 0;  // first-order torque tracking; 0: perfect
  double command_delay_s = 0;      // whole control periods
  double noise_q_rad = 0, noise_dq_rad_per_s = 0, noise_tau_nm = 0;  // standard deviations, white
  double stiction_nm = 0;  // dry friction of every joint, unknown to the controllers
  // Fraction of the rotors' inertia that the arms' torque loops compensate, 0 to 1; copied to
  // SceneArm::rotor_hidden. None: 1 in simulation, 0 of virtual arms.
  std::optional<double> rotor_hidden;
  // Transmission of every joint; 0: none. In hidden plants a mean: each joint has 0.5 to 1.5 of it.
  double transmission_stiffness_nm_per_rad = 0, gear_ripple_nm = 0;
  bool real_sensors = false;  // sensors, own estimate of forces and friction behind the sensors of real arms
  static PlantFidelity ideal() { return {}; }
  static PlantFidelity realistic() {
    return {.name = "realistic",
            .joint_friction = true,
            .torque_bandwidth_hz = 50,
            .command_delay_s = 0.001,
            .noise_q_rad = 1e-5,
            .noise_dq_rad_per_s = 1e-3,
            .noise_tau_nm = 0.05};
  }
  static PlantFidelity realistic_sensors() {
    PlantFidelity set = realistic();
    set.name = "realistic_sensors";
    set.real_sensors = true;
    return set;
  }
};

enum class ShapeType { plane, box, sphere, cylinder, capsule };

// A rigid, massless collision shape on the flange. Its mass is in SceneArm::tool.
struct ToolShape {
  ShapeType shape = ShapeType::sphere;     // sphere or box
  Vector3 size = Vector3::Constant(0.04);  // as SceneObject::size
  Pose X_FS;                               // in the flange
  SourcePlace place;
};

// Connection to a real or virtual arm, and its settings.
struct FciConnection {
  std::string address = "172.16.0.2";  // IPv4 address or host name
  int version = 0;                     // of the control interface; 0: the version of the arm
  bool gripper = true;                 // connect to the hand's gripper, if there is one
  bool vacuum = false;                 // connect to a vacuum gripper
  std::string robotiq;                 // serial port of a Robotiq gripper; empty: none
  std::string robotiq_model = "2f-85";
  double low_pass_hz = 0;   // of commanded torques; 0: none
  bool check_model = true;  // compare the robot model that the arm provides with the scene's at the start
  bool recover_at_start = false;           // clear a reflex of the arm without a request
  bool keep_collision_thresholds = false;  // without the arm's key `collision`: those of an earlier program
  SourcePlace place;
};

// A force and torque sensor between flange and tool: simulated, or an ATI Net F/T at a real arm.
struct SceneForceSensor {
  ForceSensorMount mount;
  std::optional<Load> carried;          // of the mount; none: hand and tool
  std::string address = "192.168.1.1";  // of a real one
  double counts_per_n = 1e6, counts_per_nm = 1e6;
  bool has_counts = false;  // the scene gives both; a real one needs them
};

struct SceneArm {
  std::string name;           // "left"
  std::string model = "fer";  // in models/, or a path to a model file
  // Model of the simulated arm, if it differs from `model`: a model file, or a description without a file;
  // both empty: `model`.
  std::string plant_model;
  std::shared_ptr<const RobotDescription> plant_robot;
  bool hand = true;
  // Whether the fingers of the simulated hand move. Default: closed and rigid, but movable on virtual arms.
  std::optional<bool> movable_fingers;
  // A vacuum gripper replaces the hand; suction acts at the end effector, along its z axis.
  bool vacuum = false;
  Pose X_WB;  // base in the world; of a carried arm at the start
  // On a link of an arm earlier in `arms`, which moves the base; none: the base stands still.
  std::optional<BaseMount> mount;
  SourcePlace mount_place;  // of the key `base_on`
  JointVector q_start;      // joint positions of the simulated arm at the start [rad]
  // End effector in the flange; none: the hand's tool center point, otherwise the flange.
  std::optional<Pose> X_FE;
  double farthest_end_effector = kFarthestEndEffector;  // from the flange, by this scene and by requests [m]
  Pose X_EK;                                            // stiffness frame in the end effector
  Load tool;           // rigid tool on the flange in addition to the hand: in plant and controllers
  Load load_declared;  // payload that the controllers know
  Load load_present;   // payload in the plant
  // Everything that the flange may carry, hand and tool included [kg]; none: the model's rated payload.
  std::optional<double> largest_load;
  std::vector<ToolShape> tool_shapes;
  // Fraction of the rotors' inertia that the torque loop of the simulated arm compensates: the links move as
  // if the rest were fixed to the joint (acting_motor_inertia).
  double rotor_hidden = 1;
  bool known_rotor_inertia = false;  // the mass matrix of the controllers contains the acting motor inertia
  bool known_friction = false;       // controllers know the model's friction table
  double observer_hz = 0;            // CycleConfig::Arm
  std::optional<SceneForceSensor> force_sensor;
  std::optional<FciConnection> fci;  // a real arm; none: simulated, unless an option of the run overrides it
  // Set on the arm at the start; none: the arm keeps its own.
  std::optional<SetCollisionThresholds> collision;
  std::optional<JointVector> joint_stiffness;  // of the arm's internal joint controller [N m/rad] (n x 1)
  std::optional<Vector6> cartesian_stiffness;  // of its internal Cartesian controller, in K [N/m, N m/rad]
  // Pairs of fitted collision shapes that are not checked, as text for the log
  // (RobotDescription::unguarded_pairs).
  std::vector<std::string> unguarded;
  std::vector<std::string> left_out_friction;  // RobotDescription::left_out_friction
  SafetyLimits safety;                         // complete: the model's limits, tightened by the scene
  std::vector<std::string> loosened;           // limits looser than those of the model, as text; logged
  SourcePlace place;
};

// Elastic contact of an object with the arms' tool shapes, in SI units.
struct SurfaceContact {
  double stiffness_n_per_m = 10000;  // slope of normal force against penetration
  double damping_ratio = 0.3;        // of a body of kContactMass on that stiffness
  // Slope of friction against slip velocity, inside the friction cone.
  double tangential_damping_n_s_per_m = 100;
  static constexpr double kContactMass = 4.0;  // [kg] about the effective mass of an arm at its tip
};

// A body in the scene: fixed (surface, table, wall) or free (falls, can be pushed and grasped).
struct SceneObject {
  using Shape = ShapeType;
  std::string name;
  Shape shape = Shape::box;
  Vector3 size = Vector3::Constant(
      0.1);  // box: full edge lengths; sphere: diameter in x; cylinder, capsule: diameter, -, length
  Pose X_WO;
  bool fixed = true;
  double mass = 1.0;      // free bodies [kg]
  double friction = 0.6;  // sliding
  // Parameters of MuJoCo's contact (solref/solimp); none: its defaults.
  std::optional<double> contact_time_constant_s, contact_damping_ratio;
  std::optional<SurfaceContact> contact;  // with tool shapes; none: as with other bodies
  std::array<double, 4> rgba{0.7, 0.7, 0.72, 1};
  SourcePlace place;
};

struct TimelineEvent {
  double at_s = 0;
  enum class What {
    switch_controllets,
    set_parameter,
    set_feature,
    set_reference,
    set_motion,
    stop,
    resume,
    place
  } what{};
  // switch_controllets
  std::vector<std::string> activate, deactivate;
  bool only = false;
  // set_*
  std::string controllet;
  std::string name;  // parameter, feature or input
  // Parameter; reference: in the order of Target (pose: x y z, quaternion w x y z), world.
  std::vector<double> values;
  bool on = true;         // feature
  double duration_s = 0;  // reference
  // motion: rise and sine in the order of a motion's Target (pose: x y z)
  std::vector<double> sine, rise;
  double period_s = 0, cycles = 1, ramp_s = 0;
  struct MotionPart {
    std::vector<double> sine, rise;
  };
  std::vector<MotionPart> overtones;  // [0] twice as fast, ...
  // stop, resume: arm names; empty: all
  std::vector<std::string> arms;
  // place: carried out by the simulation; other backends ignore it
  std::string object;
  Pose X_WO;
  SourcePlace place;
};

// How a run appears in ROS 2 (`run --ros`); it has no effect on the arms.
struct RosSection {
  enum class Time { automatic, simulation, system };
  // Names and message types of another system, in addition to our own.
  enum class Compat { none, multipanda_ros2, franka_ros2 };

  // How often each group of topics is published [Hz of the loop's time]; 0: never. A rate means every n-th
  // record, so that 1000 Hz is every one at a control period of 1 ms.
  struct Rates {
    double joint_states = 100;
    double robot_state = 100;  // <arm>/robot_state
    double model = 30;         // <arm>/model
    double wrench = 100;       // <arm>/wrench
    double tf = 100;
    double references = 100;  // of controllets' inputs
    double outputs = 100;     // of controllets
    double gripper = 30;      // <arm>_gripper/joint_states
    double object_poses = 30;
    double markers = 10;  // ~/markers, for viewers
    double clock = 1000;
    double loop_statistics = 1;
    double diagnostics = 1;
  };

  std::string node = "multipanda";
  std::string name_space = "/";  // of the node; "/": none
  Time time = Time::automatic;   // of the stamps; automatic: simulated where all arms are
  Compat compat = Compat::none;
  Rates rates_hz;
};

struct Scene {
  std::string name;
  std::string description;
  std::string text;  // the file as read, for the log
  std::string path;  // where it was read from
  std::uint64_t seed = 1;
  double duration_s = 0;  // default length of a run; 0: until stopped
  PlantFidelity plant;
  std::size_t substeps = 1;           // physics steps per control period
  std::size_t noslip_iterations = 0;  // of the contact solver: held objects do not creep
  std::vector<SceneArm> arms;
  std::vector<SceneObject> objects;
  std::vector<std::string> plugins;  // paths of users' libraries
  std::string backend;               // backend; empty: by each arm's key `fci`
  ContactBounds contact_bounds;      // of every controllet, also in InstanceConfig::contact
  std::vector<std::string> lifted;   // bounds above the usual ones, as text; printed at the start
  // Speeds of inputs that these bounds lower, as text; printed at the start.
  std::vector<std::string> lowered;
  std::vector<std::string> unsafer_laws;  // presets and options that give up a safeguard, as text; likewise
  std::vector<std::string> near_leaders;  // followers that may push their leaders, as text; printed likewise
  std::vector<InstanceConfig> controllets;
  std::map<std::string, SourcePlace> controllet_places;
  std::vector<std::string> active;      // at the start
  std::vector<TimelineEvent> timeline;  // sorted by time
  RosSection ros;
};

}  // namespace multipanda
