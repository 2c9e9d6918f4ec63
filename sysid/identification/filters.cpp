#include "sysid/identification/filters.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace multipanda {

LowPass::LowPass(int order, double cutoff_hz, double rate_hz) {
  if (order < 2 || order % 2 != 0 || !(cutoff_hz > 0 && cutoff_hz < rate_hz / 2)) {
    throw std::invalid_argument("low pass: expected an even order and a cut-off below half the rate");
  }
  const double k = std::tan(std::numbers::pi * cutoff_hz / rate_hz);  // cut-off, prewarped
  for (int pair = 0; pair < order / 2; ++pair) {
    const double damping = 2 * std::sin((2 * pair + 1) * std::numbers::pi / (2 * order));  // 1/Q of the poles
    const double norm = 1 / (1 + damping * k + k * k);
    const double b = k * k * norm;
    sections_.push_back({b, 2 * b, b, 2 * (k * k - 1) * norm, (1 - damping * k + k * k) * norm});
  }
}

// Direct form II transposed; every section passes a constant unchanged.
void LowPass::run(double* values, Eigen::Index count) const {
  const double first = values[0];
  for (const Section& s : sections_) {
    double z1 = (1 - s.b0) * first, z2 = (s.b2 - s.a2) * first;
    for (Eigen::Index i = 0; i < count; ++i) {
      const double x = values[i], y = s.b0 * x + z1;
      z1 = s.b1 * x - s.a1 * y + z2;
      z2 = s.b2 * x - s.a2 * y;
      values[i] = y;
    }
  }
}

Eigen::MatrixXd LowPass::zero_phase(const Eigen::MatrixXd& signals) const {
  const Eigen::Index count = signals.rows();
  Eigen::MatrixXd out(count, signals.cols());
  if (count == 0) return out;
  const Eigen::Index length = 2 * static_cast<Eigen::Index>(sections_.size()) + 1;
  const Eigen::Index edge = std::min(3 * length, count - 1);
  Eigen::VectorXd x(count + 2 * edge);
  for (Eigen::Index c = 0; c < signals.cols(); ++c) {
    const auto signal = signals.col(c);
    x.segment(edge, count) = signal;
    for (Eigen::Index i = 1; i <= edge; ++i) {
      x[edge - i] = 2 * signal[0] - signal[i];
      x[edge + count - 1 + i] = 2 * signal[count - 1] - signal[count - 1 - i];
    }
    for (int way = 0; way < 2; ++way) {
      run(x.data(), x.size());
      x.reverseInPlace();
    }
    out.col(c) = x.segment(edge, count);
  }
  return out;
}

}  // namespace multipanda
