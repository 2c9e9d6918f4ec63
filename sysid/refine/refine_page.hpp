#pragma once

#include "sysid/refine/refine.hpp"

namespace multipanda {

// The whole refinement as JSON; docs/refine.md has the keys.
nlohmann::ordered_json refine_json(const Experiment& experiment, const ExperimentVariant& variant,
                                   const RefineOptions& options, const RefineResult& result);

// Makes report.html next to refine.json and returns its path. Throws std::runtime_error with
// the script's output.
std::filesystem::path make_refine_page(const std::filesystem::path& json);

}  // namespace multipanda
