#pragma once

#include "core/reference/target.hpp"
#include "core/trajectory/quintic.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// Position and motion of a slow stream of poses or joints, estimated from its samples. Samples that arrive
// unevenly look like a series that shakes, so the estimate has a memory: a fading-memory filter of second
// degree (Morrison, "Introduction to Sequential Smoothing and Prediction", 1969). It forgets all but the last
// three samples while such three predict the next one, and remembers longer the worse they do. A sample
// counts at the time of its arrival. Lost samples need no special care: they are gaps in time.
class Series {
 public:
  using Values = QuinticSegment::Values;

  // A new series begins at a sample, at rest. `greatest_*`: speeds by which errors of prediction are judged,
  // [m/s] and [rad/s]; for joints the first [rad/s].
  void begin(const Target& sample, bool pose, double greatest_speed, double greatest_angular_speed);
  // The next sample, dt > 0 later; `period_s` of the stream. Samples with times of their own are not uneven.
  void add(const Target& sample, double dt, double period_s, bool timed = false);
  // The estimate `ahead` seconds after the newest sample. A pose's rotation is given about R_0.
  QuinticSegment::Sample at(double ahead, const Matrix3& R_0) const;
  // How unevenly the samples arrive, as a time [s].
  double unevenness() const { return unevenness_; }

 private:
  struct Filter {
    QuinticSegment::Sample now;  // at the newest sample; a pose's rotation is about R
    Matrix3 R = Matrix3::Identity();
  };

  double share(const Values& v) const;  // of the greatest speeds
  Values error(const Filter& filter, const Target& sample) const;
  void move(Filter& filter, const Values& by) const;
  Values predict(Filter& filter, double dt) const;  // returns the distance
  void correct(Filter& filter, const Values& error, double past, double dt) const;

  bool pose_ = false;
  std::size_t size_ = 0;  // coordinates
  double greatest_ = 1, greatest_angular_ = 1;
  Filter smooth_, last_three_;    // with and without memory
  Values mean_{};                 // velocity between the last two samples
  double error_ = 0, speed_ = 0;  // filtered shares
  double unevenness_ = 0;
};

}  // namespace multipanda
