#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <mutex>
#include <numbers>
#include <stop_token>
#include <thread>

#include <fmt/format.h>

#include "cli/backend_words.hpp"
#include "cli/program.hpp"
#include "cli/run_session.hpp"
#include "core/reference/quintic.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"
#include "scene/names.hpp"

namespace multipanda::cli {
namespace {

constexpr double kSettle_s = 1.0;        // after the motion, before the result is judged
constexpr double kLargestSpeed = 0.2;    // share of the joints' velocity limits
constexpr double kTolerance_rad = 0.02;  // of every joint at the end

struct MoveOptions {
  std::string scene;
  std::vector<std::string> goal;  // "home", or one number per joint
  std::string arm;                // empty: all
  double speed = 0.1;             // share of the joints' velocity limits
  bool fast = false, json = false;
  std::string record;
  BackendWords backend;
};

std::vector<double> numbers_of(const std::vector<std::string>& words) {
  std::vector<double> numbers;
  for (const auto& word : words) {
    std::size_t used = 0;
    double value = std::numeric_limits<double>::quiet_NaN();
    try {
      value = std::stod(word, &used);
    } catch (const std::exception&) {
      used = 0;
    }
    if (used != word.size() || !std::isfinite(value)) {
      throw UsageError(fmt::format("move: expected 'home' or one angle [rad] per joint, found '{}'", word));
    }
    numbers.push_back(value);
  }
  return numbers;
}

JointVector goal_of(const MoveOptions& options, const SceneArm& arm) {
  const RobotDescription robot = robot_of(arm);
  if (options.goal.size() == 1 && options.goal[0] == "home") return robot.q_home;
  const auto numbers = numbers_of(options.goal);
  const std::size_t n = robot.joint_count();
  if (numbers.size() != n) {
    throw UsageError(fmt::format("move: arm '{}' has {} joints, found {} angles (or say 'home')", arm.name, n,
                                 numbers.size()));
  }
  const JointVector goal = Eigen::Map<const Eigen::VectorXd>(numbers.data(), static_cast<Eigen::Index>(n));
  const ArmLimits& limits = arm.safety.joints;
  for (Eigen::Index j = 0; j < goal.size(); ++j) {
    if (goal[j] >= limits.q_min[j] && goal[j] <= limits.q_max[j]) continue;
    const bool degrees = std::abs(goal[j]) > 2 * std::numbers::pi;
    throw UsageError(fmt::format("move: joint {} of arm '{}' reaches from {:g} to {:g} rad, found {:g}{}",
                                 j + 1, arm.name, limits.q_min[j], limits.q_max[j], goal[j],
                                 degrees ? " (angles are radians; this looks like degrees)" : ""));
  }
  return goal;
}

struct Motion {
  ArmIndex arm = 0;
  JointVector goal;
  double slowest_joint = 0;  // velocity limit [rad/s]
  double duration_s = 0;

  // Minimum jerk keeps every joint below its share of speed.
  void plan(const JointVector& from, double speed) {
    duration_s = 0;
    for (Eigen::Index j = 0; j < goal.size(); ++j) {
      duration_s = std::max(duration_s,
                            QuinticSegment::duration_for(std::abs(goal[j] - from[j]), speed * slowest_joint));
    }
  }
};

std::string controllet_of(const SceneArm& arm) { return arm.name + "_move"; }

// A joint_impedance of its own for an arm that moves; it begins at the measured configuration.
Motion add_motion(const MoveOptions& options, ArmIndex index, Scene& scene) {
  const SceneArm& arm = scene.arms[index];
  Motion motion{.arm = index, .goal = goal_of(options, arm)};
  motion.slowest_joint = arm.safety.joints.dq_max.minCoeff();
  const std::string name = controllet_of(arm);
  InputSpec joints{.name = "joints", .quantity = Quantity::joints};
  joints.max_speed = kLargestSpeed * motion.slowest_joint;
  scene.controllets.push_back({.name = name, .type = "joint_impedance", .arms = {index}, .inputs = {joints}});
  scene.active.push_back(name);
  return motion;
}

// Simulated arms stand where the scene says: the motion is an event of the scene.
void schedule(const Motion& motion, Scene& scene) {
  TimelineEvent event{.at_s = 0.001,
                      .what = TimelineEvent::What::set_reference,
                      .controllet = controllet_of(scene.arms[motion.arm]),
                      .name = "joints"};
  event.values.assign(motion.goal.begin(), motion.goal.end());
  event.duration_s = motion.duration_s;
  scene.timeline.push_back(event);
  scene.duration_s = std::max(scene.duration_s, std::ceil(motion.duration_s + kSettle_s));
}

// Where the arms stand, as the run goes on.
class Positions {
 public:
  explicit Positions(std::size_t arms) : q_(arms) {}

