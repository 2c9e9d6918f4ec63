#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include <gmock/gmock.h>
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

// A law whose arms bear less than its parameters' specs allow.
class Bounded final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    return {.type = "bounded",
            .doc = "",
            .arms = 1,
            .parameters = {{.name = "gain", .unit = "N", .size = 0, .initial = {1}, .max = 100},
                           {.name = "scale", .initial = {1}, .max = 100},
                           {.name = "free", .initial = {1}, .max = 100},
                           {.name = "long", .size = kMaxParameterSize, .initial = {1}, .max = 100}}};
  }
  inline static double scale = 0;  // as the law saw it last
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext& context) override {
    scale = context.parameters->number(1);
    return LawResult::ok;
  }
  void bound_parameters(ParameterSet& parameters) const override {
    parameters.lower_max(0, std::array{10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0}, "soft");
    parameters.lower_max(1, std::array{5.0}, "weak");
  }
};

TEST(InstanceConfig, AValueAboveWhatTheArmBearsIsRefusedWithJointLimitAndReason) {
  Registry registry = test::test_registry();
  registry.add(controllet_type<Bounded>());
  InstanceConfig config{.name = "law", .type = "bounded", .arms = {0}};
  TestLoop loop(1, {config}, registry);
  const Instance& law = loop.modes().instance(loop.find("law"));
  const std::string second = "'gain' of joint2 must be at most 20 N here: soft";
  EXPECT_EQ(law.bound_text(0, std::array{10.0, 20.5, 30.5}), second) << "the first one above its bound";
  EXPECT_EQ(law.bound_text(0, std::array{10.5}), "'gain' of joint1 must be at most 10 N here: soft");
  EXPECT_EQ(law.bound_text(0, std::array{10.0, 20.0}), "");
  EXPECT_EQ(law.bound_text(0, std::array{0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 70.0, 999.0}), "") << "seven joints";
  EXPECT_EQ(law.bound_text(1, std::array{6.0}), "'scale' must be at most 5 here: weak");
  EXPECT_EQ(law.bound_text(1, std::array{5.0}), "");
  EXPECT_EQ(law.bound_text(2, std::array{101.0}), "") << "beyond the spec's own bound";
  config.parameters = {{"gain", {1, 20.5, 1, 1, 1, 1, 1}}};
  EXPECT_EQ(refusal(config, registry), "controllet 'law': parameter 'gain': value out of bounds; " + second);
  config.parameters = {{"free", {101}}};
  EXPECT_EQ(refusal(config, registry), "controllet 'law': parameter 'free': value out of bounds");
}

// A feature that refuses to start, and one that counts its starts.
class Refusing final : public Feature {
 public:
  std::string_view refusal() const override { return "it has no sensor"; }
  LawResult start(ControlContext&) override { return LawResult::fault; }
  LawResult update(ControlContext&) override { return LawResult::fault; }
};

class Weak final : public Feature {
 public:
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext&) override { return LawResult::ok; }
  void bound_parameters(ParameterSet& parameters) const override {
    parameters.lower_max(0, std::array{2.0}, "weak");
  }
};

class Counting final : public Feature {
 public:
  inline static int starts = 0;
  LawResult start(ControlContext&) override { return ++starts, LawResult::ok; }
  LawResult update(ControlContext&) override { return LawResult::ok; }
};

template <typename Law>
FeatureType feature_of(const char* name) {
  return {{.type = name, .doc = ""},
          [](const FeatureContext&) -> std::unique_ptr<Feature> { return std::make_unique<Law>(); }};
}

TEST(InstanceConfig, AFeatureBoundsItsParameters) {
  Registry registry = test::test_registry();
  FeatureType weak = feature_of<Weak>("weak");
  weak.descriptor.parameters = {{.name = "gain", .initial = {1}, .max = 100}};
  registry.add(weak);
  TestLoop loop(1, {spring()}, registry);
  const Instance& law = loop.modes().instance(loop.find("law"));
  const std::size_t gain = law.find_parameter("weak.gain");
  EXPECT_EQ(law.check_parameter(gain, std::array{2.0}), Verdict::accepted);
  EXPECT_EQ(law.check_parameter(gain, std::array{2.5}), Verdict::out_of_bounds);
  EXPECT_EQ(law.bound_text(gain, std::array{2.5}), "'gain' must be at most 2 here: weak");
}

