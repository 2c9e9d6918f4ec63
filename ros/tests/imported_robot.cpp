#include "imported_robot.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <stdexcept>

#if __has_include(<urdf/model.hpp>)
#include <urdf/model.hpp>
#else
#include <urdf/model.h>
#endif

namespace multipanda::ros2_control_tests {
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
