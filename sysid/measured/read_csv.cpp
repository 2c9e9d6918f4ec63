#include "sysid/measured/read_csv.hpp"

#include <array>
#include <charconv>
#include <set>

#include "core/types/spatial.hpp"
#include "sysid/measured/csv_file.hpp"

namespace multipanda {
namespace {

// A family of columns. `size` 0: one column per joint.
struct Family {
  const char* name;
  Eigen::MatrixXd MeasuredLog::*into;
  std::size_t size;
  const char*
      libfranka;       // before [0], [1], ...: franka::logToCSV (src/log.cpp of libfranka); null: not there
  const char* tables;  // before _1, _2, ... of `export --csv`; null: not there
  const char* unit;    // at the end of those names
};
constexpr std::array<Family, 9> kFamilies{{
    {"q", &MeasuredLog::q, 0, "state.q", "q", "_rad"},
    {"dq", &MeasuredLog::dq, 0, "state.dq", "dq", "_rad_per_s"},
    {"tau", &MeasuredLog::tau, 0, "state.tau_J", "tau_j", "_nm"},
    {"tau_d", &MeasuredLog::tau_d, 0, nullptr, "tau_j_d", "_nm"},
    {"tau_cmd", &MeasuredLog::tau_cmd, 0, "cmd.tau_J_d", nullptr, nullptr},
    {"gravity", &MeasuredLog::gravity, 0, nullptr, nullptr, nullptr},
    {"x_EE", &MeasuredLog::x_EE, 3, nullptr, nullptr, nullptr},
    {"quat_EE", &MeasuredLog::quat_EE, 4, nullptr, nullptr, nullptr},
    {"F_EE", &MeasuredLog::F_EE, 6, nullptr, nullptr, nullptr},
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
    const auto exported = plain("t_s", 1.0);
    return exported ? exported : plain("t", 1.0);
  }

  // Column k, from 0, of a family.
  std::optional<SourceColumn> of(const Family& family, std::size_t k) {
    if (const auto mapped = from_map(family.name + std::to_string(k + 1))) return mapped;
    if (const auto mapped = from_map(family.name, k)) return mapped;
    if (const auto ours = plain(family.name + std::to_string(k + 1), 1.0)) return ours;
    if (family.libfranka != nullptr) {
      if (const auto found = plain(std::string(family.libfranka) + "[" + std::to_string(k) + "]", 1.0))
        return found;
    }
    if (family.tables == nullptr) return std::nullopt;
    const std::string name = std::string(family.tables) + "_";
    if (const auto found = plain(name + std::to_string(k + 1) + family.unit, 1.0)) return found;
    return plain(name + std::to_string(k), 1.0);  // as exported before names had units
  }

  // Throws for entries of the map that were not used.
  void check_map_used() const {
    for (const auto& [ours, theirs] : map_) {
      if (used_.contains(ours)) continue;
      throw LogRefused(
          "column map: '" + ours +
          "' is not a known name: expected t, or q, dq, tau, tau_d, tau_cmd, gravity, x_EE, quat_EE, "
          "F_EE with a number from 1 (q1), or without one and {} in the file's name (q=pos_{})");
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

// Column k of several families: where each number belongs.
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
