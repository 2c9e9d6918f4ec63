// What a world refuses is what a run refuses, in the same words; a world that was reset is a new one.
#include <cstring>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/testing/wrong_goals.hpp"
#include "python_bindings/batch.hpp"
#include "scene/build.hpp"

namespace multipanda::controlled_world_test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

class NativeWorld : public testing::Test {
 protected:
  NativeWorld() {
    const std::uint8_t all[] = {1};
    batch_.reset(all, std::vector<WorldStart>(1));
  }
  // Why the world refuses the request; empty: it does not.
  std::string refusal(const json& request) {
    try {
      batch_.world(0).command(request);
    } catch (const RequestRefused& refused) {
      return refused.what();
    } catch (const std::invalid_argument& wrong) {
      return wrong.what();
    }
    return {};
  }
  void step() { batch_.world(0).step(1); }

  Batch batch_{"one_arm", 1, 1};
};

TEST_F(NativeWorld, WrongGoalsGetTheSentenceOfAllWaysIn) {
  const auto model = build_controller_model(batch_.scene().arms[0]);
  for (const auto& goal : test::wrong_goals(*model)) {
    const bool pose = goal.quantity == Quantity::pose;
    const char *name = pose ? "cartesian" : "joint", *input = pose ? "pose" : "joints";
    EXPECT_EQ(refusal({{"do", "switch"}, {"activate", {name}}}), "");
    step();
    json request = {{"do", "reference"}, {"controllet", name}, {"input", input}, {"values", goal.values}};
    if (goal.duration_s != 0) request["duration_s"] = goal.duration_s;
    EXPECT_THAT(refusal(request), HasSubstr(goal.sentence));
    request["stream"] = true;
    EXPECT_THAT(refusal(request), HasSubstr(goal.sentence));
  }
  step();
  EXPECT_EQ(batch_.world(0).refusal(), "");
}

// A world takes the checks of loads, too: the arm is stopped.
TEST_F(NativeWorld, TakesNoLoadWhileItsArmIsStopped) {
  const json load = {{"do", "set_load"}, {"arm", "arm"}, {"mass_kg", 0.4}};
  EXPECT_EQ(refusal(load), "");
  EXPECT_EQ(refusal({{"do", "stop"}}), "");
  step();
  EXPECT_EQ(batch_.world(0).refusal(), "");
  EXPECT_EQ(refusal(load), "");  // decided with the next cycle
  step();
  EXPECT_THAT(batch_.world(0).refusal(), HasSubstr("'arm' is stopped, and another load would move it"));
}

// Two noisy arms and an instance of every law, named as its type; objects that features see.
std::string every_law(const Registry& registry) {
  std::string text =
      "name: every_law\nduration_s: 9\nplant: {fidelity: realistic}\narms:\n"
      "  - {name: left, model: fer, base: {position_m: [0, 0.26, 0]}}\n"
      "  - {name: right, model: fer, base: {position_m: [0, -0.26, 0]}}\n"
      "objects:\n  - {name: floor, shape: plane}\n"
      "  - {name: post, shape: box, size_m: [0.1, 0.1, 0.8], position_m: [0.45, 0, 0.4]}\n"
      "  - {name: box, shape: box, size_m: [0.06, 0.2, 0.06], position_m: [0.8, 0, 0.031], fixed: false, "
      "mass_kg: 0.5}\n"
      "timeline:\n"
      "  - at_s: 0.01\n"
      "    reference: {controllet: cartesian_impedance, input: pose, position_m: [0.4, 0.3, 0.5], "
      "rpy_rad: [pi, 0, 0], duration_s: 1}\n"
      "  - {at_s: 0.05, switch: {activate: [joint_impedance]}}\n"
      "active: [cartesian_impedance]\ncontrollets:\n";
  for (const auto& [law, create] : registry.controllets()) {
    if (law.type == "hold") continue;  // every arm has one
    text += "  - {name: " + law.type + ", type: " + law.type +
            ", arms: " + (law.arms == 1 ? "left" : "[left, right]");
    text += law.observes > 0 ? ", observes: right}\n" : "}\n";
  }
  return text;
}

