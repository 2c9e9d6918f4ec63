#pragma once

#include <cstddef>

// Fixed capacities. They bound every container of the loop, so that none ever grows. The joint count of an
// arm comes from its model; these are upper limits.
namespace multipanda {

inline constexpr std::size_t kMaxJoints = 16;         // per arm
inline constexpr std::size_t kMaxArms = 16;           // per process
inline constexpr std::size_t kMaxInstances = 64;      // controllet instances, the built-in holds included
inline constexpr std::size_t kMaxFeatures = 16;       // features per controllet instance
inline constexpr std::size_t kMaxParameterSize = 16;  // numbers in one parameter
inline constexpr std::size_t kMaxTargetValues = 16;   // numbers in one set-point

}  // namespace multipanda
