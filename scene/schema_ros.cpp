#include "scene/schema.hpp"

// The keys about ROS 2.
namespace multipanda::schema {

const Section& ros_rates() {
  const auto rate = [](std::string key, std::string fallback, std::string doc) {
    return Field{.key = std::move(key),
                 .kind = FieldKind::number,
                 .unit = "Hz",
                 .fallback = std::move(fallback),
                 .min = 0,
                 .max = 1000,
                 .doc = std::move(doc)};
  };
  static const Section section{
      "ROS rates",
      "How often each group of topics is published, in the time of the loop; 0: never. A rate is met by "
      "publishing every n-th cycle: 1000 Hz is every cycle, 300 Hz becomes 333 Hz.",
      {rate("joint_states", "100", "`joint_states` of all arms and fingers."),
       rate("robot_state", "100", "`<arm>/robot_state`, everything that is known of the arm."),
       rate("model", "30", "`<arm>/model`, mass matrix, Jacobian and poses."),
       rate("wrench", "100", "`<arm>/wrench`, what the arm exerts on its environment."),
       rate("tf", "100", "`/tf`, poses of all links and frames."),
       rate("references", "100", "Set-points that controllets follow."),
       rate("outputs", "100", "What controllets tell of themselves."),
       rate("gripper", "30", "`<arm>_gripper/joint_states`."),
       rate("object_poses", "30", "`simulation/object_poses`."),
       rate("clock", "1000", "`/clock`, where stamps are in simulated time."),
       rate("loop_statistics", "1", "`~/loop_statistics`."), rate("diagnostics", "1", "`/diagnostics`.")}};
  return section;
}

const Section& ros() {
  static const Section section{
      "ROS",
      "How `run --ros` shows the run in ROS 2 ([ROS interfaces](ros_interfaces.md)). Without `--ros` nothing "
      "of "
      "it is used.",
      {{.key = "node",
        .kind = FieldKind::identifier,
        .fallback = "multipanda",
        .doc = "Name of the node; what is said of `~/` stands under it."},
       {.key = "namespace",
        .kind = FieldKind::text,
        .fallback = "/",
        .doc = "Of the node, as `/cell_1`. All names but `/tf`, `/tf_static`, `/clock` and `/diagnostics` "
               "stand in it."},
       {.key = "time",
        .kind = FieldKind::choice,
        .fallback = "automatic",
        .choices = {"automatic", "simulation", "system"},
        .doc = "Of the stamps. `simulation`: the loop's time from 0, published as `/clock`; `system`: this "
               "computer's. `automatic`: `simulation` where every arm is simulated, else `system`."},
       {.key = "rates_hz",
        .kind = FieldKind::section,
        .fallback = "{}",
        .section = &ros_rates(),
        .doc = "How often each group of topics is published."}}};
  return section;
}

}  // namespace multipanda::schema
