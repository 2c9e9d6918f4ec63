#include <algorithm>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "models/checked_yaml.hpp"
#include "models/from_urdf.hpp"
#include "models/load_identified.hpp"
#include "models/load_parts.hpp"
#include "models/robot_description.hpp"

// From YAML to RobotDescription. A file may name a `base`: it then has all of the base's sections except
// those that it gives itself, each replaced as a whole.
namespace multipanda {
namespace {

const std::vector<std::string> kSections{"name",
                                         "title",
                                         "base",
                                         "origin",
                                         "joints",
                                         "flange",
                                         "inertials",
                                         "limits",
                                         "interface_limits",
                                         "joint_friction",
                                         "link_friction",
                                         "torque_sensor",
                                         "actuation",
                                         "motor_inertia_kg_m2",
                                         "base_tilt_rad",
                                         "home_rad",
                                         "self_collision",
                                         "visuals",
                                         "meshes",
                                         "hand",
                                         "urdf",
                                         "base_link",
                                         "tip_link",
                                         "held_joints"};

// The sections in force and the files that they come from.
struct Document {
  std::map<std::string, CheckedYaml> sections;
  std::map<std::string, std::string> origin;
  CheckedYaml root;  // of the file asked for

  const CheckedYaml& at(const std::string& key) const {
    const auto found = sections.find(key);
    if (found == sections.end()) root.refuse("the section '" + key + "' is missing, here and in the base");
    return found->second;
  }
  const CheckedYaml* find(const std::string& key) const {
    const auto found = sections.find(key);
    return found == sections.end() ? nullptr : &found->second;
  }
};

// A file beside this one, with or without its ending; else a robot by name.
std::filesystem::path base_file(const CheckedYaml& base, const std::filesystem::path& folder) {
  const std::string name = base.text();
  std::filesystem::path beside = folder / name;
  if (beside.extension() != ".yaml") beside += ".yaml";
  const auto names = available_robots();
  const bool known = std::find(names.begin(), names.end(), name) != names.end();
  std::error_code missing;
  const bool itself = std::filesystem::equivalent(beside, base.file(), missing);  // my fer.yaml on base: fer
  if (std::filesystem::exists(beside) && !(known && itself)) return beside;
  if (known) return models_folder() / (name + ".yaml");
  base.refuse("there is no file " + beside.string() + ", and no robot '" + name + "'." +
              suggestion(name, names));
}

Document read_document(const std::filesystem::path& file, int depth) {
  Document document{{}, {}, CheckedYaml::load(file)};
  const CheckedYaml& root = document.root;
  root.allow_keys(kSections);
  if (const auto base = root.find("base")) {
    constexpr int kMaxDepth = 8;
    if (depth == kMaxDepth) base->refuse("too many files stand on each other; is one its own base?");
    Document below = read_document(base_file(*base, file.parent_path()), depth + 1);
    document.sections = std::move(below.sections);
    document.origin = std::move(below.origin);
    document.sections.erase("name");  // a robot has its own name
    document.sections.erase("title");
  }
  for (const auto& key : root.keys()) {
    if (key != "base" && key != "origin") document.sections.insert_or_assign(key, root.at(key));
  }
  if (const auto origin = root.find("origin")) {
    origin->allow_keys(kSections);
    for (const auto& key : origin->keys()) document.origin[key] = origin->at(key).text();
  }
  return document;
}

void read_joints(const CheckedYaml& yaml, RobotDescription& robot) {
  const std::size_t n = yaml.keys().size();
  if (n == 0 || n > kMaxJoints) yaml.refuse("expected 1 to " + std::to_string(kMaxJoints) + " joints");
  const auto names = numbered("joint", 1, n);
  yaml.allow_keys(names);
  for (const auto& name : names) robot.joints.push_back(read_placement(yaml.at(name)));
}

void read_inertials(const CheckedYaml& yaml, RobotDescription& robot) {
  const auto links = numbered("link", 0, robot.joint_count());
  yaml.allow_keys(links);
  robot.links.clear();
  for (const auto& link : links) robot.links.push_back(read_body(yaml.at(link)));
}

void read_limits(const CheckedYaml& yaml, RobotDescription& robot) {
  const std::size_t n = robot.joint_count();
  const auto names = numbered("joint", 1, n);
  yaml.allow_keys(names);
  JointLimits& limits = robot.limits;
  for (JointVector* v : {&limits.q_min, &limits.q_max, &limits.dq_max, &limits.tau_max}) {
    v->resize(static_cast<Eigen::Index>(n));
  }
  for (std::size_t j = 0; j < n; ++j) {
    const CheckedYaml joint = yaml.at(names[j]);
    joint.allow_keys({"lower_rad", "upper_rad", "velocity_rad_per_s", "effort_nm"});
    const auto i = static_cast<Eigen::Index>(j);
    limits.q_min[i] = joint.at("lower_rad").angle();
    limits.q_max[i] = joint.at("upper_rad").angle();
    limits.dq_max[i] = joint.at("velocity_rad_per_s").positive();
    limits.tau_max[i] = joint.at("effort_nm").positive();
    if (limits.q_min[i] >= limits.q_max[i]) joint.refuse("lower_rad must be below upper_rad");
  }
}

void read_interface_limits(const CheckedYaml& yaml, RobotDescription& robot) {
  const std::size_t n = robot.joint_count();
  yaml.allow_keys({"acceleration_rad_per_s2", "jerk_rad_per_s3", "torque_rate_nm_per_s", "cartesian",
                   "position_based_velocity"});
  robot.limits.ddq_max = positive_joint_vector(yaml.at("acceleration_rad_per_s2"), n);
  robot.limits.dddq_max = positive_joint_vector(yaml.at("jerk_rad_per_s3"), n);
  robot.limits.tau_rate_max = positive_joint_vector(yaml.at("torque_rate_nm_per_s"), n);
  if (const auto velocity = yaml.find("position_based_velocity")) {
    velocity->allow_keys({"lower_rad", "upper_rad", "velocity_offset_rad_per_s", "deceleration_rad_per_s2"});
    PositionBasedVelocity limits;
    limits.q_min = joint_vector(velocity->at("lower_rad"), n);
    limits.q_max = joint_vector(velocity->at("upper_rad"), n);
    limits.offset = positive_joint_vector(velocity->at("velocity_offset_rad_per_s"), n);
    limits.deceleration = positive_joint_vector(velocity->at("deceleration_rad_per_s2"), n);
    if ((limits.q_min.array() >= limits.q_max.array()).any()) {
      velocity->refuse("lower_rad must be below upper_rad in every joint");
    }
    robot.position_based_velocity = limits;
  }
  const auto cartesian = yaml.find("cartesian");
  if (!cartesian) return;
  CartesianLimits limits;
  const std::vector<std::pair<std::string, double*>> fields{
      {"velocity_m_per_s", &limits.velocity},
      {"acceleration_m_per_s2", &limits.acceleration},
      {"jerk_m_per_s3", &limits.jerk},
      {"rotation_velocity_rad_per_s", &limits.rotation_velocity},
      {"rotation_acceleration_rad_per_s2", &limits.rotation_acceleration},
      {"rotation_jerk_rad_per_s3", &limits.rotation_jerk},
      {"elbow_velocity_rad_per_s", &limits.elbow_velocity},
      {"elbow_acceleration_rad_per_s2", &limits.elbow_acceleration},
      {"elbow_jerk_rad_per_s3", &limits.elbow_jerk}};
  std::vector<std::string> keys;
  for (const auto& field : fields) keys.push_back(field.first);
  cartesian->allow_keys(keys);
  for (const auto& [key, value] : fields) {
    const bool optional = key.rfind("elbow", 0) == 0;
    if (!optional || cartesian->has(key)) *value = cartesian->at(key).positive();
  }
  robot.cartesian = limits;
}

void read_home(const CheckedYaml& yaml, RobotDescription& robot) {
  robot.q_home = joint_vector(yaml, robot.joint_count());
  const auto items = yaml.items();
  for (std::size_t j = 0; j < items.size(); ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    const double q = items[j].angle();
    if (q < robot.limits.q_min[i] || q > robot.limits.q_max[i]) {
      items[j].refuse("outside the limits of joint" + std::to_string(j + 1));
    }
  }
}

void read_looks(const Document& document, RobotDescription& robot) {
  const auto links = numbered("link", 0, robot.joint_count());
  if (const CheckedYaml* visuals = document.find("visuals")) {
    visuals->allow_keys(links);
    robot.visuals.clear();
    for (const auto& link : visuals->keys()) {
      for (auto& shape : read_shapes(visuals->at(link), link)) robot.visuals.push_back(std::move(shape));
    }
  }
  if (const CheckedYaml* meshes = document.find("meshes")) {
    auto names = links;
    names.emplace_back("hand");
    names.emplace_back("finger");
    meshes->allow_keys(names);
    for (const auto& link : meshes->keys()) robot.meshes[link] = meshes->at(link).text();
  }
}

// Of the joints that the file names, by the URDF's names.
std::map<std::string, UrdfLimits> read_urdf_limits(const CheckedYaml& yaml) {
  std::map<std::string, UrdfLimits> limits;
  for (const auto& name : yaml.keys()) {
    const CheckedYaml joint = yaml.at(name);
    joint.allow_keys({"lower_rad", "upper_rad", "velocity_rad_per_s", "effort_nm"});
    UrdfLimits& given = limits[name];
    if (const auto lower = joint.find("lower_rad")) given.lower = lower->angle();
    if (const auto upper = joint.find("upper_rad")) given.upper = upper->angle();
    if (const auto velocity = joint.find("velocity_rad_per_s")) given.velocity = velocity->positive();
    if (const auto effort = joint.find("effort_nm")) given.effort = effort->positive();
  }
  return limits;
}

// Kinematics, masses and limits of an arm that stands in a URDF.
RobotDescription read_urdf(const Document& document) {
  const CheckedYaml& urdf = document.at("urdf");
  // What one arm is beyond its make may differ from its URDF, in a file that stands on the make's.
  for (const char* key : {"joints", "flange", "inertials", "hand"}) {
    const CheckedYaml* section = document.find(key);
    const bool stands_on = section != nullptr && section->file() != urdf.file() && key != std::string("hand");
    if (section != nullptr && !stands_on) {
      section->refuse("the URDF says this; remove the section, or the line 'urdf'");
    }
  }
  UrdfChain chain;
  chain.base_link = document.at("base_link").text();
  chain.tip_link = document.at("tip_link").text();
  if (const CheckedYaml* held = document.find("held_joints")) {
    for (const auto& name : held->keys()) chain.held_joints[name] = held->at(name).number();
  }
  if (const CheckedYaml* limits = document.find("limits")) chain.limits = read_urdf_limits(*limits);
  try {
    const auto file = urdf_file(urdf.text(), std::filesystem::path(urdf.file()).parent_path());
    std::ifstream stream(file);
    const std::string text{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
    RobotDescription robot = robot_from_urdf(text, chain);
    if (const CheckedYaml* joints = document.find("joints")) {
      const std::size_t n = robot.joint_count();
      robot.joints.clear();
      read_joints(*joints, robot);
      if (robot.joint_count() != n) joints->refuse("the URDF has " + std::to_string(n) + " joints");
    }
    if (const CheckedYaml* flange = document.find("flange")) robot.flange = read_placement(*flange);
    if (const CheckedYaml* inertials = document.find("inertials")) read_inertials(*inertials, robot);
    return robot;
  } catch (const std::invalid_argument& error) {
    urdf.refuse(error.what());
  }
}

// The same from the file's own sections.
RobotDescription read_chain(const Document& document) {
  for (const char* key : {"base_link", "tip_link", "held_joints"}) {
    if (const CheckedYaml* section = document.find(key)) {
      section->refuse("this is about a URDF; add the line 'urdf: FILE', or remove the section");
    }
  }
  RobotDescription robot;
  read_joints(document.at("joints"), robot);
  robot.flange = read_placement(document.at("flange"));
  read_inertials(document.at("inertials"), robot);
  read_limits(document.at("limits"), robot);
  return robot;
}

// Friction, and what one arm is and does beyond its make.
void read_own(const Document& document, RobotDescription& robot) {
  const std::size_t n = robot.joint_count();
  const auto given = [&](const char* key) -> const CheckedYaml* {
    const CheckedYaml* section = document.find(key);
    return section == nullptr || is_taken_away(*section) ? nullptr : section;
  };
  if (const auto* section = given("joint_friction")) robot.friction = read_sigmoid(*section, n);
  if (const auto* section = given("link_friction")) robot.link_friction = read_link_friction(*section, n);
  if (const auto* section = given("torque_sensor")) robot.torque_sensor = read_torque_sensor(*section, n);
  if (const auto* section = given("actuation")) robot.actuation = read_actuation(*section);
  if (const auto* section = given("motor_inertia_kg_m2"))
    robot.motor_inertia = read_motor_inertia(*section, n);
  if (const auto* section = given("base_tilt_rad")) robot.base_tilt = read_base_tilt(*section);
}

std::filesystem::path file_of(const std::string& name_or_path) {
  const std::filesystem::path path(name_or_path);
  if (path.extension() == ".yaml" || name_or_path.find('/') != std::string::npos) return path;
  const auto names = available_robots();
  if (std::find(names.begin(), names.end(), name_or_path) == names.end()) {
    throw std::invalid_argument("there is no robot '" + name_or_path + "' in " + models_folder().string() +
                                "." + suggestion(name_or_path, names) +
                                " A file of your own is named by its path, for example ./my_arm.yaml.");
  }
  return models_folder() / (name_or_path + ".yaml");
}

}  // namespace

RobotDescription load_robot(const std::string& name_or_path) {
  const auto file = file_of(name_or_path);
  const Document document = read_document(file, 0);
  const bool imported = document.find("urdf") != nullptr;
  RobotDescription robot = imported ? read_urdf(document) : read_chain(document);
  robot.file = file;
  robot.name = document.at("name").text();
  if (!imported || document.find("title") != nullptr) robot.title = document.at("title").text();
  robot.origin = document.origin;
  if (!imported || document.find("interface_limits") != nullptr) {
    read_interface_limits(document.at("interface_limits"), robot);
  }
  read_own(document, robot);
  if (!imported || document.find("home_rad") != nullptr) read_home(document.at("home_rad"), robot);
  if (!imported || document.find("self_collision") != nullptr) {
    read_self_collision(document.at("self_collision"), robot);
    if (imported) robot.visuals.clear();  // the capsules are better to look at than sticks
  }
  read_looks(document, robot);
  if (const CheckedYaml* hand = document.find("hand")) robot.hand = read_hand(*hand);
  return robot;
}

}  // namespace multipanda
