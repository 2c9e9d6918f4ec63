#include <cmath>
#include <filesystem>
#include <numbers>
#include <stdexcept>

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "common/text.hpp"
#include "experiments/experiment.hpp"
#include "models/robot_description.hpp"
#include "scene/load.hpp"
#include "scene/rewrite.hpp"
#include "sysid/excitation/excitation.hpp"
#include "sysid/refine/refine.hpp"

namespace multipanda {
namespace {

constexpr double kNear = 2.2;  // bases closer than this may collide: twice an arm's reach plus a margin [m]
constexpr double kRangeMargin = 0.1;  // from the ends of joint 1's range [rad]
constexpr double kTurnMissing = 0.4;  // largest difference from facing away completely [rad]
constexpr double kPause = 1.0;        // at rest before and after a motion [s]

void add(YAML::Node timeline, const std::string& event) { timeline.push_back(YAML::Load(event)[0]); }

// The scene's arms with one joint impedance each; floors stay.
YAML::Node bare_scene(const Scene& scene, const std::string& name, double max_speed) {
  YAML::Node root = YAML::Load(scene.text);
  YAML::Node floors(YAML::NodeType::Sequence);
  if (root["objects"]) {
    for (const auto& object : root["objects"]) {
      if (object["shape"] && object["shape"].Scalar() == "plane") floors.push_back(object);
    }
  }
  root["name"] = name;
  root["objects"] = floors;
  root.remove("ros");
  root["controllets"] = YAML::Node(YAML::NodeType::Sequence);
  root["active"] = YAML::Node(YAML::NodeType::Sequence);
  root["timeline"] = YAML::Node(YAML::NodeType::Sequence);
  for (const auto& arm : scene.arms) {
    YAML::Node controllet;
    controllet["name"] = arm.name + "_joints";
    controllet["type"] = "joint_impedance";
    controllet["arms"] = arm.name;
    controllet["parameters"] = YAML::Load(excitation_gains(static_cast<std::size_t>(arm.q_start.size())));
    controllet["inputs"]["joints"]["max_speed_rad_per_s"] = number_text(max_speed);
    root["controllets"].push_back(controllet);
    root["active"].push_back(arm.name + "_joints");
  }
  return root;
}

// The angle about its base's z by which arm `index` has to turn to face away from the others; 0
// without arms nearby.
double turn_away(const Scene& scene, std::size_t index) {
  const Pose& X = scene.arms[index].X_WB;
  Vector3 away = Vector3::Zero();
  for (std::size_t k = 0; k < scene.arms.size(); ++k) {
    const Vector3 apart = X.position - scene.arms[k].X_WB.position;
    if (k != index && apart.norm() < kNear) away += apart.normalized() / std::max(0.1, apart.norm());
  }
  if (away.norm() < 1e-6) return 0;
  const Vector3 in_base = X.rotation.transpose() * away;
  return std::atan2(in_base.y(), in_base.x());
}

// The same, limited to joint 1's range: a slightly smaller angle is sufficient.
double turn_within_range(double turn, const ExcitationMotion& motion, const RobotDescription& robot,
                         const std::string& arm) {
  if (turn == 0) return 0;
  double low = 0, high = 0;
  for (double at = 0; at < motion.duration(); at += 0.01) {
    const double q = motion.at(at).q[0];
    low = at == 0 ? q : std::min(low, q);
    high = at == 0 ? q : std::max(high, q);
  }
  const double least = robot.limits.q_min[0] + kRangeMargin - low,
               most = robot.limits.q_max[0] - kRangeMargin - high;
  const double possible = std::max(least, std::min(most, turn));
  if (least > most || std::abs(possible - turn) > kTurnMissing) {
    throw std::invalid_argument(
        fmt::format("arm '{}' must turn by {:.2f} rad to face away from the neighboring arms; joint 1 and "
                    "the excitation allow {:.2f} to {:.2f}; excite each arm separately, with its own scene",
                    arm, turn, least, most));
  }
  return possible;
}

}  // namespace

std::string excitation_path(const std::string& model) {
  const auto path =
      std::filesystem::path(experiments_folder()) / "scenes" / ("excitation_" + model + ".yaml");
  if (!std::filesystem::exists(path)) {
    throw std::invalid_argument(
        fmt::format("there is no excitation for the model '{0}'; make one with `multipanda excite {0}` and "
                    "pass it with --excitation",
                    model));
  }
  return path.string();
}

ExcitationFile read_excitation(const std::string& path, const Registry& registry) {
  const Scene scene = load_scene(path, registry);
  for (const auto& event : scene.timeline) {
    if (event.what != TimelineEvent::What::set_motion || event.sine.size() != event.rise.size()) continue;
    const auto n = static_cast<std::size_t>(scene.arms.at(0).q_start.size());
    if (event.sine.size() != n) continue;
    ExcitationFile file{.path = path, .motion = {.q_start = scene.arms[0].q_start, .series = {}}};
    Harmonic& series = file.motion.series;
    series.period_s = event.period_s;
    series.cycles = event.cycles;
    series.ramp_s = event.ramp_s;
    std::copy(event.sine.begin(), event.sine.end(), series.sine.begin());
    std::copy(event.rise.begin(), event.rise.end(), series.rise.begin());
    for (const auto& part : event.overtones) {
      HarmonicPart& harmonic = series.harmonics[series.harmonic_count++];
      std::copy(part.sine.begin(), part.sine.end(), harmonic.sine.begin());
      std::copy(part.rise.begin(), part.rise.end(), harmonic.rise.begin());
    }
    for (std::size_t i = 0; i < n; ++i) file.max_speed = std::max(file.max_speed, series.top_speed(i, 1));
    file.max_speed = std::ceil(10 * file.max_speed) / 10;
    return file;
  }
  throw std::invalid_argument(
      path +
      " has no motion of all joints of its first arm; expected a scene written by `multipanda excite`");
}

ExcitationRun excitation_run(const Scene& scene, const std::vector<ExcitationFile>& excitations,
                             const std::vector<RobotDescription>& robots, std::uint64_t seed) {
  double max_speed = 0.5;
  for (const auto& excitation : excitations) max_speed = std::max(max_speed, excitation.max_speed);
  YAML::Node root = bare_scene(scene, "excitation", max_speed);
  root["seed"] = std::to_string(seed);
  ExcitationRun run;
  double t = 0.1 + kExcitationApproach;
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    const SceneArm& arm = scene.arms[i];
    JointVector q = excitations[i].motion.q_start;
    if (q.size() != arm.q_start.size()) {
      throw std::invalid_argument(fmt::format("arm '{}' has {} joints, the excitation {} is for {}", arm.name,
                                              arm.q_start.size(), excitations[i].path, q.size()));
    }
    const double duration = excitations[i].motion.duration();
    q[0] += turn_within_range(turn_away(scene, i), excitations[i].motion, robots[i], arm.name);
    root["arms"][i]["start_rad"] = YAML::Load(list_text({q.begin(), q.end()}));
    add(root["timeline"], reference_event(0.1, arm.name + "_joints", q));
    t += kPause;
    add(root["timeline"], motion_event(t, arm.name + "_joints", excitations[i].motion));
    run.windows.push_back({arm.name, t - 0.5 * kPause, t + duration + 0.5 * kPause});
    t += duration;
  }
  root["duration_s"] = number_text(t + kPause);
  run.scene = yaml_text(root) + "\n";
  return run;
}

std::string approach_scene(const Scene& scene) {
  YAML::Node root = bare_scene(scene, "approach", 0.5);
  for (const auto& arm : scene.arms) {
    add(root["timeline"], reference_event(0.1, arm.name + "_joints", arm.q_start));
  }
  root["duration_s"] = number_text(kExcitationApproach + 6);  // slow enough for the speed limit
  return yaml_text(root) + "\n";
}

}  // namespace multipanda
