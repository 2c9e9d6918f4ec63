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
// What the series is followed beyond its newest sample, and the brake.
constexpr double kBeyond = 0.3 * kMaxSpeed;

struct Motion {
  double fastest = 0, farthest = 0, least = 0, last = 0;  // [m/s], [m] from zero, [m], [m]; or in radians
};

// One coordinate of an input, of joints or of a pose.
class OneCoordinate {
 public:
  explicit OneCoordinate(Quantity quantity)
      : joints_(quantity == Quantity::joints),
        reference_({.name = "input", .quantity = quantity, .timeout_s = 0.5, .max_speed = kMaxSpeed}, 7) {
    if (joints_)
      reference_.start(JointVector(JointVector::Zero(7)));
    else
      reference_.start(Pose{});
  }
  void post(double x) {
    Target target;
    if (joints_) {
      target.delivery = Delivery::stream;
      target.size = 7;
      target.values[2] = x;
    } else {
      target = pose_target({Matrix3::Identity(), {x, 0, 0}}, 0, Delivery::stream);
    }
    ASSERT_EQ(reference_.post(target), Verdict::accepted);
  }
  // A hand that is held back pulls along `way`, beyond its bound.
  void resist(double way) {
    if (joints_)
      reference_.resist(JointVector(way * JointVector::Unit(7, 2)), 1.2);
    else
      reference_.resist(Vector6(way * Vector6::Unit(0)), 1.2, 0);
  }
  void advance(int step) { reference_.advance(kDt, step * kDt); }
  double position() const { return joints_ ? reference_.joints()[2] : reference_.pose().position.x(); }
  double velocity() const {
    return joints_ ? reference_.joint_velocity()[2] : reference_.twist().linear().x();
  }

 private:
  bool joints_;
  Reference reference_;
};

// Plays samples x(k) of one coordinate at the times t(k) into an input.
template <typename Time, typename Value>
Motion play(Quantity quantity, double end_s, Time&& time_of, Value&& value_of) {
  OneCoordinate input(quantity);
  Motion motion;
  int k = 0;
  double before = 0;
  for (int step = 0; step * kDt < end_s; ++step) {
    for (; time_of(k) <= step * kDt; ++k) input.post(value_of(k));
    input.advance(step);
    const double x = input.position();
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

// A brake ends in time, also if the set-point waits for a hand meanwhile: samples that lead back are
// followed. It first has to turn round, so that the way back of 1 cm takes longer than the brake.
TEST_P(FastStream, ABrakeThatWaitsForAHandEndsWhenSamplesLeadBack) {
  for (int from = 1000; from < 1500; from += 3) {  // [ms], when something holds the hand back
    OneCoordinate input(GetParam());
    double held = 0, way = 0, back = 0;
    int step = 0;
    for (; step < from + 800 && back < 0.01; ++step) {
      if (step % 50 == 0) input.post(step <= from ? (step / 50 % 4 < 2 ? 0.2 : -0.2) : held - 0.3 * way);
      if (step == from) {
        way = input.velocity() < 0 ? -1 : 1;
        held = input.position();
      }
      if (step >= from) input.resist(way);
      input.advance(step);
      if (step > from) back = way * (held - input.position());
    }
    EXPECT_GE(back, 0.01) << "from " << from << " ms on";
  }
}

// Noise of a force or a number has no mass to accelerate: what it leaves does not carry the goal after it
// away. Its speed v alone carries a minimum-jerk motion of duration T beyond its start by less than 0.2 v T.
TEST(NoisyStream, OfForcesAndNumbersIsLedToItsGoalWithoutAnOvershoot) {
  constexpr double kFastest = 1.1 * 60, kLongest = 1.0;  // [N/s], [s]
  Draw draw(19);
  for (const Quantity quantity : {Quantity::wrench, Quantity::scalar}) {
    for (const double rate : {100.0, 250.0, 1000.0}) {
      for (int trial = 0; trial < 20; ++trial) {
        Reference reference({.name = "input", .quantity = quantity, .timeout_s = 0.5, .max_speed = 60}, 3);
        reference.start_constant(0);
        const auto value = [&] {
          return quantity == Quantity::wrench ? reference.vector()[2] : reference.scalar();
        };
        const std::size_t at = quantity == Quantity::wrench ? 2 : 0;
        double most = 0, least = 0, streamed = 0;
        int k = 0;
        for (int step = 0; step < 4000; ++step) {
          Target target;
          target.size = static_cast<std::uint8_t>(reference.size());
          if (step < 2000 + trial && k / rate <= step * kDt) {
            ++k;
            target.delivery = Delivery::stream;
            target.values[at] = 20 + draw.uniform(-1, 1);
            ASSERT_EQ(reference.post(target), Verdict::accepted);
          }
          if (step == 2000 + trial) {
            streamed = most;
            ASSERT_EQ(reference.post(target), Verdict::accepted);  // zero
          }
          reference.advance(kDt, step * kDt);
          most = std::max(most, value());
          least = std::min(least, value());
        }
        EXPECT_LE(most, streamed + 0.2 * kFastest * kLongest)
            << to_string(quantity) << ", " << rate << " Hz, " << trial;
        EXPECT_GE(least, -2) << to_string(quantity) << ", " << rate << " Hz, " << trial;
        EXPECT_NEAR(value(), 0, 1e-9);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Quantities, FastStream, testing::Values(Quantity::pose, Quantity::joints),
                         [](const auto& each) { return std::string(to_string(each.param)); });

}  // namespace
}  // namespace multipanda::fast_stream_test
