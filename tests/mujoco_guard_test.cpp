// Every controllet, every feature and every switch between them over MuJoCo, with the record ring: no heap
// call, no lock and no page fault after the first cycle.
#include <sys/mman.h>

#include <gtest/gtest.h>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "core/rt/thread_setup.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::mujoco_guard_test {
namespace {

// A model with every optional property of a simulated arm.
std::shared_ptr<const RobotDescription> an_arm_of_its_own() {
  RobotDescription robot = load_robot("fer");
  FrictionLaw law;
  law.offset = law.viscous = law.stribeck = joint_constant(7, 0.1);
  law.presliding = {{0.003, joint_constant(7, 0.2)}, {0.05, joint_constant(7, 0.1)}};
  law.sigmoid = robot.friction;
  robot.link_friction = law;
  robot.torque_sensor = TorqueSensor{joint_constant(7, 1.01), joint_constant(7, 0.1), 0.05};
  robot.actuation = Actuation{60, 0.0013};
  robot.motor_inertia = joint_constant(7, 0.1);
  robot.base_tilt = {0.01, -0.01};
  return std::make_shared<const RobotDescription>(robot);
}

class MujocoGuard : public testing::Test {
 protected:
  void SetUp() override {
    if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  }
  // As a run does it: when everything is built.
  void start(Backend& backend) {
    faults_count_ = set_up_thread({.fifo_priority = {}, .cpu = {}}).front().done;
    backend.start();
  }
  void TearDown() override { munlockall(); }
  bool faults_count_ = true;
};

TEST_F(MujocoGuard, EveryControlletFeatureAndSwitch) {
  const Registry registry = Registry::with_builtins();
  Scene scene = load_scene("two_arms", registry);
  scene.plant = PlantFidelity::realistic();
  scene.timeline.clear();
  for (auto& arm : scene.arms) arm.known_friction = true;  // friction_compensation requires it
  scene.arms[0].plant_robot = an_arm_of_its_own();
  scene.controllets.clear();
  for (const auto& type : registry.controllets()) {
    InstanceConfig config{.name = "a_" + type.descriptor.type, .type = type.descriptor.type};
    for (ArmIndex arm = 0; arm < type.descriptor.arms; ++arm) config.arms.push_back(arm);
    for (ArmIndex k = 0; k < type.descriptor.observes; ++k)
      config.observes.push_back(type.descriptor.arms + k);
    scene.controllets.push_back(config);
  }
  ASSERT_GE(scene.controllets.size(), 6u);
  MujocoBackend backend(scene, {.pace = Pace::unpaced});
  ControlCycle cycle(build_cycle_config(scene, 100000), registry, backend);
  MultimodeController& modes = cycle.modes();
  start(backend);
  const auto step = [&](int count, const std::string& during) {
    for (int k = 0; k < count; ++k) {
      LoopGuard::arm();
      const ArmSet due = backend.wait();
      cycle.step(due);
      const LoopGuardCounts counts = LoopGuard::disarm();
      ASSERT_EQ(counts.heap_calls, 0u) << during;
      ASSERT_EQ(counts.lock_calls, 0u) << during;
      if (faults_count_) {
        ASSERT_EQ(counts.page_faults, 0u) << during;
      }
    }
  };
  const auto ask = [&](const Request& request, const std::string& during) {
    std::uint64_t ticket = 0;
    ASSERT_EQ(modes.post(std::span(&request, 1), ticket), Verdict::accepted) << during;
    step(1, during);
    Answer answer;
    ASSERT_TRUE(modes.poll(ticket, answer)) << during;
    ASSERT_EQ(answer.verdict, Verdict::accepted) << during;
  };
  cycle.step(backend.wait());  // the first cycle may allocate
  for (const auto& to : scene.controllets) {
    const InstanceIndex i = modes.find(to.name);
    for (const auto& from : scene.controllets) {
      const std::string what = from.name + " to " + to.name;
      ask({.activate = bit(modes.find(from.name))}, what);
      ask({.activate = bit(i)}, what);
      ASSERT_EQ(modes.owner(0), i) << what;
    }
    for (std::size_t f = 0; f < modes.instance(i).feature_count(); ++f) {
      for (const bool on : {true, false, true}) {
        const auto index = static_cast<std::uint16_t>(f);
        ask({.kind = Request::Kind::set_feature, .instance = i, .index = index, .on = on}, to.name);
        step(100, to.name);
      }
    }
    ASSERT_EQ(modes.owner(0), i) << to.name << " was deactivated";
  }
  EXPECT_EQ(cycle.record()->dropped_records.load(), 0u);
  backend.finish();
}

// An arm on a torso that another arm turns, under every pair of laws that may own them.
TEST_F(MujocoGuard, ArmsOnATorso) {
  const OpenedScene opened = open_scene(MULTIPANDA_SOURCE_DIR "/examples/carried_arm/scene.yaml");
  Scene scene = opened.scene;
  scene.timeline.clear();
  scene.active.clear();
  scene.controllets.clear();
  std::vector<std::string> names[2];
  for (const auto& type : opened.registry.controllets()) {
    if (!type.descriptor.moving_base) continue;
    for (ArmIndex arm = 0; arm + type.descriptor.arms <= 2; ++arm) {
      InstanceConfig config{.name = type.descriptor.type + (arm == 0 ? "_a" : "_b"),
                            .type = type.descriptor.type};
      for (ArmIndex k = 0; k < type.descriptor.arms; ++k) config.arms.push_back(arm + k);
      names[arm].push_back(config.name);
      scene.controllets.push_back(std::move(config));
    }
  }
  ASSERT_GE(scene.controllets.size(), 8u);
  MujocoBackend backend(scene, {.pace = Pace::unpaced});
  ControlCycle cycle(build_cycle_config(scene, 20000), opened.registry, backend);
  MultimodeController& modes = cycle.modes();
  start(backend);
  for (int k = 0; k < 10; ++k) cycle.step(backend.wait());
  for (const auto& first : names[0]) {
    for (const auto& second : names[1]) {
      // The carrier's hand would sweep an arm that no Cartesian law keeps in the world.
      if (first.starts_with("cartesian") && !second.starts_with("cartesian")) continue;
      // So would any law that is not led by hand an arm that is.
      if (second.starts_with("gravity_compensation") && first != "gravity_compensation_a") continue;
      for (const auto& name : {second, first}) {
        const Request request{.activate = bit(modes.find(name))};
        std::uint64_t ticket = 0;
        ASSERT_EQ(modes.post(std::span(&request, 1), ticket), Verdict::accepted);
        LoopGuard::arm();
        for (int k = 0; k < 50; ++k) cycle.step(backend.wait());
        const LoopGuardCounts counts = LoopGuard::disarm();
        EXPECT_EQ(counts.heap_calls + counts.lock_calls, 0u) << first << ", " << second;
        Answer answer;
        ASSERT_TRUE(modes.poll(ticket, answer));
        EXPECT_EQ(answer.verdict, Verdict::accepted) << name;
      }
    }
  }
  backend.finish();
}

// Fingers and a suction cup grasp and release.
TEST_F(MujocoGuard, Grippers) {
  const Registry registry = Registry::with_builtins();
  const Scene scene = load_scene("grippers", registry);
  MujocoBackend backend(scene, {.pace = Pace::unpaced});
  ControlCycle cycle(build_cycle_config(scene, 20000), registry, backend);
  start(backend);
  cycle.step(backend.wait());
  const auto all_well = [&](const GripperRequest& left, const GripperRequest& right) {
    auto first = backend.request(0, left);
    auto second = backend.request(1, right);
    for (int k = 0; k < 3000; ++k) {
      LoopGuard::arm();
      const ArmSet due = backend.wait();
      cycle.step(due);
      const LoopGuardCounts counts = LoopGuard::disarm();
      ASSERT_EQ(counts.heap_calls, 0u) << k;
      ASSERT_EQ(counts.lock_calls, 0u) << k;
      if (faults_count_) {
        ASSERT_EQ(counts.page_faults, 0u) << k;
      }
    }
    EXPECT_TRUE(first.get().success);
    EXPECT_TRUE(second.get().success);
  };
  all_well(GripperGrasp{.width = 0.04}, VacuumOn{.pressure_mbar = 500});
  all_well(GripperHoming{}, VacuumDrop{});
  backend.finish();
}

}  // namespace
}  // namespace multipanda::mujoco_guard_test
