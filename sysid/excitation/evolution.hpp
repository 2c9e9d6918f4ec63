#pragma once

#include <cstdint>
#include <functional>
#include <random>
#include <vector>

#include <Eigen/Core>

namespace multipanda {

// Covariance matrix adaptation (Hansen, "The CMA evolution strategy: a tutorial", 2016, default constants).
// It minimizes a function of some dozens of variables that may be curved, narrow and not smooth. The same
// seed gives the same search, whatever the number of threads.
class Evolution {
 public:
  // `scale`: initial standard deviation of each variable (n x 1), above zero.
  Evolution(const Eigen::VectorXd& start, const Eigen::VectorXd& scale, std::uint64_t seed);

  // The next candidates (n x 1 each), and their values in the same order; infinite is the worst.
  std::vector<Eigen::VectorXd> ask();
  void tell(const std::vector<double>& values);

 private:
  double normal();

  Eigen::Index n_;
  std::size_t population_, parents_;
  Eigen::VectorXd weights_, scale_, mean_, path_sigma_, path_c_, deviations_;
  Eigen::MatrixXd C_, axes_;
  double mu_eff_, c_sigma_, d_sigma_, c_c_, c_1_, c_mu_, chi_, sigma_ = 1;
  std::size_t generation_ = 0;
  std::vector<Eigen::VectorXd> steps_;
  std::mt19937_64 bits_;
};

// values[i] = function(thread, i) for i < count, on the given number of threads.
void for_all(std::size_t count, std::size_t threads,
             const std::function<void(std::size_t thread, std::size_t i)>& function);

}  // namespace multipanda
