#include <algorithm>
#include <cmath>
#include <stop_token>
#include <thread>

#include <fmt/format.h>

#include "cli/program.hpp"
#include "cli/reduced_run.hpp"
#include "cli/run_arguments.hpp"
#include "cli/run_session.hpp"
#include "common/text.hpp"
#include "runtime/motion/joint_move.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::cli {
namespace {

struct MoveOptions {
  std::string scene;
  std::vector<std::string> goal;  // "home", or one number per joint
  std::string arm;                // empty: all
  double speed = 0.1;             // fraction of the joints' velocity limits
  bool fast = false, json = false, full_speed = false;
  std::string record;
  BackendArguments backend;
};

std::vector<double> numbers_of(const std::vector<std::string>& arguments) {
  std::vector<double> numbers;
  for (const auto& argument : arguments) {
    if (!read_number(argument, numbers.emplace_back()) || !std::isfinite(numbers.back()))
      throw UsageError(
          fmt::format("move: expected 'home' or one angle [rad] per joint, found '{}'", argument));
  }
  return numbers;
}

JointVector goal_of(const MoveOptions& options, const SceneArm& arm) {
  const RobotDescription robot = robot_of(arm);
  if (options.goal.size() == 1 && options.goal[0] == "home") return robot.q_home;
  const auto numbers = numbers_of(options.goal);
  const std::size_t n = robot.joint_count();
  if (numbers.size() != n) {
    throw UsageError(fmt::format("move: arm '{}' has {} joints, found {} angles (or use 'home')", arm.name, n,
                                 numbers.size()));
  }
  if (const std::string why = build_controller_model(arm)->joint_range().refusal(numbers); !why.empty())
    throw UsageError(fmt::format("move: arm '{}': {}", arm.name, why));
  return Eigen::Map<const Eigen::VectorXd>(numbers.data(), static_cast<Eigen::Index>(n));
}

// Simulated arms start at the scene's configuration: the motion is an event of the timeline.
void schedule(const JointMove& motion, Scene& scene) {
  TimelineEvent event{.at_s = 0.001,
                      .what = TimelineEvent::What::set_reference,
                      .controllet = move_controllet(scene.arms[motion.arm]),
                      .name = "joints"};
  event.values.assign(motion.goal.begin(), motion.goal.end());
  event.duration_s = motion.duration_s;
  scene.timeline.push_back(event);
  scene.duration_s = std::max(scene.duration_s, std::ceil(motion.duration_s + JointMove::kSettle_s));
}

// Motions of real arms are planned from their measured configuration, once it is known.
void move_from_measured(std::vector<JointMove>& motions, double speed, Session& session,
                        MeasuredJoints& measured, const std::stop_token& stop) {
  const auto stopped = [&stop] { return stop.stop_requested(); };
  if (!measured.wait_for_all(stopped)) return;
  double longest_s = 0;
  for (JointMove& motion : motions) {
    motion.plan(measured.q(motion), speed, session.scene().arms[motion.arm],
                session.scene().contact_bounds.hand_speed);
    longest_s = std::max(longest_s, motion.duration_s);
    const InstanceIndex instance = session.modes().find(move_controllet(session.scene().arms[motion.arm]));
    Request request{.kind = Request::Kind::set_target, .instance = instance};
    request.target.size = static_cast<std::uint8_t>(motion.goal.size());
    std::copy(motion.goal.begin(), motion.goal.end(), request.target.values.begin());
    request.target.duration_s = motion.duration_s;
    (void)session.modes().ask(request);  // a refusal shows at the end: the arm did not arrive
  }
  (void)measured.wait_until(measured.t() + longest_s + JointMove::kSettle_s, stopped);
  session.stop();
}

int run(const MoveOptions& options) {
  const Console console(options.json);
  SessionOptions session_options{
      .paced = !options.fast, .backend = backend_options(options.backend), .record = options.record};
  OpenedScene opened = open_scene(options.scene);
  refuse_carried_arms(opened.scene, "multipanda move");
  Scene scene = with_connections(std::move(opened.scene), session_options.backend);
  const std::vector<std::string> names = names_in(scene.arms);
  if (!options.arm.empty() && std::find(names.begin(), names.end(), options.arm) == names.end()) {
    throw UsageError(fmt::format("move: the scene has no arm '{}'{}", options.arm,
                                 name_hint(options.arm, names, "no arms")));
  }
  // Not recorded as a first run: a motion to a posture does not test the scene.
  const ReducedRun reduced_run(scene, options.full_speed ? Reduction::refused : Reduction::as_usual,
                               ReducedRun::first_runs_file());
  reduced_run.apply(scene);
  if (!reduced_run.text().empty()) console.line(reduced_run.text());
  scene.controllets.clear();
  scene.active.clear();
  scene.timeline.clear();
  const bool measured = !is_simulated(scene, session_options.backend);
  std::vector<JointMove> motions;
  scene.duration_s = measured ? 0 : JointMove::kSettle_s;
  for (ArmIndex i = 0; i < scene.arms.size(); ++i) {
    if (!options.arm.empty() && scene.arms[i].name != options.arm) continue;
    motions.push_back(add_joint_move(scene, i, goal_of(options, scene.arms[i])));
    if (measured) continue;
    motions.back().plan(scene.arms[i].q_start, options.speed, scene.arms[i], scene.contact_bounds.hand_speed);
    schedule(motions.back(), scene);
  }
  MeasuredJoints positions(scene.arms.size());
  session_options.observer = [&positions](const CycleRecord& record) { positions.take(record); };
  StopSignals signals(console);
  Session session(std::move(scene), opened.registry, std::move(session_options));
  std::jthread mover;
  if (measured) {
    mover = std::jthread([&](const std::stop_token& stop) {
      move_from_measured(motions, options.speed, session, positions, stop);
    });
  }
  const RunSummary summary = run_session(session, signals, console);
  if (mover.joinable()) {
    mover.request_stop();
    mover.join();
  }
  print_summary(summary, console);

  bool arrived = true;
  const std::vector<JointArray> q = positions.q();
  for (const JointMove& motion : motions) {
    double error = 0;
    for (Eigen::Index j = 0; j < motion.goal.size(); ++j) {
      error = std::max(error, std::abs(motion.goal[j] - q[motion.arm][static_cast<std::size_t>(j)]));
    }
    const bool there = error <= JointMove::kTolerance_rad;
    arrived = arrived && there;
    console.line(fmt::format("arm '{}' {} (largest joint error {:.4f} rad)", names[motion.arm],
                             there ? "reached its goal" : "did not reach its goal", error));
  }
  for (const auto& fault : summary.faults()) console.line("failed: " + fault);
  if (options.json) fmt::print("{}\n", to_json(summary));
  return arrived && summary.success() ? kSuccess : kFailed;
}

}  // namespace

void add_move(Program& program) {
  auto options = std::make_shared<MoveOptions>();
  CLI::App* command =
      program.add("move", "Move arms slowly from their current configuration to a joint configuration",
                  "  multipanda move two_arms home\n"
                  "  multipanda move two_arms --arm left 0 -0.5 0 -2.2 0 1.8 0.8\n"
                  "The path is a straight line in joint space. It is not checked for collisions.");
  option(command, "scene", options->scene,
         "Name or path of a scene file; its controllets and timeline do not run", required);
  option(command, "goal", options->goal, "'home', or one angle per joint [rad]", required);
  option(command, "--arm", options->arm, "Arm to move; the others are held (default: all)", named("NAME"));
  option(command, "--speed", options->speed, "Fraction of the joints' velocity limits, at most 0.2",
         within(0.01, JointMove::kLargestSpeed), shown);
  command->add_flag("--full-speed", options->full_speed,
                    "Use the scene's own bounds, even before its first run on physical arms");
  command->add_flag("--fast", options->fast, "Run as fast as possible instead of in real time");
  option(command, "--record", options->record, "Record the log into a new folder inside DIR", named("DIR"));
  add_backend_arguments(command, options->backend);
  json_flag(command, options->json);
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
