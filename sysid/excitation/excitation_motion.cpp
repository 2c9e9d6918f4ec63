#include "sysid/excitation/excitation_motion.hpp"

namespace multipanda {

ExcitationMotion::Sample ExcitationMotion::at(double t) const {
  QuinticSegment::Sample sums;
  const auto n = q_start.size();
  for (Eigen::Index i = 0; i < n; ++i) sums.position[static_cast<std::size_t>(i)] = q_start[i];
  series.add(t, static_cast<std::size_t>(n), sums);
  Sample sample{JointVector(n), JointVector(n), JointVector(n)};
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    sample.q[i] = sums.position[k];
    sample.dq[i] = sums.velocity[k];
    sample.ddq[i] = sums.acceleration[k];
  }
  return sample;
}

Eigen::VectorXd coefficients_of(const ExcitationMotion& motion) {
  const auto n = motion.q_start.size();
  Eigen::VectorXd x(n * static_cast<Eigen::Index>(1 + 2 * motion.parts()));
  x.head(n) = motion.q_start;
  Eigen::Index at = n;
  const auto write = [&](const auto& values) {
    for (Eigen::Index i = 0; i < n; ++i) x[at++] = values[static_cast<std::size_t>(i)];
  };
  write(motion.series.sine);
  write(motion.series.rise);
  for (std::size_t k = 0; k < motion.series.harmonic_count; ++k) {
    write(motion.series.harmonics[k].sine);
    write(motion.series.harmonics[k].rise);
  }
  return x;
}

ExcitationMotion with_coefficients(const ExcitationMotion& shape, const Eigen::VectorXd& x) {
  ExcitationMotion motion = shape;
  const auto n = shape.q_start.size();
  motion.q_start = x.head(n);
  Eigen::Index at = n;
  const auto read = [&](auto& values) {
    for (Eigen::Index i = 0; i < n; ++i) values[static_cast<std::size_t>(i)] = x[at++];
  };
  read(motion.series.sine);
  read(motion.series.rise);
  for (std::size_t k = 0; k < motion.series.harmonic_count; ++k) {
    read(motion.series.harmonics[k].sine);
    read(motion.series.harmonics[k].rise);
  }
  return motion;
}

}  // namespace multipanda