TEST(InstanceConfig, AFeatureThatCannotStartIsRefusedWithItsReason) {
  Registry registry = test::test_registry();
  registry.add(feature_of<Refusing>("touch"));
  InstanceConfig config = spring();
  EXPECT_EQ(refusal(config, registry), "") << "it is off";
  config.features = {"touch"};
  EXPECT_EQ(refusal(config, registry), "controllet 'law': feature 'touch': it has no sensor");
}

TEST(InstanceFeatures, StartWhenTheyAreSwitchedOnOrTheirControlletStarts) {
  Registry registry = test::test_registry();
  registry.add(feature_of<Counting>("count"));
  TestLoop loop(2, {spring()}, registry);
  loop.step();
  Request request{.kind = Request::Kind::set_feature, .instance = loop.find("law")};
  request.index = static_cast<std::uint16_t>(loop.modes().instance(loop.find("law")).find_feature("count"));
  Counting::starts = 0;
  const auto starts_after = [&](bool on) {
    request.on = on;
    EXPECT_TRUE(loop.ask(request).accepted());
    return Counting::starts;
  };
  EXPECT_EQ(starts_after(true), 0) << "not active";
  EXPECT_EQ(starts_after(false), 0);
  ASSERT_TRUE(loop.activate({"law"}).accepted());
  EXPECT_EQ(Counting::starts, 0) << "off";
  EXPECT_EQ(starts_after(false), 0);
  EXPECT_EQ(starts_after(true), 1);
  EXPECT_EQ(starts_after(true), 1) << "it is on";
  EXPECT_EQ(starts_after(false), 1);
  EXPECT_EQ(starts_after(true), 2);
  ASSERT_TRUE(loop.ask({.deactivate = loop.set({"law"})}).accepted());
  ASSERT_TRUE(loop.activate({"law"}).accepted());
  EXPECT_EQ(Counting::starts, 3);
}

TEST(InstanceConfig, AFeatureThatRefusesInARunIsAnswered) {
  Registry registry = test::test_registry();
  registry.add(feature_of<Refusing>("touch"));
  TestLoop loop(2, {spring()}, registry);
  loop.step();
  ASSERT_TRUE(loop.activate({"law"}).accepted());
  const Instance& law = loop.modes().instance(loop.find("law"));
  Request request{.kind = Request::Kind::set_feature, .instance = loop.find("law"), .on = true};
  request.index = static_cast<std::uint16_t>(law.find_feature("touch"));
  EXPECT_EQ(loop.ask(request).verdict, Verdict::start_refused);
  EXPECT_FALSE(law.feature_on(request.index));
  EXPECT_EQ(loop.modes().owner(0), loop.find("law"));
}

// May refuse to start where the arm is.
class Wary final : public Feature {
 public:
  std::string_view start_condition() const override { return "the arm is too near"; }
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext&) override { return LawResult::ok; }
};

// A hold must start anywhere: after a stop, a fault, and instead of what was switched off.
TEST(InstanceConfig, AHoldHasNoFeatureThatMayRefuseToStart) {
  Registry registry = test::test_registry();
  registry.add(feature_of<Wary>("wary"));
  InstanceConfig hold{.name = "arm0_hold", .type = "hold", .arms = {0}, .features = {"wary"}};
  EXPECT_THAT(refusal(hold, registry), testing::HasSubstr("a hold must be able to start anywhere"));
  InstanceConfig law = spring();
  law.features = {"wary"};
  EXPECT_EQ(refusal(law, registry), "");

  TestLoop loop(2, {spring()}, registry);
  loop.step();
  const Instance& of_arm = loop.modes().instance(loop.find("arm0_hold"));
  Request on{.kind = Request::Kind::set_feature, .instance = loop.find("arm0_hold"), .on = true};
  on.index = static_cast<std::uint16_t>(of_arm.find_feature("wary"));
  EXPECT_EQ(loop.ask(on).verdict, Verdict::start_refused) << "it is active";
  ASSERT_TRUE(loop.activate({"law"}).accepted());
  EXPECT_EQ(loop.ask(on).verdict, Verdict::start_refused) << "it is not active";
  EXPECT_FALSE(of_arm.feature_on(on.index));
  on.instance = loop.find("law");
  EXPECT_TRUE(loop.ask(on).accepted());
}

