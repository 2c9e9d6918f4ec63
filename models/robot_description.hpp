#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/types/joint_range.hpp"
#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// Mass properties of one link.
struct RigidBody {
  double mass = 0;                    // [kg]
  Vector3 com = Vector3::Zero();      // center of mass in the link frame [m]
  Matrix3 inertia = Matrix3::Zero();  // about the center of mass, axes of the link frame [kg m^2]
};

// The same body expressed in frame A; X_AB places the frame B, in which `body` is given, in A.
RigidBody moved(const RigidBody& body, const Pose& X_AB);

// Two rigidly joined bodies as one; all in the same frame.
RigidBody merged(const RigidBody& a, const RigidBody& b);

// Whether the properties are physically consistent: mass above zero and the second moment of
// mass about the center of mass, tr(I)/2 * 1 - I, positive definite. Equivalent to a positive definite
// pseudo-inertia; implies the triangle inequality that physics engines require.
bool is_physical(const RigidBody& body);

// The data of one arm model, read from one YAML file (docs/models.md has every key).
// The arm is a chain: link0 (base), joint1, link1, ... jointN, linkN, flange, and perhaps a hand on the
// flange. Every joint turns about the z axis of the link that it moves, or slides along it (prismatic).

// Pose of a frame in its parent, as the manufacturer publishes it.
struct Placement {
  Vector3 position = Vector3::Zero();  // [m]
  Vector3 rpy = Vector3::Zero();       // R = Rz(yaw) Ry(pitch) Rx(roll) [rad]
  Pose pose() const;
};

// Every vector (n x 1). In every vector with one number per joint, a prismatic joint has m for rad, N for N m
// and kg for kg m^2.
struct JointLimits {
  JointVector q_min, q_max;  // [rad]
  JointVector dq_max;        // [rad/s]
  JointVector tau_max;       // [N m]
  JointVector ddq_max;       // [rad/s^2]
  JointVector dddq_max;      // [rad/s^3]
  JointVector tau_rate_max;  // [N m/s]
};

// Limits of the arm's Cartesian interface; linear in [m/s^k], angular in [rad/s^k].
struct CartesianLimits {
  double velocity = 0, acceleration = 0, jerk = 0;
  double rotation_velocity = 0, rotation_acceleration = 0, rotation_jerk = 0;
  double elbow_velocity = 0, elbow_acceleration = 0, elbow_jerk = 0;  // 0: not given
};

// tau_f(dq) = p1 / (1 + exp(-p2 (dq + p3))) - p1 / (1 + exp(-p2 p3)), per joint; acts against the motion.
struct JointFriction {
  JointVector p1;  // [N m]
  JointVector p2;  // [s/rad]
  JointVector p3;  // [rad/s]
};

// Dry friction before a joint slides (Dahl): its state follows the joint over a distance of some
// mrad,  z <- s sign(dq) + (z - s sign(dq)) exp(-|dq| dt / s),  and the torque is  amplitude z / s.
struct PreslidingElement {
  double distance = 0.01;  // s [rad]
  JointVector amplitude;   // >= 0 [N m] (n x 1)
};

// Friction from identification, against the motion: the sum of the parts that exist. Every vector (n x 1);
// empty: no such part. All amplitudes except the offset are >= 0, so that it dissipates.
//   tau_f = offset + viscous dq + stribeck tanh(dq / 0.01) exp(-(dq / 0.3)^2) + sum of presliding + sigmoid
struct FrictionLaw {
  JointVector offset;    // [N m]
  JointVector viscous;   // [N m s/rad]
  JointVector stribeck;  // [N m]
  std::vector<PreslidingElement> presliding;
  std::optional<JointFriction> sigmoid;
};

// Output of a torque sensor: gain tau + offset, and white noise. Every vector (n x 1).
struct TorqueSensor {
  JointVector gain;    // [1]
  JointVector offset;  // [N m]
  double noise = 0;    // standard deviation [N m]
};

// Dynamics from commanded to actual torque.
struct Actuation {
  double torque_bandwidth_hz = 0;  // first-order tracking; 0: perfect
  double command_delay = 0;        // not necessarily whole control periods [s]
};

