#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>

#include <Eigen/Core>

#include "core/cycle/backend.hpp"
#include "core/model/model_terms.hpp"
#include "core/modes/registry.hpp"
#include "core/types/tick.hpp"

// A number for the memory layout of all types that a user's library shares with the program. The hash of the
// headers finds changed headers; this number finds the same headers compiled differently: with vector flags
// (-mavx aligns Eigen's objects differently), another Eigen, another standard library or its debug mode. The
// same headers declare the same members in the same order, so sizes and alignments determine where each lies.
namespace multipanda {

// FNV-1a over the numbers.
constexpr std::uint64_t fold(std::initializer_list<std::size_t> numbers) {
  std::uint64_t hash = 14695981039346656037u;
  for (const std::size_t number : numbers) {
    for (unsigned shift = 0; shift < 64; shift += 8)
      hash = (hash ^ (number >> shift & 0xFFu)) * 1099511628211u;
  }
  return hash;
}

template <class... T>
constexpr std::uint64_t layout_of() {
  return fold({sizeof(T)..., alignof(T)...});
}

inline constexpr std::uint64_t kStateLayout = fold(
    {EIGEN_MAX_STATIC_ALIGN_BYTES, EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION,
     layout_of<Vector3, Matrix3, Vector6, JointVector, Pose, Twist, Wrench, ArmSet, RobotTime, HostTime, Load,
               ArmFrames, GripperState, InterfaceReport, ArmState, Capabilities, ArmModel, ModelTerms,
               ArmCommand, ArmRequest, GripperRequest, WorldRequest, RequestAnswer, ConnectionStatistics>()});

inline constexpr std::uint64_t kPluginLayout =
    fold({kStateLayout,
          layout_of<std::string, std::vector<bool>, std::vector<double>, std::vector<std::string>,
                    std::span<double>, std::shared_ptr<int>, std::function<void()>, std::optional<double>,
                    Registry, ParameterSet, Reference, ControlletDescriptor, ParameterSpec, InputSpec,
                    Obstacle, ControlletType, FeatureType, BackendType, BackendSetup, BackendSetup::Arm,
                    OwnedArm, ControlContext, FeatureContext, Target, Tick>()});

}  // namespace multipanda
