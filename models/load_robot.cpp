#include <algorithm>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "common/text.hpp"
#include "models/from_urdf.hpp"
#include "models/load_parts.hpp"
#include "models/robot_description.hpp"

// From YAML to RobotDescription. A file may name a `base`: it then has all sections of the base, except those
// that it replaces as a whole.
namespace multipanda {
namespace {

const std::vector<std::string> kSections{"name",
                                         "title",
                                         "base",
                                         "origin",
                                         "joints",
                                         "flange",
                                         "inertials",
                                         "own_model",
                                         "limits",
                                         "interface_limits",
                                         "joint_friction",
                                         "link_friction",
                                         "torque_sensor",
                                         "actuation",
                                         "motor_inertia_kg_m2",
                                         "rotor_inertia_kg_m2",
                                         "base_tilt_rad",
                                         "identified_range",
                                         "rated_payload_kg",
                                         "home_rad",
                                         "self_collision",
                                         "visuals",
                                         "meshes",
                                         "hand",
                                         "urdf",
                                         "base_link",
                                         "tip_link",
                                         "held_joints"};

// Effective sections and their files.
struct Document {
  std::map<std::string, Node> sections;
  std::map<std::string, std::string> origin;
  std::optional<Node> root;  // of the requested file
  std::vector<std::filesystem::path> files;

