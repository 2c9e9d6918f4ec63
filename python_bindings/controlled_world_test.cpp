// What a world refuses is what a run refuses, in the same words.
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

}  // namespace
}  // namespace multipanda::controlled_world_test
