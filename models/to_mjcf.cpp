#include <map>
#include <stdexcept>

#include "common/own_files.hpp"
#include "models/robot_description.hpp"
#include "models/write_robot.hpp"
#include "models/xml_text.hpp"

namespace multipanda {
namespace {

// Additional inertia of each finger due to its drive [kg]. There is no published value; this is that of a
// small geared motor, with which a closing finger stops at an object as softly as the real one.
constexpr double kFingerArmature = 0.2;

std::string rotation_of(const Placement& placement) { return exact(placement.pose().quaternion()); }

// Writes one arm: the text so far, and the common data of all parts.
class ArmWriter {
 public:
  ArmWriter(const RobotDescription& robot, const MjcfOptions& options)
      : robot_(robot), options_(options), motor_inertia_(acting_motor_inertia(robot, options.rotor_hidden)) {
    use_meshes_ = !options.meshes.empty() && !robot.meshes.empty();
  }

  std::string write() {
    xml_.comment(robot_.title + ". Written from " + robot_.file.filename().string() +
                 "; see there for the sources of the values.");
    xml_.open("mujoco", {{"model", robot_.name}});
    xml_.leaf("compiler", {{"angle", "radian"}, {"autolimits", "true"}, {"balanceinertia", "false"}});
    write_assets();
    xml_.open("worldbody");
    xml_.open("body", {{"name", named("link0")}});
    for (std::size_t i = 0; i <= robot_.joint_count(); ++i) write_link(i);
    xml_.leaf("site", {{"name", named("flange")},
                       {"pos", exact(robot_.flange.position)},
                       {"quat", rotation_of(robot_.flange)},
                       {"group", "4"},
                       {"size", "0.005"}});
    if (options_.hand) write_hand(*robot_.hand);
    for (std::size_t i = 0; i <= robot_.joint_count(); ++i) xml_.close();
    xml_.close();
    write_contacts();
    write_actuators();
    xml_.close();
    return xml_.text();
  }

 private:
  std::string named(const std::string& name) const { return options_.prefix + name; }
  bool movable() const { return options_.hand && options_.fingers == Fingers::movable; }

  void write_assets() {
    xml_.open("asset");
    for (const auto& [name, rgb] : shape_colors()) {
      xml_.leaf(
          "material",
          {{"name", named(name)}, {"rgba", exact(rgb) + " 1"}, {"specular", "0.4"}, {"shininess", "0.5"}});
    }
    if (use_meshes_) {
      for (const auto& [link, file] : robot_.meshes) {
        xml_.leaf("mesh", {{"name", named(link)}, {"file", (options_.meshes / file).string()}});
      }
    }
    xml_.close();
  }

  void write_inertial(const RigidBody& body) {
    const Matrix3& I = body.inertia;
    xml_.leaf("inertial", {{"mass", exact(body.mass)},
                           {"pos", exact(body.com)},
                           {"fullinertia",
                            exact(Vector3(I.diagonal())) + " " + exact(Vector3(I(0, 1), I(0, 2), I(1, 2)))}});
  }

  // Named link5, link5_2: other programs choose geoms by name.
  void write_capsule(const Capsule& capsule, const CollisionBits& bits) {
    const int number = ++capsules_[capsule.link];
    const std::string name = number == 1 ? capsule.link : capsule.link + "_" + std::to_string(number);
    write_collision({{"name", named(name)},
                     {"type", "capsule"},
                     {"fromto", exact(capsule.from) + " " + exact(capsule.to)},
                     {"size", exact(capsule.radius)}},
                    bits);
  }

  void write_collision(XmlText::Attributes attributes, const CollisionBits& bits) {
    attributes.insert(attributes.end(), {{"group", "3"},
                                         {"contype", std::to_string(bits.type)},
                                         {"conaffinity", std::to_string(bits.affinity)},
                                         {"rgba", "0.9 0.5 0.1 0.4"}});
    xml_.leaf("geom", attributes);
  }

  static XmlText::Attributes geometry(const Shape& shape) {
    switch (shape.kind) {
      case ShapeKind::box:
        return {{"type", "box"},
                {"pos", exact(shape.center.position)},
                {"quat", rotation_of(shape.center)},
                {"size", exact(Vector3(0.5 * shape.size))}};
      case ShapeKind::sphere:
        return {{"type", "sphere"}, {"pos", exact(shape.center.position)}, {"size", exact(shape.radius)}};
      case ShapeKind::capsule:
      case ShapeKind::cylinder:
        break;
    }
    return {{"type", shape.kind == ShapeKind::capsule ? "capsule" : "cylinder"},
            {"fromto", exact(shape.from) + " " + exact(shape.to)},
            {"size", exact(shape.radius)}};
  }

