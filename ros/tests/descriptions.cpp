#include "descriptions.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <regex>
#include <sstream>
#include <stdexcept>

#if __has_include(<urdf/model.hpp>)
#include <urdf/model.hpp>
#else
#include <urdf/model.h>
#endif

namespace multipanda::ros2_control_tests {

namespace {

constexpr int kJoints = 7;
struct Limits {
  double lower, upper, velocity, effort;
};
constexpr Limits kLimits[kJoints] = {{-2.8973, 2.8973, 2.175, 87}, {-1.7628, 1.7628, 2.175, 87},
                                     {-2.8973, 2.8973, 2.175, 87}, {-3.0718, -0.0698, 2.175, 87},
                                     {-2.8973, 2.8973, 2.61, 12},  {-0.0175, 3.7525, 2.61, 12},
                                     {-2.8973, 2.8973, 2.61, 12}};

std::string flat(const std::vector<std::string>& items) {
  std::string text;
  for (const auto& item : items) text += (text.empty() ? "" : " ") + item;
  return text;
}

// Side by side, out of each other's reach.
std::string base(std::size_t arm) { return "[0, " + std::to_string(0.6 * static_cast<double>(arm)) + ", 0]"; }

Component arms_of_this_project(const std::string& name, const std::string& plugin,
                               const std::vector<std::string>& arms) {
  Component component{name,   plugin, arms, {{"arm_names", flat(arms)}}, {"effort", "position", "velocity"},
                      kJoints};
  for (std::size_t i = 0; i < arms.size(); ++i)
    component.parameters["arms." + arms[i] + ".base.position_m"] = base(i);
  return component;
}

}  // namespace

const std::vector<double>& home() {
  static const std::vector<double> q = {
      0, -0.7853981633974483, 0, -2.356194490192345, 0, 1.5707963267948966, 0.7853981633974483};
  return q;
}

std::string joint_name(const std::string& arm, int number) { return arm + "_joint" + std::to_string(number); }

Component mock_component(const std::string& name, const std::vector<std::string>& arms) {
  return {name, "mock_components/GenericSystem", arms, {}, {"effort"}, kJoints};
}

Component mujoco_component(const std::string& name, const std::vector<std::string>& arms) {
  return arms_of_this_project(name, "multipanda_hardware/MujocoSystem", arms);
}

Component fci_component(const std::string& name, const std::vector<std::string>& arms,
                        const std::vector<std::string>& addresses) {
  Component component = arms_of_this_project(name, "multipanda_hardware/FciSystem", arms);
  for (std::size_t i = 0; i < arms.size(); ++i)
    component.parameters["arms." + arms[i] + ".fci"] = addresses[i];
  component.parameters["lockstep"] = "true";  // the tests' virtual arms wait for each command
  return component;
}

std::string tag(const Component& component) {
  std::ostringstream out;
  out.precision(17);
  out << "<ros2_control name=\"" << component.name << "\" type=\"system\">\n<hardware><plugin>"
      << component.plugin << "</plugin>";
  for (const auto& [name, value] : component.parameters) {
    out << "<param name=\"" << name << "\">" << value << "</param>";
  }
  out << "</hardware>\n";
  for (const auto& arm : component.arms) {
    for (int j = 1; j <= component.joints; ++j) {
      out << "<joint name=\"" << joint_name(arm, j) << "\">";
      for (const auto& command : component.commands) out << "<command_interface name=\"" << command << "\"/>";
      out << "<state_interface name=\"position\"><param name=\"initial_value\">"
          << home()[static_cast<std::size_t>(j - 1)]
          << "</param></state_interface><state_interface name=\"velocity\"><param "
             "name=\"initial_value\">0</param></state_interface><state_interface name=\"effort\"><param "
             "name=\"initial_value\">0</param></state_interface></joint>\n";
    }
  }
  out << "</ros2_control>\n";
  return out.str();
}

std::string robot(const std::vector<Component>& components) {
  std::ostringstream out;
  out.precision(17);
  out << "<?xml version=\"1.0\"?>\n<robot name=\"tested\">\n<link name=\"world\"/>\n";
  for (const auto& component : components) {
    for (const auto& arm : component.arms) {
      out << "<link name=\"" << arm << "_link0\"/><joint name=\"" << arm
          << "_base_joint\" type=\"fixed\"><parent link=\"world\"/><child link=\"" << arm
          << "_link0\"/></joint>\n";
      for (int j = 1; j <= kJoints; ++j) {
        const Limits& limits = kLimits[j - 1];
        out << "<link name=\"" << arm << "_link" << j << "\"/><joint name=\"" << joint_name(arm, j)
            << "\" type=\"revolute\"><parent link=\"" << arm << "_link" << j - 1 << "\"/><child link=\""
            << arm << "_link" << j << "\"/><axis xyz=\"0 0 1\"/><limit lower=\"" << limits.lower
            << "\" upper=\"" << limits.upper << "\" velocity=\"" << limits.velocity << "\" effort=\""
            << limits.effort << "\"/></joint>\n";
      }
    }
  }
  for (const auto& component : components) out << tag(component);
  out << "</robot>\n";
  return out.str();
}

std::string modeled_robot(const Component& component) {
  std::ifstream file(MODEL_FILE);
  std::string model{std::istreambuf_iterator<char>(file), {}};
  const std::size_t begin = model.find("<robot"), body = model.find('>', begin) + 1,
                    end = model.find("</robot>");
  if (begin == std::string::npos || end == std::string::npos)
    throw std::runtime_error("cannot read the URDF: " MODEL_FILE);
  model = model.substr(body, end - body);
  std::string text = "<?xml version=\"1.0\"?>\n<robot name=\"tested\">\n<link name=\"world\"/>\n";
  for (const auto& arm : component.arms) {
    text +=
        std::regex_replace(model, std::regex("\"(joint|link|flange)(_?[a-z0-9]*\")"), "\"" + arm + "_$1$2");
    text = std::regex_replace(text, std::regex("<material name=\"(?=[a-z]+\")"),
                              "<material name=\"" + arm + "_");
    text += "<joint name=\"" + arm + "_base_joint\" type=\"fixed\"><parent link=\"world\"/><child link=\"" +
            arm + "_link0\"/></joint>\n";
  }
  return text + tag(component) + "</robot>\n";
}

namespace {

void replace_all(std::string& text, const std::string& from, const std::string& to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
}

}  // namespace

ImportedRobot::ImportedRobot(const std::string& file, const std::vector<Arm>& arms) {
  std::ifstream in(file);
  text_.assign(std::istreambuf_iterator<char>(in), {});
  urdf::Model model;
  if (!model.initString(text_)) throw std::runtime_error("cannot read the URDF: " + file);
  const std::string open = "<ros2_control", close = "</ros2_control>";
  for (std::size_t at = text_.find(open); at != std::string::npos; at = text_.find(open))
    text_.erase(at, text_.find(close, at) + close.size() - at);
  for (const auto& arm : arms) {
    chains_[arm.name] = chain(model, arm);
    int number = 0;
    for (const auto& joint : chains_[arm.name].joints) {
      const std::string name = "\"" + joint_name(arm.name, ++number) + "\"";
      replace_all(text_, "<joint name=\"" + joint + "\"", "<joint name=" + name);
      replace_all(text_, " joint=\"" + joint + "\"", " joint=" + name);
    }
  }
}

ImportedRobot::Chain ImportedRobot::chain(const urdf::Model& model, const Arm& arm) {
  Chain chain;
  for (auto link = model.getLink(arm.tip_link); link == nullptr || link->name != arm.base_link;
       link = link->getParent()) {
    if (link == nullptr || link->parent_joint == nullptr) {
      throw std::runtime_error("no arm from " + arm.base_link + " to " + arm.tip_link);
    }
    const urdf::Joint& joint = *link->parent_joint;
    const bool moves = joint.type != urdf::Joint::FIXED;
    chain.segments.push_back({joint.parent_to_joint_origin_transform, joint.axis, moves});
    if (moves) chain.joints.push_back(joint.name);
  }
  std::reverse(chain.segments.begin(), chain.segments.end());
  std::reverse(chain.joints.begin(), chain.joints.end());
  return chain;
}

std::string ImportedRobot::description(const Component& component) const {
  std::string text = text_;
  text.insert(text.rfind("</robot>"), tag(component));
  return text;
}

urdf::Pose ImportedRobot::tip(const std::string& arm, const std::vector<double>& q) const {
  urdf::Pose pose;
  std::size_t next = 0;
  for (const Segment& segment : chains_.at(arm).segments) {
    pose.position = pose.position + pose.rotation * segment.origin.position;
    pose.rotation = pose.rotation * segment.origin.rotation;
    if (!segment.moves) continue;
    const double half = 0.5 * q.at(next++), s = std::sin(half);
    pose.rotation = pose.rotation * urdf::Rotation(s * segment.axis.x, s * segment.axis.y, s * segment.axis.z,
                                                   std::cos(half));
  }
  return pose;
}

}  // namespace multipanda::ros2_control_tests
