#include "sysid/comparison/compare.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <nlohmann/json.hpp>

namespace multipanda {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

double deviation(const VectorXd& values) {
  if (values.size() < 2) return 0;
  return std::sqrt((values.array() - values.mean()).square().sum() / static_cast<double>(values.size() - 1));
}

// How long the arm stays at its starting position: until a joint has moved by 1 mrad, less 0.1 s.
double rest_of(const MeasuredLog& log) {
  constexpr double kStill = 1e-3, kSpare = 0.1;
  for (Index k = 0; k < log.samples(); ++k) {
    if ((log.q.row(k) - log.q.row(0)).cwiseAbs().maxCoeff() > kStill)
      return std::max(0.0, log.t[k] - log.t[0] - kSpare);
  }
  return log.duration();
}

VectorXd noise_of(const MatrixXd& series, Index samples) {
  VectorXd out(series.cols());
  for (Index j = 0; j < series.cols(); ++j) out[j] = deviation(series.col(j).head(samples));
  return out;
}

void add_noise_floor(std::span<const MeasuredLog> real, const CompareOptions& options, Comparison& out) {
  constexpr double kLeastRest = 0.2;
  double rest = options.rest_s;
  for (const MeasuredLog& log : real) rest = std::min(rest, rest_of(log));
  if (rest < kLeastRest) return;
  out.rest_s = rest;
  for (std::size_t i = 0; i < out.quantities.size(); ++i) {
    QuantityFigures& figures = out.quantities[i];
    if (!figures.available()) continue;
    for (const MeasuredLog& log : real) {
      const MatrixXd series = even_series_of(log, quantities()[i], options.low_pass_hz);
      const VectorXd noise = noise_of(series, std::min(series.rows(), static_cast<Index>(1000 * rest))) /
                             static_cast<double>(real.size());
      figures.noise = figures.noise.size() == 0 ? noise : VectorXd(figures.noise + noise);
    }
  }
}

std::vector<std::string> axes_of(const ComparedQuantity& quantity, Index joints) {
  if (!quantity.per_joint) return {"x", "y", "z"};
  std::vector<std::string> names;
  for (Index j = 1; j <= joints; ++j) names.push_back(std::to_string(j));
  return names;
}

void append_row(MatrixXd& matrix, const VectorXd& row) {
  matrix.conservativeResize(matrix.rows() + 1, row.size());
  matrix.bottomRows(1) = row.transpose();
}

void add_pair(const AlignedPair& pair, Comparison& out) {
  out.pairs.push_back({pair.real_source, pair.sim_source, pair.lag_s, pair.correlation, pair.t[0],
                       pair.t[pair.t.size() - 1], pair.measured_lag_s, pair.aligned_by});
  for (const auto& warning : pair.warnings)
    out.warnings.push_back(pair.real_source + " and " + pair.sim_source + ": " + warning);
  for (std::size_t i = 0; i < out.quantities.size(); ++i) {
    QuantityFigures& figures = out.quantities[i];
    if (!pair.series[i].missing.empty()) {
      figures.missing = pair.series[i].missing;
      continue;
    }
    const MatrixXd error = pair.series[i].sim - pair.series[i].real;
    append_row(figures.rmse, (error.colwise().squaredNorm() / static_cast<double>(error.rows())).cwiseSqrt());
    append_row(figures.max, error.cwiseAbs().colwise().maxCoeff());
  }
}

std::vector<double> list(const VectorXd& values) { return {values.begin(), values.end()}; }

}  // namespace

double QuantityFigures::mean() const { return rmse.size() == 0 ? 0 : rmse.rowwise().mean().mean(); }
double QuantityFigures::spread() const { return rmse.size() == 0 ? 0 : deviation(rmse.rowwise().mean()); }
double QuantityFigures::largest() const { return max.size() == 0 ? 0 : max.maxCoeff(); }

std::optional<double> QuantityFigures::noise_floor() const {
  if (noise.size() == 0) return std::nullopt;
  return noise.mean();
}

VectorXd QuantityFigures::axis_mean() const { return rmse.colwise().mean().transpose(); }

VectorXd QuantityFigures::axis_spread() const {
  VectorXd out(rmse.cols());
  for (Index j = 0; j < rmse.cols(); ++j) out[j] = deviation(rmse.col(j));
  return out;
}

const QuantityFigures& Comparison::at(const std::string& name) const {
  for (const auto& figures : quantities) {
    if (figures.name == name) return figures;
  }
  throw std::invalid_argument("unknown quantity '" + name +
                              "': expected q, dq, tau, x_EE, F_EE, C_err or M_EE");
}

