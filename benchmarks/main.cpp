#include <exception>
#include <regex>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include "benchmarks/results.hpp"

namespace {

using multipanda::bench::Effort;

int run(int argc, char** argv) {
  CLI::App app(
      "Measures the loop, the controllets, switching and the simulation (docs/results/benchmarks.md)");
  app.name("multipanda bench");
  app.footer(
      "Examples:\n"
      "  multipanda bench                                   Google Benchmark's table of every part\n"
      "  multipanda bench --json > bench.json               one object, within 45 s\n"
      "  multipanda bench --markdown --filter 'cycle_us|limits_us'\n"
      "Arguments after -- go to Google Benchmark, for example: multipanda bench -- --benchmark_min_time=0.1");
  Effort effort;
  bool json = false, markdown = false;
  auto* as_json = app.add_flag("--json", json, "Print one JSON object; notes go to standard error");
  app.add_flag("--markdown", markdown, "Measure the same and print tables")->excludes(as_json);
  app.add_option("--filter", effort.filter, "Regular expression that selects by name, as in cycle_us/hold/1")
      ->type_name("REGEX");
  auto* samples =
      app.add_option("--samples", effort.samples, "Number of timed calls of each, with --json or --markdown")
          ->check(CLI::Range(1, 10'000'000))
          ->capture_default_str();
  app.allow_extras();
  app.prefix_command();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  std::vector<std::string> rest = app.remaining();
  if (!rest.empty() && rest.front() == "--") rest.erase(rest.begin());
  try {
    if (json || markdown) {
      if (!rest.empty()) {
        fmt::print(stderr, "multipanda bench: unexpected argument '{}'\n", rest.front());
        return 2;
      }
      const auto results = multipanda::bench::measure_all(effort);
      fmt::print("{}\n", json ? results.dump() : multipanda::bench::markdown_of(results));
      if (json) fmt::print(stderr, "{}", multipanda::bench::ratios_text(results));
      return 0;
    }
    if (samples->count() > 0) {
      fmt::print(stderr, "multipanda bench: --samples requires --json or --markdown\n");
      return 2;
    }
    rest.insert(rest.begin(), "--benchmark_filter=" + effort.filter);
    return multipanda::bench::run_google_benchmarks(rest);
  } catch (const std::regex_error& error) {
    fmt::print(stderr, "multipanda bench: --filter '{}': {}\n", effort.filter, error.what());
    return 2;
  } catch (const std::exception& error) {
    fmt::print(stderr, "multipanda bench: {}\n", error.what());
    return 1;
  }
}

}  // namespace

int main(int argc, char** argv) { return run(argc, argv); }