// Transmission between motor and link, apart from the rotor. Every vector is (n x 1), or empty: none.
struct Transmission {
  // The arm measures its joints at the motors: q = q_link + tau_J / stiffness, the static part of an elastic
  // joint, without resonance [N m/rad].
  JointVector stiffness;
  // Ripple of motor and gear: amplitude sin(cycles q_link + phase), added to the motor's torque [N m], [1],
  // [rad]; the three have the same size.
  JointVector ripple, ripple_cycles, ripple_phase;
};

// All points within `radius` of the segment from one point to the other, in the frame of `link`.
struct Capsule {
  std::string link;                                      // "link0" to "linkN", or "hand"
  Vector3 from = Vector3::Zero(), to = Vector3::Zero();  // ends of the segment [m]
  double radius = 0;                                     // [m]
};

// The convex hull of some points, at most 32, in the frame of link0.
using BaseHull = std::vector<Vector3>;

enum class ShapeKind { capsule, cylinder, sphere, box };

// A primitive for visualization; a box is also the collision shape of a finger.
struct Shape {
  ShapeKind kind = ShapeKind::box;
  std::string link;                                      // frame of its coordinates
  Vector3 from = Vector3::Zero(), to = Vector3::Zero();  // capsule, cylinder: the axis [m]
  double radius = 0;                                     // capsule, cylinder, sphere [m]
  Placement center;                                      // sphere, box
  Vector3 size = Vector3::Zero();                        // box: full edge lengths [m]
  std::string color;                                     // a name of shape_colors()
};

// A parallel gripper on the flange. The left finger slides along +y of the hand, the right one is the left
// one turned by pi about the hand's z axis.
struct HandDescription {
  Placement mount;             // hand in the flange
  Placement tcp;               // tool center point in the hand
  Placement finger_mount;      // left finger's frame in the hand, fingers closed
  RigidBody body;              // without the fingers, in the hand's frame
  RigidBody finger;            // one finger, in its own frame
  double finger_travel = 0;    // of one finger, from closed [m]
  double finger_velocity = 0;  // [m/s]
  double finger_effort = 0;    // [N]
  std::vector<Capsule> palm_capsules,
      finger_capsules;              // link "hand"; the finger capsules cover the fingers in any opening
  std::vector<Shape> finger_boxes;  // of one finger, in its frame; for fingers that move
  std::vector<Shape> visuals, finger_visuals;
};

// The motion from which the properties of an individual arm were identified.
struct IdentifiedRange {
  JointVector q_min, q_max;  // [rad]
  JointVector dq_max;        // [rad/s]
  JointVector rmse;          // expected torque error on other motion within it [N m]; empty: not known
};

struct RobotDescription {
  std::string name;                           // as in scenes: "fer"
  std::string title;                          // for readers
  std::filesystem::path file;                 // file it was read from
  std::map<std::string, std::string> origin;  // per section: source of the values and changes to them

  std::vector<Placement> joints;         // joint i+1 in link i; (n)
  std::vector<bool> prismatic;           // per joint; empty: all turn
  std::vector<std::string> joint_names;  // names in the URDF, if imported; otherwise empty
  Placement flange;                      // in the last link
  std::vector<RigidBody> links;          // (n + 1), link0 first
  // Links 1 to n as the arm's own model has them, which it sends to programs: no physical bodies, and never a
  // plant. Empty: as `links`.
  std::vector<RigidBody> own_model;
  JointLimits limits;
  std::optional<CartesianLimits> cartesian;
  std::optional<PositionBasedVelocity> position_based_velocity;
  std::optional<JointFriction> friction;  // between motor and torque sensor
  // Of rotors and gears, reflected to each joint, before the torque sensor [kg m^2] (n x 1); empty: not
  // known. The scene determines which part acts in a simulated arm (acting_motor_inertia).
  JointVector rotor_inertia;
  // Properties of an individual arm rather than its model, from identification; none or empty: perfect,
  // level, or as in the scene's fidelity. The arm's own controllers do not know them.
  std::optional<FrictionLaw> link_friction;   // beyond the torque sensor, and so measured by it
  std::optional<TorqueSensor> torque_sensor;  // in place of the fidelity's noise on tau
  std::optional<Actuation> actuation;         // in place of the fidelity's bandwidth and delay
  std::optional<Transmission> transmission;   // in place of the fidelity's; not in model files
  JointVector motor_inertia;                  // seen at the joint, before the torque sensor [kg m^2] (n x 1)
  Eigen::Vector2d base_tilt = Eigen::Vector2d::Zero();  // true base in B: Ry(second) Rx(first) [rad]
  std::optional<IdentifiedRange> identified_range;
  std::optional<double> rated_payload;  // everything that the flange may carry, hand and tool included [kg]
  JointVector q_home;                   // the `ready` configuration [rad]

