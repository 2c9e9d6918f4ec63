#include <cmath>
#include <sys/mman.h>

#include <gtest/gtest.h>

#include "core/model/task_space.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// Every controllet that comes with multipanda, with every feature, switched on, off and to each other, under
// the guard: no heap, no lock, no page fault after the first cycle. Requests are scheduled or posted outside
// the guarded part.
namespace multipanda::guard_test {
namespace {

using test::TestLoop;
using Kind = Request::Kind;

class GuardTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
    if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) faults_count_ = false;  // said below
  }
  void TearDown() override { munlockall(); }

  void guarded_step(TestLoop& loop, const std::string& during) {
    LoopGuard::arm();
    loop.step();
    const LoopGuardCounts counts = LoopGuard::disarm();
    ASSERT_EQ(counts.heap_calls, 0u) << during;
    ASSERT_EQ(counts.lock_calls, 0u) << during;
    if (faults_count_) {
      ASSERT_EQ(counts.page_faults, 0u) << during;
    }
  }
  bool faults_count_ = true;
};

void post(TestLoop& loop, const Request& request) {
  std::uint64_t ticket = 0;
  ASSERT_EQ(loop.modes().post(std::span(&request, 1), ticket), Verdict::accepted);
}

// Targets for every input of an instance: a goal, then a stream.
void post_targets(TestLoop& loop, InstanceIndex i, Delivery delivery) {
  for (Reference& input : loop.modes().instance(i).inputs()) {
    Target target;
    target.delivery = delivery;
    target.size = static_cast<std::uint8_t>(input.size());
    target.values.fill(0.1);
    if (input.spec().quantity == Quantity::pose) target = pose_target({}, 0, delivery);
    ASSERT_EQ(input.post(target), Verdict::accepted);
  }
}

// Above eight joints the sizes are no longer known to the compiler; the storage is.
TEST_F(GuardTest, TheTaskSpaceOfAnyJointCount) {
  TaskSpace task;
  for (Eigen::Index n = 1; n <= static_cast<Eigen::Index>(kMaxJoints); ++n) {
    Jacobian J(6, n);
    for (Eigen::Index i = 0; i < J.size(); ++i) J.data()[i] = std::sin(static_cast<double>(i * i));
    const JointMatrix M = JointMatrix::Identity(n, n);
    LoopGuard::arm();
    compute_task_space(J, M, task);
    const LoopGuardCounts counts = LoopGuard::disarm();
    EXPECT_EQ(counts.heap_calls, 0u) << n;
    EXPECT_EQ(counts.lock_calls, 0u) << n;
    EXPECT_EQ(task.J_bar.rows(), n);
  }
}

