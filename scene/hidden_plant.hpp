#pragma once

#include <cstdint>

#include "models/robot_description.hpp"
#include "scene/scene.hpp"

// Arms that differ from their models by a hidden random draw, for blind tests of identification from logs. A
// test checks that only virtual arms and tests include this file.
namespace multipanda {

// One arm, drawn about `nominal`, every draw uniform and independent:
//
//   mass of links 1 to n    +-10 %, inertia about the center of mass likewise
//   center of mass of them  +-10 mm per axis
//   payload, undeclared     0 to 1 kg, center up to 5 cm from the flange, fixed to the last link
//   friction                the motors' table times 0.5 to 1.5 in each joint, if the model has one
//   actuation               delay 0 to 3 ms, any fraction; bandwidth 30 to 100 Hz
//   torque sensor           noise 0.05 N m
//   mounting on the flange  +-5 mm per axis, turned by up to 2 degrees about any axis
//   rotors                  inertia times 0.7 to 1.3 in each joint, if the model has one
//
// and, about the means of the scene's `plant` (hide() only), where they are not zero:
//
//   transmission stiffness  times 0.5 to 1.5 in each joint
//   gear ripple             amplitude times 0.5 to 1.5, any phase, in each joint
//
// The same seed and index give the same arm in every scene.
RobotDescription draw_hidden_plant(const RobotDescription& nominal, std::uint64_t seed, std::size_t arm_index,
                                   const PlantFidelity& means = {});

// Replaces every simulated arm of the scene by such an arm; other noise is as in PlantFidelity::realistic(),
// with a seed different from the scene's. The models of controllers and arm firmware, and the scene's text,
// stay unchanged. Throws std::invalid_argument: a model that cannot be read.
void hide(Scene& scene, std::uint64_t seed);

}  // namespace multipanda
