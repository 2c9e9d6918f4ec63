#include "cli/backend_arguments.hpp"

#include <fmt/format.h>

namespace multipanda::cli {

void add_backend_arguments(CLI::App* command, BackendArguments& arguments) {
  command
      ->add_option(
          "--backend", arguments.backend,
          "Arms: mujoco (all simulated), fci (all real, or virtual ones of another process), virtual "
          "(virtual arms in this process, over sockets), pinocchio (all simulated without contact), "
          "replay (the states of --log), or a backend of the scene's plugins (default: as in the scene)")
      ->type_name("NAME");
  command->add_option("--log", arguments.log, "Log for --backend replay: a log.mcap or the folder of a run")
      ->type_name("LOG");
  command
      ->add_option("--address", arguments.addresses,
                   "Address of a real arm, once per arm; with --backend fci the default is 127.0.0.1 "
                   "for the scene's first arm, 127.0.0.2 for the second, ...")
      ->type_name("ARM=ADDRESS");
}

void add_experiment_arguments(CLI::App* command, BackendArguments& arguments) {
  arguments.backend = "mujoco";
  command
      ->add_option(
          "--backend", arguments.backend,
          "Arms: mujoco (simulated), virtual (virtual arms in this process, over sockets), or fci (real "
          "arms, or virtual ones of another process): a person confirms every step")
      ->check(CLI::IsMember({"mujoco", "virtual", "fci"}))
      ->capture_default_str();
  command
      ->add_option("--address", arguments.addresses,
                   "Address of an arm, once per arm of the scene; needs --backend fci")
      ->type_name("ARM=ADDRESS");
}

BackendOptions backend_options(const BackendArguments& arguments) {
  BackendOptions options = backend_named(arguments.backend);
  if ((options.kind == BackendKind::replay) == arguments.log.empty())
    throw UsageError("--backend replay and --log LOG go together");
  options.log = arguments.log;
  for (const auto& argument : arguments.addresses) {
    const std::size_t equals = argument.find('=');
    if (equals == std::string::npos || equals == 0 || equals + 1 == argument.size()) {
      throw UsageError(
          fmt::format("--address: expected ARM=ADDRESS, such as left=172.16.0.2; found '{}'", argument));
    }
    const std::string arm = argument.substr(0, equals);
    for (const auto& [known, address] : options.addresses) {
      if (known == arm) throw UsageError(fmt::format("--address: arm '{}' is named twice", arm));
    }
    options.addresses.emplace_back(arm, argument.substr(equals + 1));
  }
  return options;
}

}  // namespace multipanda::cli
