#include "cli/backend_words.hpp"

#include <fmt/format.h>

namespace multipanda::cli {

void add_backend_words(CLI::App* command, BackendWords& words) {
  command
      ->add_option("--backend", words.backend,
                   "Whose arms: mujoco (all simulated), fci (all real, or virtual ones of another process), "
                   "virtual (virtual arms in this process, over sockets); default: as the scene says")
      ->check(CLI::IsMember({"mujoco", "fci", "virtual"}));
  command
      ->add_option("--address", words.addresses,
                   "Where a real arm is, once per arm; with --backend fci, arms without one are at 127.0.0.1 "
                   "(the scene's first), 127.0.0.2, ...")
      ->type_name("ARM=ADDRESS");
}

void add_simulation_words(CLI::App* command, BackendWords& words) {
  words.backend = "mujoco";
  command
      ->add_option("--backend", words.backend,
                   "mujoco, or virtual: the same arms as virtual ones, over sockets")
      ->check(CLI::IsMember({"mujoco", "virtual"}))
      ->capture_default_str();
}

BackendOptions backend_options(const BackendWords& words) {
  BackendOptions options;
  if (words.backend == "mujoco") options.arms = ArmsFrom::mujoco;
  if (words.backend == "fci") options.arms = ArmsFrom::fci;
  if (words.backend == "virtual") options.arms = ArmsFrom::virtual_arms;
  for (const auto& word : words.addresses) {
    const std::size_t equals = word.find('=');
    if (equals == std::string::npos || equals == 0 || equals + 1 == word.size()) {
      throw UsageError(fmt::format("--address: expected ARM=ADDRESS, as left=172.16.0.2; found '{}'", word));
    }
    const std::string arm = word.substr(0, equals);
    for (const auto& [known, address] : options.addresses) {
      if (known == arm) throw UsageError(fmt::format("--address: arm '{}' is named twice", arm));
    }
    options.addresses.emplace_back(arm, word.substr(equals + 1));
  }
  return options;
}

}  // namespace multipanda::cli