// A user's law, and a user's feature, that forget nothing when they start.
class Counting final : public Controllet {
 public:
  static ControlletDescriptor descriptor() { return {.type = "counting"}; }
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext& context) override {
    *context.arms[0].tau = context.arms[0].terms->c();
    (*context.arms[0].tau)[6] = 1e-4 * ++count_;
    return LawResult::ok;
  }

 private:
  int count_ = 0;
};
class CountingFeature final : public Feature {
 public:
  static ControlletDescriptor descriptor() { return {.type = "counting_feature"}; }
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext& context) override {
    (*context.arms[0].tau)[6] += 1e-4 * ++count_;
    return LawResult::ok;
  }

 private:
  int count_ = 0;
};

Registry with_users_laws() {
  Registry registry = Registry::with_builtins();
  registry.add(controllet_type<Counting>());
  registry.add(feature_type<CountingFeature>());
  return registry;
}

class ResetWorld : public testing::Test {
 protected:
  ControlledWorld world() const { return {scene_, registry_, parts_, layout_}; }
  static std::string instance_of(const ControlletDescriptor& law) {
    return law.type == "hold" ? "left_hold" : law.type;
  }
  static WorldStart start(const ControlletDescriptor& law, std::uint64_t seed) {
    return {
        .seed = seed, .hidden = false, .q_start = {}, .objects = {}, .active = std::vector{instance_of(law)}};
  }
  static void ask(ControlledWorld& world, const json& request) {
    try {
      world.command(request);
    } catch (const RequestRefused& refused) {
      world.refuse(refused.what());  // the same in both worlds
    }
  }
  std::vector<double> row(const ControlledWorld& world) const {
    std::vector<double> numbers(layout_.size());
    world.write_state(numbers.data());
    return numbers;
  }
  void switch_feature(ControlledWorld& world, const ControlletDescriptor& law, std::size_t k, bool on) const {
    const std::string& name = registry_.features()[k].descriptor.type;
    ask(world, {{"do", "feature"}, {"controllet", instance_of(law)}, {"name", name}, {"on", on}});
  }
  // Every parameter of the law and of its features, changed.
  void change_parameters(ControlledWorld& world, const ControlletDescriptor& law) const {
    const auto change = [&](const ParameterSpec& spec, const std::string& name) {
      json value;
      if (!spec.choices.empty()) {
        value = spec.choices[spec.initial[0] == 0 ? 1 : 0];
      } else {
        std::vector<double> values = spec.initial;
        values.resize(spec.size == ParameterSpec::kPerJoint ? 7 : spec.size, values[0]);
        for (double& v : values) v += v == spec.min ? 0.01 * (spec.max - spec.min) : 0.3 * (spec.min - v);
        value = values.size() == 1 ? json(values[0]) : json(values);
      }
      ask(world, {{"do", "parameter"}, {"controllet", instance_of(law)}, {"name", name}, {"value", value}});
      world.step(1);
    };
    for (const auto& spec : law.parameters) change(spec, spec.name);
    for (const auto& feature : registry_.features()) {
      for (const auto& spec : feature.descriptor.parameters)
        change(spec, feature.descriptor.type + "." + spec.name);
    }
  }
  // A goal near the present state for every input.
  void aim(ControlledWorld& world, const ControlletDescriptor& law) const {
    for (const auto& input : law.inputs) {
      const auto& arm = layout_.arms()[input.arm];
      const std::vector<double> now = row(world);
      std::vector<double> values;
      for (const auto& field : arm.fields) {
        const bool place = field.name == (input.quantity == Quantity::pose ? "X_WE" : "q_rad");
        if (place) values.assign(now.data() + field.offset / 8, now.data() + field.offset / 8 + 7);
      }
      if (input.quantity == Quantity::wrench || input.quantity == Quantity::twist) values.assign(6, 0.1);
      if (input.quantity == Quantity::scalar) values = {0.1};
      values[0] += 0.03;
      ask(world,
          {{"do", "reference"}, {"controllet", instance_of(law)}, {"input", input.name}, {"values", values}});
    }
  }
  // All that the world shows in a run of 150 cycles, and what it refuses.
  std::pair<std::vector<double>, std::string> run(ControlledWorld& world,
                                                  const ControlletDescriptor& law) const {
    std::vector<double> all;
    for (int cycle = 0; cycle < 150; ++cycle) {
      // One per cycle: a refusal refuses all of its cycle.
      const auto k = static_cast<std::size_t>(cycle) - 10;
      if (k < registry_.features().size()) switch_feature(world, law, k, true);
      if (cycle == 30) aim(world, law);
      if (cycle == 60) change_parameters(world, law);
      const std::vector<double> now = row(world);
      all.insert(all.end(), now.begin(), now.end());
      world.step(1);
    }
    return {all, world.refusal() + world.held()};
  }
  void expect_same(ControlledWorld& used, ControlledWorld& fresh, const ControlletDescriptor& law) const {
    const auto [seen, said] = run(used, law);
    const auto [expected, expected_said] = run(fresh, law);
    EXPECT_EQ(said, expected_said) << law.type;
    ASSERT_EQ(seen.size(), expected.size());
    EXPECT_EQ(std::memcmp(seen.data(), expected.data(), 8 * seen.size()), 0) << law.type;
    EXPECT_NE(std::memcmp(seen.data(), &seen[seen.size() - layout_.size()], 8 * layout_.size()), 0);
  }
  // A run with all that a later one must not see, broken off in its midst.
  void use(ControlledWorld& world, const ControlletDescriptor& law) const {
    run(world, law);
    ask(world, {{"do", "set_load"}, {"arm", "left"}, {"mass_kg", 0.4}});
    ask(world, {{"do", "push_object"}, {"object", "box"}, {"force_n", {3, 0, 0}}});
    ask(world, {{"do", "feature"}, {"controllet", "left_hold"}, {"name", "joint_limits"}, {"on", true}});
    world.step(30);
    ask(world, {{"do", "stop"}, {"arms", {"left"}}});
    world.step(20);
    aim(world, law);  // waits for the next cycle
    switch_feature(world, law, 0, false);
  }

