#include "arm_interface/command_success.hpp"

#include <deque>
#include <random>

#include <gtest/gtest.h>

namespace multipanda::command_success_test {
namespace {

// An arm's share, as it is defined: received commands of the last 100 periods, or of the motion's.
struct Share {
  double take(bool received) {
    window.push_back(received);
    if (window.size() > 100) window.pop_front();
    double count = 0;
    for (const bool one : window) count += one ? 1 : 0;
    return count / static_cast<double>(window.size());
  }
  std::deque<bool> window;
};

TEST(CommandSuccess, CountsTheCommandsThatTheArmMissed) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> draw(0, 1);
  for (const double loss : {0.0, 0.01, 0.2, 0.9}) {
    CommandSuccess success;
    Share share;
    std::uint64_t number = 5000, missed = 0;
    for (int k = 0; k < 100; ++k) success.take(++number, false, 0, 0);
    for (int k = 0; k < 4000; ++k) {
      // None at the beginning, which the share does not resolve, and in the last window.
      const bool lost = k >= 100 && k < 3900 && draw(random) < loss;
      missed += lost ? 1 : 0;
      success.take(++number, true, share.take(!lost), 1e-3 * k);
      success.take(number, true, 0, 1e-3 * k);  // the same packet again
    }
    EXPECT_EQ(success.missed(), missed) << loss;
  }
}

TEST(CommandSuccess, WarnsOncePerMinuteAndNotBeforeTheShareMeansAnything) {
  CommandSuccess success;
  std::uint64_t number = 0;
  int warnings = 0;
  const auto run = [&](int periods, double share) {
    for (int k = 0; k < periods; ++k) {
      ++number;
      success.take(number, true, share, 1e-3 * static_cast<double>(number));
      warnings += success.take_low() ? 1 : 0;
    }
    return warnings;
  };
  EXPECT_EQ(run(120, 0), 0);
  EXPECT_EQ(run(1000, 0.9), 0);
  EXPECT_EQ(run(1, 0.89), 1);
  EXPECT_EQ(run(59'999, 0.5), 1);
  EXPECT_EQ(run(1, 0.5), 2);
  for (int k = 0; k < 70'000; ++k) {
    ++number;
    success.take(number, false, 0, 1e-3 * static_cast<double>(number));
  }
  EXPECT_EQ(run(120, 0.2), 2);  // another motion
  EXPECT_EQ(run(1, 0.2), 3);
}

// The first packet that the loop sees of a motion has any number, and some before it were lost. An arm
// divides by the motion's periods (as virtual arms do) or by 100 (as a window that begins empty does).
TEST(CommandSuccess, PeriodsBeforeTheFirstCommandAreNoReasonForAWarning) {
  for (const int before : {1, 2, 10, 19}) {
    for (const std::uint64_t first : {1u, 2u, 100u, 101u, 1'000'000u}) {
      for (const bool idle_before : {false, true}) {
        for (const bool of_hundred : {false, true}) {
          CommandSuccess success;
          if (idle_before) success.take(first, false, 0, 0);
          Share share;
          double received = 0;
          for (int k = 1; k <= 1000; ++k) {
            const double of_window = share.take(k > before);
            received += k > before ? 1 : 0;
            success.take(first + 150 + static_cast<std::uint64_t>(k), true,
                         of_hundred && k < 100 ? received / 100 : of_window, 1e-3 * k);
            ASSERT_FALSE(success.take_low()) << before << " before, packet " << first << ", period " << k;
          }
          EXPECT_LE(success.missed(), static_cast<std::uint64_t>(before));
          for (int k = 1; k <= 11; ++k) {  // 11 of the last 100 is too many
            success.take(first + 1150 + static_cast<std::uint64_t>(k), true, share.take(false), 1 + 1e-3 * k);
            EXPECT_EQ(success.take_low(), k == 11);
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace multipanda::command_success_test
