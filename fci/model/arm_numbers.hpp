#pragma once

#include <cstdint>

// The arm's data in the model library: one block of plain numbers, found by its first words and overwritten
// before the library is sent. It uses no types of this project or the standard library, because the model
// library must not depend on anything.
namespace multipanda::fci {

struct LinkNumbers {
  double rotation[9];  // of the link in the one before it, row-major
  double position[3];  // [m]
  double mass;         // [kg]
  double com[3];       // center of mass in the link [m]
  double inertia[9];   // about the center of mass, axes of the link [kg m^2]
};

struct ArmNumbers {
  static constexpr int kJoints = 7;
  std::uint64_t marker[4];     // kMarker: where the block begins
  LinkNumbers links[kJoints];  // link 1 to 7, each turned about its z axis by its joint
  double flange_rotation[9];   // in the last link, row-major
  double flange_position[3];   // [m]
  // 1: a load moves the center of mass of the last link, but that link's inertia stays as it is about the old
  // one, as a Panda's library has it; 0: about the common one.
  double keeps_last_inertia;
};

// Four arbitrary words that do not occur in a library by chance.
inline constexpr std::uint64_t kMarker[4] = {0x6d756c746970616eu, 0x64612061726d206eu, 0x756d626572732076u,
                                             0x312e9d4fb07ac5e3u};

}  // namespace multipanda::fci
