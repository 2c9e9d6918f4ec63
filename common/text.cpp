#include "common/text.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <numbers>

namespace multipanda {

namespace {

bool read_decimal(std::string_view text, double& value) {
  if (text.starts_with('+')) text.remove_prefix(1);
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error == std::errc::result_out_of_range) value = std::numeric_limits<double>::infinity();
  return (error == std::errc() || error == std::errc::result_out_of_range) &&
         end == text.data() + text.size();
}

}  // namespace

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r\n";
  const auto first = text.find_first_not_of(kBlank);
  return first == text.npos ? std::string_view()
                            : text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

std::string joined(const std::vector<std::string>& names, const char* between) {
  std::string text;
  for (const auto& name : names) text += (text.empty() ? "" : between) + name;
  return text;
}

std::string in_quotes(const std::string& name) {
  constexpr std::size_t kLongest = 60;
  std::string text = "'";
  for (const char c : name.substr(0, kLongest)) text += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  return text.append(name.size() > kLongest ? "...'" : "'");
}

std::string in_quotes(const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i) {
    text.append(i == 0 ? "'" : i + 1 == names.size() ? " or '" : ", '").append(names[i]).append("'");
  }
  return text;
}

std::string number_text(double value) {
  char buffer[40];
  const auto [end, error] = std::to_chars(buffer, buffer + sizeof(buffer), value);
  return error == std::errc() ? std::string(buffer, end) : "?";
}

std::string list_text(const std::vector<double>& values) {
  std::string text;
  for (const double value : values) text.append(text.empty() ? "[" : ", ").append(number_text(value));
  return text.empty() ? "[]" : text + "]";
}

std::string bounds_text(double min, double max, bool open_below) {
  if (open_below && std::isfinite(max))
    return "above " + number_text(min) + " and at most " + number_text(max);
  if (open_below) return "above " + number_text(min);
  if (std::isfinite(min) && std::isfinite(max)) return number_text(min) + " to " + number_text(max);
  if (std::isfinite(min)) return "at least " + number_text(min);
  if (std::isfinite(max)) return "at most " + number_text(max);
  return "";
}

bool read_number(const std::string& text, double& value) {
  if (text == ".inf" || text == "+.inf" || text == "-.inf" || text == ".Inf" || text == ".nan" ||
      text == ".NaN") {
    value = std::numeric_limits<double>::quiet_NaN();
    return true;
  }
  const std::size_t at = text.find("pi");
  if (at == std::string::npos) return read_decimal(text, value);
  const std::string before = text.substr(0, at), after = text.substr(at + 2);
  double factor = 1, divisor = 1;
  if (before == "-" || before == "+" || before.empty()) {
    factor = before == "-" ? -1 : 1;
  } else if (before.back() != '*' || !read_decimal(before.substr(0, before.size() - 1), factor)) {
    return false;
  }
  if (!after.empty() && (after[0] != '/' || !read_decimal(after.substr(1), divisor))) return false;
  value = factor * std::numbers::pi / divisor;
  return true;
}

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
