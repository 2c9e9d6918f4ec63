#include "sysid/identification/consistent_fit.hpp"

#include <cmath>

#include <Eigen/Cholesky>

namespace multipanda {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kLeastSpread = 1e-3;  // smallest spread for the weights [N m]
constexpr double kLittle = 1e-9;       // keeps unidentifiable parameters at zero
// Cost of amplitudes and tilt, chosen by cutting files of real arms (see docs/identification.md). A tilt of
// 0.3 degrees costs as much as a quarter of one joint's residual.
constexpr double kFrictionWeight = 1;              // [1/(N m)^2]
constexpr double kTiltWeight = 100 * 9.81 * 9.81;  // [1/rad^2]
constexpr double kLongestElement = 1.0 / 3;        // of a joint's travel

// Position of each unknown in the vector x = (theta; f of joint 1, ...; a, b; k).
struct Layout {
  Index n, parts;
  Index friction(Index joint) const { return 10 * n + joint * parts; }
  Index tilt() const { return 10 * n + n * parts; }
  Index gain(Index joint) const { return tilt() + 2 + joint; }
  Index size() const { return tilt() + 2 + n; }
};

class Newton {
 public:
  Newton(const Equations& equations, const FitProblem& problem, const Family& family)
      : equations_(equations),
        problem_(problem),
        at_{static_cast<Index>(equations.size()), static_cast<Index>(problem.parts.size())},
        free_(static_cast<std::size_t>(at_.size()), false),
        bounded_(free_),
        weight_(VectorXd::Ones(at_.n)),
        ridge_(VectorXd::Constant(at_.size(), kLittle)) {
    for (Index i = 0; i < at_.n; ++i) {
      const bool fixed = !problem.fixed.empty() && problem.fixed[static_cast<std::size_t>(i)];
      for (Index k = 0; k < 10; ++k) free_[index(10 * i + k)] = !fixed;
      ridge_.segment<10>(10 * i).setZero();
      priors_.emplace_back(problem.prior.segment<10>(10 * i));
      for (const std::size_t part : family.parts) {
        const std::size_t x = index(at_.friction(i)) + part;
        const FrictionPart& of = problem.parts[part];
        free_[x] = of.kind != FrictionKind::presliding || problem.travel.size() == 0 ||
                   of.distance <= kLongestElement * problem.travel[i];
        bounded_[x] = has_sign(problem.parts[part]) && problem.parts[part].kind != FrictionKind::acceleration;
      }
      free_[index(at_.gain(i))] = family.gains;
      ridge_[at_.gain(i)] = problem.gain_weight;
    }
    ridge_.segment(10 * at_.n, at_.n * at_.parts).setConstant(kFrictionWeight);
    ridge_.segment<2>(at_.tilt()).setConstant(kTiltWeight);
    free_[index(at_.tilt())] = free_[index(at_.tilt() + 1)] = family.tilt;
    center_ = VectorXd::Zero(at_.size());
    center_.head(10 * at_.n) = problem.prior;
    if (problem.hold.size() > 0) ridge_.head(10 * at_.n) = problem.hold;
    known_ = VectorXd::Zero(10 * at_.n);
    known_.tail<10>() = problem.known;
  }

  Fit run(const Fit* start) {
    VectorXd x = VectorXd::Zero(at_.size());
    x.head(10 * at_.n) = problem_.prior;
    if (start != nullptr) {
      put(*start, x);
      set_weights(start->spread);
    }
    int iterations = 0;
    const int passes = start != nullptr ? 2 : problem_.passes;
    for (int pass = 0; pass < passes; ++pass) {
      iterations += minimize(x);
      set_weights(spread(x));
    }
    Fit out = get(x);
    out.iterations = iterations;
    return out;
  }

  VectorXd square_sums(const Fit& fit) const {
    VectorXd x = VectorXd::Zero(at_.size()), out(at_.n);
    put(fit, x);
    for (Index j = 0; j < at_.n; ++j) out[j] = residual(j, x).squaredNorm();
    return out;
  }

 private:
  static std::size_t index(Index i) { return static_cast<std::size_t>(i); }
  const JointEquations& of(Index j) const { return equations_[index(j)]; }

  VectorXd residual(Index j, const VectorXd& x, MatrixXd* jacobian = nullptr) const {
    const MatrixXd& R = of(j).R;
    const Index width = 10 * (at_.n - j);
    const VectorXd theta = (x.head(10 * at_.n) + known_).tail(width);
    const MatrixXd Y = R.leftCols(width) + x[at_.tilt()] * R.middleCols(width, width) +
                       x[at_.tilt() + 1] * R.middleCols(2 * width, width);
    const auto F = R.middleCols(3 * width, at_.parts);
    const double gain = 1 + x[at_.gain(j)];
    const VectorXd rigid = Y * theta;
    if (jacobian != nullptr) {  // columns: theta of links j.., friction of the joint, a, b, k
      jacobian->resize(R.rows(), width + at_.parts + 3);
      *jacobian << gain * Y, F, gain * (R.middleCols(width, width) * theta),
          gain * (R.middleCols(2 * width, width) * theta), rigid;
    }
    return gain * rigid + F * x.segment(at_.friction(j), at_.parts) - R.rightCols<1>();
  }

