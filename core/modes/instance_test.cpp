#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include <gtest/gtest.h>

#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// An instance as its configuration asks for it: inputs, parameters, features, outputs.
namespace multipanda::instance_test {
namespace {

using test::TestLoop;

InstanceConfig spring() { return {.name = "law", .type = "spring", .arms = {0}}; }

// What refuses the configuration says; empty: nothing does.
std::string refusal(const InstanceConfig& config, const Registry& registry = test::test_registry()) {
  try {
    TestLoop(2, {config}, registry);
    return {};
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
}

TEST(InstanceConfig, IsRefusedWithItsReason) {
  InstanceConfig config = spring();
  EXPECT_EQ(refusal(config), "");
  config.arms = {2};
  EXPECT_EQ(refusal(config), "controllet 'law': there is no arm number 2");
  config.arms = {0, 1};
  EXPECT_EQ(refusal(config), "controllet 'law': 'spring' needs 1 arm(s), found 2");
  config = spring();
  config.parameters = {{"push.torque_nm", {101}}};
  EXPECT_NE(refusal(config).find("parameter 'push.torque_nm'"), std::string::npos);
  config.parameters = {{"push.torque_nm", {-100}}};
  EXPECT_EQ(refusal(config), "");
}

TEST(InstanceConfig, BoundsForContactAreAboveZero) {
  for (const auto bound :
       {&ContactBounds::hand_speed, &ContactBounds::spring_force, &ContactBounds::spring_moment}) {
    InstanceConfig config = spring();
    config.contact.*bound = 0;
    EXPECT_EQ(refusal(config), "controllet 'law': the bounds for contact must be above zero");
    config.contact.*bound = 1e-9;
    EXPECT_EQ(refusal(config), "");
  }
}

class Idle final : public Controllet {
 public:
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext&) override { return LawResult::ok; }
};

// A law with one input of each kind, of which the last belongs to `last_arm`.
Registry registry_with_inputs(std::size_t last_arm = 0) {
  Registry registry = test::test_registry();
  registry.add(
      ControlletType{{.type = "inputs",
                      .doc = "",
                      .arms = 1,
                      .inputs = {{.name = "pose", .quantity = Quantity::pose},
                                 {.name = "twist", .quantity = Quantity::twist},
                                 {.name = "wrench", .quantity = Quantity::wrench},
                                 {.name = "joints", .quantity = Quantity::joints, .arm = last_arm}}},
                     [](ArmModels) -> std::unique_ptr<Controllet> { return std::make_unique<Idle>(); }});
  return registry;
}

TEST(InstanceConfig, InputsTakeTheirLimitsFromItAndHandsKeepToTheBoundForContact) {
  InstanceConfig config{.name = "law", .type = "inputs", .arms = {1}};
  config.inputs = {{.name = "pose", .timeout_s = 0.3, .max_speed = 0.4, .max_angular_speed = 0.7},
                   {.name = "wrench", .timeout_s = 0.6, .max_speed = 90}};
  config.contact.hand_speed = 0.35;
  TestLoop loop(2, {config}, registry_with_inputs());
  const auto inputs = std::as_const(loop.modes()).instance(loop.find("law")).inputs();
  ASSERT_EQ(inputs.size(), 4u);
  EXPECT_EQ(inputs[0].spec().timeout_s, 0.3);
  EXPECT_EQ(inputs[0].spec().max_speed, 0.35) << "the tighter one";
  EXPECT_EQ(inputs[0].spec().max_angular_speed, 0.7);
  EXPECT_EQ(inputs[1].spec().timeout_s, 0.1);
  EXPECT_EQ(inputs[1].spec().max_speed, 0.35);
  EXPECT_EQ(inputs[2].spec().timeout_s, 0.6);
  EXPECT_EQ(inputs[2].spec().max_speed, 90) << "not a speed of the hand";
  EXPECT_EQ(inputs[3].spec().max_speed, 0.5) << "the hand's speed is bounded in every tick instead";
  config.inputs = {{.name = "pose", .max_speed = 0.2}};
  TestLoop slower(2, {config}, registry_with_inputs());
  EXPECT_EQ(slower.modes().instance(slower.find("law")).inputs()[0].spec().max_speed, 0.2);
  EXPECT_EQ(refusal(config, registry_with_inputs(1)),
            "controllet 'law': input 'joints' refers to an arm that the controllet does not own");
}

TEST(InstanceConfig, OneNumberIsForAllElementsOfAParameter) {
  const Registry registry = Registry::with_builtins();
  InstanceConfig config{.name = "law", .type = "joint_impedance", .arms = {0}};
  const auto stiffness = [&](const std::vector<double>& values) {
    config.parameters = {{"stiffness_nm_per_rad", values}};
    TestLoop loop(1, {config}, registry);
    const Instance& law = loop.modes().instance(loop.find("law"));
    EXPECT_EQ(law.parameter_size(law.find_parameter("stiffness_nm_per_rad")), 7u);
    return law.parameter(law.find_parameter("stiffness_nm_per_rad"));
  };
  EXPECT_EQ(stiffness({60}), std::vector<double>(7, 60));
  const std::vector<double> each = {10, 20, 30, 40, 50, 60, 70};
  EXPECT_EQ(stiffness(each), each);
  config.parameters = {{"stiffness_nm_per_rad", {10, 20}}};
  EXPECT_NE(refusal(config, registry), "");
}

TEST(InstanceConfig, AtMostSixteenFeaturesAreRegistered) {
  Registry registry = test::test_registry();
  const std::size_t own = 2;
  for (std::size_t k = own; k <= kMaxFeatures; ++k) {
    EXPECT_EQ(refusal(spring(), registry), "") << k;
    FeatureType feature = *registry.feature("push");
    feature.descriptor.type = "push" + std::to_string(k);
    registry.add(feature);
  }
  EXPECT_EQ(refusal(spring(), registry), "controllet 'arm0_hold': too many features are registered");
}

// Two features of the same kind: each acts with its own parameters and writes its own outputs.
TEST(InstanceFeatures, HaveParametersAndOutputsOfTheirOwn) {
  Registry registry = test::test_registry();
  FeatureType second = *registry.feature("push");
  second.descriptor.type = "pull";
  registry.add(second);
  InstanceConfig config = spring();
  config.features = {"push", "pull"};
  config.parameters = {{"push.torque_nm", {0.5}}, {"pull.torque_nm", {-2}}};
  TestLoop loop(2, {config}, registry);
  loop.modes().activate_at_start(loop.set({"law"}));
  loop.steps(300);
  Instance& law = loop.modes().instance(loop.find("law"));
  EXPECT_LT((loop.cycle.data().tau_feature[0] - joint_constant(7, -1.5)).norm(), 1e-12);
  const auto specs = law.output_specs();
  ASSERT_EQ(specs.size(), law.outputs().size());
  const auto output = [&](std::string_view name) {
    for (std::size_t i = 0; i < specs.size(); ++i) {
      if (specs[i].name == name) return law.outputs()[i];
    }
    return std::nan("");
  };
  EXPECT_EQ(output("push.push_nm"), 0.5);
  EXPECT_EQ(output("pull.push_nm"), -2);
  EXPECT_EQ(output("joint_limits.largest_torque_nm"), 0);
  // The outputs of a feature that is off are zero, those of the others go on.
  Request off{.kind = Request::Kind::set_feature, .instance = loop.find("law")};
  off.index = static_cast<std::uint16_t>(law.find_feature("push"));
  ASSERT_TRUE(loop.ask(off).accepted());
  EXPECT_EQ(output("push.push_nm"), 0);
  EXPECT_EQ(output("pull.push_nm"), -2);
  EXPECT_LT((loop.cycle.data().tau_feature[0] - joint_constant(7, -2)).norm(), 1e-12);
  // Names of what there is not.
  EXPECT_EQ(law.find_feature("lift"), law.feature_count());
  EXPECT_EQ(law.find_parameter("lift.torque_nm"), law.parameter_count());
  EXPECT_EQ(law.check_parameter(law.parameter_count(), std::array{1.0}), Verdict::unknown_parameter);
  EXPECT_EQ(law.bound_text(law.parameter_count(), std::array{1.0}), "");
  EXPECT_EQ(law.parameter_spec(law.find_parameter("pull.torque_nm")).name, "torque_nm");
}

// A parameter of an active instance or of its feature moves to its value within 0.2 s.
TEST(InstanceParameters, MoveOnlyWhileTheInstanceRuns) {
  InstanceConfig config = spring();
  config.features = {"push"};
  TestLoop loop(2, {config}, test::test_registry());
  loop.step();
  const Instance& law = loop.modes().instance(loop.find("law"));
  Request set{.kind = Request::Kind::set_parameter, .instance = loop.find("law"), .size = 1};
  set.index = static_cast<std::uint16_t>(law.find_parameter("push.torque_nm"));
  const auto at_once = [&](double value) {
    set.values[0] = value;
    ASSERT_TRUE(loop.ask(set).accepted());
    EXPECT_EQ(law.parameter(set.index), std::vector{value});
  };
  at_once(0.3);  // not active: this is what it starts with
  ASSERT_TRUE(loop.activate({"law"}).accepted());
  for (int k = 1; k <= 200; ++k) {
    ASSERT_NEAR(loop.cycle.data().tau_feature[0][0], 0.3 * k / 200.0, 1e-12) << "fades in";
    loop.step();
  }
  at_once(0.4);
  for (int k = 1; k <= 250; ++k) {
    ASSERT_NEAR(loop.cycle.data().tau_feature[0][0], 0.3 + 0.1 * std::min(1.0, k / 200.0), 1e-9) << k;
    loop.step();
  }
}

TEST(RegistryTypes, AreNamedOnceAndHaveFactories) {
  Registry registry = test::test_registry();
  EXPECT_THROW(registry.add(*registry.controllet("spring")), std::invalid_argument);
  EXPECT_THROW(registry.add(*registry.feature("push")), std::invalid_argument);
  ControlletType empty = *registry.controllet("spring");
  empty.descriptor.type = "empty";
  empty.create = nullptr;
  EXPECT_THROW(registry.add(empty), std::invalid_argument);
  EXPECT_EQ(registry.controllet("empty"), nullptr);
  EXPECT_EQ(registry.feature("spring"), nullptr);
  const BackendType backend{.name = "here",
                            .create = [](const BackendSetup&) { return std::unique_ptr<Backend>(); }};
  registry.add(backend);
  EXPECT_NE(registry.backend("here"), nullptr);
  EXPECT_EQ(registry.backend("there"), nullptr);
  EXPECT_THROW(registry.add(backend), std::invalid_argument);
  EXPECT_THROW(registry.add(BackendType{.name = "none"}), std::invalid_argument);
}

TEST(MultimodeSetUp, AtMostSixtyFourInstancesWithTheHolds) {
  std::vector<InstanceConfig> configs;
  for (std::size_t k = 0; k < kMaxInstances - 2; ++k) {
    configs.push_back({.name = "law" + std::to_string(k), .type = "gravity_compensation", .arms = {0}});
  }
  TestLoop loop(2, configs, test::test_registry());
  EXPECT_EQ(loop.modes().instance_count(), 64u);
  loop.step();
  EXPECT_TRUE(loop.activate({"law61"}).accepted()) << "the last one";
  EXPECT_EQ(loop.modes().active(), loop.set({"law61", "arm1_hold"}));
  EXPECT_EQ(loop.ask({.deactivate = ~InstanceSet{0}}).verdict, Verdict::accepted);
  EXPECT_EQ(loop.modes().active(), loop.set({"arm0_hold", "arm1_hold"}));
  configs.push_back({.name = "one_more", .type = "gravity_compensation", .arms = {0}});
  EXPECT_THROW(TestLoop(2, configs, test::test_registry()), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::instance_test
