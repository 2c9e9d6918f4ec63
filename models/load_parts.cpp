#include "models/load_parts.hpp"

#include <algorithm>
#include <fstream>
#include <iterator>

#include "common/text.hpp"

// Sections of a model file that describe an individual arm, from identification (docs/models.md).
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

std::string text_of(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
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

void visit_inertia(Archive& archive, Matrix3& I, bool complete, bool physical) {
  archive.about("Inertia", "A symmetric matrix; each principal moment is at most the sum of the other two.");
  const auto entry = [&](const char* name, double& value, bool diagonal) {
    Key key(name, "Entry of the inertia matrix.");
    key.in("kg m^2").within(diagonal && physical ? 0 : -100, 100);
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

void visit(Archive& archive, RigidBody& body) { visit_body(archive, body, true); }

void visit_body(Archive& archive, RigidBody& body, bool physical) {
  archive(Key("mass_kg").above(0).required(), body.mass);
  archive(Key("com_m").required(), body.com);
  archive.part(Key("inertia_kg_m2").required(),
               [&](Archive& inner) { visit_inertia(inner, body.inertia, true, physical); });
  if (archive.reading() && physical && !is_physical(body)) {
    archive.at("inertia_kg_m2")
        .refuse(
            "inertia is not physically consistent (tr(I)/2 * 1 - I must be positive definite); it is about "
            "the center of mass, with signs xy = -integral of x y dm");
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
  shape.color = "white";
  archive(Key("color").one_of(color_names()), shape.color);
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

void visit(Archive& archive, JointFriction& friction, const std::size_t& n) {
  archive(Key("p1_nm").at_least(0).joints(n).required(), friction.p1);
  archive(Key("p2_s_per_rad").at_least(0).joints(n).required(), friction.p2);
  archive(Key("p3_rad_per_s").joints(n).required(), friction.p3);
}

void visit(Archive& archive, PreslidingElement& element, const std::size_t& n) {
  archive(Key("distance_rad").above(0).required(), element.distance);
  archive(Key("amplitude_nm").at_least(0).joints(n).required(), element.amplitude);
}

void visit(Archive& archive, FrictionLaw& law, const std::size_t& n) {
  archive(Key("offset_nm").joints(n), law.offset);
  archive(Key("viscous_nm_s_per_rad").at_least(0).joints(n), law.viscous);
  archive(Key("stribeck_nm").at_least(0).joints(n), law.stribeck);
  archive.list(Key("presliding"), law.presliding, n);
  archive.section(Key("sigmoid"), law.sigmoid, n);
}

void visit(Archive& archive, TorqueSensor& sensor, const std::size_t& n) {
  archive(Key("gain").above(0).joints(n), sensor.gain);
  archive(Key("offset_nm").joints(n), sensor.offset);
  archive(Key("noise_nm").at_least(0), sensor.noise);
}

void visit(Archive& archive, IdentifiedRange& range, const std::size_t& n) {
  archive(Key("lower_rad").any_turn().joints(n).required(), range.q_min);
  archive(Key("upper_rad").any_turn().joints(n).required(), range.q_max);
  archive(Key("velocity_rad_per_s").at_least(0).joints(n).required(), range.dq_max);
  archive(Key("expected_rmse_nm").at_least(0).joints(n), range.rmse);
}

void visit(Archive& archive, Actuation& actuation) {
  archive(Key("torque_bandwidth_hz").at_least(0), actuation.torque_bandwidth_hz);
  archive(Key("command_delay_s").at_least(0), actuation.command_delay);
  constexpr double kLongest = 1.0;  // [s]
  if (actuation.command_delay > kLongest) {
    archive.at("command_delay_s").expected("at most 1 s (a larger number looks like milliseconds)");
  }
}

std::optional<RobotDescription> KnownRobots::find(const std::filesystem::path& file) {
  const std::scoped_lock lock(mutex_);
  const auto found = known_.find(file);
  if (found == known_.end()) return std::nullopt;
  for (const auto& [path, text] : found->second.texts) {
    if (text_of(path) != text) return std::nullopt;
  }
  return found->second.robot;
}

void KnownRobots::keep(const std::filesystem::path& file, const std::vector<std::filesystem::path>& files,
                       const RobotDescription& robot) {
  Entry entry{.robot = robot, .texts = {}};
  for (const auto& path : files) entry.texts.emplace_back(path, text_of(path));
  const std::scoped_lock lock(mutex_);
  known_.insert_or_assign(file, std::move(entry));
}

KnownRobots& known_robots() {
  static KnownRobots robots;
  return robots;
}

}  // namespace multipanda
