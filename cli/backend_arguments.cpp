#include "cli/backend_arguments.hpp"

#include <fmt/format.h>

namespace multipanda::cli {

void add_backend_arguments(CLI::App* command, BackendArguments& arguments) {
  option(command, "--backend", arguments.backend,
         "Arms: mujoco (all simulated), fci (all real, or virtual ones of another process), virtual "
         "(virtual arms in this process, over sockets), pinocchio (all simulated without contact), "
         "replay (the states of --log), or a backend of the scene's plugins (default: as in the scene)",
         named("NAME"));
  option(command, "--log", arguments.log, "Log for --backend replay: a log.mcap or the folder of a run",
         named("LOG"));
  option(command, "--address", arguments.addresses,
         "Address of a real arm, once per arm; with --backend fci the default is 127.0.0.1 "
         "for the scene's first arm, 127.0.0.2 for the second, ...",
         named("ARM=ADDRESS"));
}

void add_experiment_arguments(CLI::App* command, BackendArguments& arguments) {
  arguments.backend = "mujoco";
  option(command, "--backend", arguments.backend,
         "Arms: mujoco (simulated), virtual (virtual arms in this process, over sockets), or fci (real "
         "arms, or virtual ones of another process): a person confirms every step",
         one_of({"mujoco", "virtual", "fci"}), shown);
  option(command, "--address", arguments.addresses,
         "Address of an arm, once per arm of the scene; needs --backend fci", named("ARM=ADDRESS"));
}

BackendOptions backend_options(const BackendArguments& arguments) {
  BackendOptions options = backend_named(arguments.backend);
  if ((options.kind == BackendKind::replay) == arguments.log.empty())
    throw UsageError("--backend replay and --log LOG go together");
  options.log = arguments.log;
  for (const auto& argument : arguments.addresses) {
    const auto pair = key_and_value(argument);
    if (!pair)
      throw UsageError(
          fmt::format("--address: expected ARM=ADDRESS, such as left=172.16.0.2; found '{}'", argument));
    for (const auto& [known, address] : options.addresses) {
      if (known == pair->first)
        throw UsageError(fmt::format("--address: arm '{}' is named twice", pair->first));
    }
    options.addresses.push_back(*pair);
  }
  return options;
}

}  // namespace multipanda::cli
