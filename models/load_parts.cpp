#include "models/load_parts.hpp"

#include <algorithm>

namespace multipanda {

JointVector joint_vector(const CheckedYaml& yaml, std::size_t n) {
  const auto values = yaml.numbers(n);
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(n));
}

JointVector positive_joint_vector(const CheckedYaml& yaml, std::size_t n) {
  for (const auto& item : yaml.items()) (void)item.positive();
  return joint_vector(yaml, n);
}

Placement read_placement(const CheckedYaml& yaml) {
  yaml.allow_keys({"position_m", "rpy_rad"});
  Placement placement;
  placement.position = yaml.at("position_m").vector3();
  if (const auto rpy = yaml.find("rpy_rad")) placement.rpy = rpy->angles3();
  return placement;
}

RigidBody read_body(const CheckedYaml& yaml) {
  yaml.allow_keys({"mass_kg", "com_m", "inertia_kg_m2"});
  RigidBody body;
  body.mass = yaml.at("mass_kg").positive();
  body.com = yaml.at("com_m").vector3();
  const CheckedYaml inertia = yaml.at("inertia_kg_m2");
  inertia.allow_keys({"xx", "yy", "zz", "xy", "xz", "yz"});
  const auto part = [&](const char* key) { return inertia.at(key).number(); };
  body.inertia << part("xx"), part("xy"), part("xz"), part("xy"), part("yy"), part("yz"), part("xz"),
      part("yz"), part("zz");
  if (!is_physical(body)) {
    inertia.refuse(
        "no body of positive mass has this inertia (tr(I)/2 * 1 - I must be positive definite); the inertia "
        "is "
        "about the centre of mass, with signs xy = -integral of x y dm");
  }
  return body;
}

std::vector<std::string> numbered(const char* stem, std::size_t first, std::size_t last) {
  std::vector<std::string> names;
  for (std::size_t i = first; i <= last; ++i) names.push_back(stem + std::to_string(i));
  return names;
}

std::vector<Capsule> read_capsules(const CheckedYaml& yaml, const std::string& link) {
  std::vector<Capsule> capsules;
  for (const auto& item : yaml.items()) {
    item.allow_keys({"center_m", "axis", "length_m", "radius_m"});
    const Vector3 axis = item.at("axis").vector3();
    if (axis.norm() < 1e-6) item.at("axis").refuse("expected a direction, found the zero vector");
    const Vector3 half = 0.5 * item.at("length_m").positive() * axis.normalized();
    const Vector3 center = item.at("center_m").vector3();
    capsules.push_back({link, center - half, center + half, item.at("radius_m").positive()});
  }
  return capsules;
}

void read_self_collision(const CheckedYaml& yaml, RobotDescription& robot) {
  yaml.allow_keys({"capsules", "ignored_pairs"});
  const auto links = numbered("link", 0, robot.joint_count());
  const CheckedYaml capsules = yaml.at("capsules");
  capsules.allow_keys(links);
  for (const auto& link : capsules.keys()) {
    for (auto& capsule : read_capsules(capsules.at(link), link)) robot.capsules.push_back(std::move(capsule));
  }
  auto names = links;
  names.emplace_back("hand");
  for (const auto& pair : yaml.at("ignored_pairs").items()) {
    const auto ends = pair.items();
    if (ends.size() != 2) pair.refuse("expected two names of links");
    robot.ignored_pairs.emplace_back(ends[0].one_of(names, "a link"), ends[1].one_of(names, "a link"));
  }
}

std::vector<Shape> read_shapes(const CheckedYaml& yaml, const std::string& link) {
  static const std::vector<std::string> kKinds{"capsule", "cylinder", "sphere", "box"};
  std::vector<std::string> colors;
  for (const auto& color : shape_colors()) colors.push_back(color.first);
  std::vector<Shape> shapes;
  for (const auto& item : yaml.items()) {
    Shape shape;
    shape.link = link;
    const std::string kind = item.at("shape").one_of(kKinds, "a shape");
    shape.kind = static_cast<ShapeKind>(std::find(kKinds.begin(), kKinds.end(), kind) - kKinds.begin());
    if (shape.kind == ShapeKind::box) {
      item.allow_keys({"shape", "color", "center_m", "rpy_rad", "size_m"});
      shape.size = item.at("size_m").vector3();
      if (shape.size.minCoeff() <= 0) item.at("size_m").refuse("expected three lengths above 0");
    } else {
      item.allow_keys(shape.kind == ShapeKind::sphere
                          ? std::vector<std::string>{"shape", "color", "center_m", "radius_m"}
                          : std::vector<std::string>{"shape", "color", "from_m", "to_m", "radius_m"});
      shape.radius = item.at("radius_m").positive();
    }
    if (shape.kind == ShapeKind::box || shape.kind == ShapeKind::sphere) {
      shape.center.position = item.at("center_m").vector3();
      if (const auto rpy = item.find("rpy_rad")) shape.center.rpy = rpy->angles3();
    } else {
      shape.from = item.at("from_m").vector3();
      shape.to = item.at("to_m").vector3();
      if ((shape.to - shape.from).norm() < 1e-6) item.refuse("from_m and to_m are the same point");
    }
    const auto color = item.find("color");
    shape.color = color ? color->one_of(colors, "a colour") : "white";
    shapes.push_back(shape);
  }
  return shapes;
}

HandDescription read_hand(const CheckedYaml& yaml) {
  yaml.allow_keys({"mount", "tcp", "body", "finger", "palm_capsules", "finger_capsules", "visuals"});
  HandDescription hand;
  hand.mount = read_placement(yaml.at("mount"));
  hand.tcp = read_placement(yaml.at("tcp"));
  hand.body = read_body(yaml.at("body"));
  const CheckedYaml finger = yaml.at("finger");
  finger.allow_keys({"mount", "body", "travel_m", "velocity_m_per_s", "effort_n", "boxes", "visuals"});
  hand.finger_mount = read_placement(finger.at("mount"));
  hand.finger = read_body(finger.at("body"));
  hand.finger_travel = finger.at("travel_m").positive();
  hand.finger_velocity = finger.at("velocity_m_per_s").positive();
  hand.finger_effort = finger.at("effort_n").positive();
  hand.finger_boxes = read_shapes(finger.at("boxes"), "finger");
  for (const auto& box : hand.finger_boxes) {
    if (box.kind != ShapeKind::box) finger.at("boxes").refuse("expected boxes only");
  }
  hand.palm_capsules = read_capsules(yaml.at("palm_capsules"), "hand");
  hand.finger_capsules = read_capsules(yaml.at("finger_capsules"), "hand");
  hand.visuals = read_shapes(yaml.at("visuals"), "hand");
  hand.finger_visuals = read_shapes(finger.at("visuals"), "finger");
  return hand;
}

}  // namespace multipanda
