#include "sysid/measured/csv_file.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>

#include "sysid/measured/measured_log.hpp"

namespace multipanda {
namespace {

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t' || text.back() == '\r'))
    text.remove_suffix(1);
  return text;
}

// The cells of one line; text in quotes is one cell, whatever it contains.
void split(std::string_view line, char separator, std::vector<std::string_view>& cells) {
  cells.clear();
  std::size_t begin = 0;
  bool quoted = false;
  for (std::size_t i = 0; i <= line.size(); ++i) {
    if (i < line.size() && line[i] == '"') quoted = !quoted;
    if (i < line.size() && (quoted || line[i] != separator)) continue;
    std::string_view cell = trimmed(line.substr(begin, i - begin));
    if (cell.size() >= 2 && cell.front() == '"' && cell.back() == '"') cell = cell.substr(1, cell.size() - 2);
    cells.push_back(cell);
    begin = i + 1;
  }
}

// from_chars knows no leading plus sign.
bool as_number(std::string_view cell, double& value) {
  if (!cell.empty() && cell.front() == '+') cell.remove_prefix(1);
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  return error == std::errc() && end == cell.data() + cell.size();
}

struct Line {
  std::string_view text;
  std::size_t number = 0;  // in the file, from 1
  bool last_and_open = false;
};

class Lines {
 public:
  Lines(std::string_view text, std::size_t number) : text_(text), number_(number) {}
  // The next one that is neither empty nor a comment.
  std::optional<Line> next() {
    while (position_ < text_.size()) {
      const std::size_t end = text_.find('\n', position_);
      const bool open = end == std::string_view::npos;
      const std::string_view line = text_.substr(position_, open ? end : end - position_);
      position_ = open ? text_.size() : end + 1;
      ++number_;
      const std::string_view content = trimmed(line);
      if (!content.empty() && content.front() != '#') return Line{content, number_, open};
    }
    return std::nullopt;
  }
  std::size_t position() const { return position_; }

 private:
  std::string_view text_;
  std::size_t position_ = 0, number_;
};

}  // namespace

CsvFile::CsvFile(const std::filesystem::path& path) : path_(path.string()) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw LogRefused(path_ + ": cannot be opened: check the path");
  text_.assign(std::istreambuf_iterator<char>(file), {});
  if (text_.starts_with("\xEF\xBB\xBF")) text_.erase(0, 3);  // byte order mark
  Lines lines(text_, 0);
  const auto header = lines.next();
  if (!header) throw LogRefused(path_ + ": the file is empty");
  header_line_ = header->number;
  first_row_ = lines.position();
  const auto count = [&](char c) { return std::count(header->text.begin(), header->text.end(), c); };
  if (count(';') > count(separator_)) separator_ = ';';
  if (count('\t') > count(separator_)) separator_ = '\t';
  std::vector<std::string_view> cells;
  split(header->text, separator_, cells);
  names_.assign(cells.begin(), cells.end());
  double number = 0;
  if (std::all_of(cells.begin(), cells.end(), [&](auto cell) { return as_number(cell, number); })) {
    throw LogRefused(path_ + ":" + std::to_string(header_line_) + ": the first row has " +
                     std::to_string(cells.size()) +
                     " numbers where the columns' names are expected: put a row of names first, for seven "
                     "joints t,q1,...,q7,dq1,...,dq7,tau1,...,tau7");
  }
}

std::optional<std::size_t> CsvFile::find(std::string_view name) const {
  const auto found = std::find(names_.begin(), names_.end(), name);
  if (found == names_.end()) return std::nullopt;
  return static_cast<std::size_t>(found - names_.begin());
}

std::optional<std::vector<double>> CsvFile::header(std::string_view key, std::size_t count) const {
  std::string_view rest(text_);
  for (std::size_t number = 1; number < header_line_; ++number) {
    const std::size_t end = rest.find('\n');
    std::string_view line = trimmed(rest.substr(0, end));
    rest.remove_prefix(end + 1);
    if (line.empty() || line.front() != '#') continue;
    line = trimmed(line.substr(1));
    if (!line.starts_with(key)) continue;
    line = trimmed(line.substr(key.size()));
    if (line.empty() || line.front() != ':') continue;
    std::string text(line.substr(1));
    std::replace(text.begin(), text.end(), ',', ' ');
    std::vector<double> values;
    bool good = true;
    for (std::string_view left = trimmed(text); good && !left.empty();) {
      const std::string_view cell = left.substr(0, left.find_first_of(" \t"));
      good = as_number(cell, values.emplace_back()) && std::isfinite(values.back());
      left = trimmed(left.substr(cell.size()));
    }
    if (good && values.size() == count) return values;
    throw LogRefused(path_ + ":" + std::to_string(number) + ": found '" + std::string(key) + ":" + text +
                     "', expected " + std::to_string(count) + " numbers");
  }
  return std::nullopt;
}

CsvFile::Numbers CsvFile::read(const std::vector<std::size_t>& requested) const {
  Numbers out;
  std::vector<double> flat;
  Lines lines(std::string_view(text_).substr(first_row_), header_line_);
  std::vector<std::string_view> cells;
  while (const auto line = lines.next()) {
    const std::string place = path_ + ":" + std::to_string(line->number) + ": ";
    split(line->text, separator_, cells);
    if (cells.size() != names_.size()) {
      const std::string what = std::to_string(cells.size()) +
                               " cells, expected as many as names: " + std::to_string(names_.size());
      if (!line->last_and_open || cells.size() > names_.size()) throw LogRefused(place + what);
      out.warnings.push_back("line " + std::to_string(line->number) + ", the last one, is incomplete (" +
                             what + ") and is left out");
      break;
    }
    for (const std::size_t column : requested) {
      double value = 0;
      if (!as_number(cells[column], value)) {
        throw LogRefused(place + "column '" + names_[column] + "': found '" + std::string(cells[column]) +
                         "', expected a number; correct or remove this row");
      }
      if (!std::isfinite(value)) {
        throw LogRefused(place + "column '" + names_[column] + "' is " + std::string(cells[column]) +
                         "; expected a finite number: cut the log before or after this row");
      }
      flat.push_back(value);
    }
    out.lines.push_back(line->number);
  }
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  out.values = Eigen::Map<const RowMajor>(flat.data(), static_cast<Eigen::Index>(out.lines.size()),
                                          static_cast<Eigen::Index>(requested.size()));
  return out;
}

}  // namespace multipanda