// Each tick of a law has the time since its last one; a start is a whole period after "the last one".
class Timed final : public Controllet {
 public:
  inline static std::vector<double> started, ticked;
  static ControlletDescriptor descriptor() { return {.type = "timed", .doc = "", .arms = 1}; }
  LawResult start(ControlContext& context) override {
    started.push_back(context.dt);
    return LawResult::ok;
  }
  LawResult update(ControlContext& context) override {
    ticked.push_back(context.dt);
    return LawResult::ok;
  }
};

TEST(InstanceTicks, AreAsLongAsTheTimeSinceTheLastOneAndAPeriodAtTheStart) {
  Registry registry = test::test_registry();
  registry.add(controllet_type<Timed>());
  TestLoop loop(1, {{.name = "law", .type = "timed", .arms = {0}}}, registry);
  Timed::started.clear();
  Timed::ticked.clear();
  loop.world.step_s = 0.003;
  loop.steps(4);
  for (int round = 0; round < 2; ++round) {
    ASSERT_TRUE(loop.activate({"law"}).accepted());
    loop.steps(2);
    ASSERT_TRUE(loop.ask({.deactivate = loop.set({"law"})}).accepted());
    EXPECT_EQ(Timed::started.back(), kArmPeriod);
  }
  EXPECT_EQ(Timed::started.size(), 2u);
  const std::vector<double> expected = {0.001, 0.003, 0.003, 0.001, 0.003, 0.003};
  ASSERT_EQ(Timed::ticked.size(), expected.size());
  for (std::size_t k = 0; k < expected.size(); ++k) EXPECT_NEAR(Timed::ticked[k], expected[k], 1e-12);
}

// Two steps at the same time: dt is never zero. A pause of the loop: no more than five periods.
TEST(InstanceTicks, AreBounded) {
  Registry registry = test::test_registry();
  registry.add(controllet_type<Timed>());
  for (const auto& [step_s, expected] : {std::pair{0.0, 1e-6}, std::pair{0.02, 0.005}}) {
    TestLoop loop(1, {{.name = "law", .type = "timed", .arms = {0}}}, registry);
    loop.modes().activate_at_start(loop.set({"law"}));
    loop.world.step_s = step_s;
    loop.steps(2);
    EXPECT_DOUBLE_EQ(Timed::ticked.back(), expected);
  }
}

// A feature that can no longer act while it fades out has ended.
class Tired final : public Feature {
 public:
  inline static int updates = 0;
  inline static bool works = true;
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext&) override { return ++updates, works ? LawResult::ok : LawResult::fault; }
};

TEST(InstanceFeatures, OneThatFaultsWhileItFadesOutHasEnded) {
  Registry registry = test::test_registry();
  registry.add(feature_of<Tired>("tired"));
  InstanceConfig config = spring();
  config.features = {"tired"};
  TestLoop loop(1, {config}, registry);
  loop.modes().activate_at_start(loop.set({"law"}));
  loop.steps(300);
  Request off{.kind = Request::Kind::set_feature, .instance = loop.find("law")};
  off.index = static_cast<std::uint16_t>(loop.modes().instance(off.instance).find_feature("tired"));
  Tired::works = false;
  Tired::updates = 0;
  ASSERT_TRUE(loop.ask(off).accepted());
  loop.steps(5);
  EXPECT_EQ(Tired::updates, 1);
  EXPECT_EQ(loop.modes().owner(0), loop.find("law"));
}

// After the last step of a fade, which may be a part of one.
TEST(InstanceFeatures, NeverActWithMoreThanTheirTorque) {
  InstanceConfig config = spring();
  config.features = {"push"};
  TestLoop loop(1, {config}, test::test_registry());
  loop.world.step_s = 0.0015;
  loop.modes().activate_at_start(loop.set({"law"}));
  double last = 0;
  for (int k = 0; k < 300; ++k) {
    loop.step();
    const double torque = loop.cycle.data().tau_feature[0][3];
    ASSERT_GE(torque, last);
    ASSERT_LE(torque, 0.5);
    last = torque;
  }
  EXPECT_EQ(last, 0.5);
}

