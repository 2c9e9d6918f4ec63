#include "core/state/arm_state.hpp"

namespace multipanda {

std::string_view to_string(ArmMode mode) {
  switch (mode) {
    case ArmMode::other:
      return "other";
    case ArmMode::idle:
      return "idle";
    case ArmMode::move:
      return "move";
    case ArmMode::guiding:
      return "guiding";
    case ArmMode::reflex:
      return "reflex";
    case ArmMode::user_stopped:
      return "user_stopped";
    case ArmMode::recovering:
      return "recovering";
    case ArmMode::disconnected:
      return "disconnected";
  }
  return "unknown";
}

}  // namespace multipanda
