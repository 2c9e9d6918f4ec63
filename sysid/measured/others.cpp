// Recordings of other programs: read by sysid/measured/others.py, and written as logs of multipanda.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <tuple>

#include "common/own_files.hpp"
#include "common/process.hpp"
#include "common/text.hpp"
#include "logs/mcap_reader.hpp"
#include "logs/mcap_writer.hpp"
#include "logs/messages.hpp"
#include "sysid/measured/measured_log.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;

class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string pattern = (fs::temp_directory_path() / "multipanda_read_XXXXXX").string();
    if (mkdtemp(pattern.data()) == nullptr) throw LogRefused(pattern + ": the folder cannot be made");
    path = pattern;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  fs::path path;
};

}  // namespace

std::vector<MeasuredLog> read_others(const fs::path& path, const MeasuredLogOptions& options) {
  const TemporaryFolder folder;
  const fs::path script = share_folder() / "sysid/measured/others.py";
  // -E: keeps PYTHONPATH of a sourced ROS 2 from hiding the interpreter's packages.
  const ProgramResult done =
      run_program(page_python(), {"-E", "-B", script.string(), path.string(), folder.path.string()});
  if (!done.good()) {
    const std::string said(trimmed(done.output + done.reason));
    throw LogRefused(path.string() + ": " + (said.empty() ? "no output of " + script.string() : said));
  }
  std::vector<fs::path> tables;
  for (const auto& entry : fs::directory_iterator(folder.path)) tables.push_back(entry.path());
  std::ranges::sort(tables);
  std::vector<MeasuredLog> logs;
  std::string names;
  for (const fs::path& table : tables) {
    const std::string arm = table.stem() == "-" ? "" : table.stem().string();
    names += (names.empty() ? "" : ", ") + arm;
    if (!options.arm.empty() && !arm.empty() && arm != options.arm) continue;
    try {
      logs.push_back(read_csv(table, options));
    } catch (const LogRefused& error) {  // names the table, which the user never sees
      std::string text = error.what();
      throw LogRefused(text.replace(0, table.string().size(), path.string()));
    }
    logs.back().source = path.string();
    logs.back().arm = arm;
    logs.back().lines.clear();
  }
  if (logs.empty())
    throw std::invalid_argument(path.string() + " has no arm '" + options.arm + "'; expected one of " +
                                names);
  return logs;
}

bool is_own_log(const fs::path& path) {
  try {
    McapReader reader(path);
    const auto first = reader.next();
    return !first || first->schema->name.starts_with("multipanda_msgs/");
  } catch (const std::runtime_error&) {  // compressed, or another kind of file
    return false;
  }
}

void write_own_log(std::span<const MeasuredLog> logs, const fs::path& path) {
  std::vector<std::tuple<double, std::size_t, Eigen::Index>> order;  // time, log, row
  for (std::size_t i = 0; i < logs.size(); ++i) {
    for (Eigen::Index k = 0; k < logs[i].samples(); ++k) order.emplace_back(logs[i].t[k], i, k);
  }
  std::ranges::sort(order);
  McapWriter writer(path);
  writer.add(mcap::Metadata{"run", {{"scene", logs.front().source}}});
  std::vector<std::uint16_t> channels;
  std::vector<msg::ArmState> states(logs.size());
  for (std::size_t i = 0; i < logs.size(); ++i) {
    states[i].arm = logs[i].arm.empty() ? "arm" : logs[i].arm;
    channels.push_back(writer.add_channel<msg::ArmState>("/" + states[i].arm + "/state"));
  }
  for (const auto& [t, i, k] : order) {
    const auto at = [k = k](const Eigen::MatrixXd& values) {
      const Eigen::VectorXd row = values.rows() > 0 ? Eigen::VectorXd(values.row(k)) : Eigen::VectorXd();
      return std::vector<double>(row.begin(), row.end());
    };
    const MeasuredLog& log = logs[i];
    msg::ArmState& state = states[i];
    const auto ns = static_cast<std::int64_t>(std::llround(1e9 * (t - std::get<0>(order.front()))));
    state.stamp.sec = static_cast<std::int32_t>(ns / 1'000'000'000);
    state.stamp.nanosec = static_cast<std::uint32_t>(ns % 1'000'000'000);
    state.robot_time_ns = ns;
    state.cycle = ++state.sequence;
    state.q = at(log.q), state.dq = at(log.dq), state.tau_j = at(log.tau);
    state.tau_j_d = at(log.tau_d), state.tau_ext = at(log.tau_ext);
    writer.write(channels[i], ns, state);
  }
  if (const auto& status = writer.close(); !status.error.empty())
    throw std::runtime_error(path.string() + ": " + status.error);
}

}  // namespace multipanda
