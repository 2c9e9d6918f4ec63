#include "scene/flange_load.hpp"

#include <array>
#include <cstdio>

#include "scene/build.hpp"

namespace multipanda {
namespace {

std::string kilograms(double mass) {
  std::array<char, 32> text;
  std::snprintf(text.data(), text.size(), "%.4g kg", mass);
  return text.data();
}

}  // namespace

FlangeLoad flange_load(const SceneArm& arm) {
  const RobotDescription robot = robot_of(arm);
  return {.hand_and_tool = fixed_load(arm, robot), .rated = robot.rated_payload, .allowed = arm.largest_load};
}

std::string load_text(const FlangeLoad& flange, double payload) {
  const double carried = flange.hand_and_tool + payload;
  std::string text = "a payload of " + kilograms(payload) + " is declared: ";
  if (flange.hand_and_tool > 0) text += "with hand and tool (" + kilograms(flange.hand_and_tool) + ") ";
  text += "the flange carries " + kilograms(carried);
  if (!flange.most()) return text + "; the model has no rating";
  text += " of the " + kilograms(*flange.most()) + " that ";
  if (flange.allowed) {
    text += "the scene allows (";
    text += flange.rated ? "the model is rated for " + kilograms(*flange.rated) : "the model has no rating";
    text += ")";
  } else {
    text += "the model is rated for";
  }
  return text + ", " + kilograms(*flange.most() - carried) + " remain";
}

}  // namespace multipanda
