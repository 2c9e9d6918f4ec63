#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>

#include "core/cycle/backend.hpp"
#include "core/model/model_terms.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

// Change this with every change of the structs below: both sides of the address must agree on them.
inline constexpr const char* kBuildName = "2026-11 c";

// An arm's complete state, shared with controllers in the same process. ros2_control's state interfaces carry
// doubles; the bits of `<arm>/robot_state` are this struct's address, as in Franka's own packages. The
// hardware fills it in read() and controllers read it in update(), in the same thread.
//
// Readers of the address check magic, version, sizes and build. A controller of another build rejects the
// address and uses position, velocity and effort only.
struct SharedArmState {
  static constexpr std::uint64_t kMagic = 0x77'6f'64'6e'69'77'70'6d;  // "mpwindow"
  static constexpr std::uint32_t kVersion = 1;

  std::uint64_t magic = kMagic;
  std::uint32_t version = kVersion;
  std::uint32_t size = sizeof(SharedArmState);
  std::uint32_t state_size = sizeof(ArmState);
  std::uint32_t model_size = sizeof(ModelTerms);
  std::array<char, 16> build = this_build();

  // As of the last read(). A new packet has a new `sequence`.
  ArmState state;
  Capabilities capabilities;
  // Model at that state; computes terms on demand. Outlives its readers: the hardware is deactivated after
  // its controllers.
  ModelTerms* model = nullptr;
  // For requests to the arm; any thread but the loop's.
  Backend* backend = nullptr;
  ArmIndex arm = 0;

  static constexpr std::array<char, 16> this_build() {
    std::array<char, 16> build{};
    const char* const text = kBuildName;
    for (std::size_t i = 0; i < build.size() - 1 && text[i] != '\0'; ++i) build[i] = text[i];
    return build;
  }
};

// Returns the address as the value of a state interface.
inline double to_interface(const SharedArmState* shared) {
  return std::bit_cast<double>(reinterpret_cast<std::uintptr_t>(shared));
}

// Returns the struct behind a state interface's value; nullptr if there is none, or one of another build.
inline const SharedArmState* shared_arm_state(double value) {
  const auto address = std::bit_cast<std::uintptr_t>(value);
  constexpr std::uintptr_t kFirstPage = 4096, kLast = std::uintptr_t{1} << 47;  // of user space
  if (address < kFirstPage || address >= kLast || address % alignof(SharedArmState) != 0) return nullptr;
  const auto* shared = reinterpret_cast<const SharedArmState*>(address);  // NOLINT(performance-no-int-to-ptr)
  if (shared->magic != SharedArmState::kMagic || shared->version != SharedArmState::kVersion ||
      shared->size != sizeof(SharedArmState) || shared->state_size != sizeof(ArmState) ||
      shared->model_size != sizeof(ModelTerms) || shared->build != SharedArmState::this_build()) {
    return nullptr;
  }
  return shared;
}

}  // namespace multipanda
