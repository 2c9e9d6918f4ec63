// Streams at 10 to 100 Hz with samples that come unevenly or not at all give a smooth motion. The jerk of the
// set-point is compared with that of a zero-order hold: each sample stands until the next one arrives. Such a
// hold has no finite jerk, so both are compared by what can follow it:
//   limited  a set-point that runs to the held sample as fast as the limits allow (the input's speed, and the
//            acceleration with which uneven streams are caught up with), axis by axis
//   hand     a hand on the spring of an impedance law, critically damped, of 20 rad/s
// Jerk is a third difference at 1 kHz.
#include <cmath>
#include <deque>
#include <functional>

#include <gtest/gtest.h>

#include "core/reference/reference.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::smooth_stream_test {
namespace {

using test::Draw;

constexpr double kDt = 0.001;
constexpr double kMaxSpeed = 0.5, kCatchUp = 2.0;  // [m/s], [m/s^2]
constexpr double kSpring = 20;                     // [rad/s]

Vector3 place(double t) {
  return {0.1 * std::sin(1.5 * t), 0.1 * std::cos(1.1 * t), 0.03 * std::sin(0.7 * t)};
}
Matrix3 turn(double t) {
  return exp_rotation(Vector3(0.3 * std::sin(0.9 * t), 0.2 * std::cos(t), 0.15 * std::sin(0.6 * t)));
}

// The largest third difference of a curve.
class Jerk {
 public:
  void add(const Vector3& p) {
    p_.push_back(p);
    if (p_.size() < 4) return;
    peak = std::max(peak, (p_[3] - 3 * p_[2] + 3 * p_[1] - p_[0]).norm() / (kDt * kDt * kDt));
    p_.pop_front();
  }
  double peak = 0;

 private:
  std::deque<Vector3> p_;
};

class Hand {
 public:
  explicit Hand(const Vector3& p) : p_(p) {}
  const Vector3& follow(const Vector3& set_point) {
    v_ += kDt * (kSpring * kSpring * (set_point - p_) - 2 * kSpring * v_);
    return p_ += kDt * v_;
  }

 private:
  Vector3 p_, v_ = Vector3::Zero();
};

class Limited {
 public:
  explicit Limited(const Vector3& p) : p_(p) {}
  const Vector3& follow(const Vector3& held) {
    for (int i = 0; i < 3; ++i) {
      const double way = held[i] - p_[i];
      const double fastest = std::min(kMaxSpeed, std::sqrt(2 * kCatchUp * std::abs(way)));
      v_[i] = std::clamp(std::copysign(fastest, way), v_[i] - kCatchUp * kDt, v_[i] + kCatchUp * kDt);
    }
    return p_ += kDt * v_;
  }

