#include <algorithm>
#include <map>
#include <optional>
#include <type_traits>

#include "logs/cdr.hpp"
#include "logs/mcap_reader.hpp"
#include "logs/messages.hpp"
#include "scene/build.hpp"
#include "sysid/measured/measured_log.hpp"
#include "sysid/measured/scene_model.hpp"

namespace multipanda {
namespace {

using Numbers = std::vector<double>;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Pose pose(const msg::Pose& m) {
  const auto& q = m.orientation;
  return Pose::from({m.position.x, m.position.y, m.position.z}, Quaternion(q.w, q.x, q.y, q.z));
}

Load load(double mass, const msg::Point& center, const std::array<double, 6>& I) {
  Load load{.mass = mass, .p_FC = {center.x, center.y, center.z}};
  load.inertia_C << I[0], I[1], I[2], I[1], I[3], I[4], I[2], I[4], I[5];
  return load;
}

void append(Numbers& out, const Numbers& values) { out.insert(out.end(), values.begin(), values.end()); }

// One arm's samples in the order of the log.
struct ArmRows {
  std::size_t joints = 0;
  Numbers t, robot_time, q, dq, tau, tau_d, tau_ext, tau_cmd, F_est, F_true;
  std::vector<std::uint64_t> cycle;
  std::vector<bool> commanded, wrench;  // whether the cycle's other messages are present
  std::vector<ConfigFrom> configs;
  std::uint64_t sequence = 0, stale = 0, with_errors = 0;
  bool any_command = false, any_estimate = false, any_truth = false, no_tau_d = false, no_tau_ext = false;

