#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "analysis/comparison/compare.hpp"

// Limits of a comparison, for use in CI: a YAML file
//   F_EE: {rmse: 1.7, max: 10}     # mean over axes and repeats; any axis of any repeat
//   q: {rmse: 0.06, axis: 0.1}     # axis: mean over repeats of the worst axis
//   lag_s: 0.02                    # of any repeat, either way
//   arms: {left: {tau: {rmse: 1}}} # for one arm instead of the above
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
  std::string arm, axis;        // axis that broke it; may be empty
  std::optional<double> found;  // none: the logs do not tell, which counts as broken
  bool held = false;
  std::string text;  // one sentence for people
};
std::vector<GateResult> check_gate(const Gate& gate, const Comparison& comparison);

}  // namespace multipanda
