#include "common/text.hpp"

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

}  // namespace multipanda
