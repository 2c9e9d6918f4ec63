#include "fci/model/model_library.hpp"

#include <algorithm>
#include <cstring>
#include <span>
#include <stdexcept>

#ifdef MULTIPANDA_MODEL_FUNCTIONS
// The library as it was built, byte for byte.
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

}  // namespace

ArmNumbers arm_numbers(const RobotDescription& robot) {
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
  for (std::size_t i = 0; i < ArmNumbers::kJoints; ++i) {
    LinkNumbers& link = numbers.links[i];
    const Pose joint = robot.joints[i].pose();
    const RigidBody& body = robot.links[i + 1];
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

std::vector<std::byte> model_library(const RobotDescription& robot) {
  const ArmNumbers numbers = arm_numbers(robot);
  std::vector<std::byte> library(unpatched().begin(), unpatched().end());
  if (library.empty()) return library;
  const auto marker = std::as_bytes(std::span(kMarker));
  const auto place = std::search(library.begin(), library.end(), marker.begin(), marker.end());
  if (library.end() - place < static_cast<std::ptrdiff_t>(sizeof numbers))
    throw std::logic_error("the model library was built without the block for the arm's parameters");
  std::memcpy(&*place, &numbers, sizeof numbers);
  return library;
}

}  // namespace multipanda::fci
