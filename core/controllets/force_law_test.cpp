#include "core/controllets/force_law.hpp"

#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "core/controllets/energy_tank.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::force_law_test {
namespace {

using test::Draw;

// A held input reaches 1 - 1/e after a time constant, for any tick length.
TEST(LowPass, ReachesAShareByItsTimeConstantAtAnyRate) {
  for (const double dt : {0.001, 0.0005, 0.004}) {
    LowPass<double> filter;
    filter.reset(2);
    const double cutoff = 5, tau = 1 / (2 * M_PI * cutoff);
    const int ticks = static_cast<int>(std::lround(tau / dt));
    for (int i = 0; i < ticks; ++i) filter.update(4, cutoff, dt);
    EXPECT_NEAR(filter.value(), 2 + 2 * (1 - std::exp(-ticks * dt / tau)), 1e-9);
  }
}

TEST(Fade, TakesItsTimeAndIsSmooth) {
  Fade fade;
  fade.reset(false);
  double before = 0, steepest = 0;
  for (int i = 0; i < 200; ++i) {
    const double now = fade.towards(true, 0.001);
    steepest = std::max(steepest, (now - before) / 0.001);
    before = now;
  }
  EXPECT_NEAR(before, 1, 1e-9);
  EXPECT_NEAR(steepest, 1.5 / Fade::kDuration, 0.05);
  for (int i = 0; i < 100; ++i) fade.towards(false, 0.001);
  EXPECT_NEAR(fade.value(), 0.5, 1e-9);
}

TEST(ContactDetector, HasHysteresisAndABlindBeginning) {
  ContactDetector detector;
  detector.start();
  for (int i = 0; i < 99; ++i) EXPECT_FALSE(detector.update(50, 2, 0.001));
  EXPECT_TRUE(detector.update(50, 2, 0.001) || detector.update(50, 2, 0.001));
  for (int i = 0; i < 500; ++i) EXPECT_TRUE(detector.update(1.2, 2, 0.001));  // above half
  for (int i = 0; i < 500; ++i) detector.update(0.8, 2, 0.001);
  EXPECT_FALSE(detector.in_contact());
  for (int i = 0; i < 500; ++i) EXPECT_FALSE(detector.update(1.2, 2, 0.001));  // below the threshold
}

// White noise of 0.65 N on an estimate, as noise of joint sensors gives it, is no contact.
TEST(ContactDetector, NoiseIsNoContact) {
  std::mt19937 engine(7);
  std::normal_distribution<double> noise(0, 0.65);
  ContactDetector detector;
  detector.start();
  for (int i = 0; i < 60000; ++i) ASSERT_FALSE(detector.update(noise(engine), 2, 0.001));
}

TEST(ForceDirection, FollowsAForceAtItsSpeedAndNeverTurnsBack) {
  ForceDirection direction;
  direction.start({0, 0, -2});
  EXPECT_NEAR((direction.n() + Vector3::UnitZ()).norm(), 0, 1e-12);
  direction.update({0.1, 0, 0}, 1);  // too weak to have a direction
  EXPECT_NEAR((direction.n() + Vector3::UnitZ()).norm(), 0, 1e-12);
  direction.update({0, 0, 30}, 10);  // a pull
  EXPECT_NEAR((direction.n() + Vector3::UnitZ()).norm(), 0, 1e-12);
  const Vector3 F(3, 0, -3);  // 45 degrees away
  direction.update(F, 0.1);
  EXPECT_NEAR(std::acos(-direction.n().z()), 0.05, 1e-9);
  for (int i = 0; i < 100; ++i) direction.update(F, 0.1);
  EXPECT_NEAR((direction.n() - F.normalized()).norm(), 0, 1e-9);
  Draw draw(3);
  const Vector3 v = draw.vector3(1), across = direction.across(v);
  EXPECT_NEAR(across.dot(direction.n()), 0, 1e-12);
  EXPECT_NEAR((v - across).cross(direction.n()).norm(), 0, 1e-12);
}

const ForceGains kGains{.proportional = 0.2,
                        .derivative_s = 0,
                        .integral_per_s = 4,
                        .error_cutoff_hz = 10,
                        .integral_limit_n = 5};

TEST(ForceLoop, IsTheStatedLaw) {
  ForceLoop loop;
  loop.start();
  ForceGains gains = kGains;
  gains.derivative_s = 0.01;
  double e_f = 0, integral = 0;
  const double dt = 0.001, a = 1 - std::exp(-2 * M_PI * 10 * dt);
  for (int i = 0; i < 300; ++i) {
    const double desired = 10 + std::sin(0.02 * i), estimated = 9 + std::cos(0.013 * i);
    const double e = desired - estimated, last = e_f;
    e_f += a * (e - e_f);
    integral += 4 * e_f * dt;
    const double expected = desired + 0.2 * e_f + 0.01 * (e_f - last) / dt + integral;
    ASSERT_NEAR(loop.update(gains, desired, estimated, 1, dt), expected, 1e-9) << i;
  }
}

TEST(ForceLoop, NeverPullsAndDoesNotWindUp) {
  ForceLoop loop;
  loop.start();
  // Pressed far harder than desired, for long: the command ends at 0 and recovers at once.
  for (int i = 0; i < 5000; ++i) EXPECT_GE(loop.update(kGains, 2, 30, 1, 0.001), 0);
  EXPECT_EQ(loop.update(kGains, 2, 30, 1, 0.001), 0);
  EXPECT_GE(loop.integral(), -3);
  // Nothing to press on, for long: the integral stays within its limit.
  loop.start();
  for (int i = 0; i < 5000; ++i) loop.update(kGains, 20, 0, 1, 0.001);
  EXPECT_NEAR(loop.integral(), 5, 1e-9);
  // Contact lost: feed-forward only, and the integral is reset.
  for (int i = 0; i < 2000; ++i) EXPECT_NEAR(loop.update(kGains, 20, 0, 0, 0.001), 20, 1e-12);
  EXPECT_LT(loop.integral(), 1e-3);
}

// Less would be pressed than desired, but the integral keeps the command above zero: it may fall until it
// no longer does.
// As printed: without F_d fed forward f is the feedback alone, and it may pull, no deeper than allowed.
TEST(ForceLoop, WithoutFeedforwardAndClampItIsTheFeedbackAlone) {
  const auto settled = [](const ForceGains& gains, double desired, double estimated, double deepest) {
    ForceLoop loop;
    loop.start();
    double f = 0;
    for (int i = 0; i < 3000; ++i) f = loop.update(gains, desired, estimated, 1, 0.001, 60, deepest);
    return f;
  };
  ForceGains gains{.proportional = 0.5, .error_cutoff_hz = 50, .integral_limit_n = 20};
  EXPECT_NEAR(settled(gains, 10, 4, 60), 10 + 0.5 * 6, 1e-9);
  gains.feedforward = false;
  EXPECT_NEAR(settled(gains, 10, 4, 60), 0.5 * 6, 1e-9);
  EXPECT_EQ(settled(gains, 4, 10, 60), 0);
  gains.may_pull = true;
  EXPECT_NEAR(settled(gains, 4, 10, 60), -3, 1e-9);
  EXPECT_EQ(settled(gains, 4, 10, 2), -2);
  gains.integral_per_s = 5;  // no windup beyond what it may pull
  EXPECT_EQ(settled(gains, 4, 10, 2), -2);
}

TEST(ForceLoop, TheIntegralFallsUntilTheCommandIsZero) {
  ForceLoop loop;
  loop.start();
  for (int i = 0; i < 5000; ++i) loop.update(kGains, 20, 0, 1, 0.001);
  ASSERT_NEAR(loop.integral(), 5, 1e-9);
  for (int i = 0; i < 1000; ++i) loop.update(kGains, 2, 22, 1, 0.001);
  EXPECT_NEAR(loop.integral(), 2, 0.25);  // 2 N + 0.2 (-20 N) + integral = 0, less one low-pass
}

// A tank that must keep 0.3 J gives a share of what it holds above that.
TEST(EnergyTank, AffordsAShareOfWhatIsAboveTheMinimum) {
  const TankLimits limits{.min_j = 0.3, .max_j = 2, .closing_j = 0.1};
  EnergyTank tank;
  tank.start(0.8, limits);
  EXPECT_EQ(tank.affordable(0.049, 0.1, limits), 1);
  EXPECT_EQ(tank.affordable(-10, 0.1, limits), 1);
  EXPECT_NEAR(tank.affordable(0.1, 0.1, limits), 0.5, 1e-12);
  EXPECT_NEAR(tank.affordable(2, 1, limits), 0.25, 1e-12);
  tank.give(0.6);
  EXPECT_EQ(tank.affordable(0.01, 0.1, limits), 0);
}

TEST(EnergyTank, AccountsForEveryJoule) {
  const TankLimits limits{.min_j = 0, .max_j = 1, .closing_j = 0.1};
  EnergyTank tank;
  tank.start(5, limits);
  EXPECT_EQ(tank.energy(), 1);
  Draw draw(5);
  double given = 0;
  for (int i = 0; i < 20000; ++i) {
    const double work = draw.uniform(-0.0201, 0.02);
    tank.give(work);
    given += work;
    ASSERT_NEAR(tank.energy() + tank.lost(), 1 - given, 1e-9);
    ASSERT_LE(tank.energy(), 1);
  }
  EXPECT_GT(tank.lost(), 0.1);
}

TEST(EnergyTank, ValveClosesSmoothlyAboveTheMinimum) {
  const TankLimits limits{.min_j = 0.3, .max_j = 1, .closing_j = 0.1};
  EnergyTank tank;
  double before = 1;
  for (double energy = 0.45; energy > 0.25; energy -= 0.001) {
    tank.start(0.45, limits);
    tank.give(0.45 - energy);
    const double valve = tank.valve(limits);
    EXPECT_LE(valve, before + 1e-12);
    EXPECT_LT(before - valve, 0.016);  // 1.5 / 0.1 J
    if (energy >= 0.4) {
      EXPECT_EQ(valve, 1);
    }
    if (energy <= 0.3) {
      EXPECT_EQ(valve, 0);
    }
    before = valve;
  }
  EXPECT_NEAR(tank.make_up(limits), 0.3 - tank.energy() + 0.05, 0.06);
  EXPECT_NEAR(tank.energy(), 0.3, 1e-12);
}

// The cubic Hermite polynomial with flat ends, in fractions: no kink at either end of the
// valve's range.
TEST(EnergyTank, ValveIsFlatAtBothEnds) {
  const TankLimits limits{.min_j = 0.3, .max_j = 2, .closing_j = 0.8};
  const std::vector<std::pair<double, double>> expected = {{1.0 / 8, 11.0 / 256},
                                                           {1.0 / 4, 5.0 / 32},
                                                           {1.0 / 2, 1.0 / 2},
                                                           {3.0 / 4, 27.0 / 32},
                                                           {7.0 / 8, 245.0 / 256}};
  for (const auto& [share, valve] : expected) {
    EnergyTank tank;
    tank.start(limits.min_j + share * limits.closing_j, limits);
    EXPECT_NEAR(tank.valve(limits), valve, 1e-12) << share;
  }
}

// gamma alpha outwards, everything inwards, no step between; the paper's as printed.
TEST(ForceShare, FollowsItsLaw) {
  EXPECT_NEAR(contact_shape(0.02, 0.02), std::exp(-1.0), 1e-12);
  EXPECT_EQ(contact_shape(0, 0.02), 1);
  for (const double gamma : {0.0, 0.3, 1.0}) {
    for (const double alpha : {0.0, 0.6, 1.0}) {
      EXPECT_NEAR(force_share(ValveLaw::paper, gamma, alpha, 0.1), gamma + alpha * (1 - gamma), 1e-12);
      EXPECT_NEAR(force_share(ValveLaw::passive, gamma, alpha, 0.1), gamma * alpha, 1e-12);
      EXPECT_NEAR(force_share(ValveLaw::passive, gamma, alpha, 0), gamma * alpha, 1e-12);
      EXPECT_NEAR(force_share(ValveLaw::passive, gamma, alpha, -kIncomingSpeed), 1, 1e-12);
      double before = gamma * alpha;
      for (double v = 0; v > -0.03; v -= 1e-4) {
        const double share = force_share(ValveLaw::passive, gamma, alpha, v);
        EXPECT_LT(std::abs(share - before), 0.01);
        before = share;
      }
    }
  }
}

// Wherever the share rises, the force changes no faster with the velocity than the given damper would.
TEST(ForceShare, IsNoStifferADamperThanAllowed) {
  for (const double force : {0.5, 5.0, 30.0, 60.0}) {
    for (const double open : {0.0, 0.4, 1.0}) {
      for (const double damping : {20.0, 70.0, 400.0}) {
        const double width = incoming_speed_for(force, open, 1.0, damping);
        EXPECT_GE(width, kIncomingSpeed);
        constexpr double kStep = 1e-5;
        double steepest = 0;
        for (double v = 0; v > -1.2 * width; v -= width / 400) {
          const double slope = (force_share(ValveLaw::passive, open, 1.0, v - kStep, width) -
                                force_share(ValveLaw::passive, open, 1.0, v, width)) /
                               kStep;
          steepest = std::max(steepest, force * slope);
        }
        EXPECT_LT(steepest, 1.001 * damping + 1e-9);
        if (open < 1 && width > kIncomingSpeed) {
          EXPECT_GT(steepest, 0.98 * damping);  // not slower than needed
        }
      }
    }
  }
  // Without any damping the force never exceeds gamma alpha of itself.
  const double width = incoming_speed_for(30, 0.2, 0.5, 0);
  EXPECT_NEAR(force_share(ValveLaw::passive, 0.2, 0.5, -1, width), 0.1, 1e-12);
}

}  // namespace
}  // namespace multipanda::force_law_test
