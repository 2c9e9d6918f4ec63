#include "sysid/comparison/compare.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <yaml-cpp/yaml.h>

#include "common/text.hpp"

namespace multipanda {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

double deviation(const VectorXd& values) {
  if (values.size() < 2) return 0;
  return std::sqrt((values.array() - values.mean()).square().sum() / static_cast<double>(values.size() - 1));
}

// Duration of the initial rest: until a joint has moved by 1 mrad, less 0.1 s.
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

class Reader {
 public:
  explicit Reader(std::string file) : file_(std::move(file)) {}

  std::string place(const YAML::Node& node) const {
    return fmt::format("{}:{}", file_, node.Mark().line + 1);
  }
  [[noreturn]] void refuse(const YAML::Node& node, const std::string& what) const {
    throw std::invalid_argument(place(node) + ": " + what);
  }

  double limit(const YAML::Node& node, const std::string& of) const {
    double value = 0;
    try {
      value = node.as<double>();
    } catch (const YAML::Exception&) {
      refuse(node, fmt::format("{}: expected a number", of));
    }
    if (!std::isfinite(value) || value < 0)
      refuse(node, fmt::format("{}: {} is not a valid limit, expected 0 or more", of, value));
    return value;
  }

  // Quantities and lag_s of a mapping; the caller handles `arms`.
  std::vector<GateLimit> limits(const YAML::Node& map, bool outermost) const {
    if (!map.IsMap()) refuse(map, "expected a mapping of quantities to limits, such as 'F_EE: {rmse: 1.7}'");
    std::vector<std::string> names{"lag_s"};
    if (outermost) names.emplace_back("arms");
    for (const ComparedQuantity& quantity : quantities()) names.emplace_back(quantity.name);
    std::vector<GateLimit> out;
    for (const auto& entry : map) {
      const auto name = entry.first.as<std::string>();
      if (name == "arms" && outermost) continue;
      if (std::find(names.begin(), names.end(), name) == names.end())
        refuse(entry.first, fmt::format("unknown quantity '{}'{}", name, name_hint(name, names, "")));
      if (name == "lag_s") {
        out.push_back({name, "", limit(entry.second, name), place(entry.first)});
      } else if (entry.second.IsMap()) {
        for (const auto& figure : entry.second) {
          const auto kind = figure.first.as<std::string>();
          if (kind != "rmse" && kind != "axis" && kind != "max")
            refuse(figure.first,
                   fmt::format("{}: unknown figure '{}', expected rmse, axis or max", name, kind));
          out.push_back({name, kind, limit(figure.second, name + "." + kind), place(figure.first)});
        }
      } else {
        refuse(entry.second, fmt::format("{}: expected {{rmse: NUMBER}}, with axis or max", name));
      }
    }
    return out;
  }

 private:
  std::string file_;
};

std::string number(double value, const std::string& unit) { return fmt::format("{:.4g} {}", value, unit); }

GateResult judged_lag(const GateLimit& limit, const Comparison& comparison) {
  GateResult result{limit, comparison.arm, "", 0.0, false, ""};
  for (const auto& pair : comparison.pairs) result.found = std::max(*result.found, std::abs(pair.lag_s));
  result.held = *result.found <= limit.limit;
  return result;
}

GateResult judged(const GateLimit& limit, const Comparison& comparison) {
  if (limit.quantity == "lag_s") return judged_lag(limit, comparison);
  GateResult result{limit, comparison.arm, "", std::nullopt, false, ""};
  const QuantityFigures& figures = comparison.at(limit.quantity);
  if (!figures.available()) return result;
  Eigen::Index axis = 0, repeat = 0;
  if (limit.figure == "rmse") {
    result.found = figures.mean();
  } else {
    result.found =
        limit.figure == "axis" ? figures.axis_mean().maxCoeff(&axis) : figures.max.maxCoeff(&repeat, &axis);
    result.axis = figures.axes[static_cast<std::size_t>(axis)];
  }
  result.held = *result.found <= limit.limit;
  return result;
}

std::string sentence(const GateResult& result, const Comparison& comparison) {
  const GateLimit& limit = result.limit;
  const bool lag = limit.quantity == "lag_s";
  const std::string what =
      (result.arm.empty() ? "" : result.arm + ": ") + limit.quantity + (lag ? "" : " " + limit.figure);
  const std::string unit = lag ? "s" : comparison.at(limit.quantity).unit;
  if (!result.found)
    return fmt::format("{} cannot be judged: {} ({})", what, comparison.at(limit.quantity).missing,
                       limit.place);
  return fmt::format("{} is {}{}, {} {} ({})", what, number(*result.found, unit),
                     result.axis.empty() ? "" : (result.axis < "a" ? " at joint " : " along ") + result.axis,
                     result.held ? "within" : "above", number(limit.limit, unit), limit.place);
}

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
  // No mean over the repeats if one of them lacks the quantity.
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

Gate read_gate(const std::filesystem::path& path) {
  const Reader reader(path.string());
  Gate gate;
  try {
    const YAML::Node root = YAML::LoadFile(path.string());
    gate.limits = reader.limits(root, true);
    if (const YAML::Node arms = root["arms"]) {
      if (!arms.IsMap()) reader.refuse(arms, "arms: expected a mapping of arms' names to limits");
      for (const auto& arm : arms)
        gate.of_arm[arm.first.as<std::string>()] = reader.limits(arm.second, false);
    }
    if (gate.limits.empty() && gate.of_arm.empty())
      reader.refuse(root, "the file has no limits; expected at least one, such as 'F_EE: {rmse: 1.7}'");
  } catch (const YAML::BadFile&) {
    throw std::invalid_argument(path.string() + ": cannot be opened; check the path");
  } catch (const YAML::Exception& error) {
    throw std::invalid_argument(fmt::format("{}:{}: {}", path.string(), error.mark.line + 1, error.msg));
  }
  return gate;
}

std::vector<GateResult> check_gate(const Gate& gate, const Comparison& comparison) {
  std::vector<GateLimit> limits;
  if (const auto own = gate.of_arm.find(comparison.arm); own != gate.of_arm.end()) limits = own->second;
  for (const GateLimit& limit : gate.limits) {
    const bool replaced = std::any_of(limits.begin(), limits.end(), [&](const GateLimit& own) {
      return own.quantity == limit.quantity && own.figure == limit.figure;
    });
    if (!replaced) limits.push_back(limit);
  }
  std::vector<GateResult> results;
  for (const GateLimit& limit : limits) {
    GateResult result = judged(limit, comparison);
    result.text = sentence(result, comparison);
    results.push_back(std::move(result));
  }
  return results;
}

}  // namespace multipanda
