#include <cmath>
#include <map>
#include <optional>
#include <stdexcept>

#include <gtest/gtest.h>

#include "core/cycle/control_cycle.hpp"
#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// What a cycle takes from its backend: capabilities, limits, periods; and what it tells it.
namespace multipanda::build_cycle_test {
namespace {

// The arms of a test world, of which a test says what the backend can do.
struct ToldBackend final : Backend {
  explicit ToldBackend(std::size_t arms) : models(test::test_models(arms)), world(models), told(arms) {}

  std::size_t arm_count() const override { return told.size(); }
  Capabilities capabilities(ArmIndex arm) const override { return told.at(arm); }
  double period() const override { return period_s; }
  ArmSet wait() override {
    const ArmSet due = world.wait();
    return silent_waits-- > 0 ? ArmSet{} : due;
  }
  bool ended() const override { return over; }
  LoopTime now() const override { return world.now(); }
  void read(ArmSet due, std::span<ArmState> states) override { world.read(due, states); }
  void write(ArmSet due, std::span<const ArmCommand> commands) override {
    world.write(due, commands);
    sent.assign(commands.begin(), commands.end());
  }
  std::uint64_t overruns() const override { return missed; }
  std::optional<Pose> object_pose(const std::string& name) const override {
    const auto it = objects.find(name);
    return it == objects.end() ? std::nullopt : std::optional(it->second);
  }
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return {}; }

  CycleConfig config(std::size_t record_capacity = 0) const {
    return test::test_config(models, {}, record_capacity);
  }

