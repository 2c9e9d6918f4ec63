#include <atomic>

#include <fmt/format.h>

#include "cli/console.hpp"
#include "cli/link_words.hpp"
#include "generators/via_points/via_plan.hpp"
#include "runtime/signals.hpp"

// `multipanda via-points`: motions through via points, a process of its own beside the run
// (docs/motion_generator.md).
namespace multipanda::cli {
namespace {

using nlohmann::json;

struct ViaOptions {
  std::string file;
  LinkWords link;
  double scale = 1, seconds = 0;
  bool json = false;
};

json to_json(const PublishReport& report, const ViaRun& run, double duration_s) {
  json tracks = json::array();
  for (std::size_t i = 0; i < run.plan().tracks.size(); ++i) {
    const auto& track = run.plan().tracks[i];
    tracks.push_back({{"arm", track.arm},
                      {"quantity", to_string(track.quantity())},
                      {"via_points", track.joints.size() + track.poses.size()},
                      {"passed", report.goals_reached[i]}});
  }
  json result = publication_of(report);
  result["name"] = run.plan().name;
  result["duration_s"] = duration_s;
  result["tracks"] = tracks;
  return result;
}

int run(const ViaOptions& options) {
  const Console console(options.json);
  ViaPlan plan = load_via_plan(config_file("via-points", "via_points", options.file));
  plan.scale *= options.scale;
  std::atomic<bool> stop{false};
  // Before any other thread is there, so that signals are taken here alone.
  const SignalWatch signals([&stop](int) { stop = true; });
  const auto link = open_link(options.link, "via_points");
  ViaRun run(plan, starts_in(*link, plan));
  const double duration_s = run.duration();
  console.line(fmt::format("{}: {:.2f} s{}", plan.name, duration_s, plan.repeat ? ", repeated" : ""));
  const json thread = set_up_publishing_thread();
  const PublishReport report = publish_via(run, *link, {.seconds = options.seconds, .stop = &stop});
  json result = to_json(report, run, duration_s);
  result["thread"] = thread;
  result["channels"] = json::array();
  const bool heard = report.ended_by != "nobody_listens";
  if (heard) {
    link->rest();
    result["channels"] = link->channels();
  } else {
    console.line("failed: the run takes no set-points any more");
  }
  bool refused = false;
  for (const auto& channel : result["channels"]) {
    if (channel.value("refused", 0u) == 0) continue;
    refused = true;
    console.line(fmt::format("failed: {}.{} refused {} set-points", channel.value("controllet", ""),
                             channel.value("input", ""), channel.value("refused", 0u)));
  }
  console.line(fmt::format("{}: ended by {}; {} samples at {:.2f} Hz, {} missed, {} unsent", plan.name,
                           report.ended_by, report.samples, report.rate_hz, report.missed, report.unsent));
  if (options.json) fmt::print("{}\n", result.dump());
  return heard && !refused ? kSuccess : kFailed;
}

}  // namespace

void add_via_points(Program& program) {
  auto options = std::make_shared<ViaOptions>();
  CLI::App* command = program.add(
      "via-points", "Leads arms through via points, in joints or poses: publishes set-points at 1 kHz",
      "  multipanda run two_arms &\n"
      "  multipanda via-points wave --scale 0.5\n"
      "  multipanda run two_arms --ros & multipanda via-points my/file.yaml --ros");
  command->add_option("file", options->file, "Name (config/via_points) or path of a file of via points")
      ->required();
  add_link_words(command, options->link);
  command->add_option("--scale", options->scale, "Of the file's limits, above 0 and at most 1")
      ->check(CLI::Range(1e-3, 1.0));
  command->add_option("--seconds", options->seconds, "End after so long, braking")
      ->check(CLI::PositiveNumber);
  command->add_flag("--json", options->json, "One JSON object on standard output at the end");
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