  Registry registry_ = with_users_laws();
  Scene scene_ = parse_scene(every_law(registry_), "every_law", registry_);
  WorldParts parts_{scene_};
  StateRow layout_{scene_};
};

TEST_F(ResetWorld, IsANewOneToTheBitWithEveryLawAndFeature) {
  ControlledWorld used = world();
  const auto expect_new = [&](const ControlletDescriptor& law) {
    used.reset(start(law, 3));
    ControlledWorld fresh = world();
    fresh.reset(start(law, 3));
    expect_same(used, fresh, law);
  };
  for (const auto& [law, create] : registry_.controllets()) {
    used.reset(start(law, 2));
    use(used, law);
    expect_new(law);
    const ControlletDescriptor& other =
        registry_.controllet(law.type == "force" ? "ufic" : "force")->descriptor;
    used.reset(start(other, 2));
    change_parameters(used, law);  // of a law that does not run
    expect_new(law);
    used.reset(start(other, 2));
    switch_feature(used, law, registry_.features().size() - 1, true);
    used.step(1);
    expect_new(law);
  }
}

TEST_F(ResetWorld, IsANewOneWithTheTimelineAndWithHiddenPlants) {
  const ControlletDescriptor law = registry_.controllet("cartesian_impedance")->descriptor;
  ControlledWorld used = world();
  for (const bool hidden : {false, true, true, false}) {
    used.reset(start(law, 1));
    use(used, law);
    const WorldStart next{.seed = 4,
                          .hidden = hidden,
                          .q_start = {{"left", std::vector{0.1, -0.7, 0.0, -2.2, 0.1, 1.6, 0.7}}},
                          .objects = {{"box", {0.8, 0.1, 0.031, 1, 0, 0, 0}}},
                          .active = {}};
    used.reset(next);
    ControlledWorld fresh = world();
    fresh.reset(next);
    expect_same(used, fresh, law);
  }
}

}  // namespace
}  // namespace multipanda::controlled_world_test
