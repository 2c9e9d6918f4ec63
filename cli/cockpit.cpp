#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <fmt/format.h>

#include "cli/cockpit_link.hpp"
#include "cli/program.hpp"
#include "cli/report.hpp"
#include "cli/run_arguments.hpp"
#include "cli/run_session.hpp"
#include "common/process.hpp"

// `multipanda cockpit` shows recorded logs like a run with `run --cockpit` (docs/cockpit.md).
namespace multipanda::cli {
namespace {

struct Arguments {
  std::string log, other;
  std::optional<std::uint16_t> port;
  bool until_input_ends = false;
};

}  // namespace

int show_logs(const std::vector<std::filesystem::path>& logs, std::optional<std::uint16_t> port,
              bool until_input_ends) {
  const Console console(true);
  const int end_file = eventfd(0, EFD_CLOEXEC);
  const auto end = [end_file] {
    const std::uint64_t one = 1;
    [[maybe_unused]] const auto size = ::write(end_file, &one, sizeof(one));
  };
  const SignalWatch signals([&end](int) { end(); });
  std::optional<InputEndWatch> input;
  if (until_input_ends) input.emplace(end);
  {
    const std::unique_ptr<CockpitLink> shown = open_cockpit(port);
    console.line(fmt::format("reading {}", logs.front().string()));
    shown->show_logs(logs);
    print_address(*shown, console);
    pollfd wait{.fd = end_file, .events = POLLIN, .revents = 0};
    while (::poll(&wait, 1, -1) < 0 && errno == EINTR) {
    }
    shown->close("the program has ended");
  }
  input.reset();
  ::close(end_file);
  return kSuccess;
}

void add_cockpit(Program& program) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command =
      program.add("cockpit", "Show recorded logs in a browser on this computer, until Ctrl-C",
                  "  multipanda cockpit runs                           the newest run in runs\n"
                  "  multipanda cockpit runs/before runs/after         two runs, compared");
  option(command, "log", arguments->log, "Log, folder of a run, or folder of runs (the newest is used)",
         required, named("LOG"));
  option(command, "other", arguments->other, "Log that is compared with it", named("LOG"));
  option(command, "--port", arguments->port,
         fmt::format("Port of 127.0.0.1 (default {}, or a free one; 0: a free one)", kUsualCockpitPort),
         within(0, 65535));
  command->add_flag("--until-input-ends", arguments->until_input_ends,
                    "End when standard input closes, as when the program that started it has ended");
  program.on(command, [arguments] {
    std::vector<std::filesystem::path> logs{own_log(find_log(arguments->log))};
    if (!arguments->other.empty()) logs.push_back(own_log(find_log(arguments->other)));
    return show_logs(logs, arguments->port, arguments->until_input_ends);
  });
}

}  // namespace multipanda::cli
