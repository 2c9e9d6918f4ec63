#include "core/cycle/gripper_requests.hpp"

#include <cmath>

namespace multipanda {

std::string check(const GripperMove& request) {
  if (!std::isfinite(request.width) || request.width < 0) return "the width must be 0 or more metres";
  if (!std::isfinite(request.speed) || request.speed <= 0) return "the speed must be above 0 m/s";
  return {};
}

std::string check(const GripperGrasp& request) {
  if (auto why = check(GripperMove{request.width, request.speed}); !why.empty()) return why;
  if (!std::isfinite(request.force) || request.force <= 0) return "the force must be above 0 N";
  if (!(request.tolerance_inner >= 0) || !(request.tolerance_outer >= 0)) {
    return "the tolerances must be 0 or more metres";
  }
  return {};
}

}  // namespace multipanda
