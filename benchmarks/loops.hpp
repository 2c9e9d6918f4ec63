#pragma once

#include <memory>
#include <string>
#include <vector>

#include "backends/mujoco/mujoco_backend.hpp"
#include "benchmarks/smooth_motion.hpp"
#include "core/cycle/control_cycle.hpp"
#include "scene/scene.hpp"

// The measured loops: arms, controllets and worlds, built outside the loop.
namespace multipanda::bench {

inline constexpr std::size_t kArmCounts[] = {1, 2, 4, 8, 16};

// Pandas with hands over a floor, in pairs within reach of each other; a pair every two meters.
Scene scene_of(std::size_t arms, const Registry& registry);

// kMaxArms arms with their models, built once; the loops use the first few.
struct Arms {
  explicit Arms(const Registry& registry);
  explicit Arms(const Scene& scene);
  std::vector<CycleConfig::Arm> arms;
  std::vector<std::shared_ptr<const ArmModel>> models;
  std::vector<ArmConfig> configs;
  std::vector<Obstacle> obstacles;
};

// One instance of the controllet per arm, or per pair of arms ("law0", "law1", ...). Followers observe the
// arm after their own, so the last arm has none.
std::vector<InstanceConfig> instances_of(const ControlletType& type, std::size_t arms,
                                         const std::vector<std::string>& features = {});

// Goals that every input approaches for an hour, so that set-points always move slowly. Throws if a goal is
// refused by its input.
void post_slow_goals(ControlCycle& cycle, InstanceSet instances);

// A control cycle over SmoothMotion.
class MotionLoop {
 public:
  MotionLoop(const Arms& arms, std::size_t count, std::vector<InstanceConfig> instances,
             const Registry& registry, SmoothMotion::Pace pace = SmoothMotion::Pace::unpaced);

  void step() { cycle.step(world.wait()); }
  InstanceSet set(std::initializer_list<std::string_view> names) const;
  // Activates these and gives them their slow goals.
  void activate(InstanceSet instances);
  // Throws std::runtime_error if other instances run: a hold would be measured.
  void expect_active(InstanceSet instances) const;

  SmoothMotion world;
  ControlCycle cycle;
};

// All instances of `type`, active, as timed for "cycle_us/<type>/<count>".
std::shared_ptr<MotionLoop> motion_loop(const Arms& arms, std::size_t count, const ControlletType& type,
                                        const Registry& registry,
                                        const std::vector<std::string>& features = {});

// A control cycle over MuJoCo, unpaced, without recording. 1 arm: one Cartesian impedance. 2: the scene
// two_arms (hands, table, a free box) under DC. More: DC for each pair. `features` are active from the start.
class SimulationLoop {
 public:
  SimulationLoop(std::size_t arms, const Registry& registry, const std::vector<std::string>& features = {});
  void step() { cycle_->step(world_->wait()); }
  void verify() const;  // throws if the laws stopped early

 private:
  Scene scene_;
  std::unique_ptr<MujocoBackend> world_;
  std::unique_ptr<ControlCycle> cycle_;
  InstanceSet laws_ = 0;
};

// The world of SimulationLoop, without the loop.
Scene simulation_scene(std::size_t arms, const Registry& registry);

}  // namespace multipanda::bench
