#include "sysid/measured/measured_log.hpp"

#include <algorithm>
#include <array>
#include <cctype>

#include <yaml-cpp/yaml.h>

#include "core/types/statistics.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;

// A bag of rosbag2 is a folder with its description.
bool is_log(const fs::path& path) {
  if (fs::is_directory(path)) return fs::exists(path / "log.mcap") || fs::exists(path / "metadata.yaml");
  constexpr std::array kKinds{".mcap", ".csv", ".npz", ".npy", ".db3", ".bag"};
  return std::ranges::find(kKinds, path.extension()) != kKinds.end();
}

// "run_2" before "run_10".
bool before(const fs::path& a, const fs::path& b) {
  const std::string x = a.string(), y = b.string();
  std::size_t i = 0, j = 0;
  const auto digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  while (i < x.size() && j < y.size()) {
    if (digit(x[i]) && digit(y[j])) {
      std::size_t iend = i, jend = j;
      while (iend < x.size() && digit(x[iend])) ++iend;
      while (jend < y.size() && digit(y[jend])) ++jend;
      while (i + 1 < iend && x[i] == '0') ++i;
      while (j + 1 < jend && y[j] == '0') ++j;
      if (iend - i != jend - j) return iend - i < jend - j;
      if (const int order = x.compare(i, iend - i, y, j, jend - j); order != 0) return order < 0;
      i = iend, j = jend;
    } else if (x[i] != y[j]) {
      return x[i] < y[j];
    } else {
      ++i, ++j;
    }
  }
  return x.size() - i < y.size() - j;
}

}  // namespace

double MeasuredLog::period() const {
  if (samples() < 2) return 0;
  const Eigen::VectorXd steps = t.tail(samples() - 1) - t.head(samples() - 1);
  return median({steps.data(), static_cast<std::size_t>(steps.size())});
}

Eigen::MatrixXd MeasuredLog::control_error() const {
  if (tau.rows() == 0 || tau_d.rows() == 0 || gravity.rows() == 0) return {};
  return tau_d - (tau - gravity);
}

std::vector<MeasuredLog> read_measured(const fs::path& given, const MeasuredLogOptions& options) {
  const bool run = fs::is_directory(given) && !fs::exists(given / "metadata.yaml");
  const fs::path path = run ? given / "log.mcap" : given;
  if (!fs::exists(path)) {
    throw LogRefused(path.string() +
                     ": no such file; expected a log (.mcap, .csv, .npz, .db3, .bag) or the folder of a run");
  }
  const bool own = path.extension() == ".mcap" && is_own_log(path);
  if (own && !options.columns.empty())
    throw LogRefused(path.string() + ": a column map does not apply to logs of multipanda; remove --columns");
  std::vector<MeasuredLog> logs;
  if (own || path.extension() == ".csv") {
    logs = own ? read_mcap(path, options) : std::vector{read_csv(path, options)};
  } else {
    logs = read_others(path, options);
  }
  if (logs.size() == 1 && logs.front().arm.empty()) logs.front().arm = options.arm;
  for (MeasuredLog& log : logs) check_measured(log, options.refuse_above_gap_s);
  return logs;
}

ColumnMap read_column_map(const std::string& given) {
  ColumnMap map;
  if (given.empty()) return map;
  if (!given.ends_with(".yaml") && !given.ends_with(".yml")) {
    for (std::size_t begin = 0; begin <= given.size();) {
      const std::size_t end = std::min(given.find(',', begin), given.size());
      const std::string pair = given.substr(begin, end - begin);
      const std::size_t equals = pair.find('=');
      if (equals == std::string::npos || equals == 0 || equals + 1 == pair.size())
        throw LogRefused("column map: found '" + pair +
                         "', expected OURS=THEIRS (q=position_{},t=time) or a YAML file");
      map[pair.substr(0, equals)] = pair.substr(equals + 1);
      begin = end + 1;
    }
    return map;
  }
  const auto place = [&](const YAML::Mark& mark) {
    return given + ":" + std::to_string(mark.line + 1) + ": ";
  };
  try {
    const YAML::Node root = YAML::LoadFile(given);
    if (!root.IsMap())
      throw LogRefused(place(root.Mark()) +
                       "expected a mapping of our names to the file's, such as 't: time'");
    for (const auto& entry : root) {
      if (!entry.second.IsScalar())
        throw LogRefused(place(entry.second.Mark()) + "expected the name of a column after '" +
                         entry.first.as<std::string>() + "'");
      map[entry.first.as<std::string>()] = entry.second.as<std::string>();
    }
  } catch (const YAML::BadFile&) {
    throw LogRefused(given + ": cannot be opened; check the path");
  } catch (const YAML::Exception& error) {
    throw LogRefused(place(error.mark) + error.msg);
  }
  return map;
}

std::vector<fs::path> find_repeats(const fs::path& path) {
  if (fs::is_regular_file(path) || (fs::is_directory(path) && is_log(path))) return {path};
  if (!fs::is_directory(path)) throw LogRefused(path.string() + ": no such file or folder");
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(path)) {
    if (is_log(entry.path())) found.push_back(entry.path());
  }
  if (found.empty()) {
    throw LogRefused(path.string() +
                     ": contains no log; expected *.mcap, *.csv, *.npz, *.db3, *.bag or folders of runs");
  }
  std::sort(found.begin(), found.end(), before);
  return found;
}

}  // namespace multipanda