  void take(const CycleRecord& record) {
    const std::lock_guard lock(mutex_);
    for (std::size_t i = 0; i < q_.size(); ++i) q_[i] = record.arms[i].q;
    t_ = record.t.seconds();
    seen_ = seen_ || std::all_of(record.arms.begin(), record.arms.end(),
                                 [](const ArmSample& arm) { return arm.sequence > 0; });
    changed_.notify_all();
  }
  std::vector<JointArray> q() const {
    const std::lock_guard lock(mutex_);
    return q_;
  }
  double t() const {
    const std::lock_guard lock(mutex_);
    return t_;
  }
  // Every arm has said where it stands. False: asked to stop before.
  bool wait_for_all(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    return changed_.wait(lock, stop, [this] { return seen_; });
  }
  bool wait_until(double t_s, const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    return changed_.wait(lock, stop, [&] { return t_ >= t_s; });
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::vector<JointArray> q_;
  double t_ = 0;
  bool seen_ = false;
};

// Real arms stand wherever they stand: planned from there, once they have said it.
void move_from_measured(std::vector<Motion>& motions, double speed, Session& session, Positions& positions,
                        const std::stop_token& stop) {
  if (!positions.wait_for_all(stop)) return;
  const std::vector<JointArray> q = positions.q();
  double longest_s = 0;
  for (Motion& motion : motions) {
    motion.plan(Eigen::Map<const Eigen::VectorXd>(q[motion.arm].data(), motion.goal.size()), speed);
    longest_s = std::max(longest_s, motion.duration_s);
    const InstanceIndex instance = session.modes().find(controllet_of(session.scene().arms[motion.arm]));
    Request request{.kind = Request::Kind::set_target, .instance = instance};
    request.target.size = static_cast<std::uint8_t>(motion.goal.size());
    std::copy(motion.goal.begin(), motion.goal.end(), request.target.values.begin());
    request.target.duration_s = motion.duration_s;
    (void)session.modes().ask(request);  // refused: seen at the end, the arm did not arrive
  }
  (void)positions.wait_until(positions.t() + longest_s + kSettle_s, stop);
  session.stop();
}

int run(const MoveOptions& options) {
  const Console console(options.json);
  SessionOptions session_options{
      .paced = !options.fast, .backend = backend_options(options.backend), .record = options.record};
  OpenedScene opened = open_scene(options.scene);
  Scene scene = with_arms_from(std::move(opened.scene), session_options.backend);
  std::vector<std::string> names;
  for (const auto& arm : scene.arms) names.push_back(arm.name);
  if (!options.arm.empty() && std::find(names.begin(), names.end(), options.arm) == names.end()) {
    throw UsageError(fmt::format("move: the scene has no arm '{}'{}", options.arm,
                                 name_hint(options.arm, names, "no arms")));
  }
  scene.controllets.clear();
  scene.active.clear();
  scene.timeline.clear();
  const bool measured =
      std::any_of(scene.arms.begin(), scene.arms.end(), [](const auto& arm) { return arm.fci.has_value(); });
  std::vector<Motion> motions;
  scene.duration_s = measured ? 0 : kSettle_s;
  for (ArmIndex i = 0; i < scene.arms.size(); ++i) {
    if (!options.arm.empty() && scene.arms[i].name != options.arm) continue;
    motions.push_back(add_motion(options, i, scene));
    if (measured) continue;
    motions.back().plan(scene.arms[i].q_start, options.speed);
    schedule(motions.back(), scene);
  }
  Positions positions(scene.arms.size());
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
  for (const Motion& motion : motions) {
    double error = 0;
    for (Eigen::Index j = 0; j < motion.goal.size(); ++j) {
      error = std::max(error, std::abs(motion.goal[j] - q[motion.arm][static_cast<std::size_t>(j)]));
    }
    const bool there = error <= kTolerance_rad;
    arrived = arrived && there;
    console.line(fmt::format("arm '{}' {} (largest joint error {:.4f} rad)", names[motion.arm],
                             there ? "is there" : "did not arrive", error));
  }
  for (const auto& fault : summary.faults()) console.line("failed: " + fault);
  if (options.json) fmt::print("{}\n", to_json(summary));
  return arrived && summary.success() ? kSuccess : kFailed;
}

}  // namespace

void add_move(Program& program) {
  auto options = std::make_shared<MoveOptions>();
  CLI::App* command =
      program.add("move", "Moves arms slowly to a joint configuration, from wherever they stand",
                  "  multipanda move two_arms home\n"
                  "  multipanda move two_arms --arm left 0 -0.5 0 -2.2 0 1.8 0.8\n"
                  "The path is a straight line in the joints and is not checked for collisions.");
  command
      ->add_option("scene", options->scene,
                   "Name or path of a scene file; its controllets and timeline do not run")
      ->required();
  command->add_option("goal", options->goal, "'home', or one angle per joint [rad]")->required();
  command->add_option("--arm", options->arm, "Only this arm; the others are held")->type_name("NAME");
  command->add_option("--speed", options->speed, "Share of the joints' velocity limits, at most 0.2")
      ->check(CLI::Range(0.01, kLargestSpeed))
      ->capture_default_str();
  command->add_flag("--fast", options->fast, "As fast as possible instead of paced to the wall clock");
  command->add_option("--record", options->record, "Write a log into a new folder inside DIR")
      ->type_name("DIR");
  add_backend_words(command, options->backend);
  command->add_flag("--json", options->json, "One JSON object on standard output at the end");
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
