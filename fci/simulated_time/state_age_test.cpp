// How many states in a row an arm's controllet bears to miss: the limit of their age, with the arms' own
// clocks at every phase. docs/real_arms.md has the figures.
#include <gtest/gtest.h>

#include "fci/simulated_time/testing/tested_run.hpp"

namespace multipanda::fci::state_age_test {
namespace {

struct Loss {
  std::vector<std::string> laws;
  std::int64_t phase_ns = 0;  // of the right arm against the left one
  ArmSet arms;                // whose states are lost
  int states = 0;
};

// Whether the laws still have their arms 50 ms later.
bool goes_on(const Loss& loss) {
  SimulatedTimeOptions times = test::plain_times(2);
  times.arms[1].phase_ns = loss.phase_ns;
  SimulatedRun run(test::two_arms(), {.time = times, .registry = test::laws()});
  const InstanceSet laws = test::switch_to(run.modes(), loss.laws).activate;
  run.modes().activate_at_start(laws);
  run.begin();
  run.run_for(0.05);
  EXPECT_EQ(run.modes().active(), laws);
  for (ArmIndex i = 0; i < 2; ++i) {
    if (loss.arms.contains(i)) run.world().lose_states(i, loss.states);
  }
  run.run_for(0.05);
  for (ArmIndex i = 0; i < 2; ++i) EXPECT_EQ(run.data().state[i].mode, ArmMode::move) << i;
  return run.modes().active() == laws;
}

// 2 ms of age, half a period of phase and two lost packets: 4.5 ms.
TEST(StateAge, AGroupBearsThreeLostStatesOfAMemberAtAnyPhaseAndNoFive) {
  for (std::int64_t phase_ns = 0; phase_ns < 1'000'000; phase_ns += 100'000) {
    for (const ArmIndex arm : {ArmIndex{0}, ArmIndex{1}}) {
      for (const int states : {1, 2, 3, 5, 6, 15}) {
        EXPECT_EQ(goes_on({{"both"}, phase_ns, ArmSet::of(arm), states}), states <= 3)
            << states << " of arm " << arm << ", phase " << phase_ns;
      }
    }
  }
}

// The first arm to be heard again finds the other's state too old.
TEST(StateAge, AGroupThatWasSilentAsAWholeBearsNoMore) {
  for (const std::int64_t phase_ns : {300'000, 500'000, 700'000}) {
    for (const int states : {1, 3, 5, 15}) {
      EXPECT_EQ(goes_on({{"both"}, phase_ns, ArmSet::all(2), states}), states <= 3)
          << states << ", phase " << phase_ns;
    }
  }
}

TEST(StateAge, ArmsThatAreAloneBearEighteen) {
  for (const std::int64_t phase_ns : {0, 250'000, 500'000}) {
    for (const int states : {1, 4, 5, 10, 18}) {
      EXPECT_TRUE(goes_on({{"left_joints", "right_joints"}, phase_ns, ArmSet::all(2), states}))
          << states << ", phase " << phase_ns;
    }
  }
}

}  // namespace
}  // namespace multipanda::fci::state_age_test
