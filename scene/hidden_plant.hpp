#pragma once

#include <cstdint>

#include "models/robot_description.hpp"
#include "scene/scene.hpp"

// Arms that are not what their models say, by a draw that nobody is told: for honest trials of what finds out
// such things from logs. Only the virtual arms' program and tests may include this (a test sees to it):
// whoever identifies must not.
namespace multipanda {

// One arm, drawn about `nominal`, every draw uniform and independent:
//   links 1 to n         mass +-10 % (inertia about the centre of mass likewise), centre of mass +-10 mm per
//   axis payload              0 to 1 kg, centre up to 5 cm from the flange, glued to the last link,
//   undeclared friction             the motors' table times 0.5 to 1.5 in each joint, where the model has one
//   actuation            delay 0 to 3 ms, any fraction; bandwidth 30 to 100 Hz
//   torque sensor        noise 0.05 N m
//   whatever the flange  +-5 mm per axis, turned by up to 2 degrees about any axis
//   carries
// The same seed and index give the same arm in every scene.
RobotDescription draw_hidden_plant(const RobotDescription& nominal, std::uint64_t seed,
                                   std::size_t arm_index);

// Every simulated arm of the scene becomes such a one; other noise as in PlantFidelity::realistic(), drawn
// from another seed than the scene's own. What controllers and the arms' firmware believe, and the scene's
// text, stay as they are. Throws std::invalid_argument: a model that cannot be read.
void hide(Scene& scene, std::uint64_t seed);

}  // namespace multipanda
