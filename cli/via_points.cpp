#include <atomic>

#include <fmt/format.h>

#include "cli/channel_arguments.hpp"
#include "cli/program.hpp"
#include "common/process.hpp"
#include "motion_generators/via_points/via_plan.hpp"

// `multipanda via-points` publishes motions through via points in a separate
// process (docs/motion_generator.md).
namespace multipanda::cli {
namespace {

using nlohmann::json;

struct ViaOptions {
  std::string file;
  ChannelArguments channel;
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
  // Before any other thread, so that only this handler receives the signals.
  const SignalWatch signals([&stop](int) { stop = true; });
  const auto set_points = open_channel(options.channel, "via_points");
  ViaRun run(plan, starts_in(*set_points, plan));
  const double duration_s = run.duration();
  console.line(fmt::format("{}: {:.2f} s{}", plan.name, duration_s, plan.repeat ? ", repeated" : ""));
  const json thread = set_up_publishing_thread();
  const PublishReport report = publish_via(run, *set_points, {.seconds = options.seconds, .stop = &stop});
  json result = to_json(report, run, duration_s);
  result["thread"] = thread;
  result["channels"] = json::array();
  const bool accepted = report.ended_by != "no_receiver";
  if (accepted) {
    set_points->rest();
    result["channels"] = set_points->channels();
  } else {
    console.line("failed: the run no longer accepts set-points");
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
  return accepted && !refused ? kSuccess : kFailed;
}

}  // namespace

void add_via_points(Program& program) {
  auto options = std::make_shared<ViaOptions>();
  CLI::App* command = program.add(
      "via-points", "Move arms through via points (joint positions or poses); publishes set-points at 1 kHz",
      "  multipanda run two_arms &\n"
      "  multipanda via-points wave --scale 0.5\n"
      "  multipanda run two_arms --ros & multipanda via-points my/file.yaml --ros");
  option(command, "file", options->file, "Name (config/via_points) or path of a file of via points",
         required);
  add_channel_arguments(command, options->channel);
  option(command, "--scale", options->scale,
         "Fraction of the file's limits, above 0 and at most 1 (default 1)", within(1e-3, 1.0));
  option(command, "--seconds", options->seconds,
         "Brake and end after this time [s] (default: at the last point)", positive);
  json_flag(command, options->json);
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
