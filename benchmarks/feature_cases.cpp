#include <cmath>
#include <numbers>
#include <stdexcept>

#include <fmt/format.h>

#include "benchmarks/cases.hpp"
#include "benchmarks/loops.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "models/arm_source.hpp"
#include "scene/load.hpp"

namespace multipanda::bench {
namespace {

constexpr double kRange = 0.05, kSmall = 0.1;  // [m], manipulability
constexpr double kPairs = 3;

// Two Pandas that face each other, hands a few centimeters apart in the home configuration.
Scene meeting_scene(const Registry& registry) {
  return parse_scene(
      "name: meeting\n"
      "arms:\n"
      "  - {name: arm0, model: fer, known_friction: model, base: {position_m: [-0.357, 0.02, 0]}}\n"
      "  - {name: arm1, model: fer, known_friction: model, base: {position_m: [0.357, -0.02, 0], rpy_rad: "
      "[0, 0, 3.14159265358979]}}\n"
      "objects:\n"
      "  - {name: floor, shape: plane}\n",
      "meeting.yaml", registry);
}

// As many hulls with as many corners as an imported arm may have: columns behind the base, too long for
// bounding spheres to rule out any link, and too far away to push.
std::vector<BaseHull> columns() {
  constexpr double kRadius = 0.1, kHalf = 0.45;  // [m]
  constexpr std::size_t kSides = kMaxShapeVertices / 2;
  std::vector<BaseHull> hulls(6);
  for (std::size_t k = 0; k < hulls.size(); ++k) {
    for (std::size_t i = 0; i < kSides; ++i) {
      const double angle = 2 * std::numbers::pi * static_cast<double>(i) / kSides;
      const Vector3 p(-0.35 + kRadius * std::cos(angle),
                      0.2 * (static_cast<double>(k) - 2.5) + kRadius * std::sin(angle), 0.3);
      hulls[k].push_back(p + kHalf * Vector3::UnitZ());
      hulls[k].push_back(p - kHalf * Vector3::UnitZ());
    }
  }
  return hulls;
}

struct Meeting {
  std::vector<std::string> features;
  bool hulls = false;  // around both bases
};

std::shared_ptr<MotionLoop> meeting(const Registry& registry, const Meeting& how) {
  const Scene scene = meeting_scene(registry);
  const auto& features = how.features;
  Arms arms(scene);
  for (std::size_t i = 0; how.hulls && i < scene.arms.size(); ++i) {
    RobotDescription robot = load_robot(scene.arms[i].model);
    robot.base_hulls = columns();
    arms.models[i] =
        std::make_shared<const ArmModel>(arm_model_source(robot, scene.arms[i].X_WB, scene.arms[i].hand));
    arms.arms[i].model = arms.models[i];
  }
  return motion_loop(arms, 2, *registry.controllet("dual_cartesian_impedance"), registry, features);
}

// Returns an output of the first instance of the loop.
double output(MotionLoop& loop, const std::string& name) {
  const Instance& law = loop.cycle.modes().instance(loop.cycle.modes().find("law0"));
  std::size_t at = 0;
  for (const auto& spec : law.output_specs()) {
    if (spec.name == name) return law.outputs()[at];
    at += spec.size;
  }
  throw std::logic_error("no output " + name);
}

// Checks that every feature acts in all states of the table.
void expect_acting(const Registry& registry) {
  const auto loop = meeting(registry, {{"collision_avoidance"}});
  for (std::size_t k = 0; k < SmoothMotion::kPeriods; ++k) {
    loop->step();
    if (output(*loop, "collision_avoidance.active_pairs") < kPairs ||
        output(*loop, "collision_avoidance.smallest_distance_m") <= 0) {
      throw std::runtime_error(fmt::format("{} pairs within {} m, the nearest at {} m; expected at least {}",
                                           output(*loop, "collision_avoidance.active_pairs"), kRange,
                                           output(*loop, "collision_avoidance.smallest_distance_m"), kPairs));
    }
    for (const ModelTerms& terms : loop->cycle.data().terms) {
      ModelTerms here(terms.shared_model());
      here.update(terms.q(), terms.dq());
      if (here.manipulability() >= kSmall)
        throw std::runtime_error("the manipulability is not below the limit");
    }
  }
}

std::map<std::string, Meeting> combinations(const Registry& registry) {
  std::map<std::string, Meeting> sets{{"none", {}}};
  std::vector<std::string> all;
  for (const auto& feature : registry.features()) {
    const std::string& name = feature.descriptor.type;
    sets[name] = {{name}};
    all.push_back(name);
  }
  sets["all"] = {all};
  sets["collision_avoidance+hulls"] = {{"collision_avoidance"}, true};
  return sets;
}

}  // namespace

std::vector<Case> feature_cases(const Registry& registry, const Filter& selected) {
  std::vector<Case> cases;
  for (const auto& [key, how] : combinations(registry)) {
    const std::string name = "features_us/" + key;
    if (!selected(name)) continue;
    if (cases.empty()) expect_acting(registry);
    const std::shared_ptr<MotionLoop> loop = meeting(registry, how);
    const InstanceSet meant = loop->cycle.modes().active();
    cases.push_back({name, [loop] { loop->step(); }, [loop, meant] { loop->expect_active(meant); }});
  }
  return cases;
}

std::map<std::string, LoopCalls> count_feature_calls(const Registry& registry, const Filter& selected) {
  std::map<std::string, LoopCalls> calls;
  if (!kLoopGuardWorks) return calls;
  for (const auto& [key, how] : combinations(registry)) {
    if (!selected("loop_calls/" + key)) continue;
    const std::shared_ptr<MotionLoop> loop = meeting(registry, how);
    for (int k = 0; k < 100; ++k) loop->step();
    LoopGuard::arm();
    for (int k = 0; k < 10000; ++k) loop->step();
    const LoopGuardCounts counts = LoopGuard::disarm();
    calls[key] = {counts.heap_calls, counts.lock_calls};
  }
  return calls;
}

}  // namespace multipanda::bench
