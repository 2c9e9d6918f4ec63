#pragma once

#include "experiments/refine/refine.hpp"

namespace multipanda {

// Everything about a refinement, as docs/refine.md has it.
nlohmann::ordered_json refine_json(const Experiment& experiment, const ExperimentVariant& variant,
                                   const RefineOptions& options, const RefineResult& result);

// report.html beside refine.json; its path. Throws std::runtime_error with what the script said.
std::filesystem::path make_refine_page(const std::filesystem::path& json);

}  // namespace multipanda
