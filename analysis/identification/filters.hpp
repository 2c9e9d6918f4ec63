#pragma once

#include <vector>

#include <Eigen/Core>

namespace multipanda {

// Butterworth low pass of even order, by the bilinear transform with the cut-off frequency kept, as sections
// of second order. Columns are signals, rows samples.
class LowPass {
 public:
  // Throws std::invalid_argument unless the order is even and 0 < cutoff_hz < rate_hz / 2.
  LowPass(int order, double cutoff_hz, double rate_hz);

  // Forward and backward: no phase, the gain squared. Ends are continued by their reflection about the end
  // point, three times the filter's length, and the states begin as if the first value had always been there.
  Eigen::MatrixXd zero_phase(const Eigen::MatrixXd& signals) const;

 private:
  struct Section {
    double b0, b1, b2, a1, a2;
  };
  void run(double* values, Eigen::Index count) const;
  std::vector<Section> sections_;
};

}  // namespace multipanda
