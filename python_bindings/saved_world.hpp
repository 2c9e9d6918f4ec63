#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

// Everything that determines a world: its beginning and all requests since. A world is computed again from
// it, bit for bit.
namespace multipanda {

// The beginning of a world. Missing values are those of the scene.
struct WorldStart {
  std::uint64_t seed = 1;  // of the noise, and of the hidden plants
  bool hidden = false;     // the simulated arms differ from their models by a draw of the seed
  std::map<std::string, std::vector<double>> q_start;  // by arm [rad]
  std::map<std::string, std::vector<double>> objects;  // by free object: x y z [m], qw qx qy qz
  // Controllets that run from the first cycle on; then the scene's timeline is left out.
  std::optional<std::vector<std::string>> active;
};

// One call of ControlledWorld::command().
struct WorldCommand {
  std::uint64_t cycle = 0;  // cycles completed at its arrival
  nlohmann::json request;
};

struct SavedWorld {
  std::string scene;  // its text
  WorldStart start;
  std::vector<WorldCommand> commands;  // in order
  std::uint64_t cycles = 0;
  std::vector<double> state;  // of that cycle, to check the computed one
  std::string refusal;        // the refusals until then

  std::vector<std::uint8_t> pack() const;
  // Throws std::invalid_argument if these bytes are none that pack() made.
  static SavedWorld unpack(const std::uint8_t* bytes, std::size_t size);
};

}  // namespace multipanda
