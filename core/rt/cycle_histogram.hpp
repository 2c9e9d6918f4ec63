#pragma once

#include <array>
#include <cstdint>

namespace multipanda {

// Durations of any number of cycles in constant memory [ns]: 128 steps per octave, so that percentiles are
// accurate to 1 %; the largest duration is exact.
class CycleHistogram {
 public:
  void add(std::int64_t ns);

  std::uint64_t count() const { return count_; }
  std::int64_t max() const { return max_; }
  // Smallest duration that a `share` (0 to 1) of all cycles does not exceed (nearest rank), rounded up to the
  // end of its step. 0 without cycles.
  std::int64_t percentile(double share) const;

 private:
  static constexpr int kStepBits = 7, kOctaves = 26;  // up to 2^33 ns, 8 s; longer ones count as that
  static constexpr std::size_t kSteps = std::size_t{1} << kStepBits;
  static std::size_t bucket(std::uint64_t ns);
  static std::int64_t upper_end(std::size_t bucket);

  std::array<std::uint64_t, kSteps*(kOctaves + 1)> counts_{};
  std::uint64_t count_ = 0;
  std::int64_t max_ = 0;
};

}  // namespace multipanda
