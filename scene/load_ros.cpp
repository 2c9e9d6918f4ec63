#include <cctype>

#include "scene/load_parts.hpp"

namespace multipanda {
namespace {

// "/", or "/a/b_1": parts of letters, digits and _, none beginning with a digit.
bool is_namespace(const std::string& text) {
  if (text == "/") return true;
  if (text.empty() || text.front() != '/' || text.back() == '/' || text.size() > 200) return false;
  char before = 0;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    const bool part_begins = before == '/' || before == 0;
    if (c == '/' ? before == '/' : std::isalnum(byte) == 0 && c != '_') return false;
    if (part_begins && std::isdigit(byte) != 0) return false;
    before = c;
  }
  return text.find("__") == std::string::npos;
}

}  // namespace

void visit(Archive& archive, RosSection::Rates& rates) {
  archive.about("ROS rates",
                "How often each group of topics is published, in the time of the loop; 0: never. Topics are "
                "published every n-th cycle: 1000 Hz is every cycle, 300 Hz becomes 333 Hz.");
  const auto rate = [&](const char* name, double& value, const char* doc) {
    archive(Key(name, doc).in("Hz").within(0, 1000), value);
  };
  rate("joint_states", rates.joint_states, "`joint_states` of all arms and fingers.");
  rate("robot_state", rates.robot_state, "`<arm>/robot_state`, the complete state of the arm.");
  rate("model", rates.model, "`<arm>/model`, mass matrix, Jacobian and poses.");
  rate("wrench", rates.wrench, "`<arm>/wrench`, the wrench that the arm exerts on its environment.");
  rate("tf", rates.tf, "`/tf`, poses of all links and frames.");
  rate("references", rates.references, "Set-points that controllets follow.");
  rate("outputs", rates.outputs, "Outputs of controllets.");
  rate("gripper", rates.gripper, "`<arm>_gripper/joint_states`.");
  rate("object_poses", rates.object_poses, "`simulation/object_poses`.");
  rate("markers", rates.markers, "`~/markers`, while a viewer such as rviz subscribes.");
  rate("clock", rates.clock, "`/clock`, if stamps are in simulated time.");
  rate("loop_statistics", rates.loop_statistics, "`~/loop_statistics`.");
  rate("diagnostics", rates.diagnostics, "`/diagnostics`.");
}

void visit(Archive& archive, RosSection& ros) {
  archive.about(
      "ROS",
      "How `run --ros` shows the run in ROS 2 ([ROS interfaces](ros_interfaces.md)). It has no effect "
      "without `--ros`.");
  archive(Key("node", "Name of the node; names that begin with `~/` are relative to it.").identifier(),
          ros.node);
  archive(
      Key("namespace",
          "Namespace of the node, for example `/cell_1`. It applies to all names but `/tf`, `/tf_static`, "
          "`/clock` and `/diagnostics`."),
      ros.name_space);
  archive(
      Key("time",
          "Time of the stamps. `simulation`: that of the loop, from 0, published as `/clock`; `system`: that "
          "of this computer. `automatic`: `simulation` if every arm is simulated, otherwise `system`.")
          .one_of({"automatic", "simulation", "system"}),
      ros.time);
  archive(Key("compat",
              "Names and message types of another system beside our own, for its clients "
              "([multipanda_compat.md](multipanda_compat.md)). Needs its message packages when multipanda is "
              "built.")
              .one_of({"none", "multipanda_ros2", "franka_ros2"}),
          ros.compat);
  archive.section(Key("rates_hz", "How often each group of topics is published."), ros.rates_hz);
  if (archive.reading() && !is_namespace(ros.name_space)) {
    archive.at("namespace")
        .expected("'/' or a name like '/cell_1': a slash, then letters, digits and _, no digit first");
  }
}

}  // namespace multipanda
