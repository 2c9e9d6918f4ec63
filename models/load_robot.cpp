#include <algorithm>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "models/checked_yaml.hpp"
#include "models/from_urdf.hpp"
#include "models/robot_description.hpp"

// From YAML to RobotDescription. A file may name a `base`: it then has all of the base's sections except
// those that it gives itself, each replaced as a whole.
namespace multipanda {
namespace {

const std::vector<std::string> kSections{
    "name",     "title",          "base",     "origin",           "joints",
    "flange",   "inertials",      "limits",   "interface_limits", "joint_friction",
    "home_rad", "self_collision", "visuals",  "meshes",           "hand",
    "urdf",     "base_link",      "tip_link", "held_joints"};

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

Document read_document(const std::filesystem::path& file, int depth) {
  Document document{{}, {}, CheckedYaml::load(file)};
  const CheckedYaml& root = document.root;
  root.allow_keys(kSections);
  if (const auto base = root.find("base")) {
    constexpr int kMaxDepth = 8;
    if (depth == kMaxDepth) base->refuse("too many files stand on each other; is one its own base?");
    std::filesystem::path base_file = file.parent_path() / base->text();
    if (base_file.extension() != ".yaml") base_file += ".yaml";
    if (!std::filesystem::exists(base_file)) base->refuse("there is no file " + base_file.string());
    Document below = read_document(base_file, depth + 1);
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

void read_joints(const CheckedYaml& yaml, RobotDescription& robot) {
  const std::size_t n = yaml.keys().size();
  if (n == 0 || n > kMaxJoints) yaml.refuse("expected 1 to " + std::to_string(kMaxJoints) + " joints");
  const auto names = numbered("joint", 1, n);
  yaml.allow_keys(names);
  for (const auto& name : names) robot.joints.push_back(read_placement(yaml.at(name)));
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
  for (const char* key : {"joints", "flange", "inertials", "hand"}) {
    if (const CheckedYaml* section = document.find(key)) {
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
    return robot_from_urdf(text, chain);
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
  const CheckedYaml& inertials = document.at("inertials");
  const auto links = numbered("link", 0, robot.joint_count());
  inertials.allow_keys(links);
  for (const auto& link : links) robot.links.push_back(read_body(inertials.at(link)));
  read_limits(document.at("limits"), robot);
  return robot;
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
  const std::size_t n = robot.joint_count();
  if (!imported || document.find("interface_limits") != nullptr) {
    read_interface_limits(document.at("interface_limits"), robot);
  }
  if (const CheckedYaml* friction = document.find("joint_friction")) {
    friction->allow_keys({"p1_nm", "p2_s_per_rad", "p3_rad_per_s"});
    robot.friction =
        JointFriction{joint_vector(friction->at("p1_nm"), n), joint_vector(friction->at("p2_s_per_rad"), n),
                      joint_vector(friction->at("p3_rad_per_s"), n)};
  }
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
