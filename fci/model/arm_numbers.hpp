#pragma once

#include <cstdint>

// What the model library knows of an arm: one block of plain numbers, found by its first words and
// overwritten before the library is handed out. No types of ours and no standard library types: the library
// that holds it depends on nothing.
namespace multipanda::fci {

struct LinkNumbers {
  double rotation[9];  // of the link in the one before it, row-major
  double position[3];  // [m]
  double mass;         // [kg]
  double com[3];       // centre of mass in the link [m]
  double inertia[9];   // about the centre of mass, axes of the link [kg m^2]
};

struct ArmNumbers {
  static constexpr int kJoints = 7;
  std::uint64_t marker[4];     // kMarker: where the block begins
  LinkNumbers links[kJoints];  // link 1 to 7, each turned about its z axis by its joint
  double flange_rotation[9];   // in the last link, row-major
  double flange_position[3];   // [m]
};

// Any four words that do not turn up in a library by chance.
inline constexpr std::uint64_t kMarker[4] = {0x6d756c746970616eu, 0x64612061726d206eu, 0x756d626572732076u,
                                             0x312e9d4fb07ac5e3u};

}  // namespace multipanda::fci
