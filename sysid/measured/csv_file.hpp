#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

// A CSV file with one row of names. Cells are separated by commas, semicolons or tabs. Blanks around them are
// ignored, strings may be quoted, and lines beginning with # are left out, but those before the names
// may hold a value each, such as "# base_rpy_rad: 0 1.5708 0".
namespace multipanda {

class CsvFile {
 public:
  // Throws LogRefused if the file cannot be read or has no row of names.
  explicit CsvFile(const std::filesystem::path& path);

  const std::vector<std::string>& names() const { return names_; }
  std::optional<std::size_t> find(std::string_view name) const;
  std::size_t header_line() const { return header_line_; }
  // The numbers of the line "# KEY: ..." before the names, separated by blanks or commas; none: no such line.
  // Throws LogRefused with file and line unless there are `count` finite ones.
  std::optional<std::vector<double>> header(std::string_view key, std::size_t count) const;

  struct Numbers {
    Eigen::MatrixXd values;          // rows x requested columns
    std::vector<std::size_t> lines;  // of each row
    std::vector<std::string> warnings;
  };
  // Throws LogRefused with file and line for a cell that is not a finite number and for a row of another
  // length. An incomplete last row (its writer was stopped) is left out with a warning.
  Numbers read(const std::vector<std::size_t>& requested) const;

 private:
  std::string path_, text_;
  char separator_ = ',';
  std::vector<std::string> names_;
  std::size_t header_line_ = 0;
  std::size_t first_row_ = 0;  // offset in text_
};

}  // namespace multipanda
