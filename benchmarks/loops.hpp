#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/model/arm_model.hpp"
#include "core/rt/pacer.hpp"
#include "scene/build.hpp"
#include "scene/scene.hpp"

namespace multipanda::bench {

// A backend of negligible cost: every arm swings about its home configuration along one table of states and
// ignores its torque, so that a step contains only the control cycle.
class SmoothMotion final : public Backend {
 public:
  enum class Pace { unpaced, realtime };
  static constexpr double kAmplitude = 0.02;    // [rad]
  static constexpr std::size_t kPeriods = 256;  // control periods per swing

  // `configs`: frames and loads of each arm.
  SmoothMotion(const std::vector<std::shared_ptr<const ArmModel>>& models,
               const std::vector<ArmConfig>& configs, Pace pace = Pace::unpaced);

  std::size_t arm_count() const override { return arms_.size(); }
  Capabilities capabilities(ArmIndex) const override {
    return {.simulated = true, .lockstep = true, .every_command_arrives = true};
  }
  void start() override { pacer_.start(); }
  ArmSet wait() override;
  LoopTime now() const override { return now_; }
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) override;

 private:
  struct Arm {
    JointVector q_home, tau;
    ArmConfig config;
  };
  struct Offset {
    std::array<double, kMaxJoints> q, dq;
  };
  std::vector<Arm> arms_;
  std::array<Offset, kPeriods> swing_;
  Pace pace_;
  Pacer pacer_;
  std::size_t step_ = 0;
  LoopTime now_;
};

// The measured loops: arms, controllets and worlds, built outside the loop.

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
