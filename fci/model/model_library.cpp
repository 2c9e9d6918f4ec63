#include "fci/model/model_library.hpp"

#include <algorithm>
#include <cstring>
#include <span>
#include <stdexcept>

#include "models/xml_text.hpp"

#ifdef MULTIPANDA_MODEL_FUNCTIONS
// The built library, byte for byte.
asm(".section .rodata\n"
    ".balign 16\n"
    ".global multipanda_model_functions\n"
    ".global multipanda_model_functions_end\n"
    "multipanda_model_functions:\n"
    ".incbin \"" MULTIPANDA_MODEL_FUNCTIONS
    "\"\n"
    "multipanda_model_functions_end:\n"
    ".byte 0\n"
    ".previous\n");
extern "C" const std::byte multipanda_model_functions[];
extern "C" const std::byte multipanda_model_functions_end[];
#endif
namespace multipanda::fci {
namespace {

std::span<const std::byte> unpatched() {
#ifdef MULTIPANDA_MODEL_FUNCTIONS
  return {multipanda_model_functions, multipanda_model_functions_end};
#else
  return {};
#endif
}

void put(const Matrix3& m, double (&rows)[9]) {
  for (int i = 0; i < 9; ++i) rows[i] = m(i / 3, i % 3);
}
void put(const Vector3& v, double (&to)[3]) {
  for (int i = 0; i < 3; ++i) to[i] = v[i];
}

void write_origin(XmlText& xml, const Vector3& position, const Vector3& rpy) {
  xml.leaf("origin", {{"xyz", exact(position)}, {"rpy", exact(rpy)}});
}

void write_link(XmlText& xml, const std::string& name, const RigidBody& body) {
  xml.open("link", {{"name", name}});
  xml.open("inertial");
  write_origin(xml, body.com, Vector3::Zero());
  xml.leaf("mass", {{"value", exact(body.mass)}});
  const Matrix3& I = body.inertia;
  xml.leaf("inertia", {{"ixx", exact(I(0, 0))},
                       {"ixy", exact(I(0, 1))},
                       {"ixz", exact(I(0, 2))},
                       {"iyy", exact(I(1, 1))},
                       {"iyz", exact(I(1, 2))},
                       {"izz", exact(I(2, 2))}});
  xml.close();
  xml.close();
}

void write_limits(XmlText& xml, const RobotDescription& robot, Eigen::Index j) {
  const auto& by_position = robot.position_based_velocity;
  const JointLimits& limits = robot.limits;
  xml.leaf("limit", {{"lower", exact(by_position ? by_position->q_min[j] : limits.q_min[j])},
                     {"upper", exact(by_position ? by_position->q_max[j] : limits.q_max[j])},
                     {"velocity", exact(limits.dq_max[j])},
                     {"effort", exact(limits.tau_max[j])}});
  // min(dq_max, sqrt(2 deceleration d) - offset) = dq_max for every distance d >= 0, if offset = -dq_max
  xml.leaf("position_based_velocity_limits",
           {{"velocity_offset", exact(by_position ? by_position->offset[j] : -limits.dq_max[j])},
            {"deceleration_limit", exact(by_position ? by_position->deceleration[j] : limits.ddq_max[j])}});
}

}  // namespace

ArmNumbers arm_numbers(const RobotDescription& robot, LibraryModel model) {
  if (robot.has_prismatic_joints()) {
    throw std::invalid_argument(
        "robot '" + robot.name +
        "' has a prismatic joint, the arm's control interface supports revolute ones only");
  }
  if (robot.joint_count() != ArmNumbers::kJoints) {
    throw std::invalid_argument("robot '" + robot.name + "' has " + std::to_string(robot.joint_count()) +
                                " joints, the arm's control interface supports only 7");
  }
  ArmNumbers numbers{};
  std::copy(std::begin(kMarker), std::end(kMarker), numbers.marker);
  const bool own = model == LibraryModel::own && !robot.own_model.empty();
  numbers.keeps_last_inertia = own ? 1 : 0;
  for (std::size_t i = 0; i < ArmNumbers::kJoints; ++i) {
    LinkNumbers& link = numbers.links[i];
    const Pose joint = robot.joints[i].pose();
    const RigidBody& body = own ? robot.own_model[i] : robot.links[i + 1];
    put(joint.rotation, link.rotation);
    put(joint.position, link.position);
    link.mass = body.mass;
    put(body.com, link.com);
    put(body.inertia, link.inertia);
  }
  const Pose flange = robot.flange.pose();
  put(flange.rotation, numbers.flange_rotation);
  put(flange.position, numbers.flange_position);
  return numbers;
}

std::vector<std::byte> model_library(const RobotDescription& robot, LibraryModel model) {
  const ArmNumbers numbers = arm_numbers(robot, model);
  std::vector<std::byte> library(unpatched().begin(), unpatched().end());
  if (library.empty()) return library;
  const auto marker = std::as_bytes(std::span(kMarker));
  const auto place = std::search(library.begin(), library.end(), marker.begin(), marker.end());
  if (library.end() - place < static_cast<std::ptrdiff_t>(sizeof numbers))
    throw std::logic_error("the model library was built without the block for the arm's parameters");
  std::memcpy(&*place, &numbers, sizeof numbers);
  return library;
}

std::string model_urdf(const RobotDescription& robot) {
  if (robot.has_prismatic_joints()) {
    throw std::invalid_argument(
        "robot '" + robot.name +
        "' has a prismatic joint, the arm's control interface supports revolute ones only");
  }
  if (robot.joint_count() != 7) {
    throw std::invalid_argument("robot '" + robot.name + "' has " + std::to_string(robot.joint_count()) +
                                " joints, the arm's control interface supports only 7");
  }
  XmlText xml;
  // libfranka treats a name with this prefix as a mobile robot, which has no arm model.
  const bool mobile = robot.name.starts_with("tmr");
  xml.open("robot", {{"name", mobile ? "arm_" + robot.name : robot.name}});
  write_link(xml, "link0", robot.links[0]);
  for (std::size_t i = 1; i <= 7; ++i) {
    const std::string number = std::to_string(i);
    const Placement& placement = robot.joints[i - 1];
    xml.open("joint", {{"name", "joint" + number}, {"type", "revolute"}});
    write_origin(xml, placement.position, placement.rpy);
    xml.leaf("parent", {{"link", "link" + std::to_string(i - 1)}});
    xml.leaf("child", {{"link", "link" + number}});
    xml.leaf("axis", {{"xyz", "0 0 1"}});
    write_limits(xml, robot, static_cast<Eigen::Index>(i - 1));
    xml.close();
    write_link(xml, "link" + number, robot.links[i]);
  }
  xml.open("joint", {{"name", "joint8"}, {"type", "fixed"}});
  write_origin(xml, robot.flange.position, robot.flange.rpy);
  xml.leaf("parent", {{"link", "link7"}});
  xml.leaf("child", {{"link", "link8"}});
  xml.close();
  xml.leaf("link", {{"name", "link8"}});
  xml.close();
  return "<?xml version=\"1.0\"?>\n" + xml.text();
}

RigidBody end_effector(const RobotDescription& robot, bool hand, const Load& tool) {
  const RigidBody body{tool.mass, tool.p_FC, tool.inertia_C};
  if (!hand) return body;
  if (!robot.hand) throw std::invalid_argument("robot '" + robot.name + "' has no hand");
  const RigidBody in_flange = moved(rigid_hand(*robot.hand), robot.hand->mount.pose());
  return tool.mass > 0 ? merged(in_flange, body) : in_flange;
}

}  // namespace multipanda::fci