  void write_visible(XmlText::Attributes attributes, const std::string& material) {
    if (!options_.visuals) return;
    attributes.insert(
        attributes.end(),
        {{"material", named(material)}, {"group", "2"}, {"contype", "0"}, {"conaffinity", "0"}});
    xml_.leaf("geom", attributes);
  }

  void write_visuals(const std::vector<Shape>& shapes, const std::string& link) {
    if (use_meshes_ && robot_.meshes.count(link) > 0) {
      write_visible({{"type", "mesh"}, {"mesh", named(link)}}, "white");
      return;
    }
    for (const auto& shape : shapes) {
      if (shape.link == link) write_visible(geometry(shape), shape.color);
    }
  }

  double damping_of(Eigen::Index j) const {
    const bool known = options_.friction && robot_.link_friction && robot_.link_friction->viscous.size() > 0;
    return known ? robot_.link_friction->viscous[j] : 0.0;
  }

  double dry_friction_of(Eigen::Index j) const {
    if (!options_.friction || !robot_.link_friction) return 0;
    const FrictionLaw& law = *robot_.link_friction;
    double sum = law.stribeck.size() > 0 ? law.stribeck[j] : 0.0;
    for (const auto& element : law.presliding) sum += element.amplitude[j];
    return sum;
  }

  // Opens the body of link i and leaves it open: it contains the next link.
  void write_link(std::size_t i) {
    const std::string number = std::to_string(i);
    const std::string link = "link" + number;
    if (i > 0) {
      const auto j = static_cast<Eigen::Index>(i - 1);
      const Placement& placement = robot_.joints[i - 1];
      const double motor = motor_inertia_.size() > 0 ? motor_inertia_[j] : 0.0;
      xml_.open(
          "body",
          {{"name", named(link)}, {"pos", exact(placement.position)}, {"quat", rotation_of(placement)}});
      XmlText::Attributes joint{
          {"name", named("joint" + number)},
          {"axis", "0 0 1"},
          {"range", exact(robot_.limits.q_min[j]) + " " + exact(robot_.limits.q_max[j])},
          {"armature", exact(motor)},
          {"damping", exact(damping_of(j))},
          {"frictionloss", exact(dry_friction_of(j))}};
      if (robot_.is_prismatic(i - 1)) joint.insert(joint.begin() + 1, {"type", "slide"});
      xml_.leaf("joint", joint);
    }
    write_inertial(robot_.links[i]);
    write_visuals(link_visuals(robot_), link);
    for (const auto& capsule : robot_.capsules) {
      if (capsule.link == link) write_capsule(capsule, i < 2 ? kBaseBits : kArmBits);
    }
  }

  void write_hand(const HandDescription& hand) {
    const Pose X_LH = robot_.flange.pose() * hand.mount.pose();  // hand in the last link
    xml_.open("body",
              {{"name", named("hand")}, {"pos", exact(X_LH.position)}, {"quat", exact(X_LH.quaternion())}});
    write_inertial(movable() ? hand.body : rigid_hand(hand));
    xml_.leaf("site", {{"name", named("hand_tcp")},
                       {"pos", exact(hand.tcp.position)},
                       {"quat", rotation_of(hand.tcp)},
                       {"group", "4"},
                       {"size", "0.005"}});
    if (movable()) {
      write_visuals(hand.visuals, "hand");
    } else {
      write_visuals(closed_hand_visuals(hand), "hand");
      if (use_meshes_ && robot_.meshes.count("finger") > 0) {
        for (const Pose& X_HF : finger_poses(hand)) {
          write_visible({{"type", "mesh"},
                         {"mesh", named("finger")},
                         {"pos", exact(X_HF.position)},
                         {"quat", exact(X_HF.quaternion())}},
                        "gray");
        }
      }
    }
    for (const auto& capsule : hand.palm_capsules) write_capsule(capsule, kArmBits);
    if (movable()) {
      write_fingers(hand);
    } else {
      for (const auto& capsule : hand.finger_capsules) write_capsule(capsule, kArmBits);
    }
    xml_.close();
  }

  static std::vector<Pose> finger_poses(const HandDescription& hand) {
    const Pose half_turn{Vector3(-1, -1, 1).asDiagonal(), Vector3::Zero()};
    return {hand.finger_mount.pose(), half_turn * hand.finger_mount.pose()};
  }

