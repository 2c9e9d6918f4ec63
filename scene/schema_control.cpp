#include "core/types/capacity.hpp"
#include "scene/schema.hpp"

// The part of a scene file that is about controlling: controllets, inputs, the timeline.
namespace multipanda::schema {
namespace {

constexpr double kFar = 100;        // farther away [m] nothing in a scene is
constexpr double kLongest = 86400;  // a day [s]
constexpr double kPeriod = 0.001;   // of control [s]

Field quaternion() {
  return {.key = "quaternion_wxyz",
          .kind = FieldKind::numbers,
          .min = -1.01,
          .max = 1.01,
          .count = 4,
          .doc = "In place of `rpy_rad`: unit quaternion, w first."};
}
Field timeout() {
  return {.key = "timeout_s",
          .kind = FieldKind::number,
          .unit = "s",
          .min = 0.002,
          .max = 60,
          .doc = "A stream that is silent for longer is lost: its arms go to hold."};
}
Field speed(std::string key, std::string unit, std::string doc) {
  return {.key = std::move(key),
          .kind = FieldKind::number,
          .unit = std::move(unit),
          .min = 1e-4,
          .max = 1e4,
          .doc = std::move(doc)};
}
Field named(std::string key, std::string doc) {
  return {.key = std::move(key), .kind = FieldKind::text, .required = true, .doc = std::move(doc)};
}
Field values(std::string key, std::string unit, std::size_t count, std::string doc) {
  return {.key = std::move(key),
          .kind = count == 1 ? FieldKind::number : FieldKind::numbers,
          .unit = std::move(unit),
          .count = count,
          .doc = std::move(doc)};
}

}  // namespace

const Section& controllet() {
  static const Section section{
      "Controllet",
      "One instance of a control law, bound to its arms. Types, parameters, inputs: see the end of this "
      "page.",
      {{.key = "name",
        .kind = FieldKind::identifier,
        .required = true,
        .doc = "Unique; switches and references use it."},
       {.key = "type", .kind = FieldKind::text, .required = true, .doc = "Which control law."},
       {.key = "arms",
        .kind = FieldKind::texts,
        .required = true,
        .doc = "Names of the arms that it owns, in the order of its type: `left`, or `[left, right]`."},
       {.key = "features", .kind = FieldKind::texts, .doc = "Features that are on from the start."},
       {.key = "parameters",
        .kind = FieldKind::open,
        .doc = "Values of parameters, by name. A single number may stand for a list of equal ones. "
               "Parameters of "
               "features: `joint_limits: {range_rad: 0.1}` or `joint_limits.range_rad: 0.1`."},
       {.key = "inputs",
        .kind = FieldKind::open,
        .doc = "Overrides of inputs, by name: `pose: {max_speed_m_per_s: 0.2}`. Without them the type's own "
               "figures."}}};
  return section;
}

const Section& pose_input() {
  static const Section section{
      "Input (pose)",
      "Overrides of an input that carries a pose.",
      {timeout(), speed("max_speed_m_per_s", "m/s", "Fastest motion of the set-point."),
       speed("max_angular_speed_rad_per_s", "rad/s", "Fastest turn of the set-point.")}};
  return section;
}

const Section& joints_input() {
  static const Section section{
      "Input (joints)",
      "Overrides of an input that carries joint positions.",
      {timeout(), speed("max_speed_rad_per_s", "rad/s", "Fastest motion of the set-point.")}};
  return section;
}

const Section& other_input() {
  static const Section section{
      "Input (twist, wrench, scalar)",
      "Overrides of any other input.",
      {timeout(), speed("max_rate_per_s", "1/s", "Fastest change of each number, in its unit per second.")}};
  return section;
}

const Section& event() {
  static const Section section{
      "Event",
      "One item of the timeline: a time, and exactly one thing that happens then.",
      {{.key = "at_s",
        .kind = FieldKind::number,
        .unit = "s",
        .required = true,
        .min = kPeriod,
        .max = kLongest,
        .doc = "Time since the start; after 0, what holds from 0 on is `active` and the controllets' own "
               "values."},
       {.key = "switch",
        .kind = FieldKind::section,
        .section = &switch_event(),
        .doc = "Other controllets take over."},
       {.key = "parameter",
        .kind = FieldKind::section,
        .section = &parameter_event(),
        .doc = "Sets a parameter."},
       {.key = "feature",
        .kind = FieldKind::section,
        .section = &feature_event(),
        .doc = "Switches a feature."},
       {.key = "reference",
        .kind = FieldKind::section,
        .section = &reference_event(),
        .doc = "Sets a reference."},
       {.key = "motion",
        .kind = FieldKind::section,
        .section = &motion_event(),
        .doc = "Moves a reference to and fro, or round."},
       {.key = "place",
        .kind = FieldKind::section,
        .section = &place_event(),
        .doc = "Puts an object elsewhere (simulation only)."},
       {.key = "stop",
        .kind = FieldKind::texts,
        .choices = {"all"},
        .doc = "Arms that stop: they hold until resumed."},
       {.key = "resume",
        .kind = FieldKind::texts,
        .choices = {"all"},
        .doc = "Arms that may be moved again; they are still held until a switch."}}};
  return section;
}

const Section& switch_event() {
  static const Section section{
      "Switch",
      "",
      {{.key = "activate",
        .kind = FieldKind::texts,
        .doc =
            "Controllets that run afterwards. Whoever owned their arms stops; arms without owner are held."},
       {.key = "deactivate", .kind = FieldKind::texts, .doc = "Controllets that stop."},
       {.key = "only",
        .kind = FieldKind::boolean,
        .fallback = "false",
        .doc = "`true`: everything that is not in `activate` stops."}}};
  return section;
}

const Section& parameter_event() {
  static const Section section{"Parameter",
                               "",
                               {named("controllet", "Name of the instance."),
                                named("name", "Parameter; of a feature `joint_limits.range_rad`."),
                                {.key = "value",
                                 .kind = FieldKind::open,
                                 .required = true,
                                 .doc = "As under `parameters`; approached within 0.2 s."}}};
  return section;
}

const Section& feature_event() {
  static const Section section{
      "Feature",
      "",
      {named("controllet", "Name of the instance."),
       named("name", "Feature."),
       {.key = "on", .kind = FieldKind::boolean, .fallback = "true", .doc = "`false`: it is switched off."}}};
  return section;
}

const Section& reference_event() {
  static const Section section{
      "Reference",
      "A goal for an input of a running controllet, approached smoothly. Which keys hold depends on what the "
      "input "
      "carries; poses, twists and wrenches are in the world unless the input says otherwise.",
      {named("controllet", "Name of the instance."),
       named("input", "Name of the input."),
       {.key = "duration_s",
        .kind = FieldKind::number,
        .unit = "s",
        .fallback = "0",
        .min = 0,
        .max = 3600,
        .doc = "Time to get there; longer where the input's speed needs it. 0: as fast as that allows."},
       {.key = "position_m",
        .kind = FieldKind::numbers,
        .unit = "m",
        .min = -kFar,
        .max = kFar,
        .count = 3,
        .doc = "Pose: position. With `rpy_rad` or `quaternion_wxyz`."},
       {.key = "rpy_rad",
        .kind = FieldKind::numbers,
        .unit = "rad",
        .count = 3,
        .doc = "Pose: roll, pitch, yaw."},
       quaternion(),
       values("q_rad", "rad", Field::kPerJoint, "Joints: one angle per joint."),
       values("force_n", "N", 3, "Wrench: force; zero if only a torque is given."),
       values("torque_nm", "N m", 3, "Wrench: torque; zero if only a force is given."),
       values("linear_m_per_s", "m/s", 3, "Twist: velocity; zero if only the other is given."),
       values("angular_rad_per_s", "rad/s", 3, "Twist: angular velocity; zero if only the other is given."),
       values("value", "", 1, "Scalar.")}};
  return section;
}

namespace {

Field motion_vector(std::string key, std::string doc) {
  return Field{.key = std::move(key),
               .kind = FieldKind::numbers,
               .min = -1e4,
               .max = 1e4,
               .count = Field::kByQuantity,
               .doc = std::move(doc)};
}

}  // namespace

const Section& motion_event() {
  static const Section section{
      "Motion",
      "x(t) = x_0 + sine sin(theta) + rise (1 - cos(theta))/2 from where the set-point x_0 is, theta from 0 "
      "to "
      "2 pi cycles. It begins and ends at rest and lasts period_s * cycles + ramp_s. A circle of radius r: "
      "`sine` r one way, `rise` 2 r towards the centre.",
      {named("controllet", "Name of the instance."),
       named("input", "Name of the input."),
       motion_vector("sine",
                     "Pose: x, y, z [m] (it keeps its orientation). Twist, wrench: 6 numbers. Joints: one "
                     "per joint [rad]. Scalar: one. Without it zero."),
       motion_vector("rise", "As `sine`. Without it zero."),
       {.key = "overtones",
        .kind = FieldKind::sections,
        .section = &overtone(),
        .doc = "At most 7 further parts: the first swings twice as fast, the next three times as fast, and "
               "so on. All together are a Fourier series per number."},
       {.key = "period_s",
        .kind = FieldKind::number,
        .unit = "s",
        .required = true,
        .min = 0.01,
        .max = kLongest,
        .doc = "Of one turn of theta at full rate."},
       {.key = "cycles",
        .kind = FieldKind::number,
        .fallback = "1",
        .min = 0.1,
        .max = 1e6,
        .doc = "How many turns."},
       {.key = "ramp_s",
        .kind = FieldKind::number,
        .unit = "s",
        .fallback = "0.1",
        .min = 0.1,
        .max = 60,
        .doc = "Time in which the rate fades in, and out; at most period_s * cycles."}}};
  return section;
}

const Section& overtone() {
  static const Section section{
      "Overtone",
      "Adds sine sin(n theta) + rise (1 - cos(n theta))/2 to a motion, n = 2 for the first overtone.",
      {motion_vector("sine", "As the motion's. Without it zero."),
       motion_vector("rise", "As the motion's. Without it zero.")}};
  return section;
}

const Section& place_event() {
  static const Section section{
      "Place",
      "Puts an object elsewhere, at rest: a free one, or a fixed one (a table vanishes). The simulation does "
      "it "
      "by itself; real arms ignore it. Where it would stand inside something, the run ends with an error.",
      {named("object", "Name of the object."),
       {.key = "position_m",
        .kind = FieldKind::numbers,
        .unit = "m",
        .required = true,
        .min = -kFar,
        .max = kFar,
        .count = 3,
        .doc = "Centre of the object in the world."},
       {.key = "rpy_rad",
        .kind = FieldKind::numbers,
        .unit = "rad",
        .count = 3,
        .doc = "Roll, pitch, yaw. Without it or `quaternion_wxyz` as in `objects`."},
       quaternion()}};
  return section;
}

}  // namespace multipanda::schema
