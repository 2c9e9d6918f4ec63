// Simulated time itself: the same seed gives the same bits, clocks drift as they were asked to, late answers
// are dropped, and a stopped arm can be recovered.
#include "fci/simulated_time/simulated_time.hpp"

#include <bit>
#include <cmath>

#include <gtest/gtest.h>

#include "fci/simulated_time/simulated_run.hpp"
#include "fci/simulated_time/testing/tested_run.hpp"

namespace multipanda::fci {
namespace {

using test::plain_times;
using test::two_arms;

// All that the program saw and sent, as one number.
std::uint64_t fingerprint(std::uint64_t seed, double duration_s) {
  SimulatedTimeOptions times{.seed = seed};
  times.client.stalls_per_s = 4;
  SimulatedRun run(two_arms(PlantFidelity::realistic()), {.time = times, .registry = test::laws()});
  std::uint64_t hash = 1469598103934665603u;
  const auto mix = [&hash](std::uint64_t x) { hash = (hash ^ x) * 1099511628211u; };
  run.after_cycle = [&](const CycleRecord& cycle) {
    mix(static_cast<std::uint64_t>(cycle.t.ns));
    for (const ArmSample& arm : cycle.arms) {
      mix(arm.sequence);
      for (const auto* numbers : {&arm.q, &arm.tau_J, &arm.tau_cmd}) {
        for (const double x : *numbers) mix(std::bit_cast<std::uint64_t>(x));
      }
    }
  };
  run.modes().activate_at_start(test::switch_to(run.modes(), {"left_slew", "right_joints"}).activate);
  run.begin();
  run.run_for(duration_s);
  return hash;
}

TEST(SimulatedTime, TheSameSeedGivesTheSameBits) {
  const std::uint64_t once = fingerprint(3, 1.0);
  EXPECT_EQ(fingerprint(3, 1.0), once);
  EXPECT_NE(fingerprint(4, 1.0), once);
}

TEST(SimulatedTime, ArmsSendByTheirOwnClocks) {
  SimulatedTimeOptions times = plain_times(2);
  times.arms[0].drift_ppm = 1000;
  times.arms[1].drift_ppm = -1000;
  times.arms[1].phase_ns = 300'000;
  SimulatedRun run(two_arms(), {.time = times, .registry = test::laws()});
  run.begin();
  while (run.world().time_ns() < 2'000'900'000) ASSERT_TRUE(run.step());
  // From 1 ms (1.3 ms) on, every 1 ms / (1 + drift): 1999.9 ms hold 2001.9 periods, 1999.6 ms hold 1997.6.
  EXPECT_NEAR(static_cast<double>(run.world().counts(0).states_sent), 2002.5, 1);
  EXPECT_NEAR(static_cast<double>(run.world().counts(1).states_sent), 1998.5, 1);
  EXPECT_EQ(run.world().counts(0).periods_missed, 0u);
  EXPECT_EQ(run.world().counts(1).periods_missed, 0u);
  EXPECT_EQ(run.world().counts(0).answers_late, 0u);
}

// Both networks take 100 us: an answer arrives 200 us and the computing time after its state.
TEST(SimulatedTime, AnAnswerCountsForOneMillisecond) {
  for (const auto& [compute_us, in_time] :
       {std::pair{700, true}, std::pair{790, true}, std::pair{810, false}, std::pair{900, false}}) {
    SimulatedTimeOptions times = plain_times(2);
    times.client.compute.least_ns = 1000 * compute_us;
    // The two arms would delay each other's answers.
    SimulatedRun run(two_arms(), {.time = times, .registry = test::laws()});
    run.begin();
    run.run_for(0.1);
    const ArmCounts& arm = run.world().counts(0);
    EXPECT_EQ(arm.answers_late == 0, in_time) << compute_us << " us";
    EXPECT_EQ(run.data().state[0].mode == ArmMode::move, in_time) << compute_us << " us";
    if (in_time) continue;
    EXPECT_EQ(arm.longest_miss, SimulatedArm::kLostCommands);
    EXPECT_EQ(run.world().arm(0).reflex_detail().error, ArmError::communication_constraints_violation);
  }
}

// Without the client's limiter: a torque that grows by `step` each period, and one answer that is lost.
ReflexDetail after_a_lost_answer(double step) {
  SimulatedTime world(two_arms(), plain_times(2));
  world.start();
  std::vector<ArmState> states(2);
  std::vector<ArmCommand> commands(2, {.tau_cmd = joint_constant(7, 0)});
  for (int k = 0; k < 12;) {
    const ArmSet due = world.wait();
    world.read(due, states);
    if (due.contains(0)) {
      commands[0].tau_cmd[0] += step;
      if (++k == 6) world.lose_answers(0, 1);
    }
    world.write(due, commands);
  }
  return world.arm(0).reflex_detail();
}

TEST(SimulatedTime, AnArmJudgesTheTorqueByTheLastThatItTook) {
  EXPECT_FALSE(after_a_lost_answer(0.49)) << "two steps are within the rate of 1 N m per period";
  const ReflexDetail reflex = after_a_lost_answer(0.51);
  EXPECT_EQ(reflex.error, ArmError::controller_torque_discontinuity);
  EXPECT_NEAR(reflex.value, 1020, 1e-6);
}

// Where late answers are taken in the next period, a program that is always a little late is never stopped.
TEST(SimulatedTime, LateAnswersMayBeTakenNext) {
  SimulatedTimeOptions times = plain_times(2);
  times.client.compute.least_ns = 850'000;
  times.late_answers = LateAnswers::taken_next;
  SimulatedRun run(two_arms(), {.time = times, .registry = test::laws()});
  run.begin();
  run.run_for(0.2);
  EXPECT_GT(run.world().counts(0).answers_late, 100u);
  EXPECT_EQ(run.data().state[0].mode, ArmMode::move);
}

TEST(SimulatedTime, AStoppedArmIsRecoveredAndTheOtherGoesOn) {
  SimulatedRun run(two_arms(), {.time = {.seed = 5}, .registry = test::laws()});
  run.modes().activate_at_start(test::switch_to(run.modes(), {"left_joints", "right_joints"}).activate);
  bool reported = false;
  run.on_event = [&](const Event& event) {
    reported = reported || (event.kind == EventKind::arm_mode && event.arm == 0 &&
                            event.index == static_cast<std::uint16_t>(ArmMode::reflex));
  };
  run.begin();
  run.run_for(0.1);
  ASSERT_EQ(run.data().state[0].mode, ArmMode::move);
  run.world().raise(0, ArmError::joint_reflex);
  run.run_for(0.1);
  EXPECT_TRUE(reported);
  EXPECT_EQ(run.data().state[0].mode, ArmMode::reflex);
  EXPECT_EQ(run.data().state[0].errors, error_bit(ArmError::joint_reflex));
  EXPECT_EQ(run.modes().owner(1), run.modes().find("right_joints"));
  const RequestAnswer answer = run.ask(0, RecoverFromError{});
  EXPECT_TRUE(answer.success) << answer.reason;
  run.run_for(0.1);
  EXPECT_EQ(run.data().state[0].mode, ArmMode::move);
  EXPECT_EQ(run.modes().owner(0), 0u) << "held, until something is activated";
  EXPECT_EQ(run.modes().owner(1), run.modes().find("right_joints"));
  EXPECT_EQ(run.world().counts(1).motions_ended, 0u);
  run.end();
  EXPECT_EQ(run.world().arm(0).motion_end(), MotionEnd::finished);
}

TEST(SimulatedTime, ACableIsPulledAndAUserStops) {
  SimulatedRun run(two_arms(), {.time = {.seed = 6}, .registry = test::laws()});
  run.begin();
  run.run_for(0.05);
  run.world().pull_cable(0, true);
  run.run_for(0.2);
  EXPECT_EQ(run.world().arm(0).reflex_detail().error, ArmError::communication_constraints_violation);
  EXPECT_EQ(run.data().state[1].mode, ArmMode::move);
  run.run_for(1.0);
  EXPECT_EQ(run.data().state[0].mode, ArmMode::disconnected);
  run.world().pull_cable(0, false);
  run.run_for(0.05);
  EXPECT_EQ(run.data().state[0].mode, ArmMode::reflex);
  EXPECT_TRUE(run.ask(0, RecoverFromError{}).success);
  run.world().press_user_stop(1, true);
  run.run_for(0.05);
  EXPECT_EQ(run.data().state[1].mode, ArmMode::user_stopped);
  EXPECT_FALSE(run.ask(1, RecoverFromError{}).success);
  run.world().press_user_stop(1, false);
  run.run_for(0.05);
  EXPECT_TRUE(run.ask(1, RecoverFromError{}).success);
  run.run_for(0.05);
  EXPECT_EQ(run.data().state[0].mode, ArmMode::move);
  EXPECT_EQ(run.data().state[1].mode, ArmMode::move);
}

// While somebody pushes the arm, its own hold has a torque in use. A torque motion begins at zero or at that:
// which one is not known.
TEST(SimulatedTime, TheFirstAnswersOfAMotionMayBeLost) {
  for (int k = 0; k <= 24; ++k) {
    const int lost = k / 2;
    const FirstTorque first = k % 2 == 0 ? FirstTorque::zero : FirstTorque::of_own_hold;
    SimulatedRun run(two_arms(), {.time = {.seed = 7, .first_torque = first}, .registry = test::laws()});
    run.begin();
    run.run_for(0.05);
    run.world().raise(0, ArmError::joint_reflex);
    run.world().push(0, {0, 0, -30}, 2);
    run.run_for(0.5);
    EXPECT_GT(run.world().arm(0).state().tau_J_d.cwiseAbs().maxCoeff(), 5);
    run.world().lose_answers(0, lost);
    EXPECT_TRUE(run.ask(0, RecoverFromError{}).success);
    run.run_for(0.1);
    EXPECT_EQ(run.world().counts(0).answers_lost, static_cast<std::uint64_t>(lost));
    EXPECT_EQ(run.data().state[0].mode, ArmMode::move) << lost << " lost, " << k % 2;
    EXPECT_LE(run.world().counts(0).torque_rate_max, 1000 * (1 + 1e-5)) << lost << " lost, " << k % 2;
  }
}

TEST(SimulatedTime, AProgramThatEndedIsReplaced) {
  SimulatedRun run(two_arms(), {.time = {.seed = 8}, .registry = test::laws()});
  run.begin();
  run.run_for(0.05);
  run.world().lose_client();
  run.run_for(0.1);
  for (ArmIndex i = 0; i < 2; ++i) {
    EXPECT_EQ(run.data().state[i].mode, ArmMode::disconnected);
    EXPECT_EQ(run.world().arm(i).mode(), ArmMode::idle) << "its own brake and hold, no error";
    EXPECT_TRUE(run.ask(i, Reconnect{}).success);
  }
  run.run_for(0.05);
  for (ArmIndex i = 0; i < 2; ++i) EXPECT_EQ(run.data().state[i].mode, ArmMode::move);
}

// A program of 1 kHz beside the loop; one that needs 1.5 ms leaves out every second call.
TEST(SimulatedTime, AManagerWakesByItsOwnClock) {
  for (const auto& [compute_us, calls] : {std::pair{200, 1000}, std::pair{1500, 500}}) {
    SimulatedTime world(two_arms(), plain_times(2));
    int count = 0;
    std::int64_t last_ns = -1;
    world.every(1'000'000, {.least_ns = 0, .spread_ns = 200'000}, {.least_ns = 1000 * compute_us},
                [&](std::int64_t now_ns) {
                  EXPECT_GT(now_ns, last_ns);
                  last_ns = now_ns;
                  ++count;
                });
    world.start();
    const std::int64_t from = count;
    const std::int64_t end_ns = world.time_ns() + 1'000'000'000;
    while (world.time_ns() < end_ns) (void)world.wait();
    EXPECT_NEAR(static_cast<double>(count - from), calls, 2);
  }
}

}  // namespace
}  // namespace multipanda::fci
