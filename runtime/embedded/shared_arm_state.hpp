#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <string>

#include "core/plugin/layout.hpp"

namespace multipanda {

// An arm's complete state, shared with controllers in the same process. ros2_control's state interfaces carry
// doubles; the bits of `<arm>/multipanda_state` are this struct's address. The name is unique to us: Franka's
// own hardware exports other structs as `robot_state` and `robot_model`, and readers must not confuse them.
// The hardware fills it in read() and controllers read it in update(), in the same thread.
//
// Readers of the address check magic, size, the hash of the headers and the layout of the types. A controller
// of another build rejects the address.
struct SharedArmState {
  static constexpr std::uint64_t kMagic = 0x77'6f'64'6e'69'77'70'6d;  // "mpwindow"
  using Headers = std::array<char, 24>;

  // The position of these members must never change.
  std::uint64_t magic = kMagic;
  std::uint64_t size = sizeof(SharedArmState);
  Headers headers = this_build();  // hash of the headers that the hardware was compiled with
  std::uint64_t layout = kStateLayout;

  // As of the last read(). A new packet has a new `sequence`.
  ArmState state;
  Capabilities capabilities;
  // Model at that state; computes terms on demand. Outlives its readers, because the hardware is deactivated
  // after its controllers.
  ModelTerms* model = nullptr;
  // For requests to the arm; any thread but the loop's.
  Backend* backend = nullptr;
  ArmIndex arm = 0;
  // Readings for which the hardware stops the arm's gripper: set in each update() of a controller that has
  // stopped the arm, counted down in read(). A stop outlasts the controller that took it, briefly.
  mutable int stopped = 0;
  static constexpr int kStopped = 100;

  static Headers this_build();
};

// The state interfaces with the address.
inline constexpr const char* kStateInterface = "multipanda_state";
inline constexpr const char* kModelInterface = "multipanda_model";

// Returns the address as the value of a state interface.
inline double to_interface(const SharedArmState* shared) {
  return std::bit_cast<double>(reinterpret_cast<std::uintptr_t>(shared));
}

// Returns the struct behind a state interface's value; nullptr if there is none, or one of another build.
const SharedArmState* shared_arm_state(double value);
// Why the struct behind the value is not used: what was found, what was expected and what to do. Empty if it
// is used, or if there is none.
std::string shared_arm_state_refusal(double value);

}  // namespace multipanda
