// Streams that ask for more than the limits allow: samples that jump to and fro, at any rate. The set-point
// follows what it can, but neither its speed nor its way grows beyond what the limits and the samples say.
#include <cmath>

#include <gtest/gtest.h>

#include "core/reference/reference.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::fast_stream_test {
namespace {

using test::Draw;

constexpr double kDt = 0.001;
constexpr double kMaxSpeed = 0.25;  // [m/s] or [rad/s]
constexpr double kBeyond =
    0.3 * kMaxSpeed;  // what the series is followed beyond its newest sample, and the brake

struct Motion {
  double fastest = 0, farthest = 0, least = 0, last = 0;  // [m/s], [m] from zero, [m], [m]; or in radians
};

// Plays samples x(k) of one coordinate at the times t(k) into an input.
template <typename Time, typename Value>
Motion play(Quantity quantity, double end_s, Time&& time_of, Value&& value_of) {
  Reference reference({.name = "input", .quantity = quantity, .timeout_s = 0.5, .max_speed = kMaxSpeed}, 7);
  if (quantity == Quantity::joints)
    reference.start(JointVector(JointVector::Zero(7)));
  else
    reference.start(Pose{});
  Motion motion;
  int k = 0;
  double before = 0;
  for (int step = 0; step * kDt < end_s; ++step) {
    const double t = step * kDt;
    for (; time_of(k) <= t; ++k) {
      Target target;
      if (quantity == Quantity::joints) {
        target.delivery = Delivery::stream;
        target.size = 7;
        target.values[2] = value_of(k);
      } else {
        Pose X;
        X.position.x() = value_of(k);
        target = pose_target(X, 0, Delivery::stream);
      }
      EXPECT_EQ(reference.post(target), Verdict::accepted);
    }
    reference.advance(kDt, t);
    const double x = quantity == Quantity::joints ? reference.joints()[2] : reference.pose().position.x();
    motion.fastest = std::max(motion.fastest, std::abs(x - before) / kDt);
    motion.farthest = std::max(motion.farthest, std::abs(x));
    motion.least = std::min(motion.least, x);
    motion.last = before = x;
  }
  return motion;
}

class FastStream : public testing::TestWithParam<Quantity> {};

// Two samples on one side and two on the other: what the series extrapolates always points the wrong way.
TEST_P(FastStream, SamplesThatAlternateInPairsDoNotAddUp) {
  for (const double rate : {6.0, 8.0, 10.0, 15.0, 20.0, 30.0}) {
    for (const double size : {0.05, 0.1, 0.2}) {
      const auto motion = play(
          GetParam(), 15, [&](int k) { return k / rate; }, [&](int k) { return k % 4 < 2 ? size : -size; });
      EXPECT_LE(motion.fastest, 1.11 * kMaxSpeed) << rate << " Hz, " << size;
      EXPECT_LE(motion.farthest, size + kBeyond) << rate << " Hz, " << size;
    }
  }
}

TEST_P(FastStream, SamplesAtRandomDriveItNoFasterThanTheLimit) {
  Draw draw(17);
  for (int trial = 0; trial < 200; ++trial) {
    const double rate = std::exp(draw.uniform(std::log(5), std::log(400)));
    const double size = draw.uniform(0.02, 0.4), jitter = draw.uniform(0, 0.5);
    const double turns = draw.uniform(0, 1);  // how often the series changes its direction
    std::vector<double> values, times;
    double x = 0, v = kMaxSpeed * draw.uniform(0.5, 4);
    for (int k = 0; k < 10 * rate + 2; ++k) {
      times.push_back((k + draw.uniform(0, jitter)) / rate);
      if (draw.uniform(0, 1) < turns * 0.3) v = -v;
      x += v / rate;
      if (std::abs(x) > size) {
        x = std::copysign(size, x);
        v = -v;
      }
      values.push_back(trial % 2 == 0 ? x : draw.uniform(-size, size));
    }
    const auto motion = play(
        GetParam(), 10, [&](int k) { return times.at(static_cast<std::size_t>(k)); },
        [&](int k) { return values.at(static_cast<std::size_t>(k)); });
    EXPECT_LE(motion.fastest, 1.11 * kMaxSpeed) << trial << ": " << rate << " Hz";
    EXPECT_LE(motion.farthest, size + kBeyond) << trial << ": " << rate << " Hz, " << size;
  }
}

// A series that runs away from the set-point and then waits for it: approached without a way back.
TEST_P(FastStream, ARampTooFastToFollowIsCaughtUpWithWithoutTurningBack) {
  Draw draw(18);
  for (const double rate : {10.0, 20.0, 30.0, 50.0, 100.0}) {
    for (const double speed : {1.6, 3.0, 8.0}) {
      for (const double jitter : {0.0, 0.1, 0.3}) {
        std::vector<double> times;
        for (int k = 0; k < 10 * rate + 2; ++k) times.push_back((k + draw.uniform(0, jitter)) / rate);
        const double end = 0.8;
        const auto motion = play(
            GetParam(), 8, [&](int k) { return times.at(static_cast<std::size_t>(k)); },
            [&](int k) { return std::min(end, speed * kMaxSpeed * k / rate); });
        EXPECT_GE(motion.least, -0.01) << rate << " Hz, " << speed << ", " << jitter;
        EXPECT_LE(motion.fastest, 1.11 * kMaxSpeed) << rate << " Hz, " << speed << ", " << jitter;
        EXPECT_NEAR(motion.last, end, 5e-3) << rate << " Hz, " << speed << ", " << jitter;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Quantities, FastStream, testing::Values(Quantity::pose, Quantity::joints),
                         [](const auto& each) { return std::string(to_string(each.param)); });

}  // namespace
}  // namespace multipanda::fast_stream_test
