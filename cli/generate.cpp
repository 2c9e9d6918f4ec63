#include <atomic>
#include <filesystem>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "cli/console.hpp"
#include "cli/link_words.hpp"
#include "generators/course_sink.hpp"
#include "runtime/signals.hpp"
#include "scene/names.hpp"

// `multipanda generate`: motion generators, each a process of its own beside the run
// (docs/motion_generator.md).
namespace multipanda::cli {
namespace {

using circular_field::Course;
using circular_field::CourseRun;
using nlohmann::json;

struct GenerateOptions {
  std::string course;
  LinkWords link;
  std::vector<std::string> to;
  double seconds = 0;
  bool rehearse = false, json = false;
};

// --to HAND=CONTROLLET.INPUT: the hands that are named go there, and nowhere else.
void redirect(const std::vector<std::string>& words, Course& course) {
  std::vector<std::string> names, seen;
  for (const auto& hand : course.hands) names.push_back(hand.spec.name);
  for (const auto& word : words) {
    const std::size_t equals = word.find('='), dot = word.rfind('.');
    if (equals == std::string::npos || dot == std::string::npos || dot < equals) {
      throw UsageError(fmt::format("generate: expected --to HAND=CONTROLLET.INPUT, found '{}'", word));
    }
    const std::string name = word.substr(0, equals);
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) {
      throw UsageError(fmt::format("generate: the course has no hand '{}'{}", name,
                                   name_hint(name, names, "it has none")));
    }
    auto& publish = course.hands[static_cast<std::size_t>(found - names.begin())].publish;
    if (std::find(seen.begin(), seen.end(), name) == seen.end()) publish.clear();
    seen.push_back(name);
    publish.push_back({word.substr(equals + 1, dot - equals - 1), word.substr(dot + 1), Vector3::Zero()});
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
      throw UsageError("generate: this course repeats: say how long to rehearse it with --seconds");
    }
    const auto starts = starts_of(course);
    CourseRun run(course, starts);
    result = to_json(rehearse_course(run, publish), course);
  } else {
    // Before any other thread is there, so that signals are taken here alone.
    const SignalWatch signals([&stop](int) { stop = true; });
    const auto link = open_link(options.link, "circular_field");
    CourseSink sink(*link, course);
    CourseRun run(course, starts_in(*link, course));
    const json thread = set_up_publishing_thread();
    const PublishReport report = publish_course(run, sink, publish);
    result = to_json(report, course);
    result["thread"] = thread;
    result["channels"] = json::array();
    if (report.ended_by != "nobody_listens") {
      link->rest();
      result["channels"] = link->channels();
    }
  }
  bool arrived = course.repeat || result["ended_by"] == "stopped";
  if (!arrived) {
    arrived = true;
    for (const auto& hand : course.hands) {
      arrived = arrived && result["goals_reached"][hand.spec.name] == hand.goals.size();
    }
  }
  if (!arrived) console.line("failed: not every hand came to its last goal");
  if (result["ended_by"] == "nobody_listens") console.line("failed: the run takes no poses any more");
  print(result, console);
  if (options.json) fmt::print("{}\n", result.dump());
  return arrived && result["ended_by"] != "nobody_listens" ? kSuccess : kFailed;
}

}  // namespace

void add_generate(Program& program) {
  auto options = std::make_shared<GenerateOptions>();
  CLI::App* command = program.add("generate", "Publishes moving set-points to a running scene at 1 kHz",
                                  "  multipanda generate circular-field common_target --seconds 30\n"
                                  "  multipanda generate circular-field course.yaml --socket PATH --json\n"
                                  "  multipanda generate circular-field two_hands --rehearse --seconds 60");
  command->require_subcommand(1);
  CLI::App* field = command->add_subcommand(
      "circular-field", "Leads hands to their goals round moving obstacles (circular fields)");
  field->footer(
      "Examples:\n"
      "  multipanda run two_arms &\n"
      "  multipanda generate circular-field common_target --seconds 30\n"
      "  multipanda generate circular-field common_target --to pair=coupled.pose\n"
      "  multipanda run two_arms --ros & multipanda generate circular-field common_target --ros");
  field->add_option("course", options->course, "Name (config/courses) or path of a course file")->required();
  add_link_words(field, options->link);
  field->add_option("--seconds", options->seconds, "End after so long, whatever was reached")
      ->check(CLI::PositiveNumber);
  field
      ->add_option("--to", options->to,
                   "HAND=CONTROLLET.INPUT instead of what the course says; may be repeated")
      ->type_name("TEXT");
  field->add_flag("--rehearse", options->rehearse, "Plan only, as fast as possible; no run is needed");
  field->add_flag("--json", options->json, "One JSON object on standard output at the end");
  program.on(field, [options] { return run(*options); });
}

}  // namespace multipanda::cli
