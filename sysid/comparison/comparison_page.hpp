#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "sysid/comparison/compare.hpp"

namespace multipanda {

struct ComparedArm {
  Comparison comparison;
  AlignedPair shown;             // repeat that is drawn
  std::vector<GateResult> gate;  // empty: no limits
};

// Everything as JSON: "real", "sim", "passed", "arms" (to_json of each, with "gate").
nlohmann::ordered_json comparison_results(const std::string& real, const std::string& sim,
                                          std::span<const ComparedArm> arms);

// Writes results.json, the plots and report.html into the folder, which is created. Returns the path of the
// page. Throws std::runtime_error with the script's output if it fails.
std::filesystem::path make_comparison_page(const std::filesystem::path& folder,
                                           const nlohmann::ordered_json& results,
                                           std::span<const ComparedArm> arms);

}  // namespace multipanda
