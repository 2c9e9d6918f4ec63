// Chunks of samples that are not due yet: when they count, what replaces them, what ends them.
#include <cmath>

#include <gtest/gtest.h>

#include "core/reference/reference.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::chunk_test {
namespace {

constexpr double kDt = 0.001;

double series(double t) { return 0.1 * std::sin(1.5 * t) + 0.05 * t; }

class ChunkTest : public testing::Test {
 protected:
  ChunkTest() { reference_.start(JointVector::Constant(2, series(0))); }

  static Chunk chunk(double first_s, double gap_s, std::size_t count, double offset = 0) {
    Chunk made;
    made.size = 2;
    made.count = static_cast<std::uint8_t>(count);
    for (std::size_t k = 0; k < count; ++k) {
      made.times_s[k] = first_s + gap_s * static_cast<double>(k);
      made.values[k] = {series(made.times_s[k]) + offset, series(made.times_s[k]) + offset};
    }
    return made;
  }
  std::uint64_t post(const Chunk& made, Verdict expected = Verdict::accepted) {
    std::uint64_t id = 0;
    EXPECT_EQ(reference_.post(made, id), expected);
    return id;
  }
  void until(double t) {
    for (; t_ < t - kDt / 2; t_ += kDt) reference_.advance(kDt, t_);
  }
  double now() const { return reference_.joints()[0]; }

