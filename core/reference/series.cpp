#include <algorithm>
#include <cmath>

#include "core/reference/reference.hpp"

namespace multipanda {
namespace {

constexpr double kShareFilter = 0.1;  // weight of a new sample in the filtered errors and speeds
// A share of the greatest speeds: slower series are judged as if at this speed.
constexpr double kSlowestShare = 0.02;
constexpr double kShortestStep = 0.5;  // in periods; samples closer together contain little information on
                                       // velocity
// The error of three samples' prediction for errors of 1 in each: (1 + 9 + 9 + 1)^1/2.
constexpr double kThreeSamples = 4.47;
constexpr double kLongestMemory = 0.15;  // time constant of the longest memory [s]
constexpr double kHalfMemory = 0.02;     // unevenness, in periods, at which half of it is used
// An error of prediction, in periods, that no unevenness explains: the series turns. Its new velocity is then
// the smaller of the last two, so that a jump does not count as velocity.
constexpr double kTurn = 0.8;

Matrix3 rotation_of(const Target& sample) { return Pose::from(sample.values.data()).rotation; }

Vector3 turn_of(const QuinticSegment::Values& v) { return {v[3], v[4], v[5]}; }

}  // namespace

void Series::begin(const Target& sample, bool pose, double greatest_speed, double greatest_angular_speed) {
  pose_ = pose;
  size_ = pose ? 6 : sample.size;
  greatest_ = greatest_speed;
  greatest_angular_ = greatest_angular_speed;
  smooth_ = {};
  std::copy_n(sample.values.begin(), pose ? 3 : size_, smooth_.now.position.begin());
  if (pose) smooth_.R = rotation_of(sample);
  last_three_ = smooth_;
  mean_ = {};
  error_ = speed_ = unevenness_ = 0;
}

double Series::share(const Values& v) const {
  if (pose_) return Vector3(v[0], v[1], v[2]).norm() / greatest_ + turn_of(v).norm() / greatest_angular_;
  double largest = 0;
  for (std::size_t i = 0; i < size_; ++i) largest = std::max(largest, std::abs(v[i]));
  return largest / greatest_;
}

// From the estimate to a sample.
Series::Values Series::error(const Filter& filter, const Target& sample) const {
  Values e{};
  const std::size_t plain = pose_ ? 3 : size_;
  for (std::size_t i = 0; i < plain; ++i) e[i] = sample.values[i] - filter.now.position[i];
  if (!pose_) return e;
  const Vector3 r = log_rotation(rotation_of(sample) * filter.R.transpose());
  for (std::size_t i = 0; i < 3; ++i) e[3 + i] = r[static_cast<Eigen::Index>(i)];
  return e;
}

void Series::move(Filter& filter, const Values& by) const {
  const std::size_t plain = pose_ ? 3 : size_;
  for (std::size_t i = 0; i < plain; ++i) filter.now.position[i] += by[i];
  if (pose_) filter.R = Quaternion(exp_rotation(turn_of(by)) * filter.R).normalized().toRotationMatrix();
}

Series::Values Series::predict(Filter& filter, double dt) const {
  Values way{};
  auto& [position, velocity, acceleration] = filter.now;
  for (std::size_t i = 0; i < size_; ++i) {
    way[i] = dt * (velocity[i] + 0.5 * dt * acceleration[i]);
    velocity[i] += dt * acceleration[i];
  }
  move(filter, way);
  return way;
}

// `past`: weight of the memory; without it, the parabola through the last three samples.
void Series::correct(Filter& filter, const Values& error, double past, double dt) const {
  const double fresh = 1 - past;
  Values correction{};
  for (std::size_t i = 0; i < size_; ++i) {
    correction[i] = (1 - past * past * past) * error[i];
    filter.now.velocity[i] += 1.5 * fresh * fresh * (1 + past) * error[i] / dt;
    filter.now.acceleration[i] += fresh * fresh * fresh * error[i] / (dt * dt);
  }
  move(filter, correction);
}

void Series::add(const Target& sample, double dt, double period_s, bool timed) {
  const double h = std::max(dt, kShortestStep * period_s);
  const Values way = predict(last_three_, dt);
  const Values unforeseen = error(last_three_, sample);
  Values mean{};
  for (std::size_t i = 0; i < size_; ++i) mean[i] = (way[i] + unforeseen[i]) / h;
  correct(last_three_, unforeseen, 0, h);

  predict(smooth_, dt);
  const Values e = error(smooth_, sample);
  speed_ += kShareFilter * (share(mean) - speed_);
  const double speed = std::max(speed_, kSlowestShare);
  const double wrong = timed ? 0 : share(unforeseen) / kThreeSamples;
  if (share(e) > kTurn * period_s * std::max(speed, share(mean))) {
    for (std::size_t i = 0; i < size_; ++i) {
      const bool goes_on = mean[i] * mean_[i] > 0;
      smooth_.now.velocity[i] = !goes_on ? 0 : std::abs(mean[i]) < std::abs(mean_[i]) ? mean[i] : mean_[i];
    }
    smooth_.now.acceleration = {};
    move(smooth_, e);
    last_three_ = smooth_;
  } else {
    error_ += kShareFilter * (wrong - error_);
    const double uneven = std::max(wrong, error_) / speed / period_s;
    const double memory = std::exp(-period_s / kLongestMemory) * uneven / (uneven + kHalfMemory);
    correct(smooth_, e, std::pow(memory, h / period_s), h);
  }
  mean_ = mean;
  unevenness_ = error_ / speed;
}

QuinticSegment::Sample Series::at(double ahead, const Matrix3& R_0) const {
  const QuinticSegment::Sample& now = smooth_.now;
  QuinticSegment::Sample s = now;
  for (std::size_t i = 0; i < size_; ++i) {
    s.position[i] += ahead * (now.velocity[i] + 0.5 * ahead * now.acceleration[i]);
    s.velocity[i] += ahead * now.acceleration[i];
  }
  if (!pose_) return s;
  const Vector3 r = log_rotation(exp_rotation(turn_of(s.position)) * smooth_.R * R_0.transpose());
  const Vector3 omega = turn_of(s.velocity);
  const Vector3 dr = omega - 0.5 * r.cross(omega);  // inverse left Jacobian, r small within a horizon
  for (std::size_t i = 0; i < 3; ++i) {
    s.position[3 + i] = r[static_cast<Eigen::Index>(i)];
    s.velocity[3 + i] = dr[static_cast<Eigen::Index>(i)];
  }
  return s;
}

}  // namespace multipanda
