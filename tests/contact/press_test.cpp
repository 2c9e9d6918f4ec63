#include "tests/contact/press.hpp"

#include <string_view>

#include <gtest/gtest.h>

#include "core/testing/series.hpp"

// The full series prints its figures; by default one pose of each controllet runs, with and without motor
// inertia in turn.
namespace multipanda::press {
namespace {

const char* const kControllets[] = {"cartesian_impedance",
                                    "joint_impedance",
                                    "dual_cartesian_impedance",
                                    "coupled_dual_cartesian_impedance",
                                    "force",
                                    "hybrid_force",
                                    "ufic",
                                    "coupled_ufic",
                                    "joint_follower",
                                    "pose_follower",
                                    "teleoperation",
                                    "ufic along axes"};

// An arm that is led, no farther than it may be left behind: it presses on.
Press pressing(const char* controllet, int pose, bool motor_inertia) {
  Press press{controllet, pose, motor_inertia};
  const std::string_view name(controllet);
  if (name == "ufic along axes") {
    press.controllet = "ufic";
    press.axes = true;
  }
  if (name.ends_with("_follower") || name == "teleoperation") press.beyond = 0.1;
  return press;
}

TEST(Press, PersonsHandBetweenArmAndTable) {
  test::Series series;
  int at = 0;
  for (const char* controllet : kControllets) {
    ++at;
    for (int pose = 0; pose < kPoses; ++pose) {
      for (const bool motor_inertia : {false, true}) {
        // With rotor inertia, a hand that is blocked may end in a hold at a joint's velocity limit.
        const bool coupled = std::string_view(controllet) == "coupled_dual_cartesian_impedance";
        if (coupled && !motor_inertia) {
          if (series.whole() && series.full()) {
            std::printf(
                "%s\n",
                (name({controllet, pose, motor_inertia}) +
                 " skipped: without its rotor, joint 7 moves 0.002 kg m^2, and springs of 400 N/m hold "
                 "hands 0.9 m apart with a lever of 0.45 m: a mode of 299 rad/s, stable with 1 ms of "
                 "delay, unstable with 2 ms and more, before any contact")
                    .c_str());
          }
          continue;
        }
        if (!series.takes(pose == at % kPoses && motor_inertia == (at % 2 == 0))) continue;
        const Press press = pressing(controllet, pose, motor_inertia);
        SCOPED_TRACE(name(press));
        const Outcome outcome = run(press);
        series.record("impact_n", outcome.impact);
        series.record("later_n", outcome.later);
        series.record("swing_n", outcome.swing);
        series.record("hand_speed_m_per_s", outcome.hand_speed);
        if (series.full()) {
          std::printf("%-62s impact %5.1f N, later %5.1f N, swing %5.2f N, %5.3f m/s %s\n",
                      name(press).c_str(), outcome.impact, outcome.later, outcome.swing, outcome.hand_speed,
                      outcome.intervention.c_str());
          std::fflush(stdout);
        }
        EXPECT_TRUE(outcome.touched);  // otherwise the rest proves nothing
        EXPECT_LE(outcome.impact, kTransient);
        EXPECT_LE(outcome.later, kQuasiStatic);
        EXPECT_LE(outcome.hand_speed, 1.1 * 0.25);
        if (!coupled) {
          EXPECT_EQ(outcome.intervention, "");
        }
      }
    }
  }
}

// Held back until the set-point waits, then let go. Soft springs store the most.
TEST(Press, AnArmThatIsLetGoDoesNotLeap) {
  test::Series series;
  int at = 0;
  for (const char* controllet : kControllets) {
    ++at;
    for (int pose = 0; pose < kPoses; ++pose) {
      for (const bool motor_inertia : {false, true}) {
        const bool coupled = std::string_view(controllet) == "coupled_dual_cartesian_impedance";
        if (coupled && !motor_inertia) continue;
        const int usual = coupled ? 1 : at % kPoses;  // where it is fastest
        if (!series.takes(pose == usual && motor_inertia == (at % 2 == 0))) continue;
        Press press = pressing(controllet, pose, motor_inertia);
        press.released_after_s = 2;
        SCOPED_TRACE(name(press));
        const Outcome outcome = run(press);
        series.record("let_go_speed_m_per_s", outcome.let_go_speed);
        if (series.full()) {
          std::printf("%-62s let go: %5.3f m/s %s\n", name(press).c_str(), outcome.let_go_speed,
                      outcome.intervention.c_str());
          std::fflush(stdout);
        }
        EXPECT_TRUE(outcome.touched);
        if (outcome.intervention.empty()) {
          EXPECT_GT(outcome.let_go_speed, 0.02);  // it goes on
        }
        // Joint springs are bounded by what they do at the hand while the rest of the arm stands still. Two
        // hands on one set-point may end in a hold, whose springs are joint springs, too, but stiffer.
        const bool held = coupled && !outcome.intervention.empty();
        EXPECT_LE(outcome.let_go_speed, held ? 0.7 : (coupled ? 1.8 : 1.7) * 0.25);
      }
    }
  }
}

// Led farther, it is left behind, and the hand is free within some seconds. (Who leads a `teleoperation`
// feels the hand, and is not ahead as far. In pose 0 the joints of the leader end before.)
TEST(Press, AnArmThatIsLeftBehindLetsAHandGo) {
  test::Series series;
  for (const char* controllet : {"joint_follower", "pose_follower"}) {
    for (int pose = 1; pose < kPoses; ++pose) {
      if (!series.takes(pose == 1)) continue;
      const Press press{controllet, pose};
      SCOPED_TRACE(name(press));
      const Outcome outcome = run(press);
      series.record("later_n", outcome.later);
      series.record("at_end_n", outcome.at_end);
      EXPECT_GT(outcome.impact, 20);
      EXPECT_LE(outcome.later, kQuasiStatic);
      EXPECT_LT(outcome.at_end, 10);  // what is left is the friction of a table against a hand
      EXPECT_EQ(outcome.intervention, "");
    }
  }
}

TEST(Press, NorDoesAnArmOnSoftSprings) {
  for (const double stiffness : {50.0, 150.0}) {
    Press press{"cartesian_impedance", 0, true};
    press.released_after_s = 4;
    press.stiffness = stiffness;
    const Outcome outcome = run(press);
    EXPECT_GT(outcome.let_go_speed, 0.1);
    EXPECT_LE(outcome.let_go_speed, 1.6 * 0.25);
    Press lifted = press;
    lifted.bounded = false;
    EXPECT_GT(run(lifted).let_go_speed, outcome.let_go_speed);  // the test can fail
  }
}

// The same press without bounds is one that a hand does not bear: the test can fail.
TEST(Press, LiftedBoundsPressHarder) {
  const Outcome bounded = run({"cartesian_impedance", 0, false, true});
  const Outcome lifted = run({"cartesian_impedance", 0, false, false});
  EXPECT_GT(lifted.hand_speed, 1.5 * bounded.hand_speed);
  EXPECT_GT(lifted.impact, 1.2 * bounded.impact);
  EXPECT_GT(lifted.later, 1.3 * bounded.later);
}

}  // namespace
}  // namespace multipanda::press
