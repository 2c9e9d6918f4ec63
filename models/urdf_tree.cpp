#include "models/urdf_tree.hpp"

#include <charconv>
#include <cmath>
#include <set>
#include <sstream>
#include <stdexcept>

#include <boost/property_tree/ptree.hpp>
#include <boost/property_tree/xml_parser.hpp>

#include "common/text.hpp"
#include "models/robot_description.hpp"

namespace multipanda {
namespace {

using Xml = boost::property_tree::ptree;

[[noreturn]] void refuse(const std::string& where, const std::string& why) {
  throw std::invalid_argument("URDF: " + (where.empty() ? "" : where + ": ") + why);
}

// An element with its place, for messages.
struct Element {
  const Xml* xml;
  std::string where;

  std::optional<Element> find(const std::string& name) const {
    const auto child = xml->get_child_optional(name);
    if (!child) return std::nullopt;
    return Element{&*child, where + ": <" + name + ">"};
  }
  std::optional<std::string> attribute(const std::string& name) const {
    const auto value = xml->get_optional<std::string>("<xmlattr>." + name);
    return value ? std::optional<std::string>(*value) : std::nullopt;
  }
  std::string text(const std::string& name) const {
    const auto value = attribute(name);
    if (!value || value->empty()) refuse(where, "the attribute '" + name + "' is missing");
    return *value;
  }
  // `count` finite numbers, separated by blanks; independent of the locale.
  std::vector<double> numbers(const std::string& name, std::size_t count) const {
    const std::string value = text(name);
    std::istringstream words(value);
    std::vector<double> result;
    for (std::string word; words >> word;) {
      if (word.front() == '+') word.erase(0, 1);
      double number = 0;
      const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
      if (error != std::errc() || end != word.data() + word.size() || !std::isfinite(number)) {
        refuse(where, "'" + word + "' in " + name + "=\"" + value + "\" is not a finite number");
      }
      result.push_back(number);
    }
    if (result.size() != count) {
      refuse(where, "expected " + std::to_string(count) + " numbers in " + name + "=\"" + value + "\"");
    }
    return result;
  }
  double number(const std::string& name) const { return numbers(name, 1)[0]; }
  std::optional<double> optional_number(const std::string& name) const {
    return attribute(name) ? std::optional<double>(number(name)) : std::nullopt;
  }
  Vector3 vector3(const std::string& name) const {
    const auto values = numbers(name, 3);
    return {values[0], values[1], values[2]};
  }
};

Pose read_origin(const Element& element) {
  Placement placement;
  if (const auto origin = element.find("origin")) {
    if (origin->attribute("xyz")) placement.position = origin->vector3("xyz");
    if (origin->attribute("rpy")) placement.rpy = origin->vector3("rpy");
  }
  return placement.pose();
}

RigidBody read_inertial(const Element& link) {
  const auto inertial = link.find("inertial");
  if (!inertial) return {};
  const auto mass = inertial->find("mass");
  const auto inertia = inertial->find("inertia");
  if (!mass || !inertia) refuse(inertial->where, "expected <mass> and <inertia>");
  RigidBody body;
  body.mass = mass->number("value");
  if (body.mass < 0) refuse(mass->where, "expected a mass of at least 0");
  const auto part = [&](const char* name) { return inertia->number(name); };
  body.inertia << part("ixx"), part("ixy"), part("ixz"), part("ixy"), part("iyy"), part("iyz"), part("ixz"),
      part("iyz"), part("izz");
  return moved(body, read_origin(*inertial));
}

UrdfGeometry read_collision(const Element& collision) {
  UrdfGeometry result;
  result.X_LG = read_origin(collision);
  const auto geometry = collision.find("geometry");
  if (!geometry) refuse(collision.where, "expected <geometry>");
  for (const auto& [name, xml] : *geometry->xml) {
    if (name == "<xmlattr>") continue;
    const Element shape{&xml, geometry->where + ": <" + name + ">"};
    if (name == "box") {
      result.kind = UrdfGeometry::Kind::box;
      result.size = shape.vector3("size").cwiseAbs();
    } else if (name == "cylinder" || name == "sphere") {
      result.kind = name == "sphere" ? UrdfGeometry::Kind::sphere : UrdfGeometry::Kind::cylinder;
      result.radius = std::abs(shape.number("radius"));
      if (name == "cylinder") result.length = std::abs(shape.number("length"));
    } else if (name == "mesh") {
      result.kind = UrdfGeometry::Kind::mesh;
      result.file = shape.text("filename");
      if (shape.attribute("scale")) result.scale = shape.vector3("scale");
    } else {
      result.file = "the shape <" + name + "> is not known";
    }
    return result;
  }
  refuse(geometry->where, "expected a shape");
}

// An invalid shape matters only to users of that shape.
UrdfGeometry collision_or_reason(const Element& collision) {
  try {
    return read_collision(collision);
  } catch (const std::invalid_argument& error) {
    UrdfGeometry unknown;
    unknown.file = error.what();
    return unknown;
  }
}

UrdfJoint read_joint(const Element& element, const std::string& name) {
  static const std::vector<std::string> kTypes{"fixed",     "revolute", "continuous",
                                               "prismatic", "floating", "planar"};
  UrdfJoint joint;
  joint.name = name;
  joint.type = element.text("type");
  if (std::find(kTypes.begin(), kTypes.end(), joint.type) == kTypes.end()) {
    refuse(element.where,
           "unknown joint type '" + joint.type + "'" + name_hint(joint.type, kTypes, "there are none"));
  }
  const auto parent = element.find("parent"), child = element.find("child");
  if (!parent || !child) refuse(element.where, "expected <parent> and <child>");
  joint.parent = parent->text("link");
  joint.child = child->text("link");
  joint.X_PC = read_origin(element);
  if (const auto axis = element.find("axis")) joint.axis = axis->vector3("xyz");
  if (joint.axis.norm() < 1e-9) {
    if (joint.turns() || joint.slides())
      refuse(element.where, "expected an axis with a direction, found the zero vector");
    joint.axis = Vector3::UnitX();
  }
  joint.axis.normalize();
  if (const auto limit = element.find("limit")) {
    if (joint.type != "continuous") {
      joint.lower = limit->optional_number("lower");
      joint.upper = limit->optional_number("upper");
    }
    joint.velocity = limit->optional_number("velocity");
    joint.effort = limit->optional_number("effort");
  }
  if (const auto dynamics = element.find("dynamics")) {
    joint.damping = dynamics->optional_number("damping").value_or(0);
    joint.friction = dynamics->optional_number("friction").value_or(0);
  }
  if (const auto mimic = element.find("mimic")) {
    joint.mimic = UrdfMimic{mimic->text("joint"), mimic->optional_number("multiplier").value_or(1),
                            mimic->optional_number("offset").value_or(0)};
  }
  return joint;
}

// xacro replaces its own elements anywhere, and expressions in the attributes of links and joints.
void refuse_xacro(const Xml& element, const std::string& where, bool with_expressions) {
  const auto refuse_source = [](const std::string& place, const std::string& found) {
    refuse(place, "found " + found +
                      ", so this file is a source of xacro. Expand it first: xacro FILE > ROBOT.urdf");
  };
  for (const auto& [name, xml] : element) {
    if (name == "<xmlattr>") {
      for (const auto& [key, value] : xml) {
        const std::string& text = value.data();
        if (with_expressions && (text.find("${") != text.npos || text.find("$(") != text.npos))
          refuse_source(where, key + "=\"" + text + "\"");
      }
      continue;
    }
    const std::string tag = "<" + name + ">";
    if (name.starts_with("xacro:")) refuse_source(where, tag);
    refuse_xacro(xml, where.empty() ? tag : where + ": " + tag,
                 with_expressions || name == "link" || name == "joint");
  }
}

void check_tree(const UrdfTree& tree) {
  std::set<std::string> children;
  for (const auto& joint : tree.joints) {
    const std::string where = "joint '" + joint.name + "'";
    for (const auto& link : {joint.parent, joint.child}) {
      if (tree.links.count(link) == 0) refuse(where, "there is no link '" + link + "'");
    }
    if (!children.insert(joint.child).second) {
      refuse(where, "the link '" + joint.child + "' already has a parent; a URDF is a tree");
    }
    if (joint.mimic && tree.joint(joint.mimic->joint) == nullptr) {
      refuse(where, "it mimics the joint '" + joint.mimic->joint + "', which does not exist" +
                        name_hint(joint.mimic->joint, tree.joint_names(), "there are none"));
    }
  }
  for (const auto& [link, body] : tree.links) {
    std::size_t steps = 0;
    for (const UrdfJoint* j = tree.parent_joint(link); j != nullptr; j = tree.parent_joint(j->parent)) {
      if (++steps > tree.joints.size())
        refuse("link '" + link + "'", "it is its own ancestor; a URDF is a tree");
    }
  }
}

}  // namespace

Pose UrdfJoint::pose_at(double position) const {
  if (turns()) {
    return X_PC * Pose{Eigen::AngleAxisd(position, axis).toRotationMatrix(), Vector3::Zero()};
  }
  if (slides()) return X_PC * Pose{Matrix3::Identity(), position * axis};
  return X_PC;
}

std::vector<std::string> UrdfTree::link_names() const {
  std::vector<std::string> names;
  for (const auto& link : links) names.push_back(link.first);
  return names;
}

std::vector<std::string> UrdfTree::joint_names() const {
  std::vector<std::string> names;
  for (const auto& joint : joints) names.push_back(joint.name);
  return names;
}

const UrdfJoint* UrdfTree::joint(const std::string& joint_name) const {
  for (const auto& joint : joints) {
    if (joint.name == joint_name) return &joint;
  }
  return nullptr;
}

const UrdfJoint* UrdfTree::parent_joint(const std::string& link) const {
  for (const auto& joint : joints) {
    if (joint.child == link) return &joint;
  }
  return nullptr;
}

std::vector<const UrdfJoint*> UrdfTree::child_joints(const std::string& link) const {
  std::vector<const UrdfJoint*> found;
  for (const auto& joint : joints) {
    if (joint.parent == link) found.push_back(&joint);
  }
  return found;
}

UrdfTree parse_urdf(const std::string& text) {
  Xml document;
  try {
    std::istringstream stream(text);
    namespace parser = boost::property_tree::xml_parser;
    boost::property_tree::read_xml(stream, document, parser::no_comments | parser::trim_whitespace);
  } catch (const boost::property_tree::xml_parser_error& error) {
    refuse("", "line " + std::to_string(error.line()) + " is not XML: " + error.message());
  }
  const auto root = document.get_child_optional("robot");
  if (!root) refuse("", "expected the root element <robot>");
  refuse_xacro(*root, "", false);
  UrdfTree tree;
  tree.name = Element{&*root, "<robot>"}.text("name");
  for (const auto& [kind, xml] : *root) {
    if (kind != "link" && kind != "joint") continue;
    // Joints of a ros2_control tag are one level deeper; these are those of the robot.
    const std::string name = Element{&xml, "<" + kind + ">"}.text("name");
    const Element element{&xml, kind + " '" + name + "'"};
    if (kind == "link") {
      if (!tree.links.emplace(name, read_inertial(element)).second)
        refuse(element.where, "duplicate name; remove one");
      for (const auto& [part, inner] : xml) {
        if (part == "collision")
          tree.collisions[name].push_back(collision_or_reason({&inner, element.where + ": <collision>"}));
      }
    } else {
      if (tree.joint(name) != nullptr) refuse(element.where, "duplicate name; remove one");
      tree.joints.push_back(read_joint(element, name));
    }
  }
  if (tree.links.empty()) refuse("", "expected at least one link");
  check_tree(tree);
  return tree;
}

}  // namespace multipanda
