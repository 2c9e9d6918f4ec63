#include "backends/replay/replay_backend.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <stdexcept>

#include "logs/cdr.hpp"
#include "logs/mcap_reader.hpp"
#include "logs/messages.hpp"

namespace multipanda {
namespace {

JointVector joints(const std::vector<double>& values) {
  if (values.size() > kMaxJoints) throw std::runtime_error("a recorded arm has more joints than supported");
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

Pose pose(const msg::Pose& m) {
  const auto& q = m.orientation;
  return Pose::from({m.position.x, m.position.y, m.position.z}, Quaternion(q.w, q.x, q.y, q.z));
}

Wrench wrench(const msg::Wrench& m) {
  Wrench w;
  w.vector << m.force.x, m.force.y, m.force.z, m.torque.x, m.torque.y, m.torque.z;
  return w;
}

Load load(double mass, const msg::Point& center, const std::array<double, 6>& I) {
  Load load{.mass = mass, .p_FC = {center.x, center.y, center.z}};
  load.inertia_C << I[0], I[1], I[2], I[1], I[3], I[4], I[2], I[4], I[5];
  return load;
}

// The data of one cycle of the log, collected from its messages.
struct Recorded {
  LoopTime t;
  std::map<std::string, msg::ArmState> states;
  std::map<std::string, msg::ArmCommand> commands;
  std::map<std::string, msg::ArmWrench> wrenches;
  std::map<std::string, msg::ArmConfig> configs;
};

// A log recorded with fewer states or commands would be replayed in jumps.
void check_whole(const std::filesystem::path& log, const McapReader& reader) {
  for (const auto& metadata : reader.metadata()) {
    const auto every = metadata.values.find("log_every");
    if (metadata.name != "run" || every == metadata.values.end()) continue;
    if (every->second.find("state=") == std::string::npos &&
        every->second.find("command=") == std::string::npos)
      continue;
    throw std::runtime_error(log.string() + ": it was recorded with --log-every " + every->second +
                             "; replaying needs the state and command of every cycle");
  }
}

std::map<std::uint64_t, Recorded> gather(const std::filesystem::path& log) {
  std::map<std::uint64_t, Recorded> cycles;
  McapReader reader(log);
  while (const auto message = reader.next()) {
    const std::string& type = message->schema->name;
    const auto take = [&]<typename M>(std::map<std::string, M> Recorded::*where) {
      M decoded = from_cdr<M>(message->data);
      (cycles[decoded.cycle].*where)[decoded.arm] = std::move(decoded);
    };
    if (type == msg::ArmState::kType) {
      auto state = from_cdr<msg::ArmState>(message->data);
      auto& cycle = cycles[state.cycle];
      cycle.t.ns = std::int64_t{state.stamp.sec} * 1'000'000'000 + state.stamp.nanosec;
      cycle.states[state.arm] = std::move(state);
    } else if (type == msg::ArmCommand::kType) {
      take(&Recorded::commands);
    } else if (type == msg::ArmWrench::kType) {
      take(&Recorded::wrenches);
    } else if (type == msg::ArmConfig::kType) {
      take(&Recorded::configs);
    }
  }
  check_whole(log, reader);
  return cycles;
}

ArmState arm_state(const msg::ArmState& m) {
  ArmState state;
  state.sequence = m.sequence;
  state.t_robot.ns = m.robot_time_ns;
  state.q = joints(m.q);
  state.dq = joints(m.dq);
  state.tau_J = joints(m.tau_j);
  state.tau_J_d = joints(m.tau_j_d);
  state.tau_ext_hat = joints(m.tau_ext);
  state.mode = static_cast<ArmMode>(m.mode);
  state.errors = m.errors;
  state.config_version = m.config_version;
  state.command_success_rate = m.command_success_rate;
  state.gripper = {.present = m.has_gripper,
                   .width = m.gripper_width,
                   .max_width = m.gripper_max_width,
                   .grasped = m.gripper_grasped,
                   .moving = m.gripper_moving};
  return state;
}

}  // namespace

ReplayBackend::ReplayBackend(const std::filesystem::path& log, std::vector<Arm> arms, bool paced,
                             std::function<void(const std::string&)> report)
    : arms_(std::move(arms)), paced_(paced), report_(std::move(report)) {
  std::vector<std::uint32_t> version(arms_.size(), 0);
  std::vector<bool> seen(arms_.size(), false);
  for (auto& [number, recorded] : gather(log)) {
    Cycle cycle{.t = recorded.t, .due = {}, .states = {}, .commands = {}};
    for (ArmIndex i = 0; i < arms_.size(); ++i) {
      Arm& arm = arms_[i];
      const auto found = recorded.states.find(arm.name);
      const auto command = recorded.commands.find(arm.name);
      if (found == recorded.states.end() || command == recorded.commands.end()) break;
      ArmState state = arm_state(found->second);
      const auto config = recorded.configs.find(arm.name);
      if (seen[i] && state.config_version != version[i] && config != recorded.configs.end()) {
        const auto& m = config->second;
        arm.frames = {pose(m.end_effector), pose(m.stiffness)};
        arm.tool = load(m.tool_mass, m.tool_center, m.tool_inertia);
        arm.load = load(m.load_mass, m.load_center, m.load_inertia);
      }
      seen[i] = true;
      version[i] = state.config_version;
      state.frames = arm.frames;
      state.tool = arm.tool;
      state.load = arm.load;
      if (const auto w = recorded.wrenches.find(arm.name); w != recorded.wrenches.end()) {
        state.has_wrench_estimate = w->second.has_estimate;
        state.F_K_W_est = wrench(w->second.estimated);
        state.has_contact_truth = w->second.has_contact_truth;
        state.F_K_W_true = wrench(w->second.contact);
      }
      if (command->second.due) cycle.due |= ArmSet::of(i);
      cycle.states.push_back(std::move(state));
      cycle.commands.push_back(joints(command->second.tau_cmd));
    }
    if (cycle.states.size() == arms_.size() && !cycle.due.empty()) cycles_.push_back(std::move(cycle));
  }
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    if (!seen[i])
      throw std::runtime_error(log.string() + ": it has no states of arm '" + arms_[i].name + "'");
  }
  if (cycles_.empty())
    throw std::runtime_error(log.string() + ": no cycle has states and commands of every arm");
}

void ReplayBackend::finish() {
  if (!report_) return;
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(),
                "replay: %zu commands, largest difference from the recorded torques %.3g N m", compared_,
                largest_difference_);
  report_(text.data());
}

