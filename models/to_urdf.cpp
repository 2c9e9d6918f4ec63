#include <algorithm>
#include <limits>
#include <stdexcept>

#include "models/robot_description.hpp"
#include "models/write_robot.hpp"
#include "models/xml_text.hpp"

namespace multipanda {
namespace {

void write_origin(XmlText& xml, const Vector3& position, const Vector3& rpy) {
  xml.leaf("origin", {{"xyz", exact(position)}, {"rpy", exact(rpy)}});
}

void write_inertial(XmlText& xml, const RigidBody& body) {
  xml.open("inertial");
  write_origin(xml, body.com, Vector3::Zero());
  xml.leaf("mass", {{"value", exact(body.mass)}});
  xml.leaf("inertia", {{"ixx", exact(body.inertia(0, 0))},
                       {"ixy", exact(body.inertia(0, 1))},
                       {"ixz", exact(body.inertia(0, 2))},
                       {"iyy", exact(body.inertia(1, 1))},
                       {"iyz", exact(body.inertia(1, 2))},
                       {"izz", exact(body.inertia(2, 2))}});
  xml.close();
}

enum class Ends { both, from, to };  // of a capsule, which are round

// `element` is "visual" or "collision". URDF has no capsule: a cylinder and a sphere at its round ends.
void write_shape(XmlText& xml, const char* element, const Shape& shape, Ends round = Ends::both) {
  const auto write = [&](const Vector3& position, const Vector3& rpy, const char* geometry,
                         const XmlText::Attributes& size) {
    xml.open(element);
    write_origin(xml, position, rpy);
    xml.open("geometry");
    xml.leaf(geometry, size);
    xml.close();
    if (!shape.color.empty()) xml.leaf("material", {{"name", shape.color}});
    xml.close();
  };
  const Pose pose = shape_pose(shape);
  const Vector3 rpy = rpy_of(pose.rotation);
  switch (shape.kind) {
    case ShapeKind::box:
      write(pose.position, rpy, "box", {{"size", exact(shape.size)}});
      break;
    case ShapeKind::sphere:
      write(pose.position, Vector3::Zero(), "sphere", {{"radius", exact(shape.radius)}});
      break;
    case ShapeKind::capsule:
      if (round != Ends::to) write(shape.from, Vector3::Zero(), "sphere", {{"radius", exact(shape.radius)}});
      if (round != Ends::from) write(shape.to, Vector3::Zero(), "sphere", {{"radius", exact(shape.radius)}});
      [[fallthrough]];
    case ShapeKind::cylinder:
      write(pose.position, rpy, "cylinder",
            {{"radius", exact(shape.radius)}, {"length", exact((shape.to - shape.from).norm())}});
      break;
  }
}

// A capsule of a URDF, or the part of one that has an end cut off.
struct Collision {
  Capsule capsule;
  Ends round = Ends::both;
};

// MuJoCo lets link1 collide with link0, which it treats as a part of the world, and Franka's capsules of the
// two overlap: 20 N m would not turn joint 1. The part of link1 on the axis of joint 1 does not move when the
// joint turns. So its part next to the base belongs to link0 here, and the arm fills the same space except
// for a slit of 1 mm.
std::vector<Collision> collisions_of(const RobotDescription& robot) {
  const Pose X_01 = robot.joints.front().pose(), X_10 = X_01.inverse();
  double top = -std::numeric_limits<double>::infinity();  // of the base, along the axis
  for (const auto& capsule : robot.capsules) {
    if (capsule.link != "link0") continue;
    top =
        std::max({top, (X_10 * capsule.from).z() + capsule.radius, (X_10 * capsule.to).z() + capsule.radius});
  }
  const Vector3 cut(0, 0, top), slit(0, 0, 1e-3);
  std::vector<Collision> all;
  for (Capsule capsule : robot.capsules) {
    const bool turns_in_place = capsule.link == "link1" && !robot.is_prismatic(0) &&
                                capsule.from.head<2>().isZero() && capsule.to.head<2>().isZero();
    if (turns_in_place && capsule.from.z() > capsule.to.z()) std::swap(capsule.from, capsule.to);
    if (turns_in_place && capsule.from.z() < top && top < capsule.to.z() - slit.z()) {
      all.push_back({{"link0", X_01 * capsule.from, X_01 * cut, capsule.radius}, Ends::from});
      all.push_back({{"link1", cut + slit, capsule.to, capsule.radius}, Ends::to});
    } else {
      all.push_back({capsule});
    }
  }
  return all;
}

// `link` as named in the shapes, without prefix; empty: all visuals.
void write_geometry(XmlText& xml, const std::vector<Shape>& visuals, const std::vector<Collision>& collisions,
                    const std::string& link) {
  for (const auto& shape : visuals) {
    if (link.empty() || shape.link == link) write_shape(xml, "visual", shape);
  }
  for (const auto& [capsule, round] : collisions) {
    if (capsule.link != link) continue;
    Shape shape;
    shape.kind = ShapeKind::capsule;
    shape.from = capsule.from;
    shape.to = capsule.to;
    shape.radius = capsule.radius;
    write_shape(xml, "collision", shape, round);
  }
}

void write_fixed(XmlText& xml, const std::string& name, const std::string& parent, const std::string& child,
                 const Placement& placement) {
  xml.open("joint", {{"name", name}, {"type", "fixed"}});
  write_origin(xml, placement.position, placement.rpy);
  xml.leaf("parent", {{"link", parent}});
  xml.leaf("child", {{"link", child}});
  xml.close();
}

// A finger that slides along y of its own frame.
void write_finger(XmlText& xml, const HandDescription& hand, const UrdfOptions& options, bool left) {
  const std::string& prefix = options.prefix;
  const std::string link = prefix + (left ? "leftfinger" : "rightfinger");
  const Pose half_turn{Vector3(-1, -1, 1).asDiagonal(), Vector3::Zero()};
  const Pose X_HL = left ? hand.finger_mount.pose() : half_turn * hand.finger_mount.pose();
  xml.open("joint", {{"name", prefix + (left ? "finger_joint1" : "finger_joint2")}, {"type", "prismatic"}});
  write_origin(xml, X_HL.position, rpy_of(X_HL.rotation));
  xml.leaf("parent", {{"link", prefix + "hand"}});
  xml.leaf("child", {{"link", link}});
  xml.leaf("axis", {{"xyz", "0 1 0"}});
  xml.leaf("limit", {{"lower", "0"},
                     {"upper", exact(hand.finger_travel)},
                     {"velocity", exact(hand.finger_velocity)},
                     {"effort", exact(hand.finger_effort)}});
  if (!left) xml.leaf("mimic", {{"joint", prefix + "finger_joint1"}});
  xml.close();
  xml.open("link", {{"name", link}});
  write_inertial(xml, hand.finger);
  if (options.geometry) write_geometry(xml, hand.finger_visuals, {}, "");
  xml.close();
}

void write_hand(XmlText& xml, const HandDescription& hand, const UrdfOptions& options) {
  const std::string& prefix = options.prefix;
  write_fixed(xml, prefix + "hand_joint", prefix + options.flange, prefix + "hand", hand.mount);
  xml.open("link", {{"name", prefix + "hand"}});
  write_inertial(xml, options.fingers ? hand.body : rigid_hand(hand));
  if (options.geometry) {
    std::vector<Collision> capsules;
    for (const auto& palm : hand.palm_capsules) capsules.push_back({palm});
    for (const auto& fingers : hand.finger_capsules) capsules.push_back({fingers});  // in any opening
    write_geometry(xml, options.fingers ? hand.visuals : closed_hand_visuals(hand), capsules, "hand");
  }
  xml.close();
  write_fixed(xml, prefix + "hand_tcp_joint", prefix + "hand", prefix + "hand_tcp", hand.tcp);
  xml.leaf("link", {{"name", prefix + "hand_tcp"}});
  if (!options.fingers) return;
  for (const bool left : {true, false}) write_finger(xml, hand, options, left);
}

void write_joint(XmlText& xml, const RobotDescription& robot, const std::string& prefix, std::size_t i) {
  const auto j = static_cast<Eigen::Index>(i - 1);
  const Placement& placement = robot.joints[i - 1];
  xml.open("joint", {{"name", prefix + "joint" + std::to_string(i)},
                     {"type", robot.is_prismatic(i - 1) ? "prismatic" : "revolute"}});
  write_origin(xml, placement.position, placement.rpy);
  xml.leaf("parent", {{"link", prefix + "link" + std::to_string(i - 1)}});
  xml.leaf("child", {{"link", prefix + "link" + std::to_string(i)}});
  xml.leaf("axis", {{"xyz", "0 0 1"}});
  xml.leaf("limit", {{"lower", exact(robot.limits.q_min[j])},
                     {"upper", exact(robot.limits.q_max[j])},
                     {"velocity", exact(robot.limits.dq_max[j])},
                     {"effort", exact(robot.limits.tau_max[j])}});
  xml.close();
}

void write_arm(XmlText& xml, const RobotDescription& robot, const UrdfOptions& options) {
  if (options.hand && !robot.hand) throw std::invalid_argument("robot '" + robot.name + "' has no hand");
  const std::string& prefix = options.prefix;
  const auto visuals = link_visuals(robot);
  const auto collisions = collisions_of(robot);
  for (std::size_t i = 0; i <= robot.joint_count(); ++i) {
    const std::string link = "link" + std::to_string(i);
    if (i > 0) write_joint(xml, robot, prefix, i);
    xml.open("link", {{"name", prefix + link}});
    write_inertial(xml, robot.links[i]);
    if (options.geometry) write_geometry(xml, visuals, collisions, link);
    xml.close();
  }
  write_fixed(xml, prefix + options.flange + "_joint", prefix + "link" + std::to_string(robot.joint_count()),
              prefix + options.flange, robot.flange);
  xml.leaf("link", {{"name", prefix + options.flange}});
  if (options.hand) write_hand(xml, *robot.hand, options);
}

void write_colors(XmlText& xml) {
  for (const auto& [name, rgb] : shape_colors()) {
    xml.open("material", {{"name", name}});
    xml.leaf("color", {{"rgba", exact(rgb) + " 1"}});
    xml.close();
  }
}

}  // namespace

std::string to_urdf(const RobotDescription& robot, const UrdfOptions& options) {
  XmlText xml;
  xml.comment(robot.title + ". Written from " + robot.file.filename().string() +
              "; see there for the sources of the values.");
  xml.open("robot", {{"name", robot.name}});
  if (options.geometry) write_colors(xml);
  write_arm(xml, robot, options);
  xml.close();
  return "<?xml version=\"1.0\"?>\n" + xml.text();
}

std::string to_urdf(const std::string& name, const std::vector<PlacedRobot>& arms) {
  XmlText xml;
  xml.open("robot", {{"name", name}});
  write_colors(xml);
  xml.leaf("link", {{"name", "world"}});
  for (const auto& arm : arms) {
    const std::string& prefix = arm.options.prefix;
    write_fixed(xml, prefix + "base_joint", "world", prefix + "link0",
                {arm.X_WB.position, rpy_of(arm.X_WB.rotation)});
    write_arm(xml, arm.robot, arm.options);
  }
  xml.close();
  return "<?xml version=\"1.0\"?>\n" + xml.text();
}

}  // namespace multipanda
