#include "scene/schema.hpp"

#include "core/types/capacity.hpp"

namespace multipanda::schema {
namespace {

constexpr double kFar = 100;         // farther apart [m] nothing in a scene stands
constexpr double kSmallest = 0.001;  // length [m], mass [kg] below which physics engines go wrong
constexpr double kLongest = 86400;   // a day [s]
constexpr double kPeriod = 0.001;    // of control [s]

Field position(std::string doc) {
  return {.key = "position_m",
          .kind = FieldKind::numbers,
          .unit = "m",
          .fallback = "[0, 0, 0]",
          .min = -kFar,
          .max = kFar,
          .count = 3,
          .doc = std::move(doc)};
}
Field rpy() {
  return {.key = "rpy_rad",
          .kind = FieldKind::numbers,
          .unit = "rad",
          .fallback = "[0, 0, 0]",
          .count = 3,
          .doc =
              "Roll, pitch, yaw about the fixed axes x, y, z: R = Rz(yaw) Ry(pitch) Rx(roll). `pi`, `-pi/2`, "
              "`3*pi/4` may be written."};
}
Field quaternion() {
  return {.key = "quaternion_wxyz",
          .kind = FieldKind::numbers,
          .min = -1.01,
          .max = 1.01,
          .count = 4,
          .doc = "In place of `rpy_rad`: unit quaternion, w first."};
}
Field load_field(std::string key, std::string doc) {
  return {.key = std::move(key), .kind = FieldKind::section, .section = &load(), .doc = std::move(doc)};
}
Field limit(std::string key, std::string unit, double min, std::string doc) {
  return {.key = std::move(key),
          .kind = FieldKind::numbers,
          .unit = std::move(unit),
          .min = min,
          .count = Field::kPerJoint,
          .doc = std::move(doc)};
}
Field product(std::string key) {
  return {.key = std::move(key),
          .kind = FieldKind::number,
          .unit = "kg m^2",
          .fallback = "0",
          .min = -100,
          .max = 100,
          .doc = "Entry of the inertia matrix."};
}
Field moment(std::string key) {
  return {.key = std::move(key),
          .kind = FieldKind::number,
          .unit = "kg m^2",
          .required = true,
          .min = 0,
          .max = 100,
          .doc = "Entry of the inertia matrix."};
}

}  // namespace

const Section& scene() {
  static const Section section{
      "Scene",
      "The top of the file.",
      {{.key = "name",
        .kind = FieldKind::identifier,
        .doc = "Name in logs and reports; without it, the file's name."},
       {.key = "description", .kind = FieldKind::text, .fallback = "''", .doc = "A sentence for people."},
       {.key = "seed",
        .kind = FieldKind::integer,
        .fallback = "1",
        .min = 0,
        .max = 9007199254740992.0,
        .doc = "Of everything random: two unpaced runs with the same seed are the same."},
       {.key = "duration_s",
        .kind = FieldKind::number,
        .unit = "s",
        .fallback = "0",
        .min = 0,
        .max = kLongest,
        .doc = "Length of a run; 0: until stopped."},
       {.key = "plant",
        .kind = FieldKind::section,
        .fallback = "{}",
        .section = &plant(),
        .doc = "How true to real arms the simulated ones are."},
       {.key = "plugins",
        .kind = FieldKind::texts,
        .doc = "Libraries with controllets and features of your own, relative to this file."},
       {.key = "arms",
        .kind = FieldKind::sections,
        .required = true,
        .section = &arm(),
        .doc = "1 to 16 arms."},
       {.key = "objects", .kind = FieldKind::sections, .section = &object(), .doc = "Surfaces and bodies."},
       {.key = "controllets",
        .kind = FieldKind::sections,
        .section = &controllet(),
        .doc = "Controllet instances. All are built before the first cycle; which of them run is switched. "
               "Every arm "
               "also has a built-in `<arm>_hold`, which runs wherever nothing else does."},
       {.key = "active",
        .kind = FieldKind::texts,
        .doc = "Controllets that run from the first cycle on. At most one per arm; the other arms are held."},
       {.key = "timeline",
        .kind = FieldKind::sections,
        .section = &event(),
        .doc = "What happens by itself, to the cycle. Events of the same time happen in the order of the "
               "file."},
       {.key = "ros",
        .kind = FieldKind::section,
        .fallback = "{}",
        .section = &ros(),
        .doc = "How `run --ros` shows the run in ROS 2."}}};
  return section;
}

const Section& plant() {
  const auto noise = [](std::string key, std::string unit, std::string of) {
    return Field{.key = std::move(key),
                 .kind = FieldKind::number,
                 .unit = std::move(unit),
                 .min = 0,
                 .max = 10,
                 .doc = "Standard deviation of white noise on the measured " + of + ". As in the named set."};
  };
  static const Section section{
      "Plant",
      "Starts from a named set and changes single figures of it. `ideal`: rigid bodies and perfect torques. "
      "`realistic`: joint friction of the robot model, torque tracking with 50 Hz bandwidth, 1 ms command "
      "delay, "
      "sensor noise. `fr3` has no friction figures of its own and takes the Panda's.",
      {{.key = "fidelity",
        .kind = FieldKind::choice,
        .fallback = "ideal",
        .choices = {"ideal", "realistic"},
        .doc = "The named set."},
       {.key = "substeps",
        .kind = FieldKind::integer,
        .fallback = "1",
        .min = 1,
        .max = 100,
        .doc = "Physics steps per control period of 1 ms."},
       {.key = "joint_friction",
        .kind = FieldKind::boolean,
        .doc = "Friction of the robot model. As in the named set."},
       {.key = "torque_bandwidth_hz",
        .kind = FieldKind::number,
        .unit = "Hz",
        .min = 0,
        .max = 500,
        .doc = "First-order torque tracking; 0: perfect. As in the named set."},
       {.key = "command_delay_s",
        .kind = FieldKind::number,
        .unit = "s",
        .min = 0,
        .max = 0.1,
        .doc = "Whole control periods of 0.001 s. As in the named set."},
       noise("noise_q_rad", "rad", "joint positions"),
       noise("noise_dq_rad_per_s", "rad/s", "joint velocities"),
       noise("noise_tau_nm", "N m", "joint torques"),
       {.key = "stiction_nm",
        .kind = FieldKind::number,
        .unit = "N m",
        .min = 0,
        .max = 5,
        .doc = "Dry friction of every joint, which no controller knows of. As in the named set: none."},
       {.key = "noslip_iterations",
        .kind = FieldKind::integer,
        .fallback = "0",
        .min = 0,
        .max = 100,
        .doc = "Passes of the contact solver that take the creep out of friction: 5 for things that are "
               "held."}}};
  return section;
}

const Section& arm() {
  static const Section section{
      "Arm",
      "Frames are named in CONVENTIONS.md: W world, B base, F flange, E end effector, K stiffness frame.",
      {{.key = "name", .kind = FieldKind::identifier, .required = true, .doc = "Unique; for example `left`."},
       {.key = "model",
        .kind = FieldKind::text,
        .fallback = "fer",
        .doc = "A robot of models/ (`fer`, `fer_maker`, `fr3`), or the path of a model file, relative to "
               "this file."},
       {.key = "plant_model",
        .kind = FieldKind::text,
        .doc = "What the simulated arm truly is, where that is not what `model` tells its controllers and "
               "its own "
               "firmware: a model as above, of as many joints (docs/simulation.md)."},
       {.key = "hand",
        .kind = FieldKind::boolean,
        .fallback = "true",
        .doc = "The model's hand on the flange."},
       {.key = "fingers",
        .kind = FieldKind::choice,
        .choices = {"locked", "movable"},
        .doc = "Of the simulated hand. `locked`: closed and rigid; `movable`: a gripper that grasps "
               "(docs/gripper.md). Not "
               "said: locked, on virtual arms movable. The controllers' model is the rigid hand either way."},
       {.key = "vacuum",
        .kind = FieldKind::boolean,
        .fallback = "false",
        .doc =
            "A vacuum gripper in the hand's place (`hand: false`). It sucks at the end effector, along its z "
            "axis."},
       {.key = "base",
        .kind = FieldKind::section,
        .fallback = "{}",
        .section = &pose(),
        .doc = "X_WB: base in the world."},
       {.key = "start_rad",
        .kind = FieldKind::numbers,
        .unit = "rad",
        .fallback = "ready",
        .count = Field::kPerJoint,
        .choices = {"ready"},
        .doc = "Where the simulated arm stands at the start; `ready` is the model's own configuration. "
               "Controllets "
               "begin from the measured state, whatever it is."},
       {.key = "end_effector",
        .kind = FieldKind::section,
        .section = &pose(),
        .doc = "X_FE (the maker's F_T_EE): end effector in the flange. Without it the hand's tool centre "
               "point, without "
               "a hand the flange."},
       {.key = "stiffness_frame",
        .kind = FieldKind::section,
        .fallback = "{}",
        .section = &pose(),
        .doc = "X_EK (the maker's EE_T_K): stiffness frame in the end effector."},
       load_field(
           "tool",
           "Rigid tool on the flange, the hand not counted: in the plant and known to the controllers."),
       load_field("load_declared", "Payload that the controllers are told of."),
       load_field("load_present",
                  "Payload that the plant really carries. Without it, none: write both for a payload "
                  "that is there and known."),
       {.key = "tool_shapes",
        .kind = FieldKind::sections,
        .section = &tool_shape(),
        .doc = "What of the tool touches things. Massless: weight is `tool`."},
       {.key = "known_friction",
        .kind = FieldKind::choice,
        .fallback = "none",
        .choices = {"none", "model"},
        .doc = "`model`: the controllers know the robot model's friction table (feature "
               "`friction_compensation`)."},
       {.key = "safety",
        .kind = FieldKind::section,
        .fallback = "{}",
        .section = &safety(),
        .doc = "Limits of the safety stage; the maker's where nothing is said."},
       {.key = "fci",
        .kind = FieldKind::section,
        .section = &fci(),
        .doc = "This is a real arm. The address alone may be written. `--backend` of a run says otherwise."},
       {.key = "collision",
        .kind = FieldKind::section,
        .section = &collision(),
        .doc = "Thresholds of contact and reflex, set on the arm at the start. Without them, what the arm "
               "has by itself."},
       {.key = "joint_stiffness_nm_per_rad",
        .kind = FieldKind::numbers,
        .unit = "N m/rad",
        .min = 0,
        .max = 14250,
        .count = Field::kPerJoint,
        .doc = "Of the arm's own joint controller, set at the start; controllets do not use it."},
       {.key = "cartesian_stiffness",
        .kind = FieldKind::numbers,
        .unit = "N/m, N m/rad",
        .min = 0,
        .max = 3000,
        .count = 6,
        .doc = "Of the arm's own Cartesian controller: x, y, z, roll, pitch, yaw in K. As above."}}};
  return section;
}

const Section& tool_shape() {
  static const Section section{"Tool shape",
                               "A rigid shape in the flange's frame F. It collides in the simulation with "
                               "everything but the last link "
                               "and the hand, and collision avoidance knows it.",
                               {{.key = "shape",
                                 .kind = FieldKind::choice,
                                 .required = true,
                                 .choices = {"sphere", "box"},
                                 .doc = "What it is."},
                                {.key = "diameter_m",
                                 .kind = FieldKind::number,
                                 .unit = "m",
                                 .min = kSmallest,
                                 .max = 2,
                                 .doc = "Of a sphere."},
                                {.key = "size_m",
                                 .kind = FieldKind::numbers,
                                 .unit = "m",
                                 .min = kSmallest,
                                 .max = 2,
                                 .count = 3,
                                 .doc = "Of a box: full edge lengths along its x, y, z."},
                                position("Centre in the flange."),
                                rpy(),
                                quaternion()}};
  return section;
}

const Section& contact() {
  static const Section section{
      "Contact",
      "Elastic contact between this object and every tool shape. A box that lies flat on a box or a plane "
      "touches at four corners, which share the figures. What is not given is as below.",
      {{.key = "stiffness_n_per_m",
        .kind = FieldKind::number,
        .unit = "N/m",
        .fallback = "10000",
        .min = 10,
        .max = 1e6,
        .doc = "Slope of the normal force against the penetration."},
       {.key = "damping_ratio",
        .kind = FieldKind::number,
        .fallback = "0.3",
        .min = 0,
        .max = 2,
        .doc = "Of a body of 4 kg on that stiffness."},
       {.key = "tangential_damping_n_s_per_m",
        .kind = FieldKind::number,
        .unit = "N s/m",
        .fallback = "100",
        .min = 1,
        .max = 2000,
        .doc = "Friction force per slip velocity, up to friction's limit. Large values make sliding chatter, "
               "small ones let held things creep (`noslip_iterations` in `plant` stops that)."}}};
  return section;
}

const Section& pose() {
  static const Section section{"Pose",
                               "A frame in its parent. What is not given is zero.",
                               {position("Origin of the frame."), rpy(), quaternion()}};
  return section;
}

const Section& load() {
  static const Section section{
      "Load",
      "A rigid body on the flange, in the flange's frame.",
      {{.key = "mass_kg",
        .kind = FieldKind::number,
        .unit = "kg",
        .required = true,
        .min = 0,
        .max = 50,
        .doc = "Mass."},
       {.key = "com_m",
        .kind = FieldKind::numbers,
        .unit = "m",
        .fallback = "[0, 0, 0]",
        .min = -2,
        .max = 2,
        .count = 3,
        .doc = "Centre of mass in the flange."},
       {.key = "inertia_kg_m2",
        .kind = FieldKind::section,
        .section = &inertia(),
        .doc = "About the centre of mass, in the flange's axes. Without it the body is a point."}}};
  return section;
}

const Section& inertia() {
  static const Section section{
      "Inertia",
      "A symmetric matrix; each of its principal moments is at most the sum of the other two.",
      {moment("xx"), moment("yy"), moment("zz"), product("xy"), product("xz"), product("yz")}};
  return section;
}

const Section& safety() {
  static const Section section{
      "Safety",
      "Limits of one arm, tighter than the maker's. A list has one number per joint; a single number caps "
      "every joint, "
      "where the maker's own limit is lower that stays. Looser than the maker's is refused, unless "
      "`allow_looser_limits` says that it is meant: then it is done, shown and logged.",
      {{.key = "allow_looser_limits",
        .kind = FieldKind::boolean,
        .fallback = "false",
        .doc = "Limits of this section may be looser than the maker's."},
       limit("torque_max_nm", "N m", 0, "Largest commanded torque."),
       limit("torque_rate_max_nm_per_s", "N m/s", 0.001, "Fastest change of the commanded torque."),
       limit("velocity_max_rad_per_s", "rad/s", 0.001, "Faster than this, the arm goes to hold."),
       limit("position_min_rad", "rad", -std::numeric_limits<double>::infinity(),
             "Moving outwards below this, the arm goes to hold."),
       limit("position_max_rad", "rad", -std::numeric_limits<double>::infinity(),
             "Moving outwards above this, the arm goes to hold."),
       {.key = "workspace_min_m",
        .kind = FieldKind::numbers,
        .unit = "m",
        .min = -kFar,
        .max = kFar,
        .count = 3,
        .doc = "Lower corner, in the world, of the box that the end effector must not leave. Together with "
               "`workspace_max_m`."},
       {.key = "workspace_max_m",
        .kind = FieldKind::numbers,
        .unit = "m",
        .min = -kFar,
        .max = kFar,
        .count = 3,
        .doc = "Upper corner of that box."},
       {.key = "max_state_age_s",
        .kind = FieldKind::number,
        .unit = "s",
        .fallback = "0.002",
        .min = kPeriod,
        .max = 0.1,
        .doc = "An arm whose state is older goes to hold, with the other arms of its controllet. An arm that "
               "its "
               "controllet owns alone has 0.02 s."}}};
  return section;
}

const Section& object() {
  const auto length = [](std::string key, std::string doc) {
    return Field{.key = std::move(key),
                 .kind = FieldKind::number,
                 .unit = "m",
                 .min = kSmallest,
                 .max = kFar,
                 .doc = std::move(doc)};
  };
  static const Section section{
      "Object",
      "A body of the scene: fixed (a table, a wall) or free (it falls, can be pushed and grasped).",
      {{.key = "name", .kind = FieldKind::identifier, .required = true, .doc = "Unique."},
       {.key = "shape",
        .kind = FieldKind::choice,
        .required = true,
        .choices = {"plane", "box", "sphere", "cylinder", "capsule"},
        .doc = "A plane is endless, its normal the object's z; a cylinder and a capsule lie along z."},
       {.key = "size_m",
        .kind = FieldKind::numbers,
        .unit = "m",
        .min = kSmallest,
        .max = kFar,
        .count = 3,
        .doc = "Of a box: full edge lengths along x, y, z."},
       length("diameter_m", "Of a sphere, cylinder or capsule."),
       length("length_m", "Of a cylinder; of a capsule without its round ends."),
       position("Centre of the object."),
       rpy(),
       quaternion(),
       {.key = "fixed", .kind = FieldKind::boolean, .fallback = "true", .doc = "`false`: a free body."},
       {.key = "mass_kg",
        .kind = FieldKind::number,
        .unit = "kg",
        .min = kSmallest,
        .max = 1000,
        .doc = "Of a free body, which needs it."},
       {.key = "friction",
        .kind = FieldKind::number,
        .fallback = "0.6",
        .min = 0,
        .max = 5,
        .doc = "Coefficient of sliding friction."},
       {.key = "contact_time_constant_s",
        .kind = FieldKind::number,
        .unit = "s",
        .min = 0.002,
        .max = 1,
        .doc = "How soon contact pushes bodies apart; smaller is stiffer (MuJoCo's solref). Without it "
               "MuJoCo's own."},
       {.key = "contact_damping_ratio",
        .kind = FieldKind::number,
        .min = 0.01,
        .max = 10,
        .doc = "Of the contact; 1: no bouncing. Without it MuJoCo's own."},
       {.key = "contact",
        .kind = FieldKind::section,
        .section = &contact(),
        .doc = "Contact with tool shapes in SI units. Without it as with everything else."},
       {.key = "color_rgba",
        .kind = FieldKind::numbers,
        .fallback = "[0.7, 0.7, 0.72, 1]",
        .min = 0,
        .max = 1,
        .count = 4,
        .doc = "Red, green, blue, opacity."}}};
  return section;
}

std::vector<const Section*> all() {
  return {&scene(),         &plant(),           &arm(),          &pose(),         &load(),
          &inertia(),       &tool_shape(),      &safety(),       &fci(),          &collision(),
          &thresholds(),    &object(),          &contact(),      &controllet(),   &pose_input(),
          &joints_input(),  &other_input(),     &event(),        &switch_event(), &parameter_event(),
          &feature_event(), &reference_event(), &motion_event(), &overtone(),     &place_event(),
          &ros(),           &ros_rates()};
}

}  // namespace multipanda::schema
