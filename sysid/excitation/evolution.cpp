#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>
#include <numeric>
#include <thread>

#include <Eigen/Eigenvalues>

#include "sysid/excitation/excitation.hpp"

namespace multipanda {

Evolution::Evolution(const Eigen::VectorXd& start, const Eigen::VectorXd& scale, std::uint64_t seed)
    : n_(start.size()), scale_(scale), mean_(start.cwiseQuotient(scale)), bits_(seed) {
  const auto n = static_cast<double>(n_);
  population_ = 4 + static_cast<std::size_t>(3 * std::log(n));
  parents_ = population_ / 2;
  weights_.resize(static_cast<Eigen::Index>(parents_));
  for (Eigen::Index i = 0; i < weights_.size(); ++i) {
    weights_[i] = std::log(static_cast<double>(parents_) + 0.5) - std::log(static_cast<double>(i) + 1);
  }
  weights_ /= weights_.sum();
  mu_eff_ = 1 / weights_.squaredNorm();
  c_sigma_ = (mu_eff_ + 2) / (n + mu_eff_ + 5);
  d_sigma_ = 1 + 2 * std::max(0.0, std::sqrt((mu_eff_ - 1) / (n + 1)) - 1) + c_sigma_;
  c_c_ = (4 + mu_eff_ / n) / (n + 4 + 2 * mu_eff_ / n);
  c_1_ = 2 / (std::pow(n + 1.3, 2) + mu_eff_);
  c_mu_ = std::min(1 - c_1_, 2 * (mu_eff_ - 2 + 1 / mu_eff_) / (std::pow(n + 2, 2) + mu_eff_));
  chi_ = std::sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n));
  path_sigma_ = path_c_ = Eigen::VectorXd::Zero(n_);
  deviations_ = Eigen::VectorXd::Ones(n_);
  C_ = axes_ = Eigen::MatrixXd::Identity(n_, n_);
}

// Box-Muller from the generator's own bits: the same numbers with every standard library.
double Evolution::normal() {
  const auto uniform = [&] { return (static_cast<double>(bits_() >> 11) + 0.5) * 0x1p-53; };
  const double r = std::sqrt(-2 * std::log(uniform()));
  return r * std::cos(2 * std::numbers::pi * uniform());
}

std::vector<Eigen::VectorXd> Evolution::ask() {
  steps_.clear();
  std::vector<Eigen::VectorXd> candidates;
  for (std::size_t k = 0; k < population_; ++k) {
    Eigen::VectorXd z(n_);
    for (Eigen::Index i = 0; i < n_; ++i) z[i] = normal();
    steps_.push_back(axes_ * deviations_.cwiseProduct(z));
    candidates.push_back((mean_ + sigma_ * steps_.back()).cwiseProduct(scale_));
  }
  return candidates;
}

void Evolution::tell(const std::vector<double>& values) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return values[a] < values[b]; });
  Eigen::VectorXd step = Eigen::VectorXd::Zero(n_);
  Eigen::MatrixXd rank_mu = Eigen::MatrixXd::Zero(n_, n_);
  for (std::size_t k = 0; k < parents_; ++k) {
    const Eigen::VectorXd& y = steps_[order[k]];
    const double w = weights_[static_cast<Eigen::Index>(k)];
    step += w * y;
    rank_mu.selfadjointView<Eigen::Lower>().rankUpdate(y, w);
  }
  mean_ += sigma_ * step;
  ++generation_;
  const Eigen::VectorXd white = axes_ * (axes_.transpose() * step).cwiseQuotient(deviations_);
  path_sigma_ = (1 - c_sigma_) * path_sigma_ + std::sqrt(c_sigma_ * (2 - c_sigma_) * mu_eff_) * white;
  const double begun = 1 - std::pow(1 - c_sigma_, 2 * static_cast<double>(generation_));
  const bool steady =
      path_sigma_.norm() / std::sqrt(begun) < (1.4 + 2 / (static_cast<double>(n_) + 1)) * chi_;
  path_c_ = (1 - c_c_) * path_c_;
  if (steady) path_c_ += std::sqrt(c_c_ * (2 - c_c_) * mu_eff_) * step;
  C_ = (1 - c_1_ - c_mu_ + (steady ? 0 : c_1_ * c_c_ * (2 - c_c_))) * C_ + c_mu_ * rank_mu;
  C_.selfadjointView<Eigen::Lower>().rankUpdate(path_c_, c_1_);
  sigma_ *= std::exp(c_sigma_ / d_sigma_ * (path_sigma_.norm() / chi_ - 1));
  const auto every =
      static_cast<std::size_t>(std::max(1.0, 1 / ((c_1_ + c_mu_) * static_cast<double>(n_) * 10)));
  if (generation_ % every != 0) return;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(C_);  // uses the lower half only
  axes_ = solver.eigenvectors();
  deviations_ = solver.eigenvalues().cwiseMax(1e-20).cwiseSqrt();
}

void for_all(std::size_t count, std::size_t threads,
             const std::function<void(std::size_t, std::size_t)>& function) {
  std::atomic<std::size_t> next{0};
  const auto work = [&](std::size_t thread) {
    for (std::size_t i = next.fetch_add(1); i < count; i = next.fetch_add(1)) function(thread, i);
  };
  std::vector<std::jthread> helpers;
  for (std::size_t k = 1; k < threads; ++k) helpers.emplace_back(work, k);
  work(0);
}

}  // namespace multipanda