  std::vector<Capsule> capsules;  // of the links, not of the hand
  // Further hulls of an imported arm's link0, for distances only: simulated worlds do not contain them.
  std::vector<BaseHull> base_hulls;
  // Pairs of links that never touch or always touch.
  std::vector<std::pair<std::string, std::string>> ignored_pairs;
  // The same for an arm with shapes fitted to a URDF, without neighbors: "link0.2 and link5 (overlap at
  // home)". A hull of the base is "link0.k", k from 1 to the number of base_hulls.
  std::vector<std::string> unguarded_pairs;

  // Damping and dry friction that a URDF states for joints of the arm and that nothing simulates: "elbow 0.5
  // N m s/rad and 2 N m". Empty if the model's file has friction.
  std::vector<std::string> left_out_friction;

  std::vector<Shape> visuals;                 // empty: the capsules are shown
  std::map<std::string, std::string> meshes;  // link -> file below a folder of meshes, if one is installed
  std::optional<HandDescription> hand;

  std::size_t joint_count() const { return joints.size(); }
  bool is_prismatic(std::size_t joint) const { return joint < prismatic.size() && prismatic[joint]; }
  bool has_prismatic_joints() const;
};

// What the motors add to the inertia of each joint, before the torque sensor [kg m^2] (n x 1); empty:
// nothing. The motor_inertia of an individual arm acts as given; otherwise (1 - hidden) rotor_inertia, the
// part that the arm's torque loop does not compensate. `hidden`: 0 to 1.
JointVector acting_motor_inertia(const RobotDescription& robot, double hidden);

// The hand with both fingers closed as one rigid body, in the hand's frame.
RigidBody rigid_hand(const HandDescription& hand);

// The name of hull k (from 0) of the base: "link0.1", ...
std::string hull_name(std::size_t k);

// Whether two links ("link0".."linkN", "hand", or a hull of the base) are never checked against each other:
// neighbors and ignored_pairs. The hand's neighbor is the last link.
bool is_ignored_pair(const RobotDescription& robot, const std::string& a, const std::string& b);

// Reads a robot by name ("fer": models/fer.yaml of the project, or of the folder in the environment variable
// MULTIPANDA_SHARE) or by path (anything with a slash or ending in .yaml).
// Throws std::invalid_argument: file:line, what was expected, the nearest valid name.
RobotDescription load_robot(const std::string& name_or_path);

// All files of a robot: its own, those of its bases, its URDF. Throws as load_robot.
std::vector<std::filesystem::path> robot_files(const std::string& name_or_path);

// Names that load_robot knows, sorted.
std::vector<std::string> available_robots();

// Folder that holds the robots' files.
std::filesystem::path models_folder();

// Colors of the primitives: red, green, blue, each 0 to 1.
const std::map<std::string, Vector3>& shape_colors();

// Shapes to draw: those of the robot, or its capsules if it has none.
std::vector<Shape> link_visuals(const RobotDescription& robot);

// The hand with closed fingers, all in the hand's frame.
std::vector<Shape> closed_hand_visuals(const HandDescription& hand);

// A shape given in frame B, in frame A.
Shape moved(const Shape& shape, const Pose& X_AB, const std::string& link);

// Pose of a shape's own frame: a capsule or cylinder lies along z, with the origin in the middle of its axis.
Pose shape_pose(const Shape& shape);

}  // namespace multipanda