 private:
  Vector3 p_, v_ = Vector3::Zero();
};

// When samples arrive, and of what time their values are.
struct Arrival {
  double at, of;
};

// Each sample up to `jitter` periods late; of the time when it was due, or of the time when it is sent. At
// most two in a row are lost.
std::vector<Arrival> arrivals(double period, double jitter, double loss, bool of_due_time, double end,
                              Draw& draw) {
  std::vector<Arrival> all;
  int lost = 0;
  for (double due = 0; due < end; due += period) {
    const double at = due + period * draw.uniform(0, jitter);
    lost = draw.uniform(0, 1) < loss && lost < 2 ? lost + 1 : 0;
    if (lost == 0) all.push_back({at, of_due_time ? due : at});
  }
  return all;
}

// The delay by which a curve fits that of the samples best [s].
double lag_of(const std::vector<Vector3>& curve, std::size_t from,
              const std::function<Vector3(double)>& truth) {
  double best = 0, least = std::numeric_limits<double>::infinity();
  for (int shift = 0; shift < 200; ++shift) {
    double sum = 0;
    for (std::size_t k = from; k < curve.size(); k += 11)
      sum += (curve[k] - truth(kDt * (static_cast<double>(k) - shift))).squaredNorm();
    if (sum < least) {
      least = sum;
      best = kDt * shift;
    }
  }
  return best;
}

struct Case {
  double rate, jitter, loss;
  bool of_due_time;
};

std::vector<Case> cases() {
  std::vector<Case> all;
  for (const double rate : {10.0, 20.0, 50.0, 100.0}) {
    for (const double jitter : {0.0, 0.3}) {
      for (const double loss : {0.0, 0.05}) {
        for (const bool of_due_time : {true, false}) all.push_back({rate, jitter, loss, of_due_time});
      }
    }
  }
  return all;
}

class SmoothStream : public testing::TestWithParam<Quantity> {};

TEST_P(SmoothStream, HasATenthOfTheJerkOfAHoldAndAtMostOneAndAHalfPeriodsOfLag) {
  constexpr double kEnd = 12, kFrom = 2;
  const Quantity quantity = GetParam();
  double worst_limited = 0, worst_hand = 0, worst_lag = 0, worst_jerk = 0;
  for (const Case& c : cases()) {
    Draw draw(11);
    Reference reference({.name = "input", .quantity = quantity, .timeout_s = 0.5}, 3);
    // A joint input moves like the position of a pose, so that both are judged alike.
    const auto sample = [&](double t) {
      Target target = pose_target({turn(t), place(t)}, 0, Delivery::stream);
      if (quantity == Quantity::joints) target.size = 3;
      return target;
    };
    if (quantity == Quantity::pose) reference.start(Pose{turn(0), place(0)});
    if (quantity == Quantity::joints) reference.start(JointVector(place(0)));
    const auto set_point = [&]() -> Vector3 {
      return quantity == Quantity::pose ? reference.pose().position : Vector3(reference.joints());
    };
    const auto sent = arrivals(1 / c.rate, c.jitter, c.loss, c.of_due_time, kEnd, draw);
    Hand hand(place(0)), hand_at_hold(place(0));
    Limited limited(place(0));
    Jerk of_set_point, of_limited, of_hand, of_hand_at_hold, of_turn;
    Vector3 held = place(0);
    std::vector<Vector3> curve;
    std::size_t next = 0;
    for (int k = 0; k < static_cast<int>(kEnd / kDt); ++k) {
      const double t = k * kDt;
      for (; next < sent.size() && sent[next].at <= t; ++next) {
        ASSERT_EQ(reference.post(sample(sent[next].of)), Verdict::accepted);
        held = place(sent[next].of);
      }
      reference.advance(kDt, t);
      curve.push_back(set_point());
      const Vector3 p = hand.follow(curve.back()), at_hold = hand_at_hold.follow(held);
      const Vector3 bounded = limited.follow(held);
      if (t < kFrom) continue;
      ASSERT_FALSE(reference.stale());
      of_set_point.add(curve.back());
      of_hand.add(p);
      of_hand_at_hold.add(at_hold);
      of_limited.add(bounded);
    }
    const double lag = c.rate * lag_of(curve, static_cast<std::size_t>(kFrom / kDt), place);
    const auto name = testing::Message()
                      << to_string(quantity) << " at " << c.rate << " Hz, jitter " << c.jitter << ", loss "
                      << c.loss << (c.of_due_time ? ", of due time" : "");
    EXPECT_LE(of_set_point.peak, 0.1 * of_limited.peak) << name;
    EXPECT_LE(of_hand.peak, 0.1 * of_hand_at_hold.peak) << name;
    EXPECT_LE(lag, 1.5) << name;
    worst_limited = std::max(worst_limited, of_set_point.peak / of_limited.peak);
    worst_hand = std::max(worst_hand, of_hand.peak / of_hand_at_hold.peak);
    worst_lag = std::max(worst_lag, lag);
    worst_jerk = std::max(worst_jerk, of_set_point.peak);
    if (!c.of_due_time) continue;
    std::printf(
        "%-6s %3.0f Hz, jitter %2.0f %%, lost %.0f %%: peak jerk %5.1f /s^3, hold %5.0f; hand %5.1f, at hold "
        "%5.0f; lag %.2f periods\n",
        std::string(to_string(quantity)).c_str(), c.rate, 100 * c.jitter, 100 * c.loss, of_set_point.peak,
        of_limited.peak, of_hand.peak, of_hand_at_hold.peak, lag);
  }
  std::printf("%s, worst of all: %.3f of the limited hold, hand %.3f of the hold, lag %.2f periods\n",
              std::string(to_string(quantity)).c_str(), worst_limited, worst_hand, worst_lag);
}

INSTANTIATE_TEST_SUITE_P(Quantities, SmoothStream, testing::Values(Quantity::pose, Quantity::joints),
                         [](const auto& each) { return std::string(to_string(each.param)); });

// Wrenches, twists and scalars move no set-point, so nothing but their rate is bounded: no jump, no overshoot
// worth mentioning, and the same lag.
TEST(SmoothStreamOfOthers, FollowsWithoutJumps) {
  for (const Quantity quantity : {Quantity::wrench, Quantity::twist, Quantity::scalar}) {
    for (const Case& c : cases()) {
      Draw draw(12);
      Reference reference({.name = "input", .quantity = quantity, .timeout_s = 0.5, .max_speed = 50}, 3);
      reference.start_constant(0);
      const auto truth = [](double t) { return Vector3(5 * std::sin(1.5 * t), 0, 0); };
      const auto sent = arrivals(1 / c.rate, c.jitter, c.loss, c.of_due_time, 10, draw);
      std::vector<Vector3> curve;
      std::size_t next = 0;
      double step = 0, largest = 0;
      for (int k = 0; k < 10000; ++k) {
        const double t = k * kDt;
        for (; next < sent.size() && sent[next].at <= t; ++next) {
          Target target;
          target.delivery = Delivery::stream;
          target.size = static_cast<std::uint8_t>(reference.size());
          target.values[0] = truth(sent[next].of).x();
          ASSERT_EQ(reference.post(target), Verdict::accepted);
        }
        reference.advance(kDt, t);
        curve.emplace_back(reference.scalar(), 0, 0);
        if (k > 0) step = std::max(step, (curve[curve.size() - 1] - curve[curve.size() - 2]).norm());
        largest = std::max(largest, std::abs(reference.scalar()));
      }
      EXPECT_LE(c.rate * lag_of(curve, 2000, truth), 1.5);
      EXPECT_LE(step, 50 * 1.1 * kDt);  // its speed limit
      EXPECT_LE(largest, 5 * 1.15);
    }
  }
}

// A series that itself accelerates by more than uneven streams are caught up with is followed all the same,
// one period late: below a hundredth of its way beside it.
TEST(SmoothStream, ASeriesThatAcceleratesStronglyIsFollowed) {
  constexpr double kAcceleration = 1.1 * kCatchUp;
  for (const int period : {10, 20}) {  // [ms]
    for (const double omega : {6.0, 8.0}) {
      const auto series = [&](double t) { return kAcceleration / (omega * omega) * std::sin(omega * t); };
      Reference reference({.name = "pose", .quantity = Quantity::pose}, 7);
      reference.start(Pose{});
      double worst = 0;
      for (int k = 0; k < 8000; ++k) {
        if (k % period == 0) {
          Pose X;
          X.position.x() = series(k * kDt);
          ASSERT_EQ(reference.post(pose_target(X, 0, Delivery::stream)), Verdict::accepted);
        }
        reference.advance(kDt, k * kDt);
        if (k > 2000)
          worst = std::max(worst, std::abs(reference.pose().position.x() - series((k + 1 - period) * kDt)));
      }
      EXPECT_LT(worst, 0.02 * kAcceleration / (omega * omega)) << period << " ms, " << omega << " rad/s";
    }
  }
}

// A speed limit that falls while the series itself slows down below it: the set-point slows down along the
// series, more gently than towards a goal (4 m/s^2).
TEST(SmoothStream, ALimitThatFallsWithTheSeriesBrakesGently) {
  for (const int period : {1, 4, 10, 20, 50}) {  // [ms]
    Reference reference({.name = "pose", .quantity = Quantity::pose, .timeout_s = 0.5}, 7);
    reference.start(Pose{});
    double x = 0, hardest = 0;
    for (int k = 0; k < 4000; ++k) {
      x += kDt * (k < 1000 ? 0.4 * k * kDt : k < 2000 ? 0.4 : 0.2);
      if (k == 2000) reference.limit_speed(0.25);
      if (k % period == 0) {
        Pose X;
        X.position.x() = x;
        ASSERT_EQ(reference.post(pose_target(X, 0, Delivery::stream)), Verdict::accepted);
      }
      reference.advance(kDt, k * kDt);
      hardest = std::max(hardest, reference.acceleration().linear().norm());
    }
    EXPECT_LT(hardest, 3) << period << " ms";
    EXPECT_NEAR(reference.twist().linear().x(), 0.2, 1e-3) << period << " ms";
  }
}

// What smoothing must not cost: a step of the series is not overshot, and a ramp that ends by less than the
// way of a tenth of a second.
TEST(SmoothStream, JumpsAndStopsOfTheSeriesAreNotContinued) {
  for (const double rate : {10.0, 20.0, 50.0, 100.0}) {
    for (const bool ramp : {false, true}) {
      Reference reference({.name = "pose", .quantity = Quantity::pose, .timeout_s = 0.5}, 7);
      reference.start(Pose{});
      const auto series = [&](double t) { return ramp ? 0.2 * std::min(t, 2.0) : t < 2 ? 0.0 : 0.01; };
      double beyond = 0, next = 0;
      for (int k = 0; k < 6000; ++k) {
        const double t = k * kDt;
        if (t + 1e-9 >= next) {
          next += 1 / rate;
          Pose X;
          X.position.x() = series(t);
          ASSERT_EQ(reference.post(pose_target(X, 0, Delivery::stream)), Verdict::accepted);
        }
        reference.advance(kDt, t);
        beyond = std::max(beyond, reference.pose().position.x() - series(6));
      }
      EXPECT_LT(beyond, ramp ? 0.1 * 0.2 : 0.001) << rate << " Hz";
      EXPECT_NEAR(reference.pose().position.x(), series(6), 1e-4);
    }
  }
}

}  // namespace
}  // namespace multipanda::smooth_stream_test
