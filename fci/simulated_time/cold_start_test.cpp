// The first cycles of a program on a busy computer: it is late for its first states, at one of them or at
// several in a row.
#include <gtest/gtest.h>

#include "fci/simulated_time/testing/tested_run.hpp"
#include "fci/simulated_time/timing.hpp"

namespace multipanda::fci::cold_start_test {
namespace {

using Stall = SimulatedTime::Stall;

struct Start {
  std::vector<std::string> laws;
  int first = 0, count = 1;  // cycles that are late
  int longest_ms = 1;
};

Start drawn(Draw& draw) {
  Start start;
  start.laws = draw.happens(0.5) ? std::vector<std::string>{"both"}
                                 : std::vector<std::string>{"left_joints", "right_joints"};
  start.first = static_cast<int>(draw.below(3));
  start.count = 1 + static_cast<int>(draw.below(4));
  // An arm stops itself after 20 missed answers in a row.
  start.longest_ms = start.count == 1 ? 1 + static_cast<int>(draw.below(18)) : 12 / start.count;
  return start;
}

std::string text(std::uint64_t seed, const Start& start) {
  return "seed " + std::to_string(seed) + ": " + start.laws[0] + ", " + std::to_string(start.count) +
         " late from cycle " + std::to_string(start.first) + " on, up to " +
         std::to_string(start.longest_ms) + " ms";
}

TEST(ColdStart, LateFirstCyclesTakeNoArmFromItsLaw) {
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    Draw draw(seed * 6151 + 5);
    const Start start = drawn(draw);
    SCOPED_TRACE(text(seed, start));
    SimulatedRun run(test::two_arms(), {.time = {.seed = seed}, .registry = test::laws()});
    std::vector<Intervention> interventions;
    run.on_event = [&](const Event& event) {
      if (event.kind == EventKind::intervention) interventions.push_back(event.intervention);
    };
    const InstanceSet laws = test::switch_to(run.modes(), start.laws).activate;
    run.modes().activate_at_start(laws);
    run.begin();
    for (int cycle = 0; cycle < start.first + start.count; ++cycle) {
      if (cycle >= start.first) {
        const auto ns =
            1'000'000 *
            (1 + static_cast<std::int64_t>(draw.below(static_cast<std::uint64_t>(start.longest_ms))));
        run.world().stall_client(ns - 500'000,
                                 draw.happens(0.5) ? Stall::before_reading : Stall::before_sending);
      }
      ASSERT_TRUE(run.step());
    }
    run.run_for(0.1);
    EXPECT_EQ(run.modes().active(), laws);
    EXPECT_TRUE(interventions.empty()) << to_string(interventions.front());
    for (ArmIndex i = 0; i < 2; ++i) {
      EXPECT_EQ(run.data().state[i].mode, ArmMode::move) << i;
      EXPECT_EQ(run.world().counts(i).motions_ended, 0u) << i;
    }
  }
}

}  // namespace
}  // namespace multipanda::fci::cold_start_test
