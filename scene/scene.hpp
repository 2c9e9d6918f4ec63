#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/modes/instance.hpp"
#include "core/safety/safety.hpp"
#include "core/state/arm_state.hpp"
#include "core/types/spatial.hpp"
#include "scene/ros_section.hpp"

// A scene as data: what scene files (YAML, docs/scene_reference.md) say, checked, in SI units. Everything
// that is built (models, plant, control cycle, log) is built from this.
namespace multipanda {

struct RobotDescription;

// Where a value was written, for messages: "two_arms.yaml:14".
struct SourcePlace {
  std::string file;
  int line = 0;  // from 1; 0: not from a file
};

// How the arms' plant differs from rigid bodies with perfect torques. Two named sets: ideal, realistic.
struct PlantFidelity {
  std::string name = "ideal";
  bool joint_friction = false;     // of the robot model's table
  double torque_bandwidth_hz = 0;  // first-order torque tracking; 0: perfect
  double command_delay_s = 0;      // whole control periods
  double noise_q_rad = 0, noise_dq_rad_per_s = 0, noise_tau_nm = 0;  // standard deviations, white
  double stiction_nm = 0;  // dry friction of every joint, known to no controller
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
};

enum class ShapeType { plane, box, sphere, cylinder, capsule };

// A rigid, massless part of what the flange carries; it touches things. Its weight is SceneArm::tool.
struct ToolShape {
  ShapeType shape = ShapeType::sphere;     // sphere or box
  Vector3 size = Vector3::Constant(0.04);  // as SceneObject::size
  Pose X_FS;                               // in the flange
  SourcePlace place;
};

// How a real arm (or a virtual one) is reached and set up.
struct FciConnection {
  std::string address = "172.16.0.2";  // IPv4 address or host name
  int version = 0;                     // of the control interface; 0: whichever of ours the arm speaks
  bool gripper = true;                 // connect to the hand's gripper, if there is one
  bool vacuum = false;                 // connect to a vacuum gripper
  double low_pass_hz = 0;              // of commanded torques; 0: none
  bool rate_limit = false;             // commanded torques are kept within the arm's rate
  bool check_model = true;             // compare the arm's own robot model with ours at the start
  SourcePlace place;
};

struct SceneArm {
  std::string name;           // "left"
  std::string model = "fer";  // in models/, or a path to a model file
  // What the simulated arm truly is, where it is not what `model` tells its controllers: a model file, or a
  // description that was never in a file; both empty: `model`.
  std::string plant_model;
  std::shared_ptr<const RobotDescription> plant_robot;
  bool hand = true;
  // Whether the simulated hand's fingers move; not said: they are closed and rigid, on virtual arms they
  // move.
  std::optional<bool> movable_fingers;
  bool vacuum =
      false;  // a vacuum gripper in the hand's place; it sucks at the end effector, along its z axis
  Pose X_WB;  // base in the world
  JointVector q_start;  // where the simulated arm stands at the start [rad]
  std::optional<Pose>
      X_FE;            // end effector in the flange; default: the hand's tool centre point, else the flange
  Pose X_EK;           // stiffness frame in the end effector
  Load tool;           // rigid tool on the flange beyond the hand: in plant and controllers
  Load load_declared;  // payload that the controllers are told of
  Load load_present;   // payload that the plant really carries
  std::vector<ToolShape> tool_shapes;
  bool known_friction = false;       // controllers know the model's friction table
  std::optional<FciConnection> fci;  // a real arm; none: simulated, unless the run says otherwise
  // Set on the arm at the start; none: what the arm has by itself.
  std::optional<SetCollisionThresholds> collision;
  std::optional<JointVector> joint_stiffness;  // of the arm's own joint controller [N m/rad] (n x 1)
  std::optional<Vector6> cartesian_stiffness;  // of its own Cartesian controller, in K [N/m, N m/rad]
  SafetyLimits safety;                         // complete: the model's limits, tightened by the scene
  std::vector<std::string> loosened;  // limits that the scene made looser than the maker's, in words; logged
  SourcePlace place;
};

// Elastic contact of an object with the arms' tool shapes, in SI units.
struct SurfaceContact {
  double stiffness_n_per_m = 10000;            // slope of normal force against penetration
  double damping_ratio = 0.3;                  // of a body of kContactMass on that stiffness
  double tangential_damping_n_s_per_m = 100;   // slope of friction against slip, until the cone is reached
  static constexpr double kContactMass = 4.0;  // [kg] about what an arm weighs at its tip
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
  // Contact: MuJoCo's own numbers where given (solref/solimp), else its defaults.
  std::optional<double> contact_time_constant_s, contact_damping_ratio;
  std::optional<SurfaceContact> contact;  // with tool shapes; without it as with everything else
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
  std::vector<double>
      values;      // parameter; reference: in the order of Target (pose: x y z, quaternion w x y z), world
  bool on = true;  // feature
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
  // place: carried out by the simulation itself; other backends ignore it
  std::string object;
  Pose X_WO;
  SourcePlace place;
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
  std::size_t noslip_iterations = 0;  // of the contact solver, after its own: what is held does not creep
  std::vector<SceneArm> arms;
  std::vector<SceneObject> objects;
  std::vector<std::string> plugins;  // paths of users' controllet libraries
  std::vector<InstanceConfig> controllets;
  std::map<std::string, SourcePlace> controllet_places;
  std::vector<std::string> active;      // at the start
  std::vector<TimelineEvent> timeline;  // sorted by time
  RosSection ros;
};

}  // namespace multipanda