  Reference reference_{{.name = "joints", .quantity = Quantity::joints, .timeout_s = 0.3}, 2};
  double t_ = 0;
};

// Ten actions at 20 Hz, of which every half second the next ten are sent: in time and smooth.
TEST_F(ChunkTest, TheSetPointIsThereInTime) {
  double worst = 0, jerk = 0, before = 0;
  for (double begin = 0; begin < 8; begin += 0.25) {
    post(chunk(begin + 0.05, 0.05, 10));
    for (const double end = begin + 0.25; t_ < end - kDt / 2;) {
      until(t_ + kDt);
      if (t_ < 1.5) continue;
      EXPECT_TRUE(reference_.streaming());
      worst = std::max(worst, std::abs(now() - series(t_ - kDt)));
      const double a = reference_.joint_acceleration()[0];
      if (t_ > 1.6) jerk = std::max(jerk, std::abs(a - before) / kDt);
      before = a;
    }
  }
  EXPECT_LT(worst, 5e-4);  // of 0.2 m/s: 2.5 ms
  EXPECT_LT(jerk, 20);
  EXPECT_EQ(reference_.late(), 0u);
}

TEST_F(ChunkTest, ANewerOneReplacesWhatIsNotDue) {
  post(chunk(0.05, 0.05, 40));
  until(1);
  post(chunk(1.02, 0.05, 40, 0.05));
  until(1.9);
  EXPECT_NEAR(now(), series(1.9) + 0.05, 2e-3);
}

// A sender that ends its chunks and sends each sample one period ahead of its time: the series goes on.
TEST_F(ChunkTest, SamplesThatFollowItContinueItsSeries) {
  post(chunk(0.05, 0.05, 40));
  until(1.95);  // the last is due at 2.0, and taken
  double worst = 0, fastest = 0;
  for (int k = 0; k < 20; ++k) {
    Target next;
    next.size = 2;
    next.delivery = Delivery::stream;
    next.values = {series(t_ + 0.05), series(t_ + 0.05)};
    until(t_ + kDt);
    EXPECT_EQ(reference_.post(next), Verdict::accepted);
    for (int i = 1; i < 50; ++i) {
      until(t_ + kDt);
      worst = std::max(worst, std::abs(now() - series(t_ - kDt)));
      fastest = std::max(fastest, std::abs(reference_.joint_acceleration()[0]));
    }
  }
  EXPECT_LT(worst, 1e-3);
  EXPECT_LT(fastest, 1.0);
}

// Samples of chunks have exact times; what follows them is judged by its arrival again.
TEST_F(ChunkTest, UnevenSamplesThatFollowItAreSmoothedAsWithoutIt) {
  Reference plain({.name = "joints", .quantity = Quantity::joints, .timeout_s = 0.3}, 2);
  plain.start(JointVector::Constant(2, series(0)));
  post(chunk(0.05, 0.05, 20));
  test::Draw draw(7);
  double next = 1.02, apart = 0;
  for (int k = 0; k < 10000; ++k) {
    if (t_ >= next) {
      Target sample;
      sample.size = 2;
      sample.delivery = Delivery::stream;
      sample.values = {series(next), series(next)};
      EXPECT_EQ(reference_.post(sample), Verdict::accepted);
      EXPECT_EQ(plain.post(sample), Verdict::accepted);
      next += 0.05 + draw.uniform(-0.015, 0.015);
      next = std::max(next, t_ + 0.01);
    }
    plain.advance(kDt, t_);
    until(t_ + kDt);
    if (k > 8000) apart = std::max(apart, std::abs(plain.joints()[0] - now()));
  }
  EXPECT_LT(apart, 1e-5);
}

TEST_F(ChunkTest, LateSamplesAreCountedAndNotUsed) {
  until(1);
  post(chunk(0.7, 0.05, 7));  // all late: 0.7 to 1.0
  until(1.2);
  EXPECT_EQ(reference_.late(), 7u);
  EXPECT_FALSE(reference_.streaming());
  EXPECT_EQ(now(), series(0));
  post(chunk(1.105, 0.05, 20));  // 1.105 and 1.155 are late
  until(2);
  EXPECT_EQ(reference_.late(), 9u);
  EXPECT_NEAR(now(), series(2), 2e-3);
}

TEST_F(ChunkTest, SilenceBeginsAfterItsLastSample) {
  post(chunk(0.05, 0.05, 20));  // the last is due at 1.0, and taken a gap before
  until(1.24);
  EXPECT_FALSE(reference_.stale());
  until(1.27);
  EXPECT_TRUE(reference_.stale());
}

TEST_F(ChunkTest, IsEndedByAGoalASampleAStartAndItsSender) {
  for (const int way : {0, 1, 2, 3, 4}) {
    reference_.start(JointVector::Constant(2, series(0)));
    t_ = 0;
    const std::uint64_t id = post(chunk(0.05, 0.05, 40));
    until(0.5);
    Target there;
    there.size = 2;
    there.values = {0.01, 0.01};
    if (way == 1) there.delivery = Delivery::stream;
    if (way < 2) {
      EXPECT_EQ(reference_.post(there), Verdict::accepted);
    }
    if (way == 2) reference_.set(there);
    if (way == 3) reference_.start(JointVector::Constant(2, 0.01));
    if (way == 4) reference_.discard(id);
    until(2.2);
    if (way == 4) {
      EXPECT_TRUE(reference_.stale());
      EXPECT_LT(now(), series(0.7));
    } else {
      EXPECT_NEAR(now(), 0.01, way == 1 ? 1e-3 : 1e-9) << way;
    }
    EXPECT_EQ(reference_.joint_velocity()[0], 0) << way;
  }
}

TEST_F(ChunkTest, ASenderEndsOnlyItsOwn) {
  const std::uint64_t mine = post(chunk(0.05, 0.05, 20));
  post(chunk(0.05, 0.05, 40));
  reference_.discard(mine);
  until(1.9);
  EXPECT_FALSE(reference_.stale());
  EXPECT_NEAR(now(), series(1.9), 2e-3);
}

TEST_F(ChunkTest, RedefiningTheFrameEndsIt) {
  Reference reference({.name = "pose", .quantity = Quantity::pose}, 7);
  reference.start(Pose{});
  Chunk made;
  made.size = 7;
  made.count = 40;
  for (std::size_t k = 0; k < 40; ++k) {
    made.times_s[k] = 0.05 * static_cast<double>(k + 1);
    made.values[k] =
        pose_target(Pose{Matrix3::Identity(), Vector3(0.005 * static_cast<double>(k), 0, 0)}).values;
  }
  std::uint64_t id = 0;
  ASSERT_EQ(reference.post(made, id), Verdict::accepted);
  for (int k = 0; k < 500; ++k) reference.advance(kDt, k * kDt);
  reference.carry(Pose{Matrix3::Identity(), Vector3(0, 0, 0.1)});
  for (int k = 500; k < 2000; ++k) reference.advance(kDt, k * kDt);
  EXPECT_NEAR(reference.pose().position.z(), 0.1, 1e-12);
  EXPECT_LT(reference.pose().position.x(), 0.06);
}

TEST_F(ChunkTest, IsCheckedBeforeAnythingMoves) {
  Chunk made = chunk(0.1, 0.05, 10);
  made.times_s[5] = made.times_s[4];
  post(made, Verdict::out_of_bounds);
  post(chunk(0.1, 0.31, 10), Verdict::out_of_bounds);  // it would be stale in between
  made = chunk(0.1, 0.05, 10);
  made.times_s[9] = std::nan("");
  post(made, Verdict::not_finite);
  made = chunk(0.1, 0.05, 10);
  made.values[9][1] = std::nan("");
  post(made, Verdict::not_finite);
  made = chunk(0.1, 0.05, 10);
  made.size = 3;
  post(made, Verdict::wrong_size);
  made.size = 2;
  made.count = 65;
  post(made, Verdict::wrong_size);
  made.count = 0;
  post(made, Verdict::wrong_size);
  until(1);
  EXPECT_EQ(now(), series(0));
}

}  // namespace
}  // namespace multipanda::chunk_test