Capabilities ReplayBackend::capabilities(ArmIndex arm) const {
  const ArmState& first = cycles_.front().states[arm];
  return {.simulated = true,
          .lockstep = true,
          .has_external_torque = first.tau_ext_hat.size() > 0,
          .has_contact_truth = first.has_contact_truth,
          .every_command_arrives = true};
}

ArmSet ReplayBackend::wait() {
  if (begun_) ++position_;
  begun_ = true;
  if (position_ >= cycles_.size()) {
    position_ = cycles_.size() - 1;
    return {};
  }
  if (paced_) pacer_.wait();
  return cycles_[position_].due;
}

void ReplayBackend::read(ArmSet due, std::span<ArmState> states) {
  const Cycle& cycle = cycles_[position_];
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    if (due.contains(i)) states[i] = cycle.states[i];
  }
}

void ReplayBackend::write(ArmSet due, std::span<const ArmCommand> commands) {
  const Cycle& cycle = cycles_[position_];
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    if (!due.contains(i)) continue;
    const double difference = (commands[i].tau_cmd - cycle.commands[i]).lpNorm<Eigen::Infinity>();
    // False for NaN.
    if (!(difference <= largest_difference_)) largest_difference_ = difference;
    ++compared_;
  }
}

std::future<RequestAnswer> ReplayBackend::request(ArmIndex, ArmRequest) {
  return refuse_request("a recording cannot be changed: this request needs a simulated or real arm");
}

}  // namespace multipanda
