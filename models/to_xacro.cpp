#include <stdexcept>

#include "models/write_robot.hpp"
#include "models/xml_text.hpp"

namespace multipanda {
namespace {

const std::string kPrefix = "${prefix}";
const std::string kOpen = "<?xml version=\"1.0\"?>\n<robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\">\n";
const std::string kClose = "</robot>\n";

// The part of a URDF between the colors and the end.
std::string links_of(const std::string& urdf) {
  const auto first = urdf.find("  <link name=\"" + kPrefix + "link0\"");
  const auto end = urdf.rfind(kClose);
  if (first == std::string::npos || end == std::string::npos) {
    throw std::logic_error("unexpected format of to_urdf");
  }
  return urdf.substr(first, end - first);
}

// Pairs that are never checked for collision, in the notation of MoveIt's semantic description: two links, or
// the hand and a link.
std::string ignored_pairs(const RobotDescription& robot, bool of_hand) {
  std::vector<std::string> links;
  for (std::size_t i = 0; i <= robot.joint_count(); ++i) links.push_back("link" + std::to_string(i));
  if (of_hand) links.emplace_back("hand");
  std::string text;
  for (std::size_t a = 0; a < links.size(); ++a) {
    for (std::size_t b = of_hand ? links.size() - 1 : a + 1; b < links.size(); ++b) {
      if (a == b || !is_ignored_pair(robot, links[a], links[b])) continue;
      text += "  <disable_collisions link1=\"" + kPrefix + links[a] + "\" link2=\"" + kPrefix + links[b] +
              "\" reason=\"" + (b == a + 1 ? "Adjacent" : "Never") + "\"/>\n";
    }
  }
  return text;
}

std::string macro(const std::string& name, const std::string& body) {
  return "  <xacro:macro name=\"" + name + "\" params=\"prefix\">\n" + body + "  </xacro:macro>\n";
}

}  // namespace

std::string to_xacro(const RobotDescription& robot) {
  UrdfOptions options{.prefix = kPrefix, .flange = "link" + std::to_string(robot.joint_count() + 1)};
  const std::string arm = links_of(to_urdf(robot, options));
  std::string home;
  for (const double q : robot.q_home) home += (home.empty() ? "" : ", ") + exact(q);
  std::string text = kOpen + "  <!-- " + robot.title + ". Written by export_models from " +
                     robot.file.filename().string() + "; see there for the sources of the values. -->\n" +
                     "  <xacro:property name=\"" + robot.name + "_home\" value=\"${[" + home + "]}\"/>\n" +
                     "  <xacro:property name=\"" + robot.name + "_has_hand\" value=\"" +
                     (robot.hand ? "true" : "false") + "\"/>\n" + macro(robot.name + "_links", arm) +
                     macro(robot.name + "_ignored_pairs", ignored_pairs(robot, false));
  if (robot.hand) {
    options.hand = options.fingers = true;
    const std::string whole = links_of(to_urdf(robot, options));
    if (whole.rfind(arm, 0) != 0) throw std::logic_error("expected the hand after the arm");
    text += macro(robot.name + "_hand", whole.substr(arm.size()));
    text += macro(robot.name + "_hand_ignored_pairs", ignored_pairs(robot, true));
  }
  return text + kClose;
}

std::map<std::string, std::string> exported_descriptions() {
  std::map<std::string, std::string> files;
  XmlText colors;
  for (const auto& [name, rgb] : shape_colors()) {
    colors.open("material", {{"name", name}});
    colors.leaf("color", {{"rgba", exact(rgb) + " 1"}});
    colors.close();
  }
  files["colors.xacro"] = kOpen + colors.text() + kClose;
  for (const auto& name : available_robots()) files[name + ".xacro"] = to_xacro(load_robot(name));
  return files;
}

std::map<std::string, std::string> exported_models() {
  std::map<std::string, std::string> files;
  for (const auto& name : available_robots()) {
    const RobotDescription robot = load_robot(name);
    files[name + ".urdf"] = to_urdf(robot);
    files[name + ".xml"] = to_mjcf(robot, {.rotor_hidden = 0});
    if (!robot.hand) continue;
    files[name + "_hand.urdf"] = to_urdf(robot, {.hand = true});
    files[name + "_hand.xml"] = to_mjcf(robot, {.hand = true, .rotor_hidden = 0});
  }
  return files;
}

}  // namespace multipanda
