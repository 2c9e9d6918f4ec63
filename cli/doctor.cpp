#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "cli/program.hpp"
#include "common/text.hpp"
#include "doctor/examination.hpp"
#include "scene/load.hpp"

namespace multipanda::cli {
namespace {

struct DoctorOptions {
  std::vector<std::string> addresses;
  std::string scene = "two_arms";
  double seconds = 10;
  bool json = false;
};

int run(const DoctorOptions& options) {
  // A missing scene is a usage error, not a finding about this computer.
  const auto scenes = available_scenes();
  if (options.scene.find_first_of("/.") == std::string::npos &&
      std::find(scenes.begin(), scenes.end(), options.scene) == scenes.end()) {
    throw UsageError(fmt::format("doctor: there is no scene '{}'{}", options.scene,
                                 name_hint(options.scene, scenes, "there are no scenes")));
  }
  const Console console(options.json);
  const doctor::Purpose purpose = doctor::purpose_of(options.addresses);
  console.line(fmt::format("multipanda doctor: {}, {:g} s per measurement",
                           purpose == doctor::Purpose::real_arms
                               ? "judged for real arms"
                               : "judged for simulated arms (to judge for a real arm, give its address)",
                           options.seconds));
  const auto findings =
      doctor::examine({.addresses = options.addresses, .scene = options.scene, .seconds = options.seconds},
                      [&](const doctor::Finding& finding) {
                        for (const auto& line : doctor::to_text(finding, console.has_color()))
                          console.line(line);
                      });
  const doctor::Judgment verdict = doctor::verdict(findings);
  const auto count = [&](doctor::Judgment judged) {
    return std::count_if(findings.begin(), findings.end(),
                         [judged](const auto& f) { return f.judged == judged; });
  };
  console.line(fmt::format("{} ok, {} unknown, {} warning(s), {} bad", count(doctor::Judgment::ok),
                           count(doctor::Judgment::unknown), count(doctor::Judgment::warning),
                           count(doctor::Judgment::bad)));
  for (const auto& sentence : doctor::blame(findings)) console.line("cause: " + sentence);
  if (options.json) fmt::print("{}\n", doctor::to_json(findings, purpose, options.seconds));
  return verdict == doctor::Judgment::bad ? kFailed : kSuccess;
}

}  // namespace

void add_doctor(Program& program) {
  auto options = std::make_shared<DoctorOptions>();
  CLI::App* command = program.add(
      "doctor",
      "Measure whether this computer, its network and its arms sustain 1 kHz, with causes and remedies",
      "  multipanda doctor                          this computer, for simulated arms\n"
      "  multipanda doctor 172.16.0.2 172.16.0.3    also the network and two arms; moves nothing\n"
      "  multipanda doctor --scene my/scene.yaml --seconds 60 --json > doctor.json\n"
      "Fails (exit code 1) if something is bad; docs/commission.md explains every line.");
  option(command, "addresses", options->addresses, "Addresses of arms to examine", named("ADDRESS"));
  option(command, "--scene", options->scene, "Scene whose control cycle is timed (default two_arms)");
  option(command, "--seconds", options->seconds, "Duration of each measurement [s] (default 10)",
         within(0.1, 3600.0));
  json_flag(command, options->json);
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
