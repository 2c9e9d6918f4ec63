#include <gtest/gtest.h>

#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// Arms with force sensors in the loop: laws that need the force end with the sensor, others do not.
namespace multipanda::sensed_cycle_test {
namespace {

// The arms of a test world; what their sensors say is the test's.
struct SensedWorld final : Backend {
  explicit SensedWorld(const std::vector<std::shared_ptr<const ArmModel>>& models)
      : world(models), readings(models.size(), {.records = 1}) {}
  std::size_t arm_count() const override { return world.arm_count(); }
  Capabilities capabilities(ArmIndex arm) const override { return world.capabilities(arm); }
  ArmSet wait() override { return world.wait(); }
  LoopTime now() const override { return world.now(); }
  void read(ArmSet due, std::span<ArmState> states) override { world.read(due, states); }
  void write(ArmSet due, std::span<const ArmCommand> commands) override { world.write(due, commands); }
  const ForceReading* force_reading(ArmIndex arm) override { return knows ? &readings[arm] : nullptr; }
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return {}; }

  test::TestWorld world;
  std::vector<ForceReading> readings;
  bool knows = true;
};

// Arm 0 has a sensor that bears nothing, arm 1 has none.
struct Sensed : testing::Test {
  Sensed() : models(test::test_models(2)), world(models) {
    config = test::test_config(models,
                               {{.name = "press", .type = "force", .arms = {0}},
                                {.name = "stay", .type = "joint_impedance", .arms = {0}},
                                {.name = "other", .type = "force", .arms = {1}}},
                               1000);
    config.arms[0].force_sensor = ForceSensorMount{};
  }
  void build() { cycle.emplace(config, Registry::with_builtins(), world); }
  void step() { cycle->step(world.wait()); }
  InstanceSet only(const char* name) { return InstanceSet{1} << cycle->modes().find(name); }
  Answer activate(const char* name) {
    std::uint64_t ticket = 0;
    Answer answer;
    const Request request{.activate = only(name), .deactivate = 0};
    EXPECT_EQ(cycle->modes().post(std::span(&request, 1), ticket), Verdict::accepted);
    step();
    EXPECT_TRUE(cycle->modes().poll(ticket, answer));
    return answer;
  }
  bool runs(const char* name) { return (cycle->modes().active() & only(name)) != 0; }

  std::vector<std::shared_ptr<const ArmModel>> models;
  SensedWorld world;
  CycleConfig config;
  std::optional<ControlCycle> cycle;
};

TEST_F(Sensed, ForcesAreThoseOfTheSensorAndOfTheObserver) {
  build();
  step();
  world.readings[0].F_S.vector << 1, 2, 3, 0, 0, 0;
  step();
  for (const ArmIndex arm : {0, 1}) EXPECT_TRUE(cycle->data().state[arm].has_wrench_estimate);
  EXPECT_NEAR(cycle->data().state[0].F_K_W_est.force().norm(), std::sqrt(14), 1e-12);
  EXPECT_LT(cycle->data().state[1].F_K_W_est.force().norm(), 0.1);
}

TEST_F(Sensed, EndALawThatNeedsThemByTheNameOfTheFault) {
  struct Case {
    Intervention rule;
    void (*spoil)(ForceReading&);
  };
  for (const Case& wrong :
       {Case{Intervention::force_sensor_silent, [](ForceReading& r) { r.age_s = 1; }},
        Case{Intervention::force_sensor_saturated, [](ForceReading& r) { r.F_S.force().x() = 2000; }},
        Case{Intervention::force_sensor_fault,
             [](ForceReading& r) { r.F_S.force().x() = std::numeric_limits<double>::quiet_NaN(); }},
        Case{Intervention::force_sensor_contradicted,
             [](ForceReading& r) { r.F_S.force().setConstant(50); }}}) {
    world.readings[0] = {.records = 1};
    build();
    step();
    ASSERT_TRUE(activate("press").accepted());
    ASSERT_TRUE(activate("other").accepted());
    for (int k = 0; k < 300; ++k) step();
    ASSERT_TRUE(runs("press"));
    wrong.spoil(world.readings[0]);
    step();
    for (int k = 0; k < 210 && wrong.rule == Intervention::force_sensor_contradicted; ++k) step();
    EXPECT_FALSE(runs("press"));
    EXPECT_EQ(cycle->modes().owner(0), 0);  // its hold
    EXPECT_TRUE(cycle->data().tau_cmd[0].allFinite());
    EXPECT_TRUE(runs("other"));  // neither the other arm's law
    EXPECT_EQ(cycle->safety().counted(0, wrong.rule), 1u);
    EXPECT_EQ(cycle->safety().counted(0, Intervention::controllet_fault), 0u);
    const Answer refused = activate("press");
    EXPECT_EQ(refused.verdict, Verdict::start_refused);
    EXPECT_EQ(refused.rule, wrong.rule);
    EXPECT_TRUE(activate("stay").accepted());  // nor a law that needs no force
    for (int k = 0; k < 100; ++k) step();
    EXPECT_TRUE(runs("stay"));
    world.readings[0] = {.records = 2};
    step();
    EXPECT_TRUE(activate("press").accepted());
  }
}

TEST_F(Sensed, NeedABackendThatReadsThem) {
  world.knows = false;
  try {
    build();
    ADD_FAILURE() << "not refused";
  } catch (const std::invalid_argument& error) {
    EXPECT_EQ(std::string(error.what()),
              "arm 'arm0' has a force sensor, which this backend does not read; use mujoco or fci, or remove "
              "'force_sensor'");
  }
}

}  // namespace
}  // namespace multipanda::sensed_cycle_test
