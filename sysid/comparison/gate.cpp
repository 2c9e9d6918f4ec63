#include "sysid/comparison/gate.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "support/spelling.hpp"

namespace multipanda {
namespace {

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
      reader.refuse(root, "no limit in it; expected at least one, such as 'F_EE: {rmse: 1.7}'");
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
