#include "doctor/system_files.hpp"

#include <algorithm>
#include <charconv>
#include <fstream>
#include <sstream>

#include "common/text.hpp"

namespace multipanda::doctor {

bool SystemFiles::exists(const std::string& file) const {
  std::error_code error;
  return std::filesystem::exists(path(file), error);
}

std::optional<std::string> SystemFiles::text(const std::string& file) const {
  std::ifstream stream(path(file));
  if (!stream) return {};
  std::ostringstream content;
  content << stream.rdbuf();
  if (stream.bad()) return {};
  return content.str();
}

std::optional<std::string> SystemFiles::line(const std::string& file) const {
  std::ifstream stream(path(file));
  std::string line;
  if (!stream || !std::getline(stream, line)) return {};
  return std::string(trimmed(line));
}

std::optional<double> SystemFiles::number(const std::string& file) const {
  const auto text = line(file);
  if (!text) return {};
  double value = 0;
  const auto result = std::from_chars(text->data(), text->data() + text->size(), value);
  if (result.ec != std::errc()) return {};
  return value;
}

std::vector<std::string> SystemFiles::lines(const std::string& file) const {
  std::vector<std::string> lines;
  std::ifstream stream(path(file));
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

std::vector<std::string> SystemFiles::names(const std::string& folder) const {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(path(folder), error)) {
    names.push_back(entry.path().filename().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

std::vector<int> parse_core_list(const std::string& text) {
  std::vector<int> cores;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ',');) {
    int first = 0, last = 0;
    const char* end = part.data() + part.size();
    const auto begin = std::from_chars(part.data(), end, first);
    if (begin.ec != std::errc()) continue;
    last = first;
    if (begin.ptr != end && *begin.ptr == '-') (void)std::from_chars(begin.ptr + 1, end, last);
    for (int core = first; core <= last && core - first < 4096; ++core) cores.push_back(core);
  }
  return cores;
}

}  // namespace multipanda::doctor