  double cost(const VectorXd& x) const {
    double sum = ridge_.dot((x - center_).cwiseAbs2());
    for (Index i = 0; i < at_.n; ++i) {
      if (free_[index(10 * i)]) sum += problem_.lambda * priors_[index(i)].value(x.segment<10>(10 * i));
    }
    if (!std::isfinite(sum)) return sum;
    for (Index j = 0; j < at_.n; ++j) sum += factor(j) * residual(j, x).squaredNorm();
    return sum;
  }
  double factor(Index j) const {
    return weight_[j] * weight_[j] / static_cast<double>(std::max<Index>(1, of(j).rows));
  }

  void derivatives(const VectorXd& x, VectorXd& g, MatrixXd& H) const {
    g = 2 * ridge_.cwiseProduct(x - center_);
    H = (2 * ridge_).asDiagonal();
    MatrixXd J;
    for (Index j = 0; j < at_.n; ++j) {
      const VectorXd e = residual(j, x, &J);
      const Index width = 10 * (at_.n - j);
      const MatrixXd JJ = 2 * factor(j) * (J.transpose() * J);
      const VectorXd Je = 2 * factor(j) * (J.transpose() * e);
      // Blocks of the joint's unknowns: their columns in J, their entries in x, their number.
      const Index blocks[4][3] = {{0, 10 * j, width},
                                  {width, at_.friction(j), at_.parts},
                                  {width + at_.parts, at_.tilt(), 2},
                                  {width + at_.parts + 2, at_.gain(j), 1}};
      for (const auto& a : blocks) {
        g.segment(a[1], a[2]) += Je.segment(a[0], a[2]);
        for (const auto& b : blocks) {
          H.block(a[1], b[1], a[2], b[2]) += JJ.block(a[0], b[0], a[2], b[2]);
        }
      }
    }
    for (Index i = 0; i < at_.n; ++i) {
      Theta gradient;
      Eigen::Matrix<double, 10, 10> hessian;
      priors_[index(i)].value(x.segment<10>(10 * i), &gradient, &hessian);
      g.segment<10>(10 * i) += problem_.lambda * gradient;
      H.block<10, 10>(10 * i, 10 * i) += problem_.lambda * hessian;
    }
  }

  int minimize(VectorXd& x) const {
    constexpr int kMost = 60;
    double last = cost(x);
    VectorXd g;
    MatrixXd H;
    for (int iteration = 1; iteration <= kMost; ++iteration) {
      derivatives(x, g, H);
      std::vector<Index> moving;
      for (Index i = 0; i < x.size(); ++i) {
        const bool held = bounded_[index(i)] && x[i] <= 0 && g[i] > 0;
        if (free_[index(i)] && !held) moving.push_back(i);
      }
      const VectorXd scale = H.diagonal()(moving).cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
      MatrixXd reduced = scale.asDiagonal() * H(moving, moving) * scale.asDiagonal();
      reduced.diagonal().array() += 1e-13;
      VectorXd step = VectorXd::Zero(x.size());
      step(moving) = -scale.cwiseProduct(reduced.ldlt().solve(scale.cwiseProduct(g(moving))));
      const double slope = -g.dot(step);
      double length = 1, now = last;
      VectorXd next;
      for (; length > 1e-8; length /= 2) {
        next = x + length * step;
        for (const Index i : moving) {
          if (bounded_[index(i)]) next[i] = std::max(0.0, next[i]);
        }
        now = cost(next);
        if (now <= last - 1e-4 * length * slope) break;
      }
      if (!(now < last)) return iteration;
      x = next;
      const bool done = last - now < 1e-8 * (1e-3 + std::abs(now));
      last = now;
      if (done) return iteration;
    }
    return kMost;
  }

  VectorXd spread(const VectorXd& x) const {
    VectorXd out(at_.n);
    for (Index j = 0; j < at_.n; ++j) {
      out[j] = std::sqrt(residual(j, x).squaredNorm() / static_cast<double>(std::max<Index>(1, of(j).rows)));
    }
    return out;
  }
  // A compromise between equal weights and 1 / spread, which would overweight joints with little torque.
  void set_weights(const VectorXd& spread) {
    const VectorXd s = spread.cwiseMax(kLeastSpread);
    const double usual = std::exp(s.array().log().mean());
    weight_ = (s * usual).cwiseSqrt().cwiseInverse();
  }

  Fit get(const VectorXd& x) const {
    Fit out;
    out.theta = x.head(10 * at_.n);
    out.friction.resize(at_.n, at_.parts);
    for (Index j = 0; j < at_.n; ++j) out.friction.row(j) = x.segment(at_.friction(j), at_.parts);
    out.tilt = x.segment<2>(at_.tilt());
    out.gain = x.tail(at_.n);
    out.spread = spread(x);
    return out;
  }
  void put(const Fit& fit, VectorXd& x) const {
    x.head(10 * at_.n) = fit.theta;
    for (Index j = 0; j < at_.n; ++j) x.segment(at_.friction(j), at_.parts) = fit.friction.row(j);
    x.segment<2>(at_.tilt()) = fit.tilt;
    x.tail(at_.n) = fit.gain;
  }

  const Equations& equations_;
  const FitProblem& problem_;
  Layout at_;
  std::vector<bool> free_, bounded_;
  std::vector<Divergence> priors_;
  VectorXd weight_, ridge_, center_, known_;
};

}  // namespace

Fit fit_consistent(const Equations& equations, const FitProblem& problem, const Family& family,
                   const Fit* start) {
  return Newton(equations, problem, family).run(start);
}

Eigen::VectorXd squared_errors(const Equations& equations, const FitProblem& problem, const Fit& fit) {
  return Newton(equations, problem, {}).square_sums(fit);
}

}  // namespace multipanda
