#include "cli/run_arguments.hpp"

#include <dlfcn.h>
#include <stdexcept>

#include <fmt/format.h>

#include "cli/cockpit_link.hpp"
#include "cli/program.hpp"

namespace multipanda::cli {

void add_cockpit_arguments(CLI::App* command, CockpitArguments& arguments, const std::string& help) {
  command
      ->add_option_function<std::vector<std::string>>(
          "--cockpit",
          [&arguments](const std::vector<std::string>& values) {
            arguments.asked = true;
            if (values.empty() || values.front().empty()) return;
            std::size_t used = 0;
            int port = -1;
            try {
              port = std::stoi(values.front(), &used);
            } catch (const std::exception&) {
            }
            if (used != values.front().size() || port < 0 || port > 65535)
              throw UsageError(
                  fmt::format("--cockpit: expected a port from 0 to 65535, found '{}'", values.front()));
            arguments.port = static_cast<std::uint16_t>(port);
          },
          fmt::format("{} (default {}, or a free one; 0: a free one; docs/cockpit.md)", help,
                      kUsualCockpitPort))
      ->expected(0, 1)
      ->type_name("[PORT]");
}

std::unique_ptr<CockpitLink> open_cockpit(std::optional<std::uint16_t> port) {
  std::error_code error;
  const auto folder = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  auto library = (folder / "../lib/libmultipanda_cockpit.so").lexically_normal();  // in a wheel or .deb
  if (!std::filesystem::exists(library, error)) library = folder / "libmultipanda_cockpit.so";
  void* loaded = dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (loaded == nullptr)
    throw std::runtime_error(
        fmt::format("--cockpit: the page server cannot be loaded ({}); build it with "
                    "./multipanda cockpit --help (a program for arms alone has none)",
                    dlerror()));
  const auto version = reinterpret_cast<unsigned (*)()>(dlsym(loaded, "multipanda_cockpit_version"));
  const auto open = reinterpret_cast<void* (*)(const std::optional<std::uint16_t>*)>(
      dlsym(loaded, "multipanda_open_cockpit"));
  if (version == nullptr || open == nullptr || version() != kCockpitVersion)
    throw std::runtime_error(fmt::format(
        "--cockpit: {} does not belong to the same build as the program: build again", library.string()));
  return std::unique_ptr<CockpitLink>(static_cast<CockpitLink*>(open(&port)));
}

OpenedCockpit::OpenedCockpit(const CockpitArguments& arguments, const Console& console) : console_(console) {
  if (arguments.asked) cockpit_ = open_cockpit(arguments.port);
}
OpenedCockpit::~OpenedCockpit() = default;

void OpenedCockpit::on_stop_between_runs(std::function<void()> call) {
  if (cockpit_) cockpit_->on_stop_between_runs(std::move(call));
}

void OpenedCockpit::prepare(SessionOptions& session) {
  if (cockpit_) cockpit_->prepare(session);
}

void OpenedCockpit::show(Session& session) {
  if (!cockpit_) return;
  cockpit_->show(session);
  if (!printed_) print_address(*cockpit_, console_);
  printed_ = true;
}

void OpenedCockpit::end() {
  if (cockpit_) cockpit_->end();
}

void print_address(const CockpitLink& cockpit, const Console& console) {
  if (!cockpit.has_page())
    console.line("this build has no cockpit page (docs/cockpit.md); programs can use the cockpit at");
  console.line(cockpit.address());
}

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