  std::vector<std::shared_ptr<const ArmModel>> models;
  test::TestWorld world;
  std::vector<Capabilities> told;
  std::vector<ArmCommand> sent;
  double period_s = kArmPeriod;
  int silent_waits = 0;
  bool over = false;
  std::uint64_t missed = 0;
  std::map<std::string, Pose> objects;
};

void expect_refused(const CycleConfig& config, Backend& backend, const std::string& text) {
  try {
    const ControlCycle cycle(config, Registry::with_builtins(), backend);
    ADD_FAILURE() << "not refused: " << text;
  } catch (const std::invalid_argument& error) {
    EXPECT_EQ(error.what(), text);
  }
}

TEST(BuildCycle, RefusesNumbersOfArmsThatDoNotMatch) {
  ToldBackend none(0), one(1), two(2), most(kMaxArms), too_many(kMaxArms + 1);
  expect_refused(none.config(), none, "1 to 16 arms are supported, not 0");
  expect_refused(too_many.config(), too_many, "1 to 16 arms are supported, not 17");
  expect_refused(two.config(), one, "the backend has 1 arms, 2 are configured");
  expect_refused(one.config(), two, "the backend has 2 arms, 1 are configured");
  EXPECT_NO_THROW(ControlCycle(most.config(), Registry::with_builtins(), most));
}

// Nothing here closes a brake. What the commands are limited to counts, as a scene or a host gives it.
TEST(BuildCycle, RefusesAnAxisThatBearsWeight) {
  const auto slide = [](double tilt) {
    ArmModelSource source;
    source.name = "slide";
    source.urdf =
        "<robot name='slide'><link name='rail'/><link name='carriage'><inertial><mass value='40'/><inertia "
        "ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial></link><joint name='axis' "
        "type='prismatic'><parent link='rail'/><child link='carriage'/><axis xyz='0 1 0'/><limit lower='-1' "
        "upper='1' velocity='1' effort='800'/></joint></robot>";
    source.flange = "carriage";
    source.X_WB = {rotation_from_rpy({tilt, 0.3, 0}), {0.1, 0.2, 0.3}};
    source.largest_load = 0;
    source.limits.ddq_max = joint_constant(1, 5);
    source.limits.tau_rate_max = joint_constant(1, 8000);
    return std::make_shared<const ArmModel>(source);
  };
  const auto refused = [&](double tilt, double force) -> std::string {
    ToldBackend one(1);
    CycleConfig config = one.config();
    config.arms[0].model = slide(tilt);
    config.arms[0].safety = SafetyLimits::of(*config.arms[0].model);
    config.arms[0].safety.joints.tau_max[0] = force;
    try {
      const ControlCycle cycle(config, Registry::with_builtins(), one);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return {};
  };
  EXPECT_EQ(refused(0, 800), "");
  EXPECT_EQ(refused(M_PI, 800), "");
  EXPECT_NE(refused(M_PI / 2, 800).find("prismatic joint1 of arm 'slide' would bear weight"),
            std::string::npos);
  EXPECT_NE(refused(0.1, 800).find("degrees"), std::string::npos);
  // 40 kg and 0.04 cos(0.3) g press with 15.0 N.
  EXPECT_EQ(refused(0.04, 61), "");
  EXPECT_NE(refused(0.04, 59).find("of its 59 N"), std::string::npos);
}

TEST(BuildCycle, TakesLimitsOfEachArmFromItsBackend) {
  ToldBackend arms(3);
  arms.told[1] = {.own_clock = true, .torque_low_pass_hz = 100, .torque_rate_max = 400};
  arms.told[2].torque_rate_max = 4000;  // no reason to exceed the model's 1000
  ControlCycle cycle(arms.config(), Registry::with_builtins(), arms);
  for (const ArmIndex arm : {0, 1, 2}) {
    const SafetyLimits& limits = cycle.safety().limits(arm);
    const bool told = arm == 1;
    EXPECT_DOUBLE_EQ(limits.own_clock_slack_s, told ? 0.0025 : 0.0);
    EXPECT_EQ(limits.low_pass_hz, told ? 100.0 : 0.0);
    EXPECT_EQ(limits.joints.tau_rate_max, joint_constant(7, told ? 400 : 1000));
  }
}

TEST(BuildCycle, EstimatesForcesWhereTheBackendDoesNotAndNeverCompensatesFrictionTwice) {
  ToldBackend arms(2);
  arms.told[0] = {.compensates_friction = true, .has_external_torque = true};
  ControlCycle cycle(arms.config(), Registry::with_builtins(), arms);
  for (int k = 0; k < 3; ++k) cycle.step(arms.wait());
  EXPECT_EQ(cycle.data().state[0].tau_ext_hat.size(), 0);
  EXPECT_FALSE(cycle.data().state[0].has_wrench_estimate);
  EXPECT_EQ(cycle.data().state[1].tau_ext_hat.size(), 7);
  EXPECT_TRUE(cycle.data().state[1].has_wrench_estimate);
  for (const ArmIndex arm : {0, 1}) {
    const Instance& hold = cycle.modes().instance(static_cast<InstanceIndex>(arm));
    const std::string_view why = hold.feature_refusal(hold.find_feature("friction_compensation"));
    EXPECT_EQ(why.empty(), arm == 1) << why;
  }
  // Where the scene requests the observer, the backend's own does not count.
  CycleConfig config = arms.config();
  config.arms[0].observer_hz = 10;
  ControlCycle observed(config, Registry::with_builtins(), arms);
  observed.step(arms.wait());
  EXPECT_TRUE(observed.data().state[0].has_wrench_estimate);
}

TEST(BuildCycle, TellsTheBackendWhichCommandsCount) {
  ToldBackend arms(2);
  ControlCycle cycle(arms.config(), Registry::with_builtins(), arms);
  arms.world.tamper = [](ArmIndex arm, std::uint64_t step, ArmState& state) {
    if (arm == 1 && step > 0) state.mode = ArmMode::reflex;
  };
  cycle.step(arms.wait());
  EXPECT_TRUE(arms.sent[0].usable && arms.sent[1].usable);
  cycle.step(arms.wait());
  EXPECT_TRUE(arms.sent[0].usable);
  EXPECT_FALSE(arms.sent[1].usable);
  EXPECT_EQ(arms.sent[0].tau_cmd, cycle.data().tau_cmd[0]);
}

TEST(BuildCycle, ABackendThatCountsNoMissedCyclesHasNone) {
  test::TestLoop loop(1, {}, test::test_registry(), 4);
  loop.step();
  EXPECT_EQ(loop.cycle.record()->ring.front()->overruns, 0u);
}

TEST(BuildCycle, TimesAreTheBackends) {
  ToldBackend arms(1);
  arms.period_s = 0.002;
  arms.world.step_s = 0.003;
  arms.missed = 5;
  EXPECT_EQ(ControlCycle(arms.config(), Registry::with_builtins(), arms).record(), nullptr);
  ControlCycle cycle(arms.config(4), Registry::with_builtins(), arms);
  for (const double dt : {0.002, 0.003, 0.003}) {
    cycle.step(arms.wait());
    EXPECT_DOUBLE_EQ(cycle.data().tick.dt, dt);
    EXPECT_EQ(cycle.data().tick.period, 0.002);
    const CycleRecord& record = *cycle.record()->ring.front();
    EXPECT_DOUBLE_EQ(record.period_s, dt);
    EXPECT_EQ(record.overruns, 5u);
    EXPECT_EQ(record.start, cycle.data().tick.start);
    cycle.record()->ring.pop();
  }
}

// Before its first packet an arm is at rest at home, and nothing is sent to it.
TEST(BuildCycle, AnArmWithoutAPacketIsAtRest) {
  ToldBackend arms(2);
  arms.world.due_in_step = [](std::uint64_t) { return ArmSet::of(1); };
  ControlCycle cycle(arms.config(), Registry::with_builtins(), arms);
  const CycleData& data = cycle.data();
  const auto expect_at_rest = [&](ArmIndex arm) {
    const ArmState& state = data.state[arm];
    EXPECT_EQ(state.q, arms.models[arm]->q_home());
    EXPECT_EQ(state.tau_J_d.size(), 0) << "not known";
    for (const JointVector* vector :
         {&state.dq, &state.tau_J, &data.tau_controllet[arm], &data.tau_feature[arm], &data.tau_cmd[arm],
          &data.command[arm].tau_cmd}) {
      EXPECT_EQ(*vector, joint_constant(7, 0));
    }
  };
  expect_at_rest(0);
  expect_at_rest(1);
  cycle.step(arms.wait());
  expect_at_rest(0);
  EXPECT_EQ(data.state[1].tau_J_d.size(), 7);
}

// A simulation may place some objects elsewhere in any cycle; a wall stands where it is.
TEST(BuildCycle, PlacedObstaclesAreWhereTheBackendHasThemIfAllArmsAreSimulated) {
  const Pose before{Matrix3::Identity(), Vector3(1, 2, 3)};
  constexpr ArmIndex kNone = 3;
  for (const ArmIndex real : {kNone, ArmIndex{0}, ArmIndex{1}, ArmIndex{2}}) {
    ToldBackend arms(3);
    for (ArmIndex arm = 0; arm < 3; ++arm) arms.told[arm].simulated = arm != real;
    CycleConfig config = arms.config();
    for (const char* name : {"box", "wall", "unknown", "ball"}) {
      config.obstacles.push_back({name, ConvexShape::sphere({0, 0, 0}, 0.1), before, name[0] != 'w'});
    }
    ControlCycle cycle(config, Registry::with_builtins(), arms);
    for (const double x : {5.0, 6.0}) {
      const Pose now{rotation_from_rpy({0.1, 0.2, x}), Vector3(x, 0, 0)};
      arms.objects = {{"box", now}, {"wall", now}, {"ball", now}};
      cycle.step(arms.wait());
      for (const Obstacle& obstacle : cycle.data().obstacles) {
        const bool moved = real == kNone && (obstacle.name == "box" || obstacle.name == "ball");
        EXPECT_EQ(obstacle.X_WO.position, (moved ? now : before).position) << obstacle.name;
        EXPECT_EQ(obstacle.X_WO.rotation, (moved ? now : before).rotation) << obstacle.name;
      }
    }
  }
}

TEST(BuildCycle, ACycleBeginsWhenItReads) {
  ToldBackend arms(1);
  ControlCycle cycle(arms.config(), Registry::with_builtins(), arms);
  for (int k = 0; k < 3; ++k) {
    const HostTime before = host_now();
    cycle.step(arms.wait());
    EXPECT_GE(cycle.data().tick.start, before);
    EXPECT_LE(cycle.data().tick.start, cycle.data().state[0].t_host) << "when the state was read";
  }
}

TEST(BuildCycle, RunsUntilTheCallerOrTheBackendEndsIt) {
  ToldBackend arms(1);
  ControlCycle cycle(arms.config(), Registry::with_builtins(), arms);
  int asked = 0;
  arms.silent_waits = 2;  // silence is not the end
  cycle.run([&] { return ++asked <= 10; });
  EXPECT_EQ(asked, 11);
  EXPECT_EQ(cycle.data().tick.cycle, 10u);
  arms.over = true;  // nor is the end while states are due
  cycle.run([&] { return ++asked <= 15; });
  EXPECT_EQ(cycle.data().tick.cycle, 14u);
  arms.silent_waits = 1;
  cycle.run([] { return true; });
  EXPECT_EQ(cycle.data().tick.cycle, 14u);
}

}  // namespace
}  // namespace multipanda::build_cycle_test
