#pragma once

#include <optional>
#include <string>

#include "scene/scene.hpp"

namespace multipanda {

// What an arm of a scene may carry at its flange, hand and tool included [kg].
struct FlangeLoad {
  double hand_and_tool = 0;
  std::optional<double> rated;    // by the model; none: it does not say
  std::optional<double> allowed;  // the scene's `largest_load_kg`, which counts in place of the rating

  std::optional<double> most() const { return allowed ? allowed : rated; }
};
FlangeLoad flange_load(const SceneArm& arm);

// What a payload makes of it, in one sentence: "a payload of 0.3 kg is declared: with hand and tool (0.713
// kg) the flange carries 1.013 kg of the 3 kg that the model is rated for, 1.987 kg remain".
std::string load_text(const FlangeLoad& flange, double payload);

}  // namespace multipanda
