#include "core/controllets/axis_force.hpp"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

// One axis by itself, moved and felt as each test says.
namespace multipanda::axis_force_test {
namespace {

constexpr double kDt = 0.001, kInfinite = std::numeric_limits<double>::infinity();

struct Axis {
  Axis() {
    settings.threshold = 2;
    settings.reach = 1;  // gamma hardly falls
    settings.gains = {.proportional = 0.1, .integral_per_s = 5, .integral_limit_n = 20};
    now.room = 60;
    axis.start();
  }
  double run(double seconds) {
    for (int t = 0; t < std::lround(seconds / kDt); ++t) {
      const double before = f;
      axis.select(true, kDt);
      f = axis.update(settings, now, kDt);
      step = std::max(step, std::abs(f - before));
    }
    return f;
  }
  AxisForce axis;
  AxisSettings settings;
  AxisState now;
  double f = 0, step = 0;
};

// The bound of f against F_d opens below 2 N and 0.2 N m. Where bounds are lifted the room is infinite.
TEST(AxisForce, CommandIsContinuousInTheGoalAlsoWithoutBounds) {
  for (const AxisKind& kind : {kForceAxis, kMomentAxis}) {
    for (const double felt : {1000.0, -1000.0}) {
      Axis axis;
      axis.settings.kind = kind;
      axis.settings.gains.proportional = 1;
      axis.now.room = kInfinite;
      axis.now.estimated = felt;
      axis.run(1);  // in contact, whatever the sign
      axis.now.desired = 2 * kind.pulls_up_to;
      axis.run(1);
      axis.step = 0;
      double deepest = 0;
      const double slowly = kind.pulls_up_to / 2000;
      for (const double sign : {-1.0, 1.0}) {
        for (int k = -4000; k < 4000; ++k) {
          axis.now.desired = sign * k * slowly;
          deepest = std::max(deepest, std::abs(axis.run(kDt)));
        }
      }
      // It opens by kind.most over half of the 4000 periods.
      EXPECT_LT(axis.step, 1.2 * kind.most / 2000) << felt;
      EXPECT_GT(deepest, 0.9 * kind.most) << felt;
    }
  }
}

// With contact lost by moving back, it ends within twice the way of loss, however far the axis was.
TEST(AxisForce, AnAxisThatWasPushedBackLosesItsContact) {
  Axis axis;
  axis.now.desired = axis.now.estimated = 10;
  axis.run(0.6);
  EXPECT_NEAR(axis.f, 10, 1e-9);
  axis.now.estimated = 0;
  axis.now.speed = -0.1;
  axis.run(0.5);  // 50 mm
  EXPECT_GT(axis.f, 9);
  axis.now.speed = 0.05;
  axis.run(0.19);  // 9.5 mm
  EXPECT_GT(axis.f, 9);
  axis.run(0.02 + 0.21);  // 10.5 mm, and the fade
  EXPECT_LT(std::abs(axis.f), 1e-9);
}

// The way beyond the contact is counted along the goal: another direction begins at zero.
TEST(AxisForce, AGoalOfTheOtherSignBeginsANewWay) {
  Axis axis;
  axis.now.desired = axis.now.estimated = 10;
  axis.run(0.6);
  axis.now.estimated = 0;
  axis.now.speed = 0.05;
  axis.run(0.09);  // 4.5 mm beyond
  axis.now.desired = -10;
  axis.now.speed = -0.05;
  axis.run(0.06);  // 3 mm in the new direction
  axis.now.speed = 0;
  axis.run(0.4);
  EXPECT_LT(axis.f, -9);
}

// Somebody pushes an axis without a goal, and lets go: the integral, which by then is at its limit, does not
// drive the free axis on, and leaves without a step.
TEST(AxisForce, AFreeAxisIsNotDrivenByItsIntegral) {
  Axis axis;
  axis.now.estimated = 10;
  axis.run(1.5);
  EXPECT_NEAR(axis.f, -21, 0.1);
  axis.step = 0;
  axis.now.estimated = 0;
  axis.run(0.12);
  EXPECT_LT(std::abs(axis.f), 0.3);
  EXPECT_LT(axis.step, 1.1);
  // Felt below the threshold in contact's direction, it may stay as large as that.
  Axis pressing;
  pressing.now.desired = 10;
  pressing.now.estimated = 8;
  pressing.run(1.2);
  EXPECT_GT(pressing.f, 19);
  pressing.now.estimated = 0.8;  // a bounce: contact is not lost
  pressing.settings.gains.proportional = 0;
  pressing.run(0.2);
  EXPECT_NEAR(pressing.f, 10.8, 0.05);
}

// A light axis: f counts on a reaction only where one holds it.
TEST(AxisForce, BeyondWhatALightAxisBearsItNeedsAReaction) {
  const auto pressing = [](double estimated, double speed) {
    Axis axis;
    axis.settings.kind = kMomentAxis;
    axis.settings.threshold = 0.3;
    axis.settings.approach_speed = 1;
    axis.now.stiffness = 20;
    axis.now.room = 15;
    axis.now.unfelt = 0.5;
    axis.now.slow = 0.25;
    axis.now.desired = 3;
    axis.now.estimated = estimated;
    axis.now.speed = speed;
    axis.run(2);
    return axis;
  };
  EXPECT_NEAR(pressing(3, 0).f, 3, 0.01);  // held
  EXPECT_NEAR(pressing(0, 0).f, 0.5, 1e-9);
  EXPECT_NEAR(pressing(-4, 0).f, 0.5, 1e-9);
  EXPECT_NEAR(pressing(3, 0.3).f, 0.5, 1e-9);  // it turns, whatever is felt
  Axis let_go = pressing(3, 0);
  let_go.now.speed = 0.3;
  let_go.step = 0;
  let_go.run(0.021);
  EXPECT_NEAR(let_go.f, 0.5, 1e-9);
  EXPECT_LT(let_go.step, 0.3);
}

}  // namespace
}  // namespace multipanda::axis_force_test
