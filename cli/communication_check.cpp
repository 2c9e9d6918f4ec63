#include <atomic>
#include <iostream>
#include <unistd.h>

#include <fmt/format.h>

#include "cli/program.hpp"
#include "common/process.hpp"
#include "doctor/arm_stream.hpp"
#include "doctor/examination.hpp"

namespace multipanda::cli {
namespace {

struct CommunicationCheckOptions {
  std::string address;
  double seconds = 10;
  bool json = false, yes = false;
};

// Asks before the arm is put under torque control.
bool confirmed(const CommunicationCheckOptions& options, const Console& console) {
  if (options.yes) return true;
  if (isatty(STDIN_FILENO) == 0) {
    throw UsageError("communication-test: there is no terminal; confirm with --yes that the arm at " +
                     options.address + " may be put under torque control");
  }
  console.raw(
      fmt::format("The arm at {} will be under torque control with zero torque for {:g} s: it compensates "
                  "gravity and yields when pushed.\nKeep the user stop at hand. Continue? [y/N] ",
                  options.address, options.seconds));
  std::string answer;
  std::getline(std::cin, answer);
  return answer == "y" || answer == "Y" || answer == "yes";
}

int run(const CommunicationCheckOptions& options) {
  const Console console(options.json);
  if (!confirmed(options, console)) {
    console.line("canceled; nothing was done");
    return kFailed;
  }
  const doctor::Purpose purpose = doctor::purpose_of({options.address});
  std::atomic<bool> stopped{false};
  const SignalWatch watch([&](int) { stopped = true; });
  const auto reading =
      doctor::run_communication_test(options.address, options.seconds, [&] { return !stopped; });
  const auto findings = doctor::judge_communication(reading, purpose);
  for (const auto& finding : findings) {
    for (const auto& line : doctor::to_text(finding, console.has_color())) console.line(line);
  }
  const doctor::Judgment verdict = doctor::verdict(findings);
  console.line(fmt::format("verdict: {}", verdict == doctor::Judgment::ok
                                              ? "the connection is fit for torque control"
                                          : verdict == doctor::Judgment::bad
                                              ? "the connection is not fit for torque control"
                                              : "the connection works, but see the warnings above"));
  if (options.json) fmt::print("{}\n", doctor::to_json(findings, purpose, options.seconds));
  return verdict == doctor::Judgment::bad ? kFailed : kSuccess;
}

}  // namespace

void add_communication_test(Program& program) {
  auto options = std::make_shared<CommunicationCheckOptions>();
  CLI::App* command = program.add(
      "communication-test",
      "Put an arm under torque control with zero torque and count lost and late packets",
      "  multipanda communication-test 172.16.0.2\n"
      "  multipanda communication-test 127.0.0.1 --seconds 5 --yes --json     a virtual arm, in a script\n"
      "Fails (exit code 1) if the arm stops itself, or the connection is not fit for torque control.");
  option(command, "address", options->address, "Address of the arm", required, named("ADDRESS"));
  option(command, "--seconds", options->seconds, "Duration by the arm's clock [s] (default 10)",
         within(0.1, 3600.0));
  command->add_flag("--yes", options->yes, "Do not ask before the arm is put under control");
  json_flag(command, options->json);
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
