#include "common/spelling.hpp"

#include <algorithm>
#include <array>

namespace multipanda {
namespace {

// Units in keys: valid ones and common others. A unit that ends in another one comes before it.
constexpr std::array kUnits = {"nm_s_per_rad",
                               "n_s_per_m",
                               "s_per_rad",
                               "rad_per_s3",
                               "m_per_s3",
                               "nm_per_rad",
                               "nms_per_rad",
                               "rad_per_s2",
                               "deg_per_s2",
                               "nm_per_s",
                               "rad_per_s",
                               "deg_per_s",
                               "mm_per_s",
                               "cm_per_s",
                               "n_per_mm",
                               "n_per_m",
                               "m_per_s2",
                               "m_per_s",
                               "ns_per_m",
                               "n_per_s",
                               "kg_m2",
                               "kgm2",
                               "per_s",
                               "percent",
                               "degrees",
                               "radians",
                               "degree",
                               "radian",
                               "meters",
                               "metres",  // phrases: quoted
                               "wxyz",
                               "xyzw",
                               "deg",
                               "rad",
                               "rpm",
                               "mm",
                               "cm",
                               "km",
                               "ms",
                               "us",
                               "ns",
                               "kg",
                               "hz",
                               "khz",
                               "nm",
                               "kn",
                               "min",
                               "sec",
                               "m",
                               "s",
                               "n",
                               "g",
                               "h"};

}  // namespace

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::vector<std::size_t>> d(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
  for (std::size_t i = 0; i <= a.size(); ++i) {
    for (std::size_t j = 0; j <= b.size(); ++j) {
      if (i == 0 || j == 0) {
        d[i][j] = i + j;
        continue;
      }
      const std::size_t replaced = d[i - 1][j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      d[i][j] = std::min({d[i - 1][j] + 1, d[i][j - 1] + 1, replaced});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
      }
    }
  }
  return d[a.size()][b.size()];
}

std::string nearest_name(std::string_view name, const std::vector<std::string>& candidates) {
  // Longer names are not typing errors, and their table would be large.
  constexpr std::size_t kLongestName = 100;
  if (name.size() > kLongestName) return "";
  std::string best;
  std::size_t least = std::max<std::size_t>(1, name.size() / 3) + 1;
  for (const auto& candidate : candidates) {
    const std::size_t distance = edit_distance(name, candidate);
    if (distance < least) {
      least = distance;
      best = candidate;
    }
  }
  return best;
}

std::string name_hint(std::string_view name, const std::vector<std::string>& candidates, const char* none) {
  if (candidates.empty()) return std::string("; ") + none;
  const std::string nearest = nearest_name(name, candidates);
  if (!nearest.empty()) return "; did you mean '" + nearest + "'?";
  return "; valid: " + joined(candidates);
}

std::string has_no(const std::string& owner, const char* kind, const std::string& name,
                   const std::vector<std::string>& candidates) {
  return in_quotes(owner) + " has no " + kind + " " + in_quotes(name) +
         name_hint(name, candidates, "it has none");
}

UnitKey split_unit(std::string_view key) {
  for (const std::string_view unit : kUnits) {
    if (key.size() > unit.size() + 1 && key.ends_with(unit) && key[key.size() - unit.size() - 1] == '_') {
      return {key.substr(0, key.size() - unit.size() - 1), unit};
    }
  }
  return {key, {}};
}

std::vector<std::string> same_quantity(std::string_view key, const std::vector<std::string>& candidates) {
  const auto [quantity, unit] = split_unit(key);
  std::vector<std::string> same;
  for (const auto& candidate : candidates) {
    const UnitKey valid = split_unit(candidate);
    // "stiffness_nm" and "stiffness_n_per_m": the part after the split may not be a unit.
    const bool named = valid.quantity == quantity || valid.quantity == key;
    if (named && valid.unit != unit && !valid.unit.empty()) same.push_back(candidate);
  }
  return same;
}

}  // namespace multipanda