  const Node& at(const std::string& key) const {
    const auto found = sections.find(key);
    if (found == sections.end()) root->refuse("the section '" + key + "' is missing, here and in the base");
    return found->second;
  }
  const Node* find(const std::string& key) const {
    const auto found = sections.find(key);
    return found == sections.end() ? nullptr : &found->second;
  }
  std::string text(const std::string& key) const { return at(key).text(Key(key)); }
};

// A file next to this one, with or without extension; otherwise a robot by name.
std::filesystem::path base_file(const Node& base) {
  const std::string name = base.text(Key("base"));
  std::filesystem::path beside = std::filesystem::path(base.file()).parent_path() / name;
  if (beside.extension() != ".yaml") beside += ".yaml";
  const auto names = available_robots();
  const bool known = std::find(names.begin(), names.end(), name) != names.end();
  std::error_code missing;
  const bool itself = std::filesystem::equivalent(beside, base.file(), missing);  // e.g. my own fer.yaml with
                                                                                  // base: fer
  if (std::filesystem::exists(beside) && !(known && itself)) return beside;
  if (known) return models_folder() / (name + ".yaml");
  base.refuse("there is no file " + beside.string() + ", and no robot '" + name + "'" +
              name_hint(name, names, "there are no robots"));
}

Document read_document(const std::filesystem::path& file, int depth) {
  Document document;
  const Node root = Node::load(file.string());
  std::optional<Node> origin, base;
  std::map<std::string, Node> own;
  Archive::read(root, [&](Archive& archive) {
    for (const auto& section : kSections) {
      const auto node = archive.open(Key(section));
      if (node) own.emplace(section, *node);
    }
  });
  if (const auto node = own.extract("base"); !node.empty()) {
    constexpr int kMaxDepth = 8;
    if (depth == kMaxDepth)
      node.mapped().refuse("more than 8 files in a chain of bases; check that no file is its own base");
    document = read_document(base_file(node.mapped()), depth + 1);
    document.sections.erase("name");  // every robot has its own name
    document.sections.erase("title");
  }
  document.root.emplace(root);
  document.files.push_back(file);
  if (const auto node = own.extract("origin"); !node.empty()) {
    Archive::read(node.mapped(), [&](Archive& archive) {
      for (const auto& section : kSections) {
        std::string text;
        archive(Key(section), text);
        if (archive.has(section)) document.origin[section] = text;
      }
    });
  }
  for (const auto& [key, node] : own) document.sections.insert_or_assign(key, node);
  return document;
}

void read_joints(const Node& node, RobotDescription& robot) {
  const std::size_t n = node.pairs().size();
  if (n == 0 || n > kMaxJoints) node.refuse("expected 1 to " + std::to_string(kMaxJoints) + " joints");
  robot.joints.assign(n, {});
  const bool imported = !robot.joint_names.empty();
  robot.prismatic.resize(n, false);
  const auto names = numbered("joint", 1, n);
  static const std::vector<std::string> kTypes{"revolute", "prismatic"};
  Archive::read(node, [&](Archive& archive) {
    for (std::size_t i = 0; i < n; ++i) {
      archive.part(Key(names[i]).required(), [&](Archive& joint) {
        visit(joint, robot.joints[i]);
        const std::string own = kTypes[robot.is_prismatic(i) ? 1 : 0];
        std::string type = own;
        joint(Key("type").one_of(kTypes), type);
        if (imported && type != own) joint.at("type").refuse("the URDF defines this joint as " + own);
        robot.prismatic[i] = type == kTypes[1];
      });
    }
  });
}

void read_inertials(const Node& node, RobotDescription& robot) {
  const auto names = numbered("link", 0, robot.joint_count());
  robot.links.assign(names.size(), {});
  Archive::read(node, [&](Archive& archive) {
    for (std::size_t i = 0; i < names.size(); ++i) archive.section(Key(names[i]).required(), robot.links[i]);
  });
}

// Links of the arm's own model: any numbers, but a mass above 0.
void read_own_model(const Node& node, RobotDescription& robot) {
  const auto names = numbered("link", 1, robot.joint_count());
  robot.own_model.assign(names.size(), {});
  Archive::read(node, [&](Archive& archive) {
    for (std::size_t i = 0; i < names.size(); ++i) {
      archive.part(Key(names[i]).required(),
                   [&](Archive& link) { visit_body(link, robot.own_model[i], false); });
    }
  });
}

void read_limits(const Node& node, RobotDescription& robot) {
  const std::size_t n = robot.joint_count();
  JointLimits& limits = robot.limits;
  for (JointVector* v : {&limits.q_min, &limits.q_max, &limits.dq_max, &limits.tau_max})
    v->setZero(static_cast<Eigen::Index>(n));
  Archive::read(node, [&](Archive& archive) {
    for (std::size_t j = 0; j < n; ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      archive.part(Key("joint" + std::to_string(j + 1)).required(), [&](Archive& joint) {
        const LimitKeys& keys = limit_keys(robot.is_prismatic(j));
        joint(Key(keys.lower).any_turn().required(), limits.q_min[i]);
        joint(Key(keys.upper).any_turn().required(), limits.q_max[i]);
        joint(Key(keys.velocity).above(0).required(), limits.dq_max[i]);
        joint(Key(keys.effort).above(0).required(), limits.tau_max[i]);
        if (joint.reading() && limits.q_min[i] >= limits.q_max[i])
          joint.self().refuse(std::string(keys.lower) + " must be below " + keys.upper);
      });
    }
  });
}

void visit_cartesian(Archive& archive, CartesianLimits& limits) {
  const auto limit = [&](const char* name, double& value, bool required = true) {
    Key key(name);
    archive(required ? key.above(0).required() : key.above(0), value);
  };
  limit("velocity_m_per_s", limits.velocity);
  limit("acceleration_m_per_s2", limits.acceleration);
  limit("jerk_m_per_s3", limits.jerk);
  limit("rotation_velocity_rad_per_s", limits.rotation_velocity);
  limit("rotation_acceleration_rad_per_s2", limits.rotation_acceleration);
  limit("rotation_jerk_rad_per_s3", limits.rotation_jerk);
  limit("elbow_velocity_rad_per_s", limits.elbow_velocity, false);
  limit("elbow_acceleration_rad_per_s2", limits.elbow_acceleration, false);
  limit("elbow_jerk_rad_per_s3", limits.elbow_jerk, false);
}

void visit_position_based(Archive& archive, PositionBasedVelocity& limits, std::size_t n) {
  archive(Key("lower_rad").any_turn().joints(n).required(), limits.q_min);
  archive(Key("upper_rad").any_turn().joints(n).required(), limits.q_max);
  archive(Key("velocity_offset_rad_per_s").above(0).joints(n).required(), limits.offset);
  archive(Key("deceleration_rad_per_s2").above(0).joints(n).required(), limits.deceleration);
  if (archive.reading() && (limits.q_min.array() >= limits.q_max.array()).any())
    archive.self().refuse("lower_rad must be below upper_rad in every joint");
}

void read_interface_limits(const Node& node, RobotDescription& robot) {
  const std::size_t n = robot.joint_count();
  Archive::read(node, [&](Archive& archive) {
    archive(Key("acceleration_rad_per_s2").above(0).joints(n).required(), robot.limits.ddq_max);
    archive(Key("jerk_rad_per_s3").above(0).joints(n).required(), robot.limits.dddq_max);
    archive(Key("torque_rate_nm_per_s").above(0).joints(n).required(), robot.limits.tau_rate_max);
    CartesianLimits cartesian;
    PositionBasedVelocity velocity;
    archive.part(Key("cartesian"), [&](Archive& inner) { visit_cartesian(inner, cartesian); });
    archive.part(Key("position_based_velocity"),
                 [&](Archive& inner) { visit_position_based(inner, velocity, n); });
    if (archive.has("cartesian")) robot.cartesian = cartesian;
    if (archive.has("position_based_velocity")) robot.position_based_velocity = velocity;
  });
}

void read_home(const Node& node, RobotDescription& robot) {
  robot.q_home = read_joint_vector(node, Key("home_rad").any_turn(), robot.joint_count());
  const auto items = node.items();
  for (std::size_t j = 0; j < items.size(); ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    const double q = robot.q_home[i];
    if (q < robot.limits.q_min[i] || q > robot.limits.q_max[i])
      items[j].refuse("outside the limits of joint" + std::to_string(j + 1) + ", found " + number_text(q));
  }
}

void read_looks(const Document& document, RobotDescription& robot) {
  auto names = numbered("link", 0, robot.joint_count());
  if (const Node* visuals = document.find("visuals")) {
    robot.visuals.clear();
    Archive::read(*visuals, [&](Archive& archive) {
      for (const auto& link : names) {
        std::vector<Shape> shapes;
        archive.list(Key(link).each("shape"), shapes);
        for (auto& shape : on_link(std::move(shapes), link)) robot.visuals.push_back(std::move(shape));
      }
    });
  }
  if (const Node* meshes = document.find("meshes")) {
    names.emplace_back("hand");
    names.emplace_back("finger");
    Archive::read(*meshes, [&](Archive& archive) {
      for (const auto& link : names) {
        std::string file;
        archive(Key(link), file);
        if (archive.has(link)) robot.meshes[link] = file;
      }
    });
  }
}

// The limits of the joints that the file names, by the URDF's names.
std::map<std::string, UrdfLimits> read_urdf_limits(const Node& node) {
  std::map<std::string, UrdfLimits> limits;
  for (const auto& [name, joint] : node.pairs()) {
    UrdfLimits& own = limits[name];
    Archive::read(joint, [&](Archive& archive) {
      for (const bool prismatic : {false, true}) {
        const LimitKeys& keys = limit_keys(prismatic);
        archive(Key(keys.lower).any_turn(), own.lower);
        archive(Key(keys.upper).any_turn(), own.upper);
        archive(Key(keys.velocity).above(0), own.velocity);
        archive(Key(keys.effort).above(0), own.effort);
        for (const char* key : {keys.lower, keys.upper, keys.velocity, keys.effort}) {
          if (!archive.has(key)) continue;
          if (own.prismatic.value_or(prismatic) != prismatic)
            archive.at(key).refuse("expected limits of one kind of joint, found rad and m; remove one");
          own.prismatic = prismatic;
        }
      }
    });
  }
  return limits;
}

template <typename T, typename... Context>
T read_as(const Node& node, const Context&... context) {
  T value;
  Archive::read(node, value, context...);
  return value;
}

// Kinematics, masses and limits of an arm that is described by a URDF.
RobotDescription read_urdf(const Document& document) {
  const Node& urdf = document.at("urdf");
  // A file that is based on the model's file may describe an individual arm that differs from the URDF.
  for (const char* key : {"joints", "flange", "inertials", "hand"}) {
    const Node* section = document.find(key);
    const bool inherited = section != nullptr && section->file() != urdf.file() && key != std::string("hand");
    if (section != nullptr && !inherited) {
      section->refuse("the URDF defines this; remove the section, or the line 'urdf'");
    }
  }
  UrdfChain chain;
  chain.base_link = document.text("base_link");
  chain.tip_link = document.text("tip_link");
  if (const Node* held = document.find("held_joints")) {
    Key position("position");
    position.kind = Key::Kind::number;
    for (const auto& [name, value] : held->pairs()) chain.held_joints[name] = value.number(position);
  }
  if (const Node* limits = document.find("limits")) chain.limits = read_urdf_limits(*limits);
  try {
    const auto file = urdf_file(urdf.text(Key("urdf")), std::filesystem::path(urdf.file()).parent_path());
    std::ifstream stream(file);
    const std::string text{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
    RobotDescription robot = robot_from_urdf(text, chain);
    if (const Node* home = document.find("home_rad")) read_home(*home, robot);
    if (document.find("self_collision") == nullptr) {
      fit_collision(text, chain, file.parent_path(), robot);
      if (!robot.capsules.empty()) robot.visuals.clear();  // better than the thin ones
    }
    if (const Node* joints = document.find("joints")) {
      const std::size_t n = robot.joint_count();
      read_joints(*joints, robot);
      if (robot.joint_count() != n) joints->refuse("the URDF has " + std::to_string(n) + " joints");
    }
    if (const Node* flange = document.find("flange")) robot.flange = read_as<Placement>(*flange);
    if (const Node* inertials = document.find("inertials")) read_inertials(*inertials, robot);
    return robot;
  } catch (const std::invalid_argument& error) {
    urdf.refuse(error.what());
  }
}

// The same from the file's own sections.
RobotDescription read_chain(const Document& document) {
  for (const char* key : {"base_link", "tip_link", "held_joints"}) {
    if (const Node* section = document.find(key)) {
      section->refuse("this section belongs to a URDF; add the line 'urdf: FILE', or remove the section");
    }
  }
  RobotDescription robot;
  read_joints(document.at("joints"), robot);
  robot.flange = read_as<Placement>(document.at("flange"));
  read_inertials(document.at("inertials"), robot);
  if (const Node* own = document.find("own_model")) read_own_model(*own, robot);
  read_limits(document.at("limits"), robot);
  return robot;
}

// Friction, and the properties of an individual arm.
void read_own(const Document& document, RobotDescription& robot) {
  const std::size_t n = robot.joint_count();
  // The value `none` removes the section of the base.
  const auto own = [&](const char* key) -> const Node* {
    const Node* section = document.find(key);
    return section == nullptr || section->is_word({"none"}) ? nullptr : section;
  };
  if (const auto* section = own("joint_friction")) robot.friction = read_as<JointFriction>(*section, n);
  if (const auto* section = own("link_friction")) robot.link_friction = read_as<FrictionLaw>(*section, n);
  if (robot.friction || robot.link_friction) robot.left_out_friction.clear();
  if (const auto* section = own("torque_sensor")) robot.torque_sensor = read_as<TorqueSensor>(*section, n);
  if (const auto* section = own("actuation")) robot.actuation = read_as<Actuation>(*section);
  if (const auto* section = own("motor_inertia_kg_m2"))
    robot.motor_inertia = read_joint_vector(*section, Key("motor_inertia_kg_m2").at_least(0), n);
  if (const auto* section = own("rotor_inertia_kg_m2"))
    robot.rotor_inertia = read_joint_vector(*section, Key("rotor_inertia_kg_m2").at_least(0), n);
  if (const auto* section = own("identified_range"))
    robot.identified_range = read_as<IdentifiedRange>(*section, n);
  if (const auto* section = own("rated_payload_kg"))
    robot.rated_payload = section->number(Key("rated_payload_kg").above(0));
  if (const auto* section = own("base_tilt_rad")) {
    const auto tilt = section->numbers(Key("base_tilt_rad").size(2));
    robot.base_tilt = {tilt[0], tilt[1]};
  }
}

std::filesystem::path file_of(const std::string& name_or_path) {
  const std::filesystem::path path(name_or_path);
  if (path.extension() == ".yaml" || name_or_path.find('/') != std::string::npos) return path;
  const auto names = available_robots();
  if (std::find(names.begin(), names.end(), name_or_path) == names.end()) {
    throw std::invalid_argument("there is no robot '" + name_or_path + "' in " + models_folder().string() +
                                name_hint(name_or_path, names, "there are no robots") +
                                " (a file of your own is named by its path, for example ./my_arm.yaml)");
  }
  return models_folder() / (name_or_path + ".yaml");
}

}  // namespace

RobotDescription load_robot(const std::string& name_or_path) {
  const auto file = file_of(name_or_path);
  if (auto known = known_robots().find(file)) return *std::move(known);
  const Document document = read_document(file, 0);
  const bool imported = document.find("urdf") != nullptr;
  RobotDescription robot = imported ? read_urdf(document) : read_chain(document);
  robot.file = file;
  robot.name = document.text("name");
  if (!imported || document.find("title") != nullptr) robot.title = document.text("title");
  for (const auto& [section, text] : document.origin) robot.origin[section] = text;
  if (!imported || document.find("interface_limits") != nullptr) {
    read_interface_limits(document.at("interface_limits"), robot);
  }
  read_own(document, robot);
  if (!imported || document.find("home_rad") != nullptr) read_home(document.at("home_rad"), robot);
  if (!imported || document.find("self_collision") != nullptr) {
    read_self_collision(document.at("self_collision"), robot);
    if (imported) robot.visuals.clear();  // the model's capsules are better than the thin ones
  }
  read_looks(document, robot);
  if (const Node* hand = document.find("hand")) robot.hand = read_as<HandDescription>(*hand);
  if (!imported) known_robots().keep(file, document.files, robot);
  return robot;
}

std::vector<std::filesystem::path> robot_files(const std::string& name_or_path) {
  const Document document = read_document(file_of(name_or_path), 0);
  auto files = document.files;
  if (const Node* urdf = document.find("urdf")) {
    files.push_back(urdf_file(urdf->text(Key("urdf")), std::filesystem::path(urdf->file()).parent_path()));
    if (document.find("self_collision") == nullptr) {
      for (auto& mesh : mesh_files(files.back())) files.push_back(std::move(mesh));
    }
  }
  return files;
}

}  // namespace multipanda
