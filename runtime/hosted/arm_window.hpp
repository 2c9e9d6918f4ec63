#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>

#include "core/cycle/backend.hpp"
#include "core/model/model_terms.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

// Changes with every change of the structs below: what is passed by address must mean the same on both sides.
inline constexpr const char* kBuildName = "2026-11 a";

// All that hardware knows of an arm, for controllers in the same process. ros2_control's state interfaces
// carry doubles; `<arm>/robot_state` carries this struct's address in the bits of one, as users of Franka's
// packages know it. The hardware fills it in read(); controllers look at it in update(): the same thread.
//
// Whoever reads the address checks magic, version, sizes and build: a controller of another build refuses it
// and works from position, velocity and effort alone.
struct ArmWindow {
  static constexpr std::uint64_t kMagic = 0x77'6f'64'6e'69'77'70'6d;  // "mpwindow"
  static constexpr std::uint32_t kVersion = 1;

  std::uint64_t magic = kMagic;
  std::uint32_t version = kVersion;
  std::uint32_t size = sizeof(ArmWindow);
  std::uint32_t state_size = sizeof(ArmState);
  std::uint32_t model_size = sizeof(ModelTerms);
  std::array<char, 16> build = this_build();

  // As of the last read(). A packet that is new has another `sequence`.
  ArmState state;
  Capabilities capabilities;
  // At that state; computes what is asked for. Outlives no reader: the hardware is deactivated after its
  // controllers.
  ModelTerms* model = nullptr;
  // Requests to the arm, any thread but the loop's.
  Backend* backend = nullptr;
  ArmIndex arm = 0;

  static constexpr std::array<char, 16> this_build() {
    std::array<char, 16> build{};
    const char* const text = kBuildName;
    for (std::size_t i = 0; i < build.size() - 1 && text[i] != '\0'; ++i) build[i] = text[i];
    return build;
  }
};

// The address as the value of a state interface.
inline double to_interface(const ArmWindow* window) {
  return std::bit_cast<double>(reinterpret_cast<std::uintptr_t>(window));
}

// The window behind a state interface's value; nullptr: there is none, or one of another build.
inline const ArmWindow* window_behind(double value) {
  const auto address = std::bit_cast<std::uintptr_t>(value);
  constexpr std::uintptr_t kFirstPage = 4096, kLast = std::uintptr_t{1} << 47;  // of user space
  if (address < kFirstPage || address >= kLast || address % alignof(ArmWindow) != 0) return nullptr;
  const auto* window = reinterpret_cast<const ArmWindow*>(address);  // NOLINT(performance-no-int-to-ptr)
  if (window->magic != ArmWindow::kMagic || window->version != ArmWindow::kVersion ||
      window->size != sizeof(ArmWindow) || window->state_size != sizeof(ArmState) ||
      window->model_size != sizeof(ModelTerms) || window->build != ArmWindow::this_build()) {
    return nullptr;
  }
  return window;
}

}  // namespace multipanda
