#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "common/text.hpp"
#include "core/types/spatial.hpp"
#include "sysid/measured/measured_log.hpp"

namespace multipanda {
namespace {

// A CSV file with one row of names. Cells are separated by commas, semicolons or tabs. Blanks around them are
// ignored, strings may be quoted, and lines beginning with # are left out, but those before the names
// may hold a value each, such as "# base_rpy_rad: 0 1.5708 0".
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

// from_chars does not accept a leading plus sign.
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

// A family of columns. `size` 0: one column per joint.
struct Family {
  const char* name;
  Eigen::MatrixXd MeasuredLog::*into;
  std::size_t size;
  // Prefix before [0], [1], ...: franka::logToCSV (src/log.cpp of libfranka); null: none.
  const char* libfranka;
  const char* field;   // its name in libfranka's RobotState, before 1, 2, ...; null: ours
  const char* tables;  // prefix before _1, _2, ... of `export --csv`; null: none
  const char* unit;    // suffix of those names
};
constexpr std::array<Family, 11> kFamilies{{
    {"q", &MeasuredLog::q, 0, "state.q", nullptr, "q", "_rad"},
    {"dq", &MeasuredLog::dq, 0, "state.dq", nullptr, "dq", "_rad_per_s"},
    {"tau", &MeasuredLog::tau, 0, "state.tau_J", "tau_J", "tau_j", "_nm"},
    {"tau_d", &MeasuredLog::tau_d, 0, nullptr, "tau_J_d", "tau_j_d", "_nm"},
    {"tau_cmd", &MeasuredLog::tau_cmd, 0, "cmd.tau_J_d", nullptr, nullptr, nullptr},
    {"gravity", &MeasuredLog::gravity, 0, nullptr, nullptr, nullptr, nullptr},
    {"tau_ext", &MeasuredLog::tau_ext, 0, "state.tau_ext_hat_filtered", "tau_ext_hat_filtered", "tau_ext",
     "_nm"},
    {"x_EE", &MeasuredLog::x_EE, 3, nullptr, nullptr, nullptr, nullptr},
    {"quat_EE", &MeasuredLog::quat_EE, 4, nullptr, nullptr, nullptr, nullptr},
    {"F_EE", &MeasuredLog::F_EE, 6, nullptr, nullptr, nullptr, nullptr},
    {"contact", &MeasuredLog::contact, 1, nullptr, nullptr, nullptr, nullptr},
}};

struct SourceColumn {
  std::size_t column;
  double factor;
};

class Columns {
 public:
  Columns(const CsvFile& file, std::string path, const ColumnMap& map)
      : file_(file), path_(std::move(path)), map_(map) {}

  bool from_libfranka() const { return file_.find("state.q[0]").has_value(); }

  std::optional<SourceColumn> time() {
    if (const auto mapped = from_map("t")) return mapped;
    if (from_libfranka()) return plain("time", 1e-3);  // written in ms
    for (const char* name : {"t_s", "t", "time"}) {
      if (const auto found = plain(name, 1.0)) return found;
    }
    return std::nullopt;
  }

  // Column k, from 0, of a family.
  std::optional<SourceColumn> of(const Family& family, std::size_t k) {
    if (const auto mapped = from_map(family.name + std::to_string(k + 1))) return mapped;
    if (const auto mapped = from_map(family.name, k)) return mapped;
    for (const char* name : {family.name, family.field}) {
      if (name == nullptr) continue;
      if (const auto found = plain(family.size == 1 ? name : name + std::to_string(k + 1), 1.0)) return found;
    }
    if (family.libfranka != nullptr) {
      if (const auto found = plain(std::string(family.libfranka) + "[" + std::to_string(k) + "]", 1.0))
        return found;
    }
    if (family.tables == nullptr) return std::nullopt;
    return plain(std::string(family.tables) + "_" + std::to_string(k + 1) + family.unit, 1.0);
  }

  // Throws for unused entries of the map.
  void check_map_used() const {
    for (const auto& [ours, theirs] : map_) {
      if (used_.contains(ours)) continue;
      throw LogRefused(
          "column map: '" + ours +
          "' is not a known name: expected t, or q, dq, tau, tau_d, tau_cmd, gravity, tau_ext, x_EE, "
          "quat_EE, F_EE, contact with a number from 1 (q1), or without one and {} in the file's name "
          "(q=pos_{})");
    }
  }

 private:
  std::optional<SourceColumn> plain(const std::string& name, double factor) const {
    const auto column = file_.find(name);
    if (!column) return std::nullopt;
    return SourceColumn{*column, factor};
  }

