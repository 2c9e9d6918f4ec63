#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "core/types/capacity.hpp"

namespace multipanda {

// Motion of `size` coordinates over [0, T]: a polynomial of degree five per coordinate that starts at a given
// position, velocity and acceleration and ends in the goal with a given velocity (0 unless said) and no
// acceleration. Between two rests it is the minimum-jerk motion. After T it stays at the goal. Evaluation is
// closed form; nothing allocates.
class QuinticSegment {
 public:
  using Values = std::array<double, kMaxTargetValues>;
  struct Sample {
    Values position{}, velocity{}, acceleration{};
  };

  // duration <= 0: at the goal at once.
  void plan(std::size_t size, const Sample& start, const Values& goal, double duration_s,
            const Values& end_velocity = {});
  void evaluate(double t, Sample& out) const;
  double duration() const { return duration_; }
  std::size_t size() const { return size_; }

  // The duration that keeps a rest-to-rest motion over `distance` below `max_speed`: peak speed is 15/8 of
  // the mean.
  static double duration_for(double distance, double max_speed) { return 1.875 * distance / max_speed; }
  // The same for its acceleration, whose peak is 10 / sqrt(3) distance / duration^2.
  static double duration_within(double distance, double max_acceleration) {
    return std::sqrt(10 / std::numbers::sqrt3 * distance / max_acceleration);
  }

 private:
  std::size_t size_ = 0;
  double duration_ = 0;
  Values goal_{};
  std::array<std::array<double, 6>, kMaxTargetValues> coefficients_{};
};

}  // namespace multipanda
