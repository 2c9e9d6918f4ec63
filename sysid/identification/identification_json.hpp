#pragma once

#include <filesystem>

#include <nlohmann/json.hpp>

#include "sysid/identification/identify.hpp"
#include "sysid/identification/predict.hpp"

namespace multipanda {

// What `identify --json` prints; docs/identification.md has every key.
nlohmann::ordered_json to_json(const Identification& identification);
// With the series of measured and predicted torque, for the page.
nlohmann::ordered_json to_json_with_series(const Identification& identification);

// One model's entry of `predict --json`.
nlohmann::ordered_json to_json(const Prediction& prediction);

// Makes DIR/identification.html from it. Throws std::runtime_error with the script's output.
void write_identification_page(const Identification& identification, const std::filesystem::path& directory);

}  // namespace multipanda
