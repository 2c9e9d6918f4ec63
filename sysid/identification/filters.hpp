#pragma once

#include <vector>

#include <Eigen/Core>

namespace multipanda {

// Butterworth low pass of even order, by the bilinear transform with a prewarped cut-off, as second-order
// sections. Columns are signals, rows samples.
class LowPass {
 public:
  // Throws std::invalid_argument unless the order is even and 0 < cutoff_hz < rate_hz / 2.
  LowPass(int order, double cutoff_hz, double rate_hz);

  // Filters forward and backward: zero phase, squared gain. Ends are extended by reflection about the end
  // point, three times the filter's length. The states start as if the first value had always been there.
  Eigen::MatrixXd zero_phase(const Eigen::MatrixXd& signals) const;

 private:
  struct Section {
    double b0, b1, b2, a1, a2;
  };
  void run(double* values, Eigen::Index count) const;
  std::vector<Section> sections_;
};

}  // namespace multipanda
