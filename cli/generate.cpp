#include <atomic>
#include <filesystem>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "cli/channel_arguments.hpp"
#include "cli/program.hpp"
#include "common/process.hpp"
#include "common/text.hpp"
#include "motion_generators/publish.hpp"

// `multipanda generate` runs motion generators in separate processes (docs/motion_generator.md).
namespace multipanda::cli {
namespace {

using circular_field::Course;
using circular_field::CourseRun;
using nlohmann::json;

struct GenerateOptions {
  std::string course;
  ChannelArguments channel;
  std::vector<std::string> to;
  double seconds = 0;
  bool rehearse = false, json = false;
};

// --to HAND=CONTROLLET.INPUT overrides the course for the named hands.
void redirect(const std::vector<std::string>& arguments, Course& course) {
  std::vector<std::string> names, seen;
  for (const auto& hand : course.hands) names.push_back(hand.spec.name);
  for (const auto& argument : arguments) {
    const std::size_t equals = argument.find('='), dot = argument.rfind('.');
    if (equals == std::string::npos || dot == std::string::npos || dot < equals) {
      throw UsageError(fmt::format("generate: expected --to HAND=CONTROLLET.INPUT, found '{}'", argument));
    }
    const std::string name = argument.substr(0, equals);
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) {
      throw UsageError(fmt::format("generate: the course has no hand '{}'{}", name,
                                   name_hint(name, names, "it has none")));
    }
    auto& publish = course.hands[static_cast<std::size_t>(found - names.begin())].publish;
    if (std::find(seen.begin(), seen.end(), name) == seen.end()) publish.clear();
    seen.push_back(name);
    publish.push_back(
        {argument.substr(equals + 1, dot - equals - 1), argument.substr(dot + 1), Vector3::Zero()});
  }
}

json to_json(const PublishReport& report, const Course& course) {
  json goals = json::object();
  for (std::size_t i = 0; i < course.hands.size(); ++i)
    goals[course.hands[i].spec.name] = report.goals_reached[i];
  json result = publication_of(report);
  result["course"] = course.name;
  result["plan_us"] = {{"median", report.step_median_us}, {"worst", report.step_worst_us}};
  result["clearance_m"] = report.clearance_m;
  result["speed_m_per_s"] = report.speed_m_per_s;
  result["goals_reached"] = goals;
  return result;
}

void print(const json& report, const Console& console) {
  console.line(fmt::format("{}: ended by {}; {} samples at {:.2f} Hz, {} missed, {} unsent",
                           report["course"].get<std::string>(), report["ended_by"].get<std::string>(),
                           report["samples"].get<std::uint64_t>(), report["rate_hz"].get<double>(),
                           report["missed"].get<std::uint64_t>(), report["unsent"].get<std::uint64_t>()));
  console.line(fmt::format("smallest clearance {:.3f} m, largest speed {:.3f} m/s, goals reached: {}",
                           report["clearance_m"].get<double>(), report["speed_m_per_s"].get<double>(),
                           report["goals_reached"].dump()));
}

int run(const GenerateOptions& options) {
  const Console console(options.json);
  Course course = circular_field::load_course(config_file("generate", "courses", options.course));
  redirect(options.to, course);
  std::atomic<bool> stop{false};
  const PublishOptions publish{.seconds = options.seconds, .stop = &stop};
  json result;
  if (options.rehearse) {
    if (course.repeat && options.seconds == 0) {
      throw UsageError("generate: this course repeats; set the length of the rehearsal with --seconds");
    }
    const auto starts = starts_of(course);
    CourseRun run(course, starts);
    result = to_json(rehearse_course(run, publish), course);
  } else {
    // Before any other thread, so that only this handler receives the signals.
    const SignalWatch signals([&stop](int) { stop = true; });
    const auto set_points = open_channel(options.channel, "circular_field");
    CourseSink sink(*set_points, course);
    CourseRun run(course, starts_in(*set_points, course));
    const json thread = set_up_publishing_thread();
    const PublishReport report = publish_course(run, sink, publish);
    result = to_json(report, course);
    result["thread"] = thread;
    result["channels"] = json::array();
    if (report.ended_by != "no_receiver") {
      set_points->rest();
      result["channels"] = set_points->channels();
    }
  }
  bool arrived = course.repeat || result["ended_by"] == "stopped";
  if (!arrived) {
    arrived = true;
    for (const auto& hand : course.hands) {
      arrived = arrived && result["goals_reached"][hand.spec.name] == hand.goals.size();
    }
  }
  if (!arrived) console.line("failed: not every hand reached its last goal");
  if (result["ended_by"] == "no_receiver") console.line("failed: the run no longer accepts poses");
  print(result, console);
  if (options.json) fmt::print("{}\n", result.dump());
  return arrived && result["ended_by"] != "no_receiver" ? kSuccess : kFailed;
}

}  // namespace

void add_generate(Program& program) {
  auto options = std::make_shared<GenerateOptions>();
  CLI::App* command = program.add("generate", "Publish moving set-points to a running scene at 1 kHz",
                                  "  multipanda generate circular-field common_target --seconds 30\n"
                                  "  multipanda generate circular-field course.yaml --socket PATH --json\n"
                                  "  multipanda generate circular-field two_hands --rehearse --seconds 60");
  command->require_subcommand(1);
  CLI::App* field = command->add_subcommand(
      "circular-field", "Move hands to their goals around moving obstacles with circular fields");
  field->footer(
      "Examples:\n"
      "  multipanda run two_arms &\n"
      "  multipanda generate circular-field common_target --seconds 30\n"
      "  multipanda generate circular-field common_target --to pair=coupled.pose\n"
      "  multipanda run two_arms --ros & multipanda generate circular-field common_target --ros");
  option(field, "course", options->course, "Name (config/courses) or path of a course file", required);
  add_channel_arguments(field, options->channel);
  option(field, "--seconds", options->seconds,
         "End after this time, even before the goals [s] (default: at the goals)", positive);
  option(field, "--to", options->to, "HAND=CONTROLLET.INPUT to use instead of the course's; may be repeated",
         named("TEXT"));
  field->add_flag("--rehearse", options->rehearse, "Plan only, as fast as possible, without a run");
  json_flag(field, options->json);
  program.on(field, [options] { return run(*options); });
}

}  // namespace multipanda::cli
