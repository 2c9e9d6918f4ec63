#pragma once

#include <cmath>
#include <fstream>
#include <random>

#include "sysid/measured/measured_log.hpp"

// Synthetic logs for tests: every number follows from a formula.
namespace multipanda {

// Joints swing as q_j = 0.3 sin(w_j t), w_j = 1 + 0.3 j rad/s; torques are 5 cos(w_j t) + j.
inline MeasuredLog swinging_log(double duration_s = 3.0, Eigen::Index joints = 7, double step_s = 0.001) {
  MeasuredLog log;
  log.source = "swing";
  const auto N = static_cast<Eigen::Index>(std::lround(duration_s / step_s)) + 1;
  log.t = Eigen::VectorXd::LinSpaced(N, 0.0, duration_s);
  log.q.resize(N, joints), log.dq.resize(N, joints), log.tau.resize(N, joints);
  for (Eigen::Index j = 0; j < joints; ++j) {
    const double w = 1 + 0.3 * static_cast<double>(j);
    log.q.col(j) = 0.3 * (w * log.t.array()).sin();
    log.dq.col(j) = 0.3 * w * (w * log.t.array()).cos();
    log.tau.col(j) = 5 * (w * log.t.array()).cos() + static_cast<double>(j);
  }
  return log;
}

inline void write_plain_csv(const MeasuredLog& log, const std::filesystem::path& path) {
  std::ofstream file(path);
  file.precision(17);
  file << "t";
  for (const char* family : {"q", "dq", "tau"})
    for (Eigen::Index j = 1; j <= log.joints(); ++j) file << ',' << family << j;
  for (Eigen::Index k = 0; k < log.samples(); ++k) {
    file << '\n' << log.t[k];
    for (const Eigen::MatrixXd* values : {&log.q, &log.dq, &log.tau})
      for (Eigen::Index j = 0; j < log.joints(); ++j) file << ',' << (*values)(k, j);
  }
  file << '\n';
}

}  // namespace multipanda
