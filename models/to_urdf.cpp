#include "models/to_urdf.hpp"

#include <stdexcept>

#include "models/looks.hpp"
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

// `element` is "visual" or "collision". URDF has no capsule: a cylinder and a sphere at each end.
void write_shape(XmlText& xml, const char* element, const Shape& shape) {
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
      write(shape.from, Vector3::Zero(), "sphere", {{"radius", exact(shape.radius)}});
      write(shape.to, Vector3::Zero(), "sphere", {{"radius", exact(shape.radius)}});
      [[fallthrough]];
    case ShapeKind::cylinder:
      write(pose.position, rpy, "cylinder",
            {{"radius", exact(shape.radius)}, {"length", exact((shape.to - shape.from).norm())}});
      break;
  }
}

void write_geometry(XmlText& xml, const std::vector<Shape>& visuals, const std::vector<Capsule>& capsules,
                    const std::string& link) {
  for (const auto& shape : visuals) {
    if (shape.link == link) write_shape(xml, "visual", shape);
  }
  for (const auto& capsule : capsules) {
    if (capsule.link != link) continue;
    Shape shape;
    shape.kind = ShapeKind::capsule;
    shape.from = capsule.from;
    shape.to = capsule.to;
    shape.radius = capsule.radius;
    write_shape(xml, "collision", shape);
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

void write_hand(XmlText& xml, const HandDescription& hand, bool geometry) {
  write_fixed(xml, "hand_joint", "flange", "hand", hand.mount);
  xml.open("link", {{"name", "hand"}});
  write_inertial(xml, rigid_hand(hand));
  if (geometry) {
    auto capsules = hand.palm_capsules;
    capsules.insert(capsules.end(), hand.finger_capsules.begin(), hand.finger_capsules.end());
    write_geometry(xml, closed_hand_visuals(hand), capsules, "hand");
  }
  xml.close();
  write_fixed(xml, "hand_tcp_joint", "hand", "hand_tcp", hand.tcp);
  xml.leaf("link", {{"name", "hand_tcp"}});
}

}  // namespace

std::string to_urdf(const RobotDescription& robot, const UrdfOptions& options) {
  if (options.hand && !robot.hand) throw std::invalid_argument("robot '" + robot.name + "' has no hand");
  XmlText xml;
  xml.comment(robot.title + ". Written from " + robot.file.filename().string() +
              "; origin of the figures there.");
  xml.open("robot", {{"name", robot.name}});
  const auto visuals = link_visuals(robot);
  if (options.geometry) {
    for (const auto& [name, rgb] : shape_colors()) {
      xml.open("material", {{"name", name}});
      xml.leaf("color", {{"rgba", exact(rgb) + " 1"}});
      xml.close();
    }
  }
  for (std::size_t i = 0; i <= robot.joint_count(); ++i) {
    const std::string number = std::to_string(i);
    const std::string link = "link" + number;
    if (i > 0) {
      const auto j = static_cast<Eigen::Index>(i - 1);
      const Placement& placement = robot.joints[i - 1];
      xml.open("joint", {{"name", "joint" + number}, {"type", "revolute"}});
      write_origin(xml, placement.position, placement.rpy);
      xml.leaf("parent", {{"link", "link" + std::to_string(i - 1)}});
      xml.leaf("child", {{"link", link}});
      xml.leaf("axis", {{"xyz", "0 0 1"}});
      xml.leaf("limit", {{"lower", exact(robot.limits.q_min[j])},
                         {"upper", exact(robot.limits.q_max[j])},
                         {"velocity", exact(robot.limits.dq_max[j])},
                         {"effort", exact(robot.limits.tau_max[j])}});
      xml.close();
    }
    xml.open("link", {{"name", link}});
    write_inertial(xml, robot.links[i]);
    if (options.geometry) write_geometry(xml, visuals, robot.capsules, link);
    xml.close();
  }
  write_fixed(xml, "flange_joint", "link" + std::to_string(robot.joint_count()), "flange", robot.flange);
  xml.leaf("link", {{"name", "flange"}});
  if (options.hand) write_hand(xml, *robot.hand, options.geometry);
  xml.close();
  return "<?xml version=\"1.0\"?>\n" + xml.text();
}

}  // namespace multipanda
