#include "runtime/embedded/sample_track.hpp"

#include <algorithm>
#include <cmath>

#include "core/types/time.hpp"

namespace multipanda {
namespace {

// A command closer than this to the previous one replaces it, unless that leaves a wide gap.
constexpr double kNearStamps = 2e-4, kWideGap = 3e-3;  // [s]
constexpr double kClockGain = 2e-3;  // per period: the playback follows the program's clock within 0.5 s
constexpr double kLargestDrift = 1e-3;
constexpr double kLostClock = 0.05;  // the clocks' relation is determined again [s]
constexpr double kShortestInterval = 5e-4, kLongestInterval = 0.02;  // [s] of the program's period

}  // namespace

void SampleTrack::clear() {
  count_ = 0;
  fresh_ = false;
}

void SampleTrack::push(std::int64_t stamp_ns, std::span<const double> values) {
  if (count_ > 0 && stamp_ns < origin_ns_ + static_cast<std::int64_t>(newest().t * 1e9) - 1000) clear();
  if (count_ == 0) {
    origin_ns_ = stamp_ns;
    play_ = -delay();
  }
  const double t = seconds(std::chrono::nanoseconds(stamp_ns - origin_ns_));
  const std::size_t size = std::min(values.size(), kValues);
  if (count_ > 0 && t - newest().t < kNearStamps && (count_ == 1 || t - back(1).t < kWideGap)) {
    if (count_ > 1) newest().t = t;
    std::copy_n(values.begin(), size, newest().values.begin());
    fresh_ = true;
    return;
  }
  if (count_ > 0)
    interval_ += 0.01 * (std::clamp(t - newest().t, kShortestInterval, kLongestInterval) - interval_);
  Sample& sample = samples_[next_];
  sample.t = t;
  std::copy_n(values.begin(), size, sample.values.begin());
  next_ = (next_ + 1) % kSamples;
  count_ = std::min(count_ + 1, kSamples);
  fresh_ = true;
}

void SampleTrack::advance() {
  if (count_ == 0) return;
  play_ += kArmPeriod * (1 + rate_);
  if (!fresh_) return;
  fresh_ = false;
  const double error = back(0).t - delay() - play_;
  if (std::abs(error) > kLostClock) {
    play_ += error;
    return;
  }
  play_ += kClockGain * error;
  rate_ = std::clamp(rate_ + kClockGain * kClockGain / 4 * error / kArmPeriod, -kLargestDrift, kLargestDrift);
}

SampleTrack::Place SampleTrack::place() const {
  std::size_t age = 0;
  while (age + 1 < count_ && back(age).t > play_) ++age;
  const Sample& before = back(age);
  if (before.t > play_ || (age == 0 && count_ == 1)) {
    return {&before, &before, 1, 0, std::max(0.0, play_ - before.t)};
  }
  if (age == 0) {
    const Sample& earlier = back(1);
    return {&earlier, &before, 1, before.t - earlier.t, play_ - before.t};
  }
  const Sample& after = back(age - 1);
  const double gap = after.t - before.t;
  return {&before, &after, (play_ - before.t) / gap, gap, 0};
}

double kept_velocity(double beyond) { return std::clamp(1 - (beyond - kKeptMotion) / kSlowing, 0.0, 1.0); }

double kept_distance(double beyond) {
  const double full = std::min(beyond, kKeptMotion);
  const double slowing = std::clamp(beyond - kKeptMotion, 0.0, kSlowing);
  return full + slowing * (1 - slowing / (2 * kSlowing));
}

}  // namespace multipanda
