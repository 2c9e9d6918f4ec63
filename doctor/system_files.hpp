#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace multipanda::doctor {

// The kernel's files in /proc and /sys. Files that are missing or not readable give no value. Tests use
// another root.
class SystemFiles {
 public:
  explicit SystemFiles(std::filesystem::path root = "/") : root_(std::move(root)) {}

  std::filesystem::path path(const std::string& file) const { return root_ / file; }
  bool exists(const std::string& file) const;
  // Whole content; `file` without a leading slash: "proc/stat".
  std::optional<std::string> text(const std::string& file) const;
  // First line, without surrounding spaces.
  std::optional<std::string> line(const std::string& file) const;
  std::optional<double> number(const std::string& file) const;  // of the first line
  std::vector<std::string> lines(const std::string& file) const;
  std::vector<std::string> names(const std::string& folder) const;  // of its entries, sorted

 private:
  std::filesystem::path root_;
};

// "0-2,5" -> {0, 1, 2, 5}. Stops at the first invalid character.
std::vector<int> parse_core_list(const std::string& text);

}  // namespace multipanda::doctor
