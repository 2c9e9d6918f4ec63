// Two leaders lead two followers in one scene, measured by the plant's true joints: each follower follows its
// own leader, whatever law leads the other pair.
#include "tests/teleoperation/pairs.hpp"

#include <gtest/gtest.h>

namespace multipanda::teleoperation {
namespace {

// Joints are compared with friction only: without it the leader's elbow, which nobody holds, swings faster
// than a follower's set-point may move.
TEST(Pairs, TwoPersonsLeadTwoFollowersWithoutOwningThem) {
  for (const auto& plant : {PlantFidelity::ideal(), PlantFidelity::realistic()}) {
    const PairsOutcome found = run({.laws = {"joint_follower", "pose_follower"}, .plant = plant});
    SCOPED_TRACE(plant.name);
    EXPECT_EQ(found.interventions, "");
    for (const PairOutcome& pair : found.pairs) {
      EXPECT_TRUE(pair.kept);
      EXPECT_GT(pair.way, 0.08);
      EXPECT_GT(pair.follower_way, 0.08);
    }
    const bool friction = plant.name != "ideal";
    if (friction) {
      EXPECT_LE(found.pairs[0].joint_error, 0.01);
    }
    EXPECT_LE(found.pairs[1].hand_error, friction ? 0.01 : 0.003);  // 400 N/m against the joints' friction
  }
}

TEST(Pairs, TwoTeleoperationsInOneScene) {
  const PairsOutcome found = run({.laws = {"teleoperation", "teleoperation"}});
  EXPECT_EQ(found.interventions, "");
  for (const PairOutcome& pair : found.pairs) {
    EXPECT_TRUE(pair.kept);
    EXPECT_GT(pair.way, 0.08);
    EXPECT_LE(pair.hand_error, 0.002);
  }
}

// Only one of two persons moves: the other pair stays where it is, and follows nobody.
TEST(Pairs, APairDoesNotFollowTheOthersLeader) {
  for (const char* law : {"teleoperation", "joint_follower", "pose_follower"}) {
    const PairsOutcome found = run({.laws = {law, law}, .moves = {true, false}});
    SCOPED_TRACE(law);
    EXPECT_EQ(found.interventions, "");
    EXPECT_GT(found.pairs[0].follower_way, 0.08);
    EXPECT_LT(found.pairs[1].follower_way, 1e-4);
  }
}

}  // namespace
}  // namespace multipanda::teleoperation