// Springs of the law pull back what a feature lets go: its fade and its parameters are the slower, the faster
// the fastest arm moves already, up to 0.1 m/s or 0.5 rad/s. What presses nothing is not slowed.
TEST(InstanceFeatures, LetGoTheSlowerTheFasterTheirArmsMove) {
  test::Draw draw(58);
  double least = 1, most = 0;
  for (ArmIndex trial = 0; trial < 24; ++trial) {
    InstanceConfig config{.name = "both", .type = "pair", .arms = {0, 1}, .features = {"push"}};
    const bool lifted = trial % 8 == 0;
    if (!lifted) config.contact = {};
    TestLoop loop(2, {config}, test::test_registry());
    loop.modes().activate_at_start(loop.set({"both"}));
    std::array<JointVector, 2> q, dq;
    double fastest = 0;
    const auto step = [&](int count, bool moves) {
      for (; count > 0; --count) {
        for (const ArmIndex arm : {ArmIndex{0}, ArmIndex{1}}) {
          loop.world.set_position(arm, q[arm]);
          loop.world.set_velocity(arm, (moves ? 1 : 0) * dq[arm]);
        }
        loop.step();
      }
      return loop.cycle.data().tau_feature[1][2];
    };
    for (const ArmIndex arm : {ArmIndex{0}, ArmIndex{1}}) {
      q[arm] = loop.models[arm]->q_home() + draw.joints(7, 0.1);
      const double size = trial % 2 == arm ? 0.05 : 1;
      dq[arm] =
          size * (trial % 3 == 0 ? draw.uniform(0, 0.6) * JointVector::Unit(7, 6) : draw.joints(7, 0.15));
      constexpr double h = 1e-5;
      ModelTerms above(loop.models[arm]), below(loop.models[arm]);
      above.update(q[arm] + h * dq[arm], dq[arm]);
      below.update(q[arm] - h * dq[arm], dq[arm]);
      const double hand = (above.X_WE().position - below.X_WE().position).norm() / (2 * h);
      fastest = std::max({fastest, hand / 0.1, dq[arm].maxCoeff() / 0.5, -dq[arm].minCoeff() / 0.5});
    }
    const double pace = lifted ? 1 : std::max(0.05, 1 - fastest);
    // Arms that move against the push are braked, by 20 1/s times their momentum.
    ModelTerms terms(loop.models[1]);
    terms.update(q[1], dq[1]);
    const bool yields = dq[0].sum() < 0 || dq[1].sum() < 0;
    const double brake = yields ? -20 * (1 - pace) * terms.M().row(2).dot(dq[1]) : 0;
    least = std::min(least, pace);
    if (!lifted) most = std::max(most, pace);
    ASSERT_EQ(step(210, false), 0.5);
    const InstanceIndex both = loop.find("both");
    const Instance& law = loop.modes().instance(both);
    const auto post = [&](Request request) {
      std::uint64_t ticket = 0;
      ASSERT_EQ(loop.modes().post(std::span(&request, 1), ticket), Verdict::accepted);
    };
    Request value{.kind = Request::Kind::set_parameter, .instance = both, .size = 1, .values = {0}};
    value.index = static_cast<std::uint16_t>(law.find_parameter("push.torque_nm"));
    post(value);
    EXPECT_NEAR(step(3, true), 0.5 - 3 * pace * 0.0025 + brake, 1e-9) << trial;
    ASSERT_EQ(step(210, false), 0);
    value.values[0] = 0.4;
    post(value);
    EXPECT_NEAR(step(1, true), 0.002, 1e-9) << trial;
    EXPECT_NEAR(step(2, true), 0.002 + 2 * pace * 0.002 + brake, 1e-9) << trial;
    ASSERT_EQ(step(210, false), 0.4);
    Request off{.kind = Request::Kind::set_feature, .instance = both};
    off.index = static_cast<std::uint16_t>(law.find_feature("push"));
    post(off);
    EXPECT_NEAR(step(3, true), 0.4 * (1 - 3 * pace / 200) + brake, 1e-9) << trial;
  }
  EXPECT_EQ(least, 0.05);
  EXPECT_GT(most, 0.5);
}

