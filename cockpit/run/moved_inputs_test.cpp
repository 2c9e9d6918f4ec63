#include <cmath>

#include <gtest/gtest.h>

#include "cockpit/run/state_view.hpp"

namespace multipanda::cockpit::moved_inputs_test {
namespace {

std::vector<double> rest(Quantity quantity, const std::vector<double>& before, const std::vector<double>& now,
                         double dt = 1e-3) {
  return MovedInputs::resting_place(quantity, before, now, dt);
}

std::vector<double> pose(double x, double yaw) {
  return {x, 0, 0.4, std::cos(yaw / 2), 0, 0, std::sin(yaw / 2)};
}

double yaw_of(const std::vector<double>& pose) { return 2 * std::atan2(pose[6], pose[3]); }

TEST(RestingPlace, IsThePlaceOfWhatRests) {
  EXPECT_EQ(rest(Quantity::joints, {1, 2}, {1, 2}), (std::vector<double>{1, 2}));
  EXPECT_EQ(rest(Quantity::pose, pose(0.5, 0), pose(0.5, 0)), pose(0.5, 0));
  EXPECT_EQ(rest(Quantity::scalar, {1}, {2}), std::vector<double>{2});
  EXPECT_EQ(rest(Quantity::joints, {1}, {2}, 0), std::vector<double>{2});  // nothing is known of its speed
}

TEST(RestingPlace, OfForcesAndSpeedsIsZero) {
  EXPECT_EQ(rest(Quantity::wrench, {1, 2, 3, 4, 5, 6}, {1, 2, 3, 4, 5, 6}), std::vector<double>(6, 0));
  EXPECT_EQ(rest(Quantity::twist, {1, 2, 3, 4, 5, 6}, {1, 2, 3, 4, 5, 6}), std::vector<double>(6, 0));
}

// Constant braking from v takes v^2 / 2a; within 0.1 s at least, half of v times that.
TEST(RestingPlace, IsAheadByTheBrakingDistance) {
  EXPECT_NEAR(rest(Quantity::pose, pose(0.5 - 0.0001, 0), pose(0.5, 0))[0], 0.5 + 0.1 * 0.05, 1e-9);
  EXPECT_NEAR(rest(Quantity::pose, pose(0.5 + 0.001, 0), pose(0.5, 0))[0], 0.5 - 1.0 / 8, 1e-9);
  EXPECT_NEAR(rest(Quantity::joints, {0.998}, {1})[0], 1 + 4.0 / 10, 1e-9);
  EXPECT_NEAR(yaw_of(rest(Quantity::pose, pose(0.5, 0.3 - 0.0005), pose(0.5, 0.3))), 0.3 + 0.5 * 0.05, 1e-6);
  EXPECT_NEAR(yaw_of(rest(Quantity::pose, pose(0.5, 0.3 + 0.002), pose(0.5, 0.3))), 0.3 - 4.0 / 16, 1e-6);
}

}  // namespace
}  // namespace multipanda::cockpit::moved_inputs_test
