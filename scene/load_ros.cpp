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

RosSection::Rates read_rates(const Mapping& mapping) {
  return {.joint_states = mapping.number("joint_states"),
          .robot_state = mapping.number("robot_state"),
          .model = mapping.number("model"),
          .wrench = mapping.number("wrench"),
          .tf = mapping.number("tf"),
          .references = mapping.number("references"),
          .outputs = mapping.number("outputs"),
          .gripper = mapping.number("gripper"),
          .object_poses = mapping.number("object_poses"),
          .clock = mapping.number("clock"),
          .loop_statistics = mapping.number("loop_statistics"),
          .diagnostics = mapping.number("diagnostics")};
}

}  // namespace

void read_ros(const Mapping& root, SceneReader& reader) {
  const Mapping mapping = root.section("ros");
  RosSection& ros = reader.scene.ros;
  ros.node = mapping.text("node");
  ros.name_space = mapping.text("namespace");
  if (!is_namespace(ros.name_space)) {
    mapping.entry("namespace")
        .expected("'/' or a name as '/cell_1': a slash, then letters, digits and _, no digit first");
  }
  const std::string time = mapping.text("time");
  ros.time = time == "simulation" ? RosSection::Time::simulation
             : time == "system"   ? RosSection::Time::system
                                  : RosSection::Time::automatic;
  ros.rates_hz = read_rates(mapping.section("rates_hz"));
}

}  // namespace multipanda
