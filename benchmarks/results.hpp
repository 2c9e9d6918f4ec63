#pragma once

#include <map>
#include <string>

#include <nlohmann/json.hpp>

#include "benchmarks/cases.hpp"

namespace multipanda::bench {

struct Effort {
  std::size_t samples = 20000;  // of each timed call
  std::string filter = ".*";
};

// Everything that `--json` prints, measured now; docs/results/benchmarks.md explains the keys. Takes at most
// about 40 s: if the time is over, it takes fewer samples, and `samples` says how many.
nlohmann::ordered_json measure_all(const Effort& effort);

// The same as Markdown tables.
std::string markdown_of(const nlohmann::ordered_json& results);

// The ratios: "name: value", one per line.
std::string ratios_text(const nlohmann::ordered_json& results);

// Prints Google Benchmark's table of every part. `arguments` are its own flags.
int run_google_benchmarks(const std::vector<std::string>& arguments);

}  // namespace multipanda::bench
