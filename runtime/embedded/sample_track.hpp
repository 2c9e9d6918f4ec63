#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace multipanda {

// Commands of a program with a clock of its own, resampled once per period of the arm. The program stamps
// each command with its clock. The track plays them back on the arm's clock after a delay, and interpolates:
// only the stamps matter, not the times of writing. The clocks may drift apart.
//
// The delay is two of the program's periods and 1 ms, 3 ms at 1 kHz: commands up to about 1 ms late are still
// in time. One thread; nothing allocates.
class SampleTrack {
 public:
  static constexpr std::size_t kValues = 16;
  struct Sample {
    double t = 0;  // the program's time since the first stamp [s]
    std::array<double, kValues> values{};
  };

  // Clears the commands but keeps the clocks' relation.
  void clear();
  bool empty() const { return count_ == 0; }
  // The program's newest command. A decreasing stamp starts a new track.
  void push(std::int64_t stamp_ns, std::span<const double> values);
  // The arm's next period begins.
  void advance();

  // Position of the playback: at the fraction `share` between two commands that are `gap` apart (0: only
  // one), or beyond the newest one.
  struct Place {
    const Sample* from = nullptr;
    const Sample* to = nullptr;
    double share = 1, gap = 0, beyond = 0;  // [1, s, s]
  };
  Place place() const;  // not when empty

  double delay() const { return 2 * interval_ + 0.001; }  // [s]
  double drift() const { return rate_; }                  // of the program's clock relative to the arm's

 private:
  static constexpr std::size_t kSamples = 64;
  const Sample& back(std::size_t age) const { return samples_[(next_ + kSamples - 1 - age) % kSamples]; }
  Sample& newest() { return samples_[(next_ + kSamples - 1) % kSamples]; }

  std::array<Sample, kSamples> samples_{};
  std::size_t next_ = 0, count_ = 0;
  std::int64_t origin_ns_ = 0;
  bool fresh_ = false;
  double play_ = 0;         // [s], the program's time
  double rate_ = 0;         // drift
  double interval_ = 1e-3;  // the program's period [s]
};

// Continuation of a motion without new commands, `beyond` the newest one [s]: at its velocity for
// kKeptMotion, then slower until it rests. Returns the fraction of the velocity, and the distance per
// velocity [s].
inline constexpr double kKeptMotion = 0.02, kSlowing = 0.1;  // [s]
double kept_velocity(double beyond);
double kept_distance(double beyond);

}  // namespace multipanda
