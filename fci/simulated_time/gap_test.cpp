// Up to 19 answers in a row that are lost or late stop no arm; longer gaps end in a hold or in the arm's own
// stop, and the run says which. 100 seeded gaps; 1000 in the full series.
#include <array>
#include <iostream>

#include <gtest/gtest.h>

#include "core/testing/series.hpp"
#include "fci/simulated_time/testing/tested_run.hpp"
#include "fci/simulated_time/timing.hpp"

namespace multipanda::fci {
namespace {

enum class Moment : std::uint8_t { first_cycle, switching, full_slew, contact, two_arms, count_ };
enum class Kind : std::uint8_t { answers_lost, answers_late, states_lost, program_stalls, count_ };
constexpr std::array kMoments{"first cycle", "switch", "full slew", "contact", "two arms in one controllet"};
constexpr std::array kKinds{"answers lost", "answers late", "states lost", "program stalls"};

struct Gap {
  std::uint64_t seed = 0;
  Moment moment{};
  Kind kind{};
  ArmIndex arm = 0;
  int answers = 1;
  bool realistic = false, taken_next = false;
  FirstTorque first = FirstTorque::zero;
};

Gap drawn(std::uint64_t seed, int fewest, int most) {
  Draw draw(seed * 7919 + 13);
  Gap gap{.seed = seed};
  // In turn, so that every moment meets every kind; the rest is drawn.
  gap.moment = static_cast<Moment>(seed % static_cast<std::uint64_t>(Moment::count_));
  gap.kind = static_cast<Kind>(seed / 5 % static_cast<std::uint64_t>(Kind::count_));
  gap.first = seed / 20 % 2 == 0 ? FirstTorque::zero : FirstTorque::of_own_hold;
  gap.arm = gap.moment == Moment::contact ? 0 : static_cast<ArmIndex>(draw.below(2));
  gap.answers = fewest + static_cast<int>(draw.below(static_cast<std::uint64_t>(most - fewest + 1)));
  gap.realistic = draw.happens(0.5);
  gap.taken_next = draw.happens(0.3);
  return gap;
}

std::string text(const Gap& gap) {
  return "seed " + std::to_string(gap.seed) + ": " + std::to_string(gap.answers) + " " +
         kKinds[static_cast<std::size_t>(gap.kind)] + ", " + kMoments[static_cast<std::size_t>(gap.moment)] +
         ", arm " + std::to_string(gap.arm) + (gap.realistic ? ", realistic plant" : "") +
         (gap.taken_next ? ", late answers taken next" : "") +
         (gap.first == FirstTorque::zero ? "" : ", a motion begins at the torque of the arm's hold");
}

struct Outcome {
  std::array<ArmCounts, 2> accounts;
  std::array<ReflexDetail, 2> reflexes;
  std::array<ArmMode, 2> modes{};
  std::array<bool, 2> held{};           // by its hold, not by the law that had it
  std::array<bool, 2> mode_reported{};  // the record has an event: the arm left torque control
  std::array<bool, 2> hold_reported{};  // the record has an event: an intervention took the arm from its law
  double contact_n = 0, arm_seconds = 0;
  double first_nm = 0;  // largest torque in use before the first command of a motion that begins at it
};

void make_gap(SimulatedRun& run, const Gap& gap, Draw& draw) {
  SimulatedTime& world = run.world();
  switch (gap.kind) {
    case Kind::answers_lost:
      return world.lose_answers(gap.arm, gap.answers);
    case Kind::answers_late:  // by one to three periods
      return world.delay_answers(gap.arm, gap.answers,
                                 1'000'000 + static_cast<std::int64_t>(draw.below(2'000'000)));
    case Kind::states_lost:
      return world.lose_states(gap.arm, gap.answers);
    case Kind::program_stalls:  // 1 ms less some: the last answer comes in time
      return world.stall_client(
          1'000'000 * gap.answers - 500'000,
          draw.happens(0.5) ? SimulatedTime::Stall::before_reading : SimulatedTime::Stall::before_sending);
    case Kind::count_:
      break;
  }
}

std::vector<std::string> laws_of(Moment moment) {
  switch (moment) {
    case Moment::full_slew:
      return {"left_slew", "right_slew"};
    case Moment::contact:
      return {"left_pose", "right_joints"};
    case Moment::two_arms:
      return {"both"};
    default:
      return {"left_joints", "right_joints"};
  }
}

Outcome run_gap(const Gap& gap) {
  Draw draw(gap.seed * 104729 + 1);
  SimulatedTimeOptions times{.seed = gap.seed};
  times.late_answers = gap.taken_next ? LateAnswers::taken_next : LateAnswers::dropped;
  times.first_torque = gap.first;
  SimulatedRun run(test::two_arms(gap.realistic ? PlantFidelity::realistic() : PlantFidelity::ideal()),
                   {.time = times, .registry = test::laws()});
  Outcome outcome;
  run.on_event = [&](const Event& event) {
    if (event.kind == EventKind::arm_mode && event.arm < 2) outcome.mode_reported[event.arm] = true;
    if (event.kind == EventKind::switch_refused) outcome.hold_reported = {true, true};
    if (event.kind != EventKind::intervention || event.intervention == Intervention::torque_rate_clamped) {
      return;
    }
    // A law that ends leaves all of its arms, and a refused start concerns every arm.
    for (ArmIndex i = 0; i < 2; ++i) {
      const bool of_law = event.instance < run.modes().instance_count() &&
                          run.modes().instance(event.instance).arms().contains(i);
      if (event.arm == i || of_law) outcome.hold_reported[i] = true;
    }
  };
  const auto names = laws_of(gap.moment);
  run.modes().activate_at_start(test::switch_to(run.modes(), names).activate);
  const bool pushed = gap.moment == Moment::first_cycle && gap.first == FirstTorque::of_own_hold;
  for (ArmIndex i = 0; pushed && i < 2; ++i) run.world().push(i, {0, 0, -60}, 0.02);
  run.begin();
  for (ArmIndex i = 0; pushed && i < 2; ++i) {
    outcome.first_nm = std::max(outcome.first_nm, run.world().arm(i).state().tau_J_d.cwiseAbs().maxCoeff());
  }
  if (gap.moment == Moment::first_cycle) {
    const int cycles = static_cast<int>(draw.below(3));
    for (int k = 0; k < cycles; ++k) (void)run.step();
  } else {
    run.run_for(0.02 + 0.02 * draw.unit());
  }
  JointVector q = run.data().state[gap.arm].q;
  MultimodeController& modes = run.modes();
  if (gap.moment == Moment::switching) {
    // In motion, to another law.
    q += joint_constant(7, 0.3);
    (void)run.ask(test::joint_goal(modes, gap.arm == 0 ? "left_joints" : "right_joints", q, 0));
    run.run_for(0.1 + 0.1 * draw.unit());
  } else if (gap.moment == Moment::contact) {
    // 50 mm beyond the table at 600 N/m.
    (void)run.ask(test::pose_goal(run, modes, "left_pose", "pose", 0, Vector3(0, 0, -0.07), 0));
    run.run_for(0.9 + 0.1 * draw.unit());
  } else if (gap.moment == Moment::two_arms) {
    (void)run.ask(test::pose_goal(run, modes, "both", "common_pose", 0, Vector3(0.1, 0.05, 0.1), 0));
    run.run_for(0.15 + 0.1 * draw.unit());
  }
  outcome.contact_n = run.world().arm(0).state().F_K_W_true.force().norm();
  outcome.mode_reported = outcome.hold_reported = {};
  if (gap.moment == Moment::switching) {
    const bool before = draw.happens(0.5);
    const int apart = static_cast<int>(draw.below(4));
    if (before) {
      make_gap(run, gap, draw);
      for (int k = 0; k < apart; ++k) (void)run.step();
    }
    const Request request = test::switch_to(modes, {gap.arm == 0 ? "left_slew" : "right_slew"});
    std::uint64_t ticket = 0;
    EXPECT_EQ(modes.post(std::span(&request, 1), ticket), Verdict::accepted);
    if (!before) {
      for (int k = 0; k < apart; ++k) (void)run.step();
      make_gap(run, gap, draw);
    }
  } else {
    make_gap(run, gap, draw);
  }
  run.run_for(0.15);
  for (ArmIndex i = 0; i < 2; ++i) {
    outcome.accounts[i] = run.world().counts(i);
    outcome.reflexes[i] = run.world().arm(i).reflex_detail();
    outcome.modes[i] = run.data().state[i].mode;
    outcome.held[i] = modes.owner(i) == i;
  }
  outcome.arm_seconds = 2e-9 * static_cast<double>(run.world().time_ns());
  return outcome;
}

TEST(Gaps, UpToNineteenAnswersStopNoArm) {
  multipanda::test::Series series;
  for (std::uint64_t seed = 1; seed <= 1000; ++seed) {
    if (!series.takes(seed <= 100)) continue;
    const Gap gap = drawn(seed, 1, 19);
    const Outcome outcome = run_gap(gap);
    SCOPED_TRACE(text(gap));
    int longest = 0, held = 0;
    for (ArmIndex i = 0; i < 2; ++i) {
      const ReflexDetail& reflex = outcome.reflexes[i];
      EXPECT_EQ(outcome.modes[i], ArmMode::move)
          << "arm " << i << ": error " << static_cast<int>(reflex.error) << " " << reflex.value << " > "
          << reflex.limit << ", longest gap " << outcome.accounts[i].longest_miss;
      EXPECT_EQ(outcome.accounts[i].motions_ended, 0u);
      // From the last torque that the arm took, however many answers it missed.
      EXPECT_LE(outcome.accounts[i].torque_rate_max, 1000 * (1 + 1e-5));
      EXPECT_LT(outcome.accounts[i].longest_miss, 20);
      longest = std::max(longest, outcome.accounts[i].longest_miss);
      held += outcome.held[i];
      // A held arm has an event with the reason.
      EXPECT_TRUE(!outcome.held[i] || outcome.hold_reported[i]) << "arm " << i;
    }
    series.record("arm_s", outcome.arm_seconds);
    series.record("first_nm", outcome.first_nm);
    series.record("longest_miss", longest);
    series.record("held", held);
    // The gap took place. A stall may fall between two answers, and late ones are taken by some arms.
    const bool must_miss = gap.kind == Kind::answers_lost && gap.moment != Moment::first_cycle;
    if (must_miss) {
      EXPECT_GE(outcome.accounts[gap.arm].longest_miss, gap.answers);
    }
    if (gap.moment == Moment::contact) {
      EXPECT_GT(outcome.contact_n, 20);
      EXPECT_LT(outcome.contact_n, 45);
    }
  }
  if (!series.whole()) return;
  EXPECT_GE(series.largest("longest_miss"), 18);
  EXPECT_GT(series.largest("first_nm"), 2);  // more than one command can be near zero and near it
  const auto gaps = static_cast<double>(series.size());
  std::cout << gaps << " gaps, longest " << series.largest("longest_miss") << "; arms that went on "
            << 2 * gaps - series.sum("held") << ", were held " << series.sum("held") << "; "
            << series.sum("arm_s") << " arm-seconds\n";
}

TEST(Gaps, LongerOnesEndInAHoldOrTheArmsOwnStopAndTheRunSaysWhich) {
  multipanda::test::Series series;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    if (!series.takes(seed <= 40)) continue;
    int stopped = 0, held = 0;
    const Gap gap = drawn(seed + 5000, 21, 50);
    const Outcome outcome = run_gap(gap);
    SCOPED_TRACE(text(gap));
    for (ArmIndex i = 0; i < 2; ++i) {
      const bool concerned = i == gap.arm || gap.kind == Kind::program_stalls;
      if (outcome.modes[i] != ArmMode::move) {
        EXPECT_TRUE(concerned) << "arm " << i << " was stopped by the gap of the other";
        EXPECT_EQ(outcome.modes[i], ArmMode::reflex);
        EXPECT_EQ(outcome.reflexes[i].error, ArmError::communication_constraints_violation);
        EXPECT_TRUE(outcome.mode_reported[i]) << "no event says that arm " << i << " stopped";
        ++stopped;
      } else if (outcome.held[i]) {
        // The laws of the first cycle start together or not at all.
        EXPECT_TRUE(concerned || gap.moment == Moment::two_arms || gap.moment == Moment::first_cycle)
            << "arm " << i;
        EXPECT_TRUE(outcome.hold_reported[i]) << "no event says that arm " << i << " is held";
        ++held;
      } else {
        EXPECT_LT(outcome.accounts[i].longest_miss, 20);
      }
      EXPECT_LE(outcome.accounts[i].torque_rate_max, 1000 * (1 + 1e-5));
    }
    series.record("stopped_itself", stopped);
    series.record("held", held);
  }
  if (!series.whole()) return;
  EXPECT_GT(series.sum("stopped_itself"), 0);
  std::cout << 2 * series.size() << " arms: " << series.sum("stopped_itself") << " stopped themselves, "
            << series.sum("held") << " were held\n";
}

}  // namespace
}  // namespace multipanda::fci
