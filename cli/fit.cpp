#include <filesystem>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cli/program.hpp"
#include "models/write_robot.hpp"
#include "scene/build.hpp"
#include "sysid/identification/rollout_fit.hpp"
#include "sysid/measured/scene_model.hpp"
#include "yaml_reader/node.hpp"

// `multipanda fit` finds delay and torque bandwidth of an arm, or the stiffness of a surface, by replaying a
// log in simulation (docs/identification.md).
namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct FitArguments {
  std::string log, arm, scene, surface, plant_model, out;
  RolloutOptions options;
  bool json = false;
};

std::size_t arm_of(const Scene& scene, const MeasuredLog& log) {
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    if (scene.arms[i].name == log.arm) return i;
  }
  throw UsageError("fit: the scene in " + log.source + " has no arm '" + log.arm + "'");
}

// A log of another program in the given scene, by whose arm poses and gravity are computed. The torque in use
// is then the best record of what was commanded.
void put_into_scene(MeasuredLog& log, const std::string& file) {
  log.scene_text = read_text(file);
  log.scene_path = file;
  const Scene scene = rebuild_scene(log.scene_text, file);
  if (scene.arms.size() == 1) log.arm = scene.arms.front().name;
  complete_from_scene(log, log.scene_text, file, log.arm);
  if (log.tau_cmd.rows() == 0) log.tau_cmd = log.tau_d;
}

Json list(const Eigen::VectorXd& v) { return std::vector<double>(v.data(), v.data() + v.size()); }

Json rollout_json(const RolloutFit& fit) {
  return {{"rms", fit.rms},         {"passes", fit.passes},     {"converged", fit.converged},
          {"windows", fit.windows}, {"rollouts", fit.rollouts}, {"warnings", fit.warnings}};
}

int fit_surface_of(FitArguments& arguments, const MeasuredLog& log, const Scene& scene,
                   const Console& console) {
  const SurfaceFit fit = fit_surface(log, scene, arm_of(scene, log), arguments.surface, arguments.options);
  for (const std::string& warning : fit.fit.warnings) console.line("warning: " + warning);
  console.line(
      fmt::format("'{}': {:.0f} +- {:.0f} N/m (rough estimate {:.0f}), its surface {:+.3f} +- {:.3f} mm",
                  arguments.surface, fit.stiffness, fit.stiffness_half95, fit.rough_stiffness,
                  1e3 * fit.height, 1e3 * fit.height_half95));
  if (arguments.json) {
    fmt::print("{}\n", Json{{"surface", arguments.surface},
                            {"stiffness_n_per_m", fit.stiffness},
                            {"stiffness_half95_n_per_m", fit.stiffness_half95},
                            {"rough_stiffness_n_per_m", fit.rough_stiffness},
                            {"height_m", fit.height},
                            {"height_half95_m", fit.height_half95},
                            {"fit", rollout_json(fit.fit)}}
                           .dump());
  }
  return fit.fit.converged ? kSuccess : kFailed;
}