TEST(InstanceInputs, AreRecordedInTheirOrderWithTheirSizes) {
  TestLoop loop(1, {{.name = "law", .type = "inputs", .arms = {0}}}, registry_with_inputs(), 2);
  loop.modes().activate_at_start(loop.set({"law"}));
  const std::vector<std::size_t> sizes = {7, 6, 6, 7};
  for (int k = 0; k < 5; ++k) {  // more than the ring has
    loop.step();
    const CycleRecord& record = *loop.cycle.record()->ring.front();
    ASSERT_EQ(record.reference_count, sizes.size());
    for (std::size_t i = 0; i < sizes.size(); ++i) {
      EXPECT_EQ(record.references[i].instance, loop.find("law"));
      EXPECT_EQ(record.references[i].input, i);
      EXPECT_EQ(record.references[i].size, sizes[i]);
    }
    loop.cycle.record()->ring.pop();
  }
}

// A joint reference far away: the hand of the arm where it is now keeps to the bound for contact.
TEST(InstanceInputs, JointReferencesKeepTheHandToTheBoundForContact) {
  constexpr double kBound = 0.1;  // [m/s]
  double fastest[2] = {0, 0};
  for (const bool bounded : {false, true}) {
    InstanceConfig config{.name = "law", .type = "follow", .arms = {1}};
    if (bounded) config.contact.hand_speed = kBound;
    TestLoop loop(2, {config}, test::test_registry());
    loop.step();
    ASSERT_TRUE(loop.activate({"law"}).accepted());
    Request goal{.kind = Request::Kind::set_target, .instance = loop.find("law")};
    goal.target.size = 7;
    const JointVector home = loop.models[1]->q_home();
    for (std::size_t i = 0; i < 7; ++i) goal.target.values[i] = home[static_cast<Eigen::Index>(i)] + 0.4;
    ASSERT_TRUE(loop.ask(goal).accepted());
    for (int k = 0; k < 6000; ++k) {
      loop.step();
      const Reference& reference = loop.modes().instance(loop.find("law")).inputs()[0];
      ModelTerms terms(loop.models[1]);
      terms.update(loop.cycle.data().state[1]);
      const Vector6 V = terms.J_V_WE().lazyProduct(reference.joint_velocity());
      fastest[bounded] = std::max(fastest[bounded], V.head<3>().norm());
    }
  }
  EXPECT_GT(fastest[0], 3 * kBound);
  EXPECT_LE(fastest[1], 1.01 * kBound) << "the pace is filtered";
  EXPECT_GE(fastest[1], 0.95 * kBound);
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
  EXPECT_EQ(output("push.push_nm"), 0.5) << "it fades";
  loop.steps(200);
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

TEST(RegistryTypes, HasEveryControlletAndFeatureOfMultipanda) {
  const auto names = [](const auto& types) {
    std::vector<std::string> list;
    for (const auto& type : types) list.push_back(type.descriptor.type);
    return list;
  };
  const Registry registry = Registry::with_builtins();
  EXPECT_EQ(names(registry.controllets()),
            (std::vector<std::string>{"hold", "gravity_compensation", "joint_impedance",
                                      "cartesian_impedance", "dual_cartesian_impedance",
                                      "coupled_dual_cartesian_impedance", "force", "hybrid_force", "ufic",
                                      "coupled_ufic", "joint_follower", "pose_follower", "teleoperation"}));
  EXPECT_EQ(names(registry.features()),
            (std::vector<std::string>{"joint_limits", "collision_avoidance", "manipulability",
                                      "friction_compensation"}));
}

TEST(InstanceParameters, OfALawMoveWithinAFifthOfASecond) {
  Registry registry = test::test_registry();
  registry.add(controllet_type<Bounded>());
  TestLoop loop(1, {{.name = "law", .type = "bounded", .arms = {0}}}, registry);
  loop.step();
  ASSERT_TRUE(loop.activate({"law"}).accepted());
  EXPECT_EQ(Bounded::scale, 1);
  Request set{.kind = Request::Kind::set_parameter, .instance = loop.find("law"), .index = 1, .size = 1};
  set.values[0] = 3;
  ASSERT_TRUE(loop.ask(set).accepted());
  for (int k = 1; k <= 210; ++k) {
    ASSERT_NEAR(Bounded::scale, 1 + 2 * std::min(1.0, k / 200.0), 1e-9) << k;
    loop.step();
  }
}

TEST(InstanceParameters, HaveAtMostAsManyNumbersAsARequestHolds) {
  Registry registry = test::test_registry();
  registry.add(controllet_type<Bounded>());
  TestLoop loop(1, {{.name = "law", .type = "bounded", .arms = {0}}}, registry);
  const Instance& law = loop.modes().instance(loop.find("law"));
  Request set{.kind = Request::Kind::set_parameter, .instance = loop.find("law")};
  set.index = static_cast<std::uint16_t>(law.find_parameter("long"));
  set.values.fill(7);
  for (const std::size_t size : {kMaxParameterSize, kMaxParameterSize - 1, kMaxParameterSize + 1}) {
    set.size = static_cast<std::uint8_t>(size);
    EXPECT_EQ(loop.ask(set).verdict, size == kMaxParameterSize ? Verdict::accepted : Verdict::wrong_size);
  }
  EXPECT_EQ(law.parameter(set.index), std::vector<double>(kMaxParameterSize, 7));
}

// A start needs no ramps: parameters that were on their way when the controllet ended are where they go to.
TEST(InstanceParameters, AreWhereTheyGoToAfterAStart) {
  Registry registry = test::test_registry();
  registry.add(controllet_type<Bounded>());
  TestLoop loop(1, {{.name = "law", .type = "bounded", .arms = {0}, .features = {"push"}}}, registry);
  loop.step();
  ASSERT_TRUE(loop.activate({"law"}).accepted());
  const Instance& law = loop.modes().instance(loop.find("law"));
  std::array<Request, 2> batch;
  for (std::size_t i = 0; i < 2; ++i) {
    batch[i] = {.kind = Request::Kind::set_parameter, .instance = loop.find("law"), .size = 1};
    batch[i].index = static_cast<std::uint16_t>(law.find_parameter(i == 0 ? "scale" : "push.torque_nm"));
    batch[i].values[0] = 4;
    ASSERT_TRUE(loop.ask(batch[i]).accepted());
  }
  loop.steps(5);
  ASSERT_TRUE(loop.ask({.deactivate = loop.set({"law"})}).accepted());
  loop.step();
  ASSERT_TRUE(loop.activate({"law"}).accepted());
  EXPECT_EQ(Bounded::scale, 4);
  EXPECT_NEAR(loop.cycle.data().tau_feature[0][0], 4.0 / 200, 1e-12) << "of the fade";
}

// A law that is told of redefined end effectors.
class Framed final : public Controllet {
 public:
  inline static std::vector<std::pair<std::size_t, Pose>> moved;
  static ControlletDescriptor descriptor() { return {.type = "framed", .doc = "", .arms = 2}; }
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext&) override { return LawResult::ok; }
  void end_effector_moved(ControlContext&, std::size_t arm, const Pose& X) override {
    moved.emplace_back(arm, X);
  }
};