  std::optional<SourceColumn> from_map(const std::string& ours, std::optional<std::size_t> k = std::nullopt) {
    const auto entry = map_.find(ours);
    if (entry == map_.end()) return std::nullopt;
    used_.insert(ours);
    std::string name = entry->second;
    double factor = 1.0;
    if (const std::size_t star = name.find(" * "); star != std::string::npos) {
      const std::string text = name.substr(star + 3);
      const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), factor);
      if (error != std::errc() || end != text.data() + text.size())
        throw LogRefused("column map: '" + ours + "': the factor '" + text + "' is not a number");
      name.resize(star);
    }
    for (const auto& [mark, first] : {std::pair{"{0}", std::size_t{0}}, std::pair{"{}", std::size_t{1}}}) {
      const std::size_t at = name.find(mark);
      if (at == std::string::npos || !k) continue;
      name.replace(at, std::string(mark).size(), std::to_string(*k + first));
      // The family ends where the file's columns end.
      if (*k > 0 && !file_.find(name)) return std::nullopt;
    }
    const auto found = plain(name, factor);
    if (!found) {
      throw LogRefused(path_ + ":" + std::to_string(file_.header_line()) + ": the column map looks for '" +
                       name + "' (our '" + ours + "'), which is not among the columns " + found_names(file_));
    }
    return found;
  }

 public:
  static std::string found_names(const CsvFile& file) {
    std::string list;
    for (std::size_t i = 0; i < file.names().size() && i < 30; ++i)
      list += (i > 0 ? "," : "") + file.names()[i];
    if (file.names().size() > 30) list += ",... (" + std::to_string(file.names().size()) + " columns)";
    return list;
  }

 private:
  const CsvFile& file_;
  std::string path_;
  const ColumnMap& map_;
  std::set<std::string> used_;
};

// Column k of several families: destination of each number.
struct Slot {
  Eigen::MatrixXd MeasuredLog::*into;
  Eigen::Index column;
  double factor;
};

}  // namespace

MeasuredLog read_csv(const std::filesystem::path& path, const MeasuredLogOptions& options) {
  const CsvFile file(path);
  Columns columns(file, path.string(), options.columns);
  const std::string place = path.string() + ":" + std::to_string(file.header_line()) + ": ";
  const std::string expected =
      "; expected t,q1,...,dq1,...,tau1,... for each joint; rename the columns or give a column "
      "map (--columns FILE.yaml or q=NAME_{},dq=...)";
  const auto time = columns.time();
  if (!time) throw LogRefused(place + "no column of time; found " + Columns::found_names(file) + expected);

  MeasuredLog log;
  log.source = path.string();
  if (const auto rpy = file.header("base_rpy_rad", 3))
    log.gravity_B = rotation_from_rpy({(*rpy)[0], (*rpy)[1], (*rpy)[2]}).transpose() * Vector3(0, 0, -9.81);
  std::vector<std::size_t> requested{time->column};
  std::vector<Slot> slots;
  std::size_t joints = 0;
  for (const Family& family : kFamilies) {
    std::size_t count = 0;
    while (family.size == 0 || count < family.size) {
      const auto found = columns.of(family, count);
      if (!found) break;
      requested.push_back(found->column);
      slots.push_back({family.into, static_cast<Eigen::Index>(count++), found->factor});
    }
    if (family.into == &MeasuredLog::q) joints = count;
    const std::size_t needed = family.size == 0 ? joints : family.size;
    const bool optional =
        family.into != &MeasuredLog::q &&
        !(options.needs_dynamics && (family.into == &MeasuredLog::dq || family.into == &MeasuredLog::tau));
    if (needed == 0 || (count == 0 && !optional)) {
      throw LogRefused(place + "no column " + family.name + "1; found " + Columns::found_names(file) +
                       expected);
    }
    if (count != 0 && count != needed) {
      throw LogRefused(place + std::to_string(count) + " columns of " + family.name + ", expected " +
                       std::to_string(needed) + (family.size == 0 ? ", as many as of q" : ""));
    }
  }
  columns.check_map_used();

  auto numbers = file.read(requested);
  log.warnings = std::move(numbers.warnings);
  log.lines = std::move(numbers.lines);
  const Eigen::Index rows = numbers.values.rows();
  log.t = numbers.values.col(0) * time->factor;
  for (std::size_t i = 0; i < slots.size(); ++i) {
    Eigen::MatrixXd& matrix = log.*slots[i].into;
    matrix.conservativeResize(rows, std::max(matrix.cols(), slots[i].column + 1));
    matrix.col(slots[i].column) = numbers.values.col(static_cast<Eigen::Index>(i) + 1) * slots[i].factor;
  }
  if (columns.from_libfranka()) {
    if (log.tau_cmd.size() > 0 && (log.tau_cmd.array() == 0).all()) {
      log.tau_cmd.resize(0, 0);
      log.warnings.emplace_back("all commanded torques are 0: the robot was moved by a motion generator");
    } else {
      // A record pairs each command with the following state, in which it is the torque in use
      // (franka/log.h).
      log.tau_d = log.tau_cmd;
    }
  }
  return log;
}

}  // namespace multipanda
