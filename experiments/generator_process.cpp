#include "experiments/generator_process.hpp"

#include <chrono>
#include <cstdint>
#include <stdexcept>

namespace multipanda {

GeneratorProcess::GeneratorProcess(const Options& options)
    : process_({.program = options.program,
                .arguments = arguments(options),
                .output = std::filesystem::path(options.messages).concat(".json"),
                .errors = options.messages}) {}

std::vector<std::string> GeneratorProcess::arguments(const Options& options) {
  std::vector<std::string> all{
      "generate", "circular-field", options.course.string(), "--seconds", std::to_string(options.seconds),
      "--json"};
  if (options.ros_node.empty()) {
    all.insert(all.end(), {"--socket", options.socket.string()});
  } else {
    all.insert(all.end(), {"--ros", "--node", options.ros_node});
  }
  return all;
}

nlohmann::ordered_json GeneratorProcess::finish(double timeout_s) {
  process_.stop(std::chrono::milliseconds(static_cast<std::int64_t>(timeout_s * 1e3)));
  auto report = nlohmann::ordered_json::parse(process_.output(), nullptr, false);
  if (report.is_discarded()) {
    throw std::runtime_error("the motion generator wrote no report (exit code " +
                             std::to_string(process_.exit_code()) + "); its messages:\n" + process_.errors());
  }
  return report;
}

std::filesystem::path own_program() { return std::filesystem::read_symlink("/proc/self/exe"); }

}  // namespace multipanda
