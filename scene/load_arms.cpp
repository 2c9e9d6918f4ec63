#include <cmath>
#include <filesystem>
#include <tuple>

#include <Eigen/Eigenvalues>

#include "scene/load_parts.hpp"
#include "scene/names.hpp"
#include "scene/schema.hpp"

namespace multipanda {
namespace {

JointVector joint_vector(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

std::string joint_name(Eigen::Index i) { return "joint" + std::to_string(i + 1); }

Matrix3 read_inertia(const Mapping& mapping) {
  const auto n = [&](const char* key) { return mapping.number(key); };
  Matrix3 I;
  I << n("xx"), n("xy"), n("xz"), n("xy"), n("yy"), n("yz"), n("xz"), n("yz"), n("zz");
  const Vector3 moments = Eigen::SelfAdjointEigenSolver<Matrix3>(I, Eigen::EigenvaluesOnly).eigenvalues();
  const double slack = 1e-9 * moments.cwiseAbs().maxCoeff();
  if (moments[0] < -slack || moments[0] + moments[1] < moments[2] - slack) {
    mapping.self().refuse(
        "no rigid body has this inertia: expected principal moments of which each is at least 0 and at "
        "most the sum of the other two, found " +
        number_text(moments[0]) + ", " + number_text(moments[1]) + ", " + number_text(moments[2]));
  }
  return I;
}

Load read_load(const Mapping& arm, const std::string& key) {
  Load load;
  if (!arm.has(key)) return load;
  const Mapping mapping = arm.section(key);
  load.mass = mapping.number("mass_kg");
  load.p_FC = mapping.vector3("com_m");
  if (mapping.has("inertia_kg_m2")) load.inertia_C = read_inertia(mapping.section("inertia_kg_m2"));
  if (load.mass == 0 && load.inertia_C != Matrix3::Zero()) {
    mapping.self().refuse(
        "a body without mass has no inertia; give mass_kg above 0, or leave inertia_kg_m2 out");
  }
  return load;
}

std::vector<ToolShape> read_tool_shapes(const Mapping& arm) {
  std::vector<ToolShape> shapes;
  for (const auto& item : arm.items("tool_shapes")) {
    const std::string number = std::to_string(shapes.size() + 1);
    Mapping mapping(item, schema::tool_shape());
    mapping.rename(arm.self().what() + ": tool shape " + number);
    ToolShape shape{.X_FS = read_pose(mapping), .place = mapping.self().place()};
    std::tie(shape.shape, shape.size) = read_shape(mapping, {"size_m", "diameter_m"});
    shapes.push_back(std::move(shape));
  }
  return shapes;
}

bool read_known_friction(const Mapping& arm, const RobotDescription& robot) {
  if (arm.text("known_friction") == "none") return false;
  if (!robot.friction) {
    arm.entry("known_friction")
        .refuse("the model " + in_quotes(robot.name) + " has no friction table; write 'none'");
  }
  return true;
}

// The robot that `key` names; `name`: as load_robot knows it from wherever the program runs.
RobotDescription read_robot(const Mapping& arm, const char* key, std::string& name) {
  const Entry entry = arm.entry(key);
  name = arm.text(key);
  const bool path = name.find('/') != std::string::npos || name.ends_with(".yaml");
  if (path && std::filesystem::path(name).is_relative()) {
    name = (std::filesystem::path(entry.file().folder) / name).lexically_normal().string();
    if (name.find('/') == std::string::npos) name = "./" + name;
  }
  const auto known = available_robots();
  if (!path && std::find(known.begin(), known.end(), name) == known.end()) {
    entry.refuse("there is no robot model " + in_quotes(name) +
                 name_hint(name, known, "there are no models"));
  }
  try {
    return load_robot(name);
  } catch (const std::invalid_argument& error) {
    entry.refuse(error.what());
  }
}

// What the simulated arm truly is, where the scene says so.
void read_plant_model(const Mapping& mapping, const RobotDescription& robot, SceneArm& arm) {
  if (!mapping.has("plant_model")) return;
  const RobotDescription plant = read_robot(mapping, "plant_model", arm.plant_model);
  const Entry entry = mapping.entry("plant_model");
  if (plant.joint_count() != robot.joint_count()) {
    entry.refuse("the model " + in_quotes(arm.plant_model) + " has " + std::to_string(plant.joint_count()) +
                 " joints, " + in_quotes(arm.model) + " has " + std::to_string(robot.joint_count()) +
                 "; expected as many");
  }
  if (arm.hand && !plant.hand) {
    entry.refuse("the model " + in_quotes(arm.plant_model) + " has no hand; expected one, or 'hand: false'");
  }
}

void read_start(const Mapping& arm, const RobotDescription& robot, SceneArm& out) {
  const Entry entry = arm.entry("start_rad");
  if (entry.node().IsScalar()) {
    if (!entry.is_word({"ready"})) {
      entry.expected("'ready' or a list of " + std::to_string(robot.joint_count()) + " angles [rad]");
    }
    out.q_start = robot.q_home;
    return;
  }
  out.q_start = joint_vector(arm.numbers("start_rad", robot.joint_count()));
  const auto& limits = robot.limits;
  for (Eigen::Index i = 0; i < out.q_start.size(); ++i) {
    if (out.q_start[i] >= limits.q_min[i] && out.q_start[i] <= limits.q_max[i]) continue;
    entry.items()[static_cast<std::size_t>(i)].refuse(
        "unreachable start: " + joint_name(i) + " of " + in_quotes(out.model) + " reaches from " +
        number_text(limits.q_min[i]) + " to " + number_text(limits.q_max[i]) + " rad, found " +
        number_text(out.q_start[i]));
  }
}

// One limit of the safety section. `sign` +1: the smaller is the tighter; -1: the larger is.
void read_limit(const Mapping& safety, const std::string& key, double sign, JointVector& limit,
                SceneArm& out) {
  if (!safety.has(key)) return;
  const Entry entry = safety.entry(key);
  const Field& field = safety.field(key);
  const bool allowed = safety.boolean("allow_looser_limits");
  if (entry.node().IsScalar()) {  // a cap: never loosens
    const double cap = entry.number(field);
    if ((sign * (limit.array() - cap) <= 0).all()) {
      entry.refuse("no joint is limited by " + number_text(cap) + " " + field.unit +
                   ": the maker's own limits are tighter" +
                   (allowed ? "; to loosen them, give one number per joint" : ""));
    }
    limit = sign > 0 ? JointVector(limit.cwiseMin(cap)) : JointVector(limit.cwiseMax(cap));
    return;
  }
  const JointVector wanted = joint_vector(safety.numbers(key, static_cast<std::size_t>(limit.size())));
  for (Eigen::Index i = 0; i < limit.size(); ++i) {
    if (sign * (wanted[i] - limit[i]) <= 0) continue;
    const std::string words = key + " of " + joint_name(i) + ": " + number_text(wanted[i]) + " " +
                              field.unit + " is looser than the maker's " + number_text(limit[i]) + " " +
                              field.unit;
    if (!allowed) {
      entry.items()[static_cast<std::size_t>(i)].refuse(
          words + "; if that is meant, write 'allow_looser_limits: true' in this section");
    }
    out.loosened.push_back(words);
  }
  limit = wanted;
}

void read_safety(const Mapping& arm, const RobotDescription& robot, SceneArm& out) {
  SafetyLimits& safety = out.safety;
  safety.joints = {robot.limits.q_min,   robot.limits.q_max,   robot.limits.dq_max,
                   robot.limits.ddq_max, robot.limits.tau_max, robot.limits.tau_rate_max};
  const Mapping mapping = arm.section("safety");
  read_limit(mapping, "torque_max_nm", 1, safety.joints.tau_max, out);
  read_limit(mapping, "torque_rate_max_nm_per_s", 1, safety.joints.tau_rate_max, out);
  read_limit(mapping, "velocity_max_rad_per_s", 1, safety.joints.dq_max, out);
  read_limit(mapping, "position_min_rad", -1, safety.joints.q_min, out);
  read_limit(mapping, "position_max_rad", 1, safety.joints.q_max, out);
  for (Eigen::Index i = 0; i < safety.joints.q_min.size(); ++i) {
    const double low = safety.joints.q_min[i], high = safety.joints.q_max[i];
    if (low >= high) {
      mapping.self().refuse(joint_name(i) + " has no room: position_min_rad " + number_text(low) +
                            ", position_max_rad " + number_text(high));
    }
    if (out.q_start[i] < low || out.q_start[i] > high) {
      mapping.self().refuse("unreachable start: " + joint_name(i) + " starts at " +
                            number_text(out.q_start[i]) + " rad, this section allows " + number_text(low) +
                            " to " + number_text(high));
    }
  }
  const double usual_age = safety.max_state_age_s;
  safety.max_state_age_s = mapping.number("max_state_age_s");
  if (safety.max_state_age_s > usual_age) {
    const std::string words = "max_state_age_s: " + number_text(safety.max_state_age_s) +
                              " s is looser than the usual " + number_text(usual_age) + " s";
    if (!mapping.boolean("allow_looser_limits")) {
      mapping.entry("max_state_age_s")
          .refuse(words + "; if that is meant, write 'allow_looser_limits: true'");
    }
    out.loosened.push_back(words);
  }
  const auto box = mapping.present({"workspace_min_m", "workspace_max_m"});
  if (box.size() == 1) {
    mapping.entry(box[0]).refuse("expected both workspace_min_m and workspace_max_m, found only one of them");
  }
  if (box.size() == 2) {
    safety.workspace = WorkspaceBox{mapping.vector3(box[0]), mapping.vector3(box[1])};
    if ((safety.workspace->max - safety.workspace->min).minCoeff() <= 0) {
      mapping.entry(box[1]).refuse("expected each number above that of workspace_min_m; the box is empty");
    }
  }
}

void read_grippers(const Mapping& mapping, SceneArm& arm) {
  if (mapping.has("fingers")) {
    arm.movable_fingers = mapping.text("fingers") == "movable";
    if (!arm.hand) mapping.entry("fingers").refuse("the arm has no hand; remove this line, or 'hand: false'");
  }
  arm.vacuum = mapping.boolean("vacuum");
  if (arm.vacuum && arm.hand) {
    mapping.entry("vacuum").refuse("the vacuum gripper takes the hand's place; write 'hand: false' too");
  }
}

// Two arms of one robot may share their base (its torso): their first joints must not.
void check_room(const Mapping& mapping, const RobotDescription& robot, const SceneReader& reader,
                const SceneArm& arm) {
  constexpr double kNearest = 0.1;  // [m] two bases that near each other would stand inside one another
  const auto near = [](const Vector3& a, const Vector3& b) { return (a - b).norm() < kNearest; };
  for (std::size_t i = 0; i < reader.scene.arms.size(); ++i) {
    const SceneArm& other = reader.scene.arms[i];
    if (near(other.X_WB.position, arm.X_WB.position) &&
        near(other.X_WB * reader.robots[i].joints[0].position, arm.X_WB * robot.joints[0].position)) {
      mapping.entry("base").refuse("stands inside arm '" + other.name + "'; expected bases at least " +
                                   number_text(kNearest) + " m apart (base: {position_m: [x, y, z]})");
    }
  }
}

SceneArm read_arm(Mapping mapping, SceneReader& reader) {
  SceneArm arm;
  arm.name = mapping.text("name");
  arm.place = mapping.self().place();
  for (const auto& other : reader.scene.arms) {
    if (other.name == arm.name) {
      mapping.entry("name").refuse("two arms are called " + in_quotes(arm.name) + ", the first in line " +
                                   std::to_string(other.place.line));
    }
  }
  mapping.rename("arm '" + arm.name + "'");
  const RobotDescription robot = read_robot(mapping, "model", arm.model);
  arm.hand = mapping.boolean("hand");
  if (arm.hand && !robot.hand) {
    const bool asked = mapping.has("hand");
    mapping.entry("hand").refuse("the model " + in_quotes(arm.model) + " has no hand; " +
                                 (asked ? "expected 'hand: false'" : "write 'hand: false'"));
  }
  read_plant_model(mapping, robot, arm);
  read_grippers(mapping, arm);
  arm.X_WB = read_pose(mapping.section("base"));
  check_room(mapping, robot, reader, arm);
  read_start(mapping, robot, arm);
  if (mapping.has("end_effector")) arm.X_FE = read_pose(mapping.section("end_effector"));
  arm.X_EK = read_pose(mapping.section("stiffness_frame"));
  arm.tool = read_load(mapping, "tool");
  arm.load_declared = read_load(mapping, "load_declared");
  arm.load_present = read_load(mapping, "load_present");
  arm.tool_shapes = read_tool_shapes(mapping);
  arm.known_friction = read_known_friction(mapping, robot);
  read_safety(mapping, robot, arm);
  read_arm_interface(mapping, robot, reader, arm);
  reader.robots.push_back(robot);
  return arm;
}

}  // namespace

Pose read_pose(const Mapping& mapping) {
  const auto turns = mapping.present({"rpy_rad", "quaternion_wxyz"});
  if (turns.size() == 2) {
    mapping.entry("quaternion_wxyz").refuse("expected rpy_rad or quaternion_wxyz, found both");
  }
  Pose X;
  X.position = mapping.vector3("position_m");
  if (turns.size() == 1 && turns[0] == "quaternion_wxyz") {
    const auto q = mapping.numbers("quaternion_wxyz");
    const Quaternion turn(q[0], q[1], q[2], q[3]);
    constexpr double kFarFromUnit = 1e-2;
    if (std::abs(turn.norm() - 1) > kFarFromUnit) {
      mapping.entry("quaternion_wxyz")
          .refuse("expected a unit quaternion [w, x, y, z], found length " + number_text(turn.norm()));
    }
    X.rotation = turn.normalized().toRotationMatrix();
  } else if (turns.size() == 1) {
    X.rotation = rotation_from_rpy(mapping.vector3("rpy_rad"));
  }
  return X;
}

ArmIndex SceneReader::arm(const Entry& name) const {
  std::vector<std::string> names;
  for (ArmIndex i = 0; i < scene.arms.size(); ++i) {
    if (scene.arms[i].name == name.node().Scalar()) return i;
    names.push_back(scene.arms[i].name);
  }
  name.refuse("there is no arm " + in_quotes(name.node().Scalar()) +
              name_hint(name.node().Scalar(), names, "there are none"));
}

void read_arms(const Mapping& root, SceneReader& reader) {
  const auto items = root.items("arms");
  if (items.empty() || items.size() > kMaxArms) {
    root.entry("arms").refuse("expected 1 to " + std::to_string(kMaxArms) + " arms, found " +
                              std::to_string(items.size()));
  }
  for (std::size_t i = 0; i < items.size(); ++i) {
    const Entry item = items[i].as("arm " + std::to_string(i + 1));
    reader.scene.arms.push_back(read_arm({item, schema::arm()}, reader));
    const std::string hold = reader.scene.arms.back().name + "_hold";
    reader.holds.push_back({.name = hold, .type = "hold", .arms = {i}});
  }
}

}  // namespace multipanda
