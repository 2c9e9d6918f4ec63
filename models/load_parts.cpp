#include "models/load_parts.hpp"

#include <algorithm>

#include "support/spelling.hpp"

namespace multipanda {
namespace {

std::vector<std::string> color_names() {
  std::vector<std::string> names;
  for (const auto& color : shape_colors()) names.push_back(color.first);
  return names;
}

void visit_capsule_lists(Archive& archive, const std::vector<std::string>& links, std::vector<Capsule>& all) {
  for (const auto& link : links) {
    std::vector<Capsule> capsules;
    archive.list(Key(link).each("capsule"), capsules);
    for (auto& capsule : on_link(std::move(capsules), link)) all.push_back(std::move(capsule));
  }
}

}  // namespace

JointVector read_joint_vector(const Node& node, Key key, std::size_t n) {
  const auto values = node.numbers(key.joints(n));
  return Eigen::Map<const Eigen::VectorXd>(values.data(), std::ssize(values));
}

void visit(Archive& archive, Placement& placement) {
  archive(Key("position_m").required(), placement.position);
  archive(Key("rpy_rad").any_turn(), placement.rpy);
}

void visit_inertia(Archive& archive, Matrix3& I, bool complete) {
  archive.about("Inertia", "A symmetric matrix; each principal moment is at most the sum of the other two.");
  const auto entry = [&](const char* name, double& value, bool diagonal) {
    Key key(name, "Entry of the inertia matrix.");
    key.in("kg m^2").within(diagonal ? 0 : -100, 100);
    archive(diagonal || complete ? key.required() : key, value);
  };
  entry("xx", I(0, 0), true);
  entry("yy", I(1, 1), true);
  entry("zz", I(2, 2), true);
  entry("xy", I(0, 1), false);
  entry("xz", I(0, 2), false);
  entry("yz", I(1, 2), false);
  I(1, 0) = I(0, 1);
  I(2, 0) = I(0, 2);
  I(2, 1) = I(1, 2);
}

void visit(Archive& archive, RigidBody& body) {
  archive(Key("mass_kg").above(0).required(), body.mass);
  archive(Key("com_m").required(), body.com);
  archive.part(Key("inertia_kg_m2").required(),
               [&](Archive& inner) { visit_inertia(inner, body.inertia, true); });
  if (archive.reading() && !is_physical(body)) {
    archive.at("inertia_kg_m2")
        .refuse(
            "inertia is not physically consistent (tr(I)/2 * 1 - I must be positive definite); it is about "
            "the "
            "center of mass, with signs xy = -integral of x y dm");
  }
}

std::vector<std::string> numbered(const char* stem, std::size_t first, std::size_t last) {
  std::vector<std::string> names;
  for (std::size_t i = first; i <= last; ++i) names.push_back(stem + std::to_string(i));
  return names;
}

void visit(Archive& archive, Capsule& capsule) {
  Vector3 center = Vector3::Zero(), axis = Vector3::Zero();
  double length = 0;
  archive(Key("center_m").required(), center);
  archive(Key("axis").required(), axis);
  archive(Key("length_m").above(0).required(), length);
  archive(Key("radius_m").above(0).required(), capsule.radius);
  if (!archive.reading()) return;
  if (axis.norm() < 1e-6) archive.at("axis").refuse("expected a direction, found the zero vector");
  const Vector3 half = 0.5 * length * axis.normalized();
  capsule.from = center - half;
  capsule.to = center + half;
}

void read_self_collision(const Node& node, RobotDescription& robot) {
  const auto links = numbered("link", 0, robot.joint_count());
  auto names = links;
  names.emplace_back("hand");
  Archive::read(node, [&](Archive& archive) {
    archive.part(Key("capsules").required(),
                 [&](Archive& inner) { visit_capsule_lists(inner, links, robot.capsules); });
    const auto pairs = archive.open(Key("ignored_pairs").required());
    if (!pairs) return;
    if (!pairs->is_list()) pairs->expected("a list of pairs of links");
    for (const auto& pair : pairs->items()) {
      Key link("link");
      link.kind = Key::Kind::choice;
      link.one_of(names);
      const auto ends = pair.items();
      if (!pair.is_list() || ends.size() != 2) pair.expected("two names of links");
      robot.ignored_pairs.emplace_back(ends[0].text(link), ends[1].text(link));
    }
  });
}

void visit(Archive& archive, Shape& shape) {
  static const std::vector<std::string> kKinds{"capsule", "cylinder", "sphere", "box"};
  archive(Key("shape").one_of(kKinds).required(), shape.kind);
  std::vector<std::string> colors = color_names();
  colors.emplace_back("grey");  // until the next release; phrases: quoted
  shape.color = "white";
  archive(Key("color").one_of(colors), shape.color);
  if (shape.color == "grey") shape.color = "gray";  // phrases: quoted
  archive(Key("center_m").no_default(), shape.center.position);
  archive(Key("rpy_rad").any_turn().no_default(), shape.center.rpy);
  archive(Key("size_m").above(0).no_default(), shape.size);
  archive(Key("radius_m").above(0).no_default(), shape.radius);
  archive(Key("from_m").no_default(), shape.from);
  archive(Key("to_m").no_default(), shape.to);
  if (!archive.reading()) return;
  const bool box = shape.kind == ShapeKind::box, sphere = shape.kind == ShapeKind::sphere;
  const std::vector<std::string> required = box      ? std::vector<std::string>{"center_m", "size_m"}
                                            : sphere ? std::vector<std::string>{"center_m", "radius_m"}
                                                     : std::vector<std::string>{"from_m", "to_m", "radius_m"};
  for (const auto& key : archive.present({"center_m", "rpy_rad", "size_m", "radius_m", "from_m", "to_m"})) {
    const bool valid = std::find(required.begin(), required.end(), key) != required.end();
    if (!valid && !(box && key == "rpy_rad"))
      archive.at(key).refuse("a " + kKinds[static_cast<std::size_t>(shape.kind)] + " has no '" + key +
                             "'; expected " + joined(required));
  }
  for (const auto& key : required) {
    if (!archive.has(key))
      archive.self().refuse("a " + kKinds[static_cast<std::size_t>(shape.kind)] + " needs '" + key + "'");
  }
  if (!box && !sphere && (shape.to - shape.from).norm() < 1e-6)
    archive.self().refuse("from_m and to_m are the same point");
}

void visit(Archive& archive, HandDescription& hand) {
  archive.section(Key("mount").required(), hand.mount);
  archive.section(Key("tcp").required(), hand.tcp);
  archive.section(Key("body").required(), hand.body);
  archive.part(Key("finger").required(), [&](Archive& finger) {
    finger.section(Key("mount").required(), hand.finger_mount);
    finger.section(Key("body").required(), hand.finger);
    finger(Key("travel_m").above(0).required(), hand.finger_travel);
    finger(Key("velocity_m_per_s").above(0).required(), hand.finger_velocity);
    finger(Key("effort_n").above(0).required(), hand.finger_effort);
    finger.list(Key("boxes").each("box").required(), hand.finger_boxes);
    finger.list(Key("visuals").each("shape").required(), hand.finger_visuals);
    for (const auto& box : hand.finger_boxes) {
      if (box.kind != ShapeKind::box) finger.at("boxes").refuse("expected boxes only");
    }
  });
  archive.list(Key("palm_capsules").each("capsule").required(), hand.palm_capsules);
  archive.list(Key("finger_capsules").each("capsule").required(), hand.finger_capsules);
  archive.list(Key("visuals").each("shape").required(), hand.visuals);
  if (!archive.reading()) return;
  hand.palm_capsules = on_link(std::move(hand.palm_capsules), "hand");
  hand.finger_capsules = on_link(std::move(hand.finger_capsules), "hand");
  hand.finger_boxes = on_link(std::move(hand.finger_boxes), "finger");
  hand.visuals = on_link(std::move(hand.visuals), "hand");
  hand.finger_visuals = on_link(std::move(hand.finger_visuals), "finger");
}

}  // namespace multipanda