TEST(InstanceFrames, OfTheStartAreKnownAndEachChangeIsToldOnce) {
  Registry registry = test::test_registry();
  registry.add(controllet_type<Framed>());
  TestLoop loop(2, {{.name = "law", .type = "framed", .arms = {1, 0}}}, registry);
  std::array<Pose, 2> X_FE{Pose{rotation_from_rpy({0.1, 0.2, 0.3}), {0.1, 0, 0}},
                           Pose{rotation_from_rpy({0.3, 0.1, 0.2}), {0, 0.2, 0}}};
  loop.world.tamper = [&](ArmIndex arm, std::uint64_t, ArmState& state) { state.frames.X_FE = X_FE[arm]; };
  Framed::moved.clear();
  loop.step();
  ASSERT_TRUE(loop.activate({"law"}).accepted());
  loop.steps(3);
  EXPECT_TRUE(Framed::moved.empty());
  const Pose shift{Matrix3::Identity(), {0, 0, 0.1}}, turn{rotation_from_rpy({0, 0, 0.4}), {0, 0, 0}};
  X_FE[0] = X_FE[0] * shift;  // the law's second arm
  loop.steps(3);
  X_FE[1] = X_FE[1] * turn;
  loop.steps(3);
  ASSERT_EQ(Framed::moved.size(), 2u);
  EXPECT_EQ(Framed::moved[0].first, 1u);
  EXPECT_LT(pose_error(Framed::moved[0].second, shift).norm(), 1e-12);
  EXPECT_EQ(Framed::moved[1].first, 0u);
  EXPECT_LT(pose_error(Framed::moved[1].second, turn).norm(), 1e-12);
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
