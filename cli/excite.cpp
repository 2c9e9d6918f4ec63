#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cli/program.hpp"
#include "common/process.hpp"
#include "sysid/excitation/excitation.hpp"

// `multipanda excite` finds a motion that makes the parameters of an arm identifiable
// (docs/identification.md).
namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;

struct ExciteArguments {
  std::string model, out;
  ExcitationOptions options;
  double seconds = 0;
  std::vector<double> room;
  bool no_hand = false, json = false;
};

nlohmann::ordered_json to_json(const Excitation& excitation, const ExciteArguments& arguments,
                               const fs::path& file) {
  nlohmann::ordered_json fields{{"model", arguments.model},
                                {"scene", file.string()},
                                {"condition", excitation.condition},
                                {"random_best", excitation.random_best},
                                {"random_median", excitation.random_median},
                                {"random_motions", arguments.options.random_motions},
                                {"parameters", excitation.parameters},
                                {"evaluations", excitation.evaluations},
                                {"duration_s", excitation.motion.duration()}};
  for (const auto& use : excitation.use) {
    fields["limits"].push_back({{"name", use.name}, {"use", use.use}, {"worst", use.worst}});
  }
  return fields;
}

void prepare(ExciteArguments& arguments) {
  ExcitationOptions& options = arguments.options;
  if (arguments.seconds > 0) {
    options.cycles = std::floor((arguments.seconds - options.ramp) / options.period);
    if (options.cycles < 1) {
      throw UsageError(fmt::format(
          "excite: {} s is too short for a whole period of {} s and a ramp of {} s; expected at least {} s, "
          "or a shorter --period",
          arguments.seconds, options.period, options.ramp, options.period + options.ramp));
    }
  }
  if (!arguments.room.empty()) {
    for (Eigen::Index i = 0; i < 3; ++i) {
      options.limits.room_min[i] = arguments.room[static_cast<std::size_t>(i)];
      options.limits.room_max[i] = arguments.room[static_cast<std::size_t>(i + 3)];
    }
  }
}

int run(ExciteArguments& arguments) {
  const Console console(arguments.json);
  const RobotDescription robot = load_robot(arguments.model);
  prepare(arguments);
  arguments.options.hand = !arguments.no_hand && robot.hand.has_value();
  std::atomic<bool> stop{false};
  const SignalWatch watch([&](int) {
    stop = true;
    console.line("stopping: the best motion so far is kept (interrupt again after 2 s to quit at once)");
  });
  arguments.options.stop = &stop;
  arguments.options.progress = [&](const std::string& line) { console.line(line); };
  const Excitation excitation = optimize_excitation(robot, arguments.options);

  const fs::path file =
      arguments.out.empty() ? fs::path("excitation_" + robot.name + ".yaml") : fs::path(arguments.out);
  const std::string text = excitation_scene(
      excitation, robot, arguments.model, arguments.options.hand,
      fmt::format("Made with --seed {} --harmonics {}.", arguments.options.seed, arguments.options.parts));
  if (file.has_parent_path()) fs::create_directories(file.parent_path());
  std::ofstream out(file);
  out << text;
  out.close();
  if (!out) throw std::runtime_error(file.string() + " cannot be written");

  console.line(fmt::format("condition number {:.2f}: {:.0f} % of the best of {} random motions ({:.1f})",
                           excitation.condition, 100 * excitation.condition / excitation.random_best,
                           arguments.options.random_motions, excitation.random_best));
  for (const auto& use : excitation.use) {
    console.line(fmt::format("  {:<15} {:5.1f} % of the limit   {}", use.name, 100 * std::max(0.0, use.use),
                             use.worst));
  }
  console.line(fmt::format("{}: {:.1f} s of motion; multipanda run {} --record runs", file.string(),
                           excitation.motion.duration(),
                           file.has_parent_path() ? file.string() : "./" + file.string()));
  if (arguments.json) fmt::print("{}\n", to_json(excitation, arguments, file).dump());
  return excitation.condition < 0.5 * excitation.random_best ? kSuccess : kFailed;
}

}  // namespace

void add_excite(Program& program) {
  auto arguments = std::make_shared<ExciteArguments>();
  ExcitationOptions& options = arguments->options;
  CLI::App* command =
      program.add("excite",
                  "Find a motion that makes the parameters of an arm identifiable, within its limits, and "
                  "write it as a scene",
                  "  multipanda excite fer\n"
                  "  multipanda excite fr3 --out my/excitation.yaml --seconds 25 --harmonics 5 --seed 3\n"
                  "  multipanda excite fer --room -0.2 -0.5 0.1 0.7 0.5 1.2\n"
                  "  multipanda run ./excitation_fer.yaml --record runs");
  option(command, "model", arguments->model, "Name (see multipanda list models) or path of a model file",
         required);
  option(command, "--out", arguments->out, "Scene file to write (default ./excitation_MODEL.yaml)");
  option(command, "--period", options.period, "Period of the base frequency [s]", within(1.0, 100.0), shown);
  option(command, "--seconds", arguments->seconds,
         "Longest duration of the motion, cut to whole periods [s] (default: two periods)", positive);
  option(command, "--harmonics", options.parts, "Number of harmonics per joint",
         within(1, static_cast<int>(kMaxHarmonics + 1)), shown);
  option(command, "--seed", options.seed, "Random seed of the initial motions and the search", shown);
  option(command, "--evaluations", options.evaluations, "Number of motions that the search tries",
         within(100, 1000000), shown);
  option(command, "--room", arguments->room,
         "Box in the base frame that the links, hand and tool must not leave [m] (default -0.25 "
         "-0.9 0.08 0.9 0.9 1.3)",
         expecting(6), named("XMIN YMIN ZMIN XMAX YMAX ZMAX"));
  option(command, "--reach", options.limits.reach,
         "Length of a payload of 5 cm radius in front of the flange [m], 0 for none", within(0.0, 1.0),
         shown);
  option(command, "--payload", options.limits.payload, "Mass of that payload, for the torque limits [kg]",
         within(0.0, 10.0), shown);
  command->add_flag("--no-hand", arguments->no_hand, "The hand of the model is not mounted");
  json_flag(command, arguments->json);
  program.on(command, [arguments] { return run(*arguments); });
}

}  // namespace multipanda::cli