Comparison compare(std::span<const MeasuredLog> real, std::span<const MeasuredLog> sim,
                   const CompareOptions& options) {
  if (real.empty() || sim.empty())
    throw std::invalid_argument("a comparison needs a real and a simulated log");
  Comparison out;
  out.low_pass_hz = options.low_pass_hz;
  out.arm = !real[0].arm.empty() ? real[0].arm : sim[0].arm;
  for (const ComparedQuantity& quantity : quantities())
    out.quantities.push_back({quantity.name,
                              quantity.what,
                              quantity.unit,
                              axes_of(quantity, real[0].joints()),
                              {},
                              {},
                              {},
                              {},
                              quantity.paper});
  std::size_t pairs = std::max(real.size(), sim.size());
  if (real.size() != sim.size() && real.size() > 1 && sim.size() > 1) {
    pairs = std::min(real.size(), sim.size());
    out.warnings.push_back(std::to_string(real.size()) + " real and " + std::to_string(sim.size()) +
                           " simulated repeats: only the first " + std::to_string(pairs) +
                           " of each are compared");
  }
  for (std::size_t i = 0; i < pairs; ++i)
    add_pair(align(real[real.size() == 1 ? 0 : i], sim[sim.size() == 1 ? 0 : i], options), out);
  // A quantity that one repeat lacks has no mean over the repeats.
  for (QuantityFigures& figures : out.quantities) {
    if (!figures.available()) figures.rmse.resize(0, 0), figures.max.resize(0, 0);
  }
  add_noise_floor(real.first(std::min(real.size(), pairs)), options, out);
  const auto pass_on = [&](std::span<const MeasuredLog> logs) {
    for (const MeasuredLog& log : logs.first(std::min(logs.size(), pairs)))
      for (const auto& warning : log.warnings) out.warnings.push_back(log.source + ": " + warning);
  };
  pass_on(real);
  pass_on(sim);
  return out;
}

std::vector<QuantityChange> change(const Comparison& before, const Comparison& after) {
  std::vector<QuantityChange> out;
  for (std::size_t i = 0; i < before.quantities.size(); ++i) {
    const QuantityFigures &b = before.quantities[i], &a = after.quantities[i];
    if (!b.available() || !a.available()) continue;
    QuantityChange c{b.name, b.unit, b.mean(), a.mean(), std::max(b.spread(), a.spread()), 1, false};
    if (c.before > 0) c.ratio = c.after / c.before;
    c.worse = c.after - c.before > 2 * c.spread + 1e-12;
    out.push_back(c);
  }
  return out;
}

nlohmann::ordered_json to_json(const Comparison& comparison) {
  using Json = nlohmann::ordered_json;
  Json out{
      {"arm", comparison.arm}, {"repeats", comparison.pairs.size()}, {"low_pass_hz", comparison.low_pass_hz}};
  for (const auto& figures : comparison.quantities) {
    Json entry{{"what", figures.what}, {"unit", figures.unit}, {"available", figures.available()}};
    if (!figures.available()) {
      entry["missing"] = figures.missing;
    } else {
      entry["rmse_mean"] = figures.mean();
      entry["rmse_spread"] = figures.spread();
      entry["max"] = figures.largest();
      entry["noise_floor"] = figures.noise_floor() ? Json(*figures.noise_floor()) : Json();
      entry["paper"] = figures.paper > 0 ? Json(figures.paper) : Json();
      entry["axes"] = figures.axes;
      entry["rmse"] = list(figures.axis_mean());
      entry["rmse_spread_by_axis"] = list(figures.axis_spread());
      entry["max_by_axis"] = list(figures.max.colwise().maxCoeff());
      if (figures.noise.size() > 0) entry["noise_by_axis"] = list(figures.noise);
      entry["rmse_by_repeat"] = list(figures.rmse.rowwise().mean());
    }
    out["quantities"][figures.name] = std::move(entry);
  }
  for (const auto& pair : comparison.pairs) {
    out["pairs"].push_back({{"real", pair.real},
                            {"sim", pair.sim},
                            {"lag_s", pair.lag_s},
                            {"measured_lag_s", pair.measured_lag_s ? Json(*pair.measured_lag_s) : Json()},
                            {"correlation", pair.correlation},
                            {"aligned_by", pair.aligned_by},
                            {"from_s", pair.from_s},
                            {"to_s", pair.to_s}});
  }
  out["rest_s"] = comparison.rest_s;
  out["warnings"] = comparison.warnings;
  return out;
}

nlohmann::ordered_json to_json(const std::vector<QuantityChange>& changes) {
  nlohmann::ordered_json out = nlohmann::ordered_json::object();
  for (const auto& c : changes) {
    out[c.name] = {{"unit", c.unit},     {"before", c.before}, {"after", c.after},
                   {"spread", c.spread}, {"ratio", c.ratio},   {"worse", c.worse}};
  }
  return out;
}

}  // namespace multipanda
