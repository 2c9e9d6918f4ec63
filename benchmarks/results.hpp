#pragma once

#include <map>
#include <string>

#include <nlohmann/json.hpp>

#include "benchmarks/figures.hpp"

namespace multipanda::bench {

struct Effort {
  std::size_t samples = 20000;  // of each timed call
  std::string filter = ".*";
};

// Everything that `--json` prints, measured now; docs/benchmarks.md says what each key means. Takes at most
// about 40 s: where time runs out, fewer samples were taken, and `samples` says how many.
nlohmann::ordered_json measure_all(const Effort& effort);

// The same as Markdown tables, for people.
std::string markdown_of(const nlohmann::ordered_json& results);

// The figures that are judged: "name: value", one per line.
std::string ratios_text(const nlohmann::ordered_json& results);

// The default of the program: Google Benchmark's table of everything, part by part. `arguments` are its own
// flags.
int run_google_benchmarks(const std::vector<std::string>& arguments);

}  // namespace multipanda::bench