int fit_actuation_of(FitArguments& arguments, const MeasuredLog& log, const Scene& scene,
                     const Console& console) {
  const std::size_t arm = arm_of(scene, log);
  // Without the motor inertia of the simulation, which is not identified from this arm.
  RobotDescription robot = plant_robot_of(scene.arms[arm]);
  const SceneArm& own = scene.arms[arm];
  robot.motor_inertia = (own.plant_model.empty() ? robot_of(own) : load_robot(own.plant_model)).motor_inertia;
  const ActuationFit quick = fit_actuation(std::span(&log, 1), robot);
  console.line(fmt::format(
      "in closed form: delay {:.3f} +- {:.3f} ms, bandwidth {:.2f} +- {:.2f} Hz, noise {:.4f} N m",
      1e3 * quick.actuation.command_delay, 1e3 * quick.delay_half95, quick.actuation.torque_bandwidth_hz,
      quick.bandwidth_half95, quick.noise));
  const ActuationRollouts found =
      fit_actuation_by_rollouts(std::span(&log, 1), scene, arm, quick, arguments.options);
  for (const auto* warnings : {&quick.warnings, &found.fit.warnings}) {
    for (const std::string& warning : *warnings) console.line("warning: " + warning);
  }
  console.line(fmt::format("by rollouts: delay {:.3f} +- {:.3f} ms, bandwidth {:.2f} Hz",
                           1e3 * found.actuation.command_delay, found.fit.half95[0],
                           found.actuation.torque_bandwidth_hz));
  if (!arguments.out.empty()) {
    ActuationFit best = quick;
    best.actuation = found.actuation;
    apply(best, robot);
    robot.name = fs::path(arguments.out).stem().string();
    if (fs::path(arguments.out).has_parent_path())
      fs::create_directories(fs::path(arguments.out).parent_path());
    write_robot(robot, robot_of(scene.arms[arm]), arguments.out);
    console.line("model: " + arguments.out);
  }
  if (arguments.json) {
    fmt::print("{}\n", Json{{"delay_s", found.actuation.command_delay},
                            {"delay_half95_s", 1e-3 * found.fit.half95[0]},
                            {"bandwidth_hz", found.actuation.torque_bandwidth_hz},
                            {"closed_form",
                             {{"delay_s", quick.actuation.command_delay},
                              {"delay_half95_s", quick.delay_half95},
                              {"bandwidth_half95_hz", quick.bandwidth_half95}}},
                            {"friction_scale", list(quick.friction_scale)},
                            {"motor_inertia_kg_m2", list(quick.motor_inertia)},
                            {"friction_scale_half95", list(quick.friction_scale_half95)},
                            {"torque_noise_nm", quick.noise},
                            {"fit", rollout_json(found.fit)}}
                           .dump());
  }
  return found.fit.converged ? kSuccess : kFailed;
}

int run(FitArguments& arguments) {
  const Console console(arguments.json);
  MeasuredLogOptions reading;
  reading.arm = arguments.arm;
  std::vector<MeasuredLog> logs = read_measured(arguments.log, reading);
  if (logs.size() != 1) {
    throw UsageError(fmt::format("fit: {} has {} arms and one is fitted at a time; name it with --arm",
                                 arguments.log, logs.size()));
  }
  MeasuredLog& log = logs.front();
  if (!arguments.scene.empty()) put_into_scene(log, arguments.scene);
  if (log.scene_text.empty()) {
    throw UsageError("fit: " + arguments.log +
                     " has no scene to replay it in; name one with --scene, or use a log of `multipanda run "
                     "--record`");
  }
  Scene scene = rebuild_scene(log.scene_text, log.scene_path);
  if (!arguments.plant_model.empty()) scene.arms[arm_of(scene, log)].plant_model = arguments.plant_model;
  arguments.options.progress = [&console](const FitProgress& p) {
    std::string line = fmt::format("pass {:2}: residual {:.4f}", p.pass, p.rms);
    for (std::size_t i = 0; i < p.names.size(); ++i) {
      line += fmt::format(", {} {:.5g}", p.names[i], p.value[static_cast<Eigen::Index>(i)]);
    }
    console.line(line + fmt::format(" ({} rollouts)", p.rollouts));
    return true;
  };
  return arguments.surface.empty() ? fit_actuation_of(arguments, log, scene, console)
                                   : fit_surface_of(arguments, log, scene, console);
}

}  // namespace

void add_fit(Program& program) {
  auto arguments = std::make_shared<FitArguments>();
  CLI::App* command = program.add(
      "fit",
      "Find delay and torque bandwidth of an arm, or the stiffness of a surface, by replaying a log in "
      "simulation",
      "  multipanda fit runs/excitation/log.mcap --plant-model my/panda.yaml --out my/panda_tuned.yaml\n"
      "  multipanda fit runs/task_3/log.mcap --surface table --json");
  option(command, "log", arguments->log, "Log, or folder of a run", required, named("LOG"));
  option(command, "--arm", arguments->arm, "Arm to use if the log has several");
  option(command, "--scene", arguments->scene, "Scene of a log that has none: CSV, NPZ, a bag",
         existing_file);
  option(command, "--surface", arguments->surface, "Object of the scene whose stiffness is fitted",
         named("OBJECT"));
  option(command, "--plant-model", arguments->plant_model,
         "Model file of the arm (default: as in the scene)");
  option(command, "--out", arguments->out,
         "Model file to write, with the fitted delay, bandwidth, friction and noise");
  option(command, "--windows", arguments->options.windows, "Number of short replays per candidate", shown);
  option(command, "--threads", arguments->options.threads, "Number of threads, 0 for one per core", shown);
  json_flag(command, arguments->json);
  program.on(command, [arguments] { return run(*arguments); });
}

}  // namespace multipanda::cli