  Eigen::Index rows() const { return static_cast<Eigen::Index>(t.size()); }
  bool at(std::uint64_t number) const { return !cycle.empty() && cycle.back() == number; }
};

void take(const msg::ArmState& state, ArmRows& arm) {
  // A cycle without a new packet repeats the last state, which is not a measurement.
  if (state.sequence == arm.sequence) {
    ++arm.stale;
    return;
  }
  arm.sequence = state.sequence;
  arm.joints = state.q.size();
  arm.t.push_back(state.stamp.sec + 1e-9 * state.stamp.nanosec);
  arm.robot_time.push_back(1e-9 * static_cast<double>(state.robot_time_ns));
  arm.cycle.push_back(state.cycle);
  arm.commanded.push_back(false);
  arm.wrench.push_back(false);
  if (state.errors != 0) ++arm.with_errors;
  append(arm.q, state.q);
  append(arm.dq, state.dq);
  append(arm.tau, state.tau_j);
  arm.no_tau_d = arm.no_tau_d || state.tau_j_d.size() != arm.joints;
  append(arm.tau_d, arm.no_tau_d ? Numbers(arm.joints) : state.tau_j_d);
  arm.no_tau_ext = arm.no_tau_ext || state.tau_ext.size() != arm.joints;
  append(arm.tau_ext, arm.no_tau_ext ? Numbers(arm.joints) : state.tau_ext);
  // Missing values keep their row, so that row k is the same sample in every series.
  append(arm.tau_cmd, Numbers(arm.joints));
  append(arm.F_est, Numbers(6));
  append(arm.F_true, Numbers(6));
}

void put_last(Numbers& out, const Numbers& values) {
  std::copy(values.begin(), values.end(), out.end() - static_cast<std::ptrdiff_t>(values.size()));
}

void take(const msg::ArmCommand& command, ArmRows& arm) {
  if (!arm.at(command.cycle) || command.tau_cmd.size() != arm.joints) return;
  put_last(arm.tau_cmd, command.tau_cmd);
  arm.commanded.back() = arm.any_command = true;
}

Numbers numbers(const msg::Wrench& F) {
  return {F.force.x, F.force.y, F.force.z, F.torque.x, F.torque.y, F.torque.z};
}

void take(const msg::ArmWrench& wrench, ArmRows& arm) {
  if (!arm.at(wrench.cycle)) return;
  arm.wrench.back() = true;
  if (wrench.has_estimate) put_last(arm.F_est, numbers(wrench.estimated)), arm.any_estimate = true;
  if (wrench.has_contact_truth) put_last(arm.F_true, numbers(wrench.contact)), arm.any_truth = true;
}

void take(const msg::ArmConfig& config, ArmRows& arm) {
  arm.configs.push_back({arm.rows(),
                         {pose(config.end_effector), pose(config.stiffness)},
                         load(config.tool_mass, config.tool_center, config.tool_inertia),
                         load(config.load_mass, config.load_center, config.load_inertia)});
}

struct Gathered {
  std::map<std::string, ArmRows> arms;
  std::string scene_text, scene_path;
  std::vector<std::string> notes;
};

Gathered gather(const std::filesystem::path& path) {
  Gathered all;
  McapReader reader(path);
  while (const auto message = reader.next()) {
    const auto take_as = [&]<typename M>(std::type_identity<M>) {
      if (!holds<M>(*message->schema)) return;
      const M decoded = from_cdr<M>(message->data);
      take(decoded, all.arms[decoded.arm]);
    };
    take_as(std::type_identity<msg::ArmState>{});
    take_as(std::type_identity<msg::ArmCommand>{});
    take_as(std::type_identity<msg::ArmWrench>{});
    take_as(std::type_identity<msg::ArmConfig>{});
  }
  for (const auto& metadata : reader.metadata()) {
    if (metadata.name != "run") continue;
    if (const auto found = metadata.values.find("scene_path"); found != metadata.values.end())
      all.scene_path = found->second;
  }
  for (const auto& attachment : reader.attachments()) {
    if (attachment.name == "scene.yaml") all.scene_text = attachment.data;
  }
  if (!reader.complete())
    all.notes.emplace_back(
        "the log has no footer (killed, or the disk was full): read up to its last complete chunk");
  if (reader.damaged_records() > 0)
    all.notes.push_back(std::to_string(reader.damaged_records()) + " damaged records are left out");
  return all;
}

Eigen::MatrixXd chosen(const Numbers& flat, std::size_t width, const std::vector<Eigen::Index>& rows) {
  const auto all = Eigen::Map<const RowMajor>(flat.data(), static_cast<Eigen::Index>(flat.size() / width),
                                              static_cast<Eigen::Index>(width));
  return all(rows, Eigen::all);
}

// The arm's own clock, if packets reached the loop with jitter: the arm samples evenly, while stamps are
// times of the loop. In lock-step both are the same.
void use_robot_time(const Eigen::VectorXd& robot_time, MeasuredLog& log) {
  const Eigen::VectorXd t = (robot_time.array() - robot_time[0]) + log.t[0];
  const double apart = (t - log.t).cwiseAbs().maxCoeff();
  if (apart < 1e-6 || apart > 0.1) return;
  log.t = t;
}

MeasuredLog assemble(const std::string& name, ArmRows& arm, const Gathered& all, const std::string& source) {
  MeasuredLog log;
  log.source = source;
  log.arm = name;
  log.warnings = all.notes;
  log.scene_text = all.scene_text;
  log.scene_path = all.scene_path;

  const bool any_wrench = arm.any_estimate || arm.any_truth;
  std::vector<Eigen::Index> rows;
  for (std::size_t k = 0; k < arm.t.size(); ++k) {
    if ((arm.any_command && !arm.commanded[k]) || (any_wrench && !arm.wrench[k])) continue;
    rows.push_back(static_cast<Eigen::Index>(k));
  }
  if (rows.empty()) return log;
  const auto warn = [&](std::uint64_t count, const std::string& what) {
    if (count > 0) log.warnings.push_back(std::to_string(count) + what);
  };
  warn(arm.cycle.back() - arm.cycle.front() + 1 - arm.t.size() - arm.stale,
       " cycles are missing: the writer fell behind");
  warn(arm.t.size() - rows.size(), " cycles lack their command or wrench and are left out");
  warn(arm.stale, " cycles had no new packet of the arm and are left out");
  warn(arm.with_errors, " cycles with an error of the arm");

  log.t = chosen(arm.t, 1, rows);
  if (rows.size() > 1) use_robot_time(chosen(arm.robot_time, 1, rows), log);
  const std::size_t n = arm.joints;
  log.q = chosen(arm.q, n, rows);
  log.dq = chosen(arm.dq, n, rows);
  log.tau = chosen(arm.tau, n, rows);
  if (!arm.no_tau_d) log.tau_d = chosen(arm.tau_d, n, rows);
  if (!arm.no_tau_ext) log.tau_ext = chosen(arm.tau_ext, n, rows);
  if (arm.any_command) log.tau_cmd = chosen(arm.tau_cmd, n, rows);
  if (arm.any_estimate) log.F_EE = chosen(arm.F_est, 6, rows);
  if (arm.any_truth) log.F_true = chosen(arm.F_true, 6, rows);
  // A configuration applies from a row of the log on; count only the rows that were kept.
  for (ConfigFrom& config : arm.configs)
    config.sample = std::lower_bound(rows.begin(), rows.end(), config.sample) - rows.begin();
  return log;
}

void complete(MeasuredLog& log, const ArmRows& arm, const std::optional<Scene>& scene) {
  if (!scene) return;
  for (const SceneArm& candidate : scene->arms) {
    if (candidate.name != log.arm) continue;
    const auto model = build_arm_model(candidate);
    if (static_cast<Eigen::Index>(model->joint_count()) != log.joints()) continue;
    std::vector<ConfigFrom> configs = arm.configs;
    if (configs.empty() || configs.front().sample > 0) {
      const ArmConfig config = arm_config(candidate);
      configs.insert(configs.begin(), {0, config.frames, config.tool, config.load});
    }
    complete_from_model(log, model, configs);
    return;
  }
  log.warnings.emplace_back("no x_EE and no gravity: the scene in the log has no such arm");
}

}  // namespace

std::vector<MeasuredLog> read_mcap(const std::filesystem::path& path, const MeasuredLogOptions& options) {
  Gathered all;
  try {
    all = gather(path);
  } catch (const LogRefused&) {
    throw;
  } catch (const std::runtime_error& error) {  // not MCAP, damaged
    const std::string text = error.what();
    throw LogRefused(text.find(path.string()) == text.npos ? path.string() + ": " + text : text);
  }
  std::optional<Scene> scene;
  bool base_moves = false;
  if (all.arms.empty()) throw LogRefused(path.string() + ": no states of an arm in this log");
  try {
    scene = rebuild_scene(all.scene_text, all.scene_path);
  } catch (const CarriedArmRefused& error) {
    base_moves = true;
    all.notes.push_back(std::string("no x_EE, no gravity: ") + error.what());
  } catch (const std::exception& error) {
    all.notes.push_back(std::string("no x_EE, no gravity: the scene cannot be rebuilt: ") + error.what());
  }
  std::vector<MeasuredLog> logs;
  std::string names;
  for (auto& [name, arm] : all.arms) {
    names += (names.empty() ? "" : ", ") + name;
    if (!options.arm.empty() && name != options.arm) continue;
    MeasuredLog log = assemble(name, arm, all, path.string());
    if (log.samples() == 0) continue;
    log.base_moves = base_moves;
    complete(log, arm, scene);
    logs.push_back(std::move(log));
  }
  if (logs.empty() && !options.arm.empty() && !all.arms.contains(options.arm))
    throw std::invalid_argument(path.string() + " has no arm '" + options.arm + "'; expected one of " +
                                names);
  if (logs.empty()) throw LogRefused(path.string() + ": no complete cycle of arm " + names);
  return logs;
}

}  // namespace multipanda
