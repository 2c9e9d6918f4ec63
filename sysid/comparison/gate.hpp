#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "sysid/comparison/compare.hpp"

// Limits of a comparison, for use in CI. A YAML file:
//   F_EE: {rmse: 1.7, max: 10}     # rmse: mean over axes and repeats; max: any axis of any repeat
//   q: {rmse: 0.06, axis: 0.1}     # axis: mean over repeats of the worst axis
//   lag_s: 0.02                    # of any repeat, in either direction
//   arms: {left: {tau: {rmse: 1}}} # for one arm, in place of the limits above
namespace multipanda {

struct GateLimit {
  std::string quantity;  // "F_EE", or "lag_s"
  std::string figure;    // "rmse", "axis", "max"; empty for lag_s
  double limit = 0;
  std::string place;  // "gate.yaml:3"
};

struct Gate {
  std::vector<GateLimit> limits;
  std::map<std::string, std::vector<GateLimit>> of_arm;  // in place of the same limits above
};

// Throws std::invalid_argument with file and line.
Gate read_gate(const std::filesystem::path& path);

struct GateResult {
  GateLimit limit;
  std::string arm, axis;        // axis that exceeds the limit; may be empty
  std::optional<double> found;  // none: the logs lack the quantity, which counts as a violated limit
  bool held = false;
  std::string text;  // one human-readable sentence
};
std::vector<GateResult> check_gate(const Gate& gate, const Comparison& comparison);

}  // namespace multipanda
