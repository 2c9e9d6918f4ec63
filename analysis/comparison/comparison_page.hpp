#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "analysis/comparison/compare.hpp"
#include "analysis/comparison/gate.hpp"

namespace multipanda {

struct ComparedArm {
  Comparison comparison;
  AlignedPair shown;             // the repeat whose series are drawn
  std::vector<GateResult> gate;  // empty: no limits
};

// Everything as JSON: "real", "sim", "passed", "arms" (to_json of each, with "gate").
nlohmann::ordered_json comparison_results(const std::string& real, const std::string& sim,
                                          std::span<const ComparedArm> arms);

// Writes results.json, the pictures and report.html into the folder, which is made. The page's path. Throws
// std::runtime_error with what the script said if there is no page.
std::filesystem::path make_comparison_page(const std::filesystem::path& folder,
                                           const nlohmann::ordered_json& results,
                                           std::span<const ComparedArm> arms);

}  // namespace multipanda