TEST_F(GuardTest, EveryControlletWithEveryFeatureAndEverySwitch) {
  const Registry registry = Registry::with_builtins();
  ASSERT_GE(registry.controllets().size(), 2u);
  ASSERT_GE(registry.features().size(), 1u);
  std::vector<InstanceConfig> configs;
  for (const auto& type : registry.controllets()) {
    InstanceConfig config{.name = "one_" + type.descriptor.type, .type = type.descriptor.type};
    for (ArmIndex arm = 0; arm < type.descriptor.arms; ++arm) config.arms.push_back(arm);
    for (ArmIndex k = 0; k < type.descriptor.observes; ++k)
      config.observes.push_back(type.descriptor.arms + k);
    const decltype(config.parameters) axes = {{"force_z", {1}}, {"moment_x", {1}}, {"force_frame", {1}}};
    if (config.type == "hybrid_force") config.parameters = axes;  // without, its force part rests
    configs.push_back(config);
    if (config.type == "ufic") {
      config.name += "_along_axes";
      config.parameters = axes;
      configs.push_back(config);
    }
  }
  TestLoop loop(2, configs, registry, 20000);
  loop.step();
  for (const auto& config : configs) {
    const InstanceIndex i = loop.find(config.name);
    for (const auto& from : configs) {
      post(loop, {.activate = bit(loop.find(from.name))});
      guarded_step(loop, from.name);
      post(loop, {.activate = bit(i)});
      guarded_step(loop, from.name + " to " + config.name);
      ASSERT_EQ(loop.modes().owner(0), i) << config.name;
    }
    Instance& instance = loop.modes().instance(i);
    for (std::size_t f = 0; f < instance.feature_count(); ++f) {
      const std::string name = config.name + " + " + instance.feature_descriptor(f).type;
      for (const bool on : {true, false, true}) {
        post(loop,
             {.kind = Kind::set_feature, .instance = i, .index = static_cast<std::uint16_t>(f), .on = on});
        for (int k = 0; k < 5; ++k) guarded_step(loop, name);
        // These arms have no shapes that could collide: a refusal is guarded, too.
        ASSERT_EQ(instance.feature_on(f), on && instance.feature_refusal(f).empty()) << name;
      }
    }
    for (std::size_t p = 0; p < instance.parameter_count(); ++p) {
      Request request{.kind = Kind::set_parameter, .instance = i, .index = static_cast<std::uint16_t>(p)};
      const auto value = instance.parameter(p);
      request.size = static_cast<std::uint8_t>(value.size());
      std::copy(value.begin(), value.end(), request.values.begin());
      post(loop, request);
      guarded_step(loop, config.name + " " + instance.parameter_names()[p]);
    }
    for (int k = 0; k < 30; ++k) {
      post_targets(loop, i, k < 10 ? Delivery::goal : Delivery::stream);
      guarded_step(loop, config.name + " with targets");
    }
    for (std::size_t k = 0; k < instance.inputs().size(); ++k) {
      const Reference& input = instance.inputs()[k];
      Request request{.kind = Kind::set_target, .instance = i, .index = static_cast<std::uint16_t>(k)};
      if (input.spec().quantity == Quantity::pose) {
        request.target = pose_target(input.pose());
      } else if (input.spec().quantity == Quantity::joints) {
        request.target.set({input.joints().data(), input.size()});
      } else {
        continue;
      }
      request.until.limits[GoalEnd::distance] = 1e-12;
      post(loop, request);
      guarded_step(loop, config.name + " with a goal that ends");
      guarded_step(loop, config.name + " after its end");
    }
    loop.modes().stop(ArmSet::of(0));
    guarded_step(loop, config.name + " stopped");
    post(loop, {.kind = Kind::resume, .arms = ArmSet::all(2)});
    guarded_step(loop, config.name + " resumed");
  }
}

TEST_F(GuardTest, DeactivatingControlletsThatReturnNonsense) {
  for (const double fault :
       {1.0, 3.0, 5.0, 6.0}) {  // a throw allocates in the C++ runtime, which is the thrower's fault
    TestLoop loop(
        2, {{.name = "bad", .type = "broken", .arms = {0}}, {.name = "p", .type = "pair", .arms = {0, 1}}},
        test::test_registry(), 100);
    loop.modes().activate_at_start(loop.set({"bad"}));
    loop.steps(3);
    Request request{.kind = Kind::set_parameter, .instance = loop.find("bad"), .size = 1};
    request.values[0] = fault;
    post(loop, request);
    guarded_step(loop, "fault");
    ASSERT_EQ(loop.modes().owner(0), 0);
    bool broken = true;
    loop.world.tamper = [&broken](ArmIndex, std::uint64_t, ArmState& state) {
      if (broken) state.q[0] = std::nan("");
    };
    post(loop, {.activate = loop.set({"p"})});
    guarded_step(loop, "refused");
    broken = false;
    for (int k = 0; k < 200; ++k) guarded_step(loop, "record overflow");
  }
}

// The guard must detect what happens inside a step; otherwise the tests above prove nothing.
TEST_F(GuardTest, AnAllocatingStepIsDetected) {
  TestLoop loop(1, {}, test::test_registry());
  loop.steps(2);
  std::vector<double> growing;
  loop.world.tamper = [&](ArmIndex, std::uint64_t, ArmState&) { growing.resize(growing.size() + 1000); };
  LoopGuard::arm();
  loop.step();
  EXPECT_GT(LoopGuard::disarm().heap_calls, 0u);
}

}  // namespace
}  // namespace multipanda::guard_test
