#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "analysis/excitation/excitation.hpp"
#include "cli/console.hpp"
#include "cli/program.hpp"
#include "runtime/signals.hpp"

// `multipanda excite`: a motion that tells an arm's parameters apart (docs/excitation.md).
namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;

struct ExciteWords {
  std::string model, out;
  ExcitationOptions options;
  double seconds = 0;
  std::vector<double> room;
  bool no_hand = false, json = false;
};

nlohmann::ordered_json to_json(const Excitation& excitation, const ExciteWords& words, const fs::path& file) {
  nlohmann::ordered_json json{{"model", words.model},
                              {"scene", file.string()},
                              {"condition", excitation.condition},
                              {"random_best", excitation.random_best},
                              {"random_median", excitation.random_median},
                              {"random_motions", words.options.random_motions},
                              {"parameters", excitation.parameters},
                              {"evaluations", excitation.evaluations},
                              {"duration_s", excitation.motion.duration()}};
  for (const auto& use : excitation.use) {
    json["limits"].push_back({{"name", use.name}, {"use", use.use}, {"worst", use.worst}});
  }
  return json;
}

void prepare(ExciteWords& words) {
  ExcitationOptions& options = words.options;
  if (words.seconds > 0) {
    options.cycles = std::floor((words.seconds - options.ramp) / options.period);
    if (options.cycles < 1) {
      throw UsageError(
          fmt::format("excite: {} s hold no whole period of {} s and a ramp of {} s; expected at least {} s, "
                      "or a shorter "
                      "--period",
                      words.seconds, options.period, options.ramp, options.period + options.ramp));
    }
  }
  if (!words.room.empty()) {
    for (Eigen::Index i = 0; i < 3; ++i) {
      options.limits.room_min[i] = words.room[static_cast<std::size_t>(i)];
      options.limits.room_max[i] = words.room[static_cast<std::size_t>(i + 3)];
    }
  }
}

int run(ExciteWords& words) {
  const Console console(words.json);
  const RobotDescription robot = load_robot(words.model);
  prepare(words);
  words.options.hand = !words.no_hand && robot.hand.has_value();
  std::atomic<bool> stop{false};
  const SignalWatch watch([&](int) {
    stop = true;
    console.line("stopping: the best so far (once more: quit at once)");
  });
  words.options.stop = &stop;
  words.options.progress = [&](const std::string& line) { console.line(line); };
  const Excitation excitation = optimise_excitation(robot, words.options);

  const fs::path file =
      words.out.empty() ? fs::path("excitation_" + robot.name + ".yaml") : fs::path(words.out);
  const std::string text = excitation_scene(
      excitation, words.model, words.options.hand,
      fmt::format("Made with --seed {} --harmonics {}.", words.options.seed, words.options.parts));
  if (file.has_parent_path()) fs::create_directories(file.parent_path());
  std::ofstream out(file);
  out << text;
  out.close();
  if (!out) throw std::runtime_error(file.string() + " cannot be written");

  console.line(fmt::format("condition number {:.2f}: {:.0f} % of the best of {} random motions ({:.1f})",
                           excitation.condition, 100 * excitation.condition / excitation.random_best,
                           words.options.random_motions, excitation.random_best));
  for (const auto& use : excitation.use) {
    console.line(fmt::format("  {:<15} {:5.1f} % of what is allowed   {}", use.name,
                             100 * std::max(0.0, use.use), use.worst));
  }
  console.line(fmt::format("{}: {:.1f} s of motion; multipanda run {} --record runs", file.string(),
                           excitation.motion.duration(),
                           file.has_parent_path() ? file.string() : "./" + file.string()));
  if (words.json) fmt::print("{}\n", to_json(excitation, words, file).dump());
  return excitation.condition < 0.5 * excitation.random_best ? kSuccess : kFailed;
}

}  // namespace

void add_excite(Program& program) {
  auto words = std::make_shared<ExciteWords>();
  ExcitationOptions& options = words->options;
  CLI::App* command = program.add(
      "excite",
      "Finds a motion that tells an arm's parameters apart, within all its limits, and writes a scene of it",
      "  multipanda excite fer\n"
      "  multipanda excite fr3 --out my/excitation.yaml --seconds 25 --harmonics 5 --seed 3\n"
      "  multipanda excite fer --room -0.2 -0.5 0.1 0.7 0.5 1.2\n"
      "  multipanda run ./excitation_fer.yaml --record runs");
  command->add_option("model", words->model, "Name (multipanda list models) or path of a model file")
      ->required();
  command->add_option("--out", words->out, "Scene file to write; default ./excitation_MODEL.yaml");
  command->add_option("--period", options.period, "Of the base frequency [s]")
      ->check(CLI::Range(1.0, 100.0))
      ->capture_default_str();
  command->add_option("--seconds", words->seconds, "Of motion at most; whole periods; default: two periods")
      ->check(CLI::PositiveNumber);
  command->add_option("--harmonics", options.parts, "Of every joint's series")
      ->check(CLI::Range(1, static_cast<int>(kMaxOvertones + 1)))
      ->capture_default_str();
  command->add_option("--seed", options.seed, "Of the random motions and the search")->capture_default_str();
  command->add_option("--evaluations", options.evaluations, "Motions that the search tries")
      ->check(CLI::Range(100, 1000000))
      ->capture_default_str();
  command
      ->add_option(
          "--room", words->room,
          "Where links, hand and tool stay, in the base's frame [m]; default -0.25 -0.9 0.08 0.9 0.9 1.3")
      ->expected(6)
      ->type_name("XMIN YMIN ZMIN XMAX YMAX ZMAX");
  command
      ->add_option("--reach", options.limits.reach,
                   "Something of 5 cm radius reaches so far before the flange [m]; 0: nothing")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  command->add_option("--payload", options.limits.payload, "Carried there, for the torque limits [kg]")
      ->check(CLI::Range(0.0, 10.0))
      ->capture_default_str();
  command->add_flag("--no-hand", words->no_hand, "The model's hand is not mounted");
  command->add_flag("--json", words->json, "Standard output has one JSON object");
  program.on(command, [words] { return run(*words); });
}

}  // namespace multipanda::cli
