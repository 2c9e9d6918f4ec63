// Teleoperation in simulation, measured by the plant's true joints and forces. teleoperation_figures prints
// the figures. The full series are every case with three seeds; by default every 25th runs,
// which meets each delay, loss, table and seed.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "core/testing/series.hpp"
#include "tests/teleoperation/trial.hpp"

namespace multipanda::teleoperation {
namespace {

const PlantFidelity kPlants[] = {PlantFidelity::ideal(), PlantFidelity::realistic()};

TEST(TeleoperationTrial, FollowsWithin2mmInFreeMotion) {
  for (const bool force : {false, true}) {
    for (const auto& plant : kPlants) {
      for (const double scale : {1.0, 0.5}) {
        const Trial trial{.position_force = force, .plant = plant, .scale = scale};
        const FreeMotion found = free_motion(trial);
        EXPECT_EQ(found.fault, "") << name(trial);
        EXPECT_LE(found.largest_error, 0.002) << name(trial);
      }
    }
  }
}

TEST(TeleoperationTrial, LetsTheLeaderFeelTheForceWithin10Percent) {
  for (const bool force : {false, true}) {
    for (const auto& plant : kPlants) {
      for (const double table : {1e3, 1e4, 1e5}) {
        const Trial trial{.position_force = force, .plant = plant, .table_n_per_m = table};
        const Contact found = contact(trial);
        EXPECT_EQ(found.fault, "") << name(trial);
        EXPECT_GT(found.pressed, 10) << name(trial);
        EXPECT_LE(found.error, 0.1) << name(trial);
        EXPECT_LE(found.peak, 1.1 * found.pressed) << name(trial);
      }
    }
  }
}

// The stated bandwidth: up to 12 Hz the follower moves as far as the leader or a little farther.
TEST(TeleoperationTrial, HasItsBandwidth) {
  for (const double hz : {0.5, 2.0, 5.0, 12.0}) {
    const Response found = response(hz);
    EXPECT_GT(found.gain, M_SQRT1_2) << hz;
    EXPECT_LT(found.gain, 1.35) << hz;
    EXPECT_LT(found.phase, 0.02) << hz;
    EXPECT_GT(found.phase, -70 * M_PI / 180) << hz;
  }
}

// S = kinetic energy of both arms + tanks + energy under way never grows by more than what the operator and
// the table put in, with any delay, loss and table.
TEST(TeleoperationTrial, IsPassive) {
  test::Series series;
  int at = 0;
  for (const bool force : {false, true}) {
    for (const double tanks : {5.0, 0.05}) {
      for (const double delay : {0.0, 0.01, 0.05, 0.1, 0.2}) {
        for (const double loss : {0.0, 0.3}) {
          for (const double table : {1e3, 1e4, 1e5}) {
            for (std::uint32_t seed = 1; seed <= 3; ++seed) {
              if (!series.takes(++at % 25 == 0)) continue;
              const Trial trial = disturbed({.position_force = force,
                                             .table_n_per_m = table,
                                             .delay_s = delay,
                                             .loss = loss,
                                             .tank_start_j = tanks},
                                            seed);
              const Outcome outcome = run(trial);
              const Passivity found = passivity(outcome);
              SCOPED_TRACE(name(trial) + ", seed " + std::to_string(seed));
              series.record("excess_j", found.excess);
              series.record("gain_j", found.gain);
              series.record("least_tank_j", found.least_tank);
              series.record("contact_share", found.contact_share);
              EXPECT_TRUE(outcome.kept) << outcome.rules;
              EXPECT_LE(found.excess, 0);
              EXPECT_LE(found.gain, 1e-3);
              EXPECT_GE(found.least_tank, -5e-3);
              EXPECT_LE(found.imbalance, 1e-9);
              EXPECT_GT(found.contact_share, 0.02);
            }
          }
        }
      }
    }
  }
}

// A leader that feels nothing gives no energy, so the follower may only take what is in the tanks.
TEST(TeleoperationTrial, WithoutEnergyTheFollowerFades) {
  test::Series series;
  for (const double delay : {0.0, 0.1}) {
    for (const double table : {1e3, 1e5}) {
      if (!series.takes((delay > 0) == (table > 1e4))) continue;
      const Trial trial = disturbed({.plant = PlantFidelity::realistic(),
                                     .table_n_per_m = table,
                                     .delay_s = delay,
                                     .force_scale = 0,
                                     .tank_start_j = 0.1,
                                     .refill_below_j = 0},
                                    1);
      const Outcome outcome = run(trial);
      const Passivity found = passivity(outcome);
      SCOPED_TRACE(name(trial));
      series.record("gain_j", found.gain);
      series.record("least_valve", found.least_valve);
      EXPECT_TRUE(outcome.kept) << outcome.rules;
      EXPECT_LT(found.least_valve, 0.5);
      EXPECT_LE(found.excess, 0);
      EXPECT_LE(found.gain, 5e-3);
      EXPECT_GE(found.least_tank, -5e-3);
    }
  }
}

// Nobody holds the leader, and the follower carries an undeclared load: both sink, as passivity allows, no
// faster than the drive of a leader ends (0.2 m/s), until the clutch opens.
TEST(TeleoperationTrial, AnUndeclaredWeightHardlySinksWithAFreeLeader) {
  for (const bool force : {false, true}) {
    Trial trial{.position_force = force, .duration_s = 3};
    trial.undeclared_kg = 1;
    trial.way = [](double) { return Vector3(Vector3::Zero()); };
    trial.holds = [](double) { return false; };
    const Outcome outcome = run(trial);
    double fastest = 0;
    for (const Sample& s : outcome.samples) fastest = std::max(fastest, s.speed);
    EXPECT_LE(fastest, 0.27) << name(trial);
    const Sample& last = outcome.samples.back();
    EXPECT_EQ(outcome.of(last, "slipped"), 1) << name(trial);
    EXPECT_LT(last.led.z(), -0.01) << name(trial);                 // it does sink
    EXPECT_GT((last.led - last.error).z(), -0.12) << name(trial);  // the follower
    EXPECT_GT(last.led.z(), -0.2) << name(trial);
    EXPECT_LT(last.speed, 0.01) << name(trial);
  }
}

}  // namespace
}  // namespace multipanda::teleoperation