  void write_fingers(const HandDescription& hand) {
    const std::vector<std::string> bodies{"left_finger", "right_finger"};
    const auto poses = finger_poses(hand);
    for (std::size_t f = 0; f < 2; ++f) {
      xml_.open("body", {{"name", named(bodies[f])},
                         {"pos", exact(poses[f].position)},
                         {"quat", exact(poses[f].quaternion())}});
      xml_.leaf("joint", {{"name", named("finger_joint" + std::to_string(f + 1))},
                          {"type", "slide"},
                          {"axis", "0 1 0"},
                          {"range", "0 " + exact(hand.finger_travel)},
                          {"solreflimit", "0.004 1"},  // as stiff as metal stops
                          {"solimplimit", "0.99 0.99 0.001"},
                          {"armature", exact(kFingerArmature)}});
      write_inertial(hand.finger);
      write_visuals(hand.finger_visuals, "finger");
      for (std::size_t i = 0; i < hand.finger_boxes.size(); ++i) {
        XmlText::Attributes box = geometry(hand.finger_boxes[i]);
        box.insert(box.begin(), {"name", named(bodies[f] + std::to_string(i + 1))});
        write_collision(std::move(box), kArmBits);
      }
      xml_.close();
    }
  }

  // MuJoCo ignores contacts of parent and child only if the parent moves, so every ignored pair is listed.
  void write_contacts() {
    std::vector<std::string> links;
    for (std::size_t i = 0; i <= robot_.joint_count(); ++i) links.push_back("link" + std::to_string(i));
    if (options_.hand) links.emplace_back("hand");
    xml_.open("contact");
    for (std::size_t a = 0; a < links.size(); ++a) {
      for (std::size_t b = a + 1; b < links.size(); ++b) {
        if (is_ignored_pair(robot_, links[a], links[b])) exclude(links[a], links[b]);
      }
    }
    if (movable()) {
      exclude("left_finger", "right_finger");  // their joint limits keep them apart
      for (const std::string finger : {"left_finger", "right_finger"}) {
        for (const auto& link : links) {
          if (link == "hand" || is_ignored_pair(robot_, link, "hand")) exclude(link, finger);
        }
      }
    }
    xml_.close();
  }

  void exclude(const std::string& a, const std::string& b) {
    xml_.leaf("exclude", {{"body1", named(a)}, {"body2", named(b)}});
  }

  void write_actuators() {
    if (movable()) {
      xml_.open("equality");
      // As stiff as a rack and pinion: a difference far below 0.1 mm in any grasp.
      xml_.leaf("joint", {{"name", named("fingers")},
                          {"joint1", named("finger_joint2")},
                          {"joint2", named("finger_joint1")},
                          {"polycoef", "0 1 0 0 0"},
                          {"solref", "0.004 1"},
                          {"solimp", "0.99 0.99 0.001"}});
      xml_.close();
    }
    if (!options_.actuators) return;
    xml_.open("actuator");
    for (std::size_t i = 1; i <= robot_.joint_count(); ++i) {
      const std::string joint = named("joint" + std::to_string(i));
      xml_.leaf("motor", {{"name", joint}, {"joint", joint}, {"gear", "1"}});
    }
    if (movable()) {
      // Stiff enough to reach the rated force within a few millimeters; the damping is stable at steps of
      // 1 ms.
      xml_.leaf("position", {{"name", named("fingers")},
                             {"joint", named("finger_joint1")},
                             {"kp", "10000"},
                             {"kv", "40"},
                             {"ctrlrange", "0 " + exact(robot_.hand->finger_travel)},
                             {"forcerange",
                              exact(-robot_.hand->finger_effort) + " " + exact(robot_.hand->finger_effort)}});
    }
    xml_.close();
  }

  const RobotDescription& robot_;
  const MjcfOptions& options_;
  JointVector motor_inertia_;
  bool use_meshes_ = false;
  std::map<std::string, int> capsules_;  // written so far, by link
  XmlText xml_;
};

}  // namespace

std::string to_mjcf(const RobotDescription& robot, const MjcfOptions& options) {
  if (options.hand && !robot.hand) throw std::invalid_argument("robot '" + robot.name + "' has no hand");
  return ArmWriter(robot, options).write();
}

std::filesystem::path installed_meshes() {
  std::error_code missing;
  for (const std::filesystem::path& packages : python_package_folders()) {
    const std::filesystem::path folder =
        packages / "cmeel.prefix/share/example-robot-data/robots/panda_description/meshes";
    if (std::filesystem::is_directory(folder, missing)) return folder;
  }
  return {};
}

}  // namespace multipanda
