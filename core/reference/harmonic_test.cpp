// The motion of a harmonic against its formula with a numerical phase; its top speed against samples.
#include "core/reference/harmonic.hpp"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "core/testing/test_arm.hpp"

namespace multipanda::harmonic_test {
namespace {

using test::Draw;
using Values = QuinticSegment::Values;

Harmonic some(Draw& draw, std::size_t harmonics, double amplitude) {
  Harmonic motion{.period_s = draw.uniform(2, 6), .cycles = draw.uniform(1.2, 3.4)};
  motion.ramp_s = draw.uniform(0.2, motion.period_s);
  motion.harmonic_count = harmonics;
  for (std::size_t i = 0; i < 3; ++i) {
    motion.sine[i] = draw.uniform(-amplitude, amplitude);
    motion.rise[i] = draw.uniform(-amplitude, amplitude);
    for (std::size_t k = 0; k < harmonics; ++k) {
      motion.harmonics[k].sine[i] = draw.uniform(-amplitude, amplitude);
      motion.harmonics[k].rise[i] = draw.uniform(-amplitude, amplitude);
    }
  }
  return motion;
}

QuinticSegment::Sample at(const Harmonic& motion, double t) {
  QuinticSegment::Sample sample;
  motion.add(t, 3, sample);
  return sample;
}

// Simpson's rule over the rate of theta, faded in and out by 6 u^5 - 15 u^4 + 10 u^3.
double phase(const Harmonic& motion, double t) {
  const double T = motion.period_s * motion.cycles + motion.ramp_s;
  const auto fade = [](double u) {
    u = std::clamp(u, 0.0, 1.0);
    return u * u * u * (10 + u * (6 * u - 15));
  };
  const auto rate = [&](double x) {
    return 2 * std::numbers::pi / motion.period_s * fade(x / motion.ramp_s) * fade((T - x) / motion.ramp_s);
  };
  const double end = std::clamp(t, 0.0, T);
  const int n = 4000;
  double sum = rate(0) + rate(end);
  for (int i = 1; i < n; ++i) sum += (i % 2 == 1 ? 4 : 2) * rate(end * i / n);
  return sum * end / n / 3;
}

TEST(Harmonic, FollowsItsFormula) {
  Draw draw(5);
  for (int trial = 0; trial < 30; ++trial) {
    const Harmonic motion = some(draw, static_cast<std::size_t>(trial % 4), 0.3);
    const double T = motion.period_s * motion.cycles + motion.ramp_s;
    EXPECT_NEAR(motion.duration(), T, 1e-12);
    for (int k = 0; k < 12; ++k) {
      const double t = k == 0 ? -0.5 : k == 1 ? T + 0.5 : draw.uniform(0, T);
      const double theta = phase(motion, t);
      const auto now = at(motion, t), before = at(motion, t - 1e-5), after = at(motion, t + 1e-5);
      for (std::size_t i = 0; i < 3; ++i) {
        double x = motion.sine[i] * std::sin(theta) + motion.rise[i] * std::pow(std::sin(theta / 2), 2);
        for (std::size_t h = 0; h < motion.harmonic_count; ++h) {
          const double n = static_cast<double>(h) + 2;
          x += motion.harmonics[h].sine[i] * std::sin(n * theta) +
               motion.harmonics[h].rise[i] * std::pow(std::sin(n * theta / 2), 2);
        }
        EXPECT_NEAR(now.position[i], x, 1e-7);
        EXPECT_NEAR(now.velocity[i], (after.position[i] - before.position[i]) / 2e-5, 1e-6);
        EXPECT_NEAR(now.acceleration[i], (after.velocity[i] - before.velocity[i]) / 2e-5, 1e-6);
      }
    }
  }
}

TEST(Harmonic, TopSpeedIsThatOfDenseSamples) {
  Draw draw(6);
  for (int trial = 0; trial < 40; ++trial) {
    Harmonic motion = some(draw, static_cast<std::size_t>(trial % 4), trial % 2 == 0 ? 0.01 : 2);
    motion.cycles = 3;  // more than one period at the full rate
    for (const auto& [first, count] : {std::pair<std::size_t, std::size_t>{0, 3}, {1, 1}, {1, 2}, {2, 1}}) {
      double fastest = 0;
      for (int k = 0; k < 20000; ++k) {
        const auto sample = at(motion, motion.ramp_s + motion.period_s * k / 20000.0);
        double square = 0;
        for (std::size_t i = first; i < first + count; ++i) square += std::pow(sample.velocity[i], 2);
        fastest = std::max(fastest, std::sqrt(square));
      }
      const double top = motion.top_speed(first, count);
      EXPECT_GE(top, fastest * (1 - 1e-12));
      EXPECT_LE(top, fastest * (motion.harmonic_count > 0 ? 1.0004 : 1 + 1e-6));
    }
  }
}

}  // namespace
}  // namespace multipanda::harmonic_test
