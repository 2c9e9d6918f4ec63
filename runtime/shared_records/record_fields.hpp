#pragma once

#include <cstdint>
#include <cstring>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "core/types/spatial.hpp"

// The numbers of a shared record, each of 8 bytes, declared once: the same functions list the fields and
// write them, so that table and memory cannot disagree.
namespace multipanda {

// What the thread that takes the records adds to an arm's sample.
struct ArmAddition {
  bool stopped = false;  // until it is resumed
  Intervention last_intervention = Intervention::none;
  Pose X_WE;
};

struct RecordField {
  std::string name;
  char type = 'f';         // f: 64 bit floating point; u, i: 64 bit integer
  std::size_t offset = 0;  // bytes from the begin of the record
  std::size_t count = 1;
};

// Lists the fields.
class FieldList {
 public:
  explicit FieldList(std::size_t offset) : offset_(offset) {}
  void prefix(const std::string& text) { prefix_ = text; }
  void number(const char* name, double /*value*/) { add(name, 'f', 1); }
  void count(const char* name, std::uint64_t /*value*/) { add(name, 'u', 1); }
  void time(const char* name, std::int64_t /*value*/) { add(name, 'i', 1); }
  void numbers(const std::string& name, std::span<const double> values) { add(name, 'f', values.size()); }

  std::size_t offset() const { return offset_; }
  std::vector<RecordField>& fields() { return fields_; }

 private:
  void add(const std::string& name, char type, std::size_t count) {
    fields_.push_back({prefix_ + name, type, offset_, count});
    offset_ += 8 * count;
  }
  std::size_t offset_;
  std::string prefix_;
  std::vector<RecordField> fields_;
};

// Writes them.
class FieldWriter {
 public:
  explicit FieldWriter(std::byte* at) : at_(at) {}
  void prefix(const std::string& /*text*/) {}
  void number(const char* /*name*/, double value) { put(&value, 8); }
  void count(const char* /*name*/, std::uint64_t value) { put(&value, 8); }
  void time(const char* /*name*/, std::int64_t value) { put(&value, 8); }
  void numbers(const std::string& /*name*/, std::span<const double> values) {
    put(values.data(), values.size_bytes());
  }

 private:
  void put(const void* value, std::size_t bytes) {
    std::memcpy(at_, value, bytes);
    at_ += bytes;
  }
  std::byte* at_;
};

void visit_cycle(auto& to, const CycleRecord& record) {
  to.count("cycle", record.cycle);
  to.time("t_ns", record.t.ns);
  to.time("start_ns", record.start.ns);
  to.number("period_s", record.period_s);
  to.count("overruns", record.overruns);
  to.time("read_ns", record.stages.read);
  to.time("controllets_ns", record.stages.controllets);
  to.time("features_ns", record.stages.features);
  to.time("safety_ns", record.stages.safety);
  to.time("write_ns", record.stages.write);
  to.time("total_ns", record.stages.total);
}

void visit_arm(auto& to, const ArmSample& sample, const ArmAddition& more, std::size_t joints) {
  static constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  static constexpr std::array<double, 6> kNone{kNan, kNan, kNan, kNan, kNan, kNan};
  static constexpr std::array<double, kMaxJoints> kNoJoints = [] {
    std::array<double, kMaxJoints> values{};
    values.fill(kNan);
    return values;
  }();
  const auto of_joints = [joints](const std::array<double, kMaxJoints>& values) {
    return std::span(values).first(joints);
  };
  to.count("sequence", sample.sequence);
  to.time("t_robot_ns", sample.t_robot_ns);
  to.number("age_s", sample.age_s);
  to.count("mode", sample.mode);
  to.count("errors", sample.errors);
  to.count("owner", sample.owner);
  to.count("stopped", more.stopped ? 1 : 0);
  to.count("due", sample.due ? 1 : 0);
  to.count("config_version", sample.config_version);
  to.count("interventions", sample.interventions);
  to.count("last_intervention", static_cast<std::uint64_t>(more.last_intervention));
  to.number("command_success_rate", sample.command_success_rate);
  to.count("has_gripper", sample.has_gripper ? 1 : 0);
  to.count("gripper_grasped", sample.gripper_grasped ? 1 : 0);
  to.count("gripper_moving", sample.gripper_moving ? 1 : 0);
  to.number("gripper_width_m", sample.gripper_width);
  to.number("gripper_max_width_m", sample.gripper_max_width);
  const Quaternion r = more.X_WE.quaternion();
  const std::array<double, 4> wxyz{r.w(), r.x(), r.y(), r.z()};
  to.numbers("position_m", std::span(more.X_WE.position.data(), 3));
  to.numbers("quaternion_wxyz", wxyz);
  to.numbers("wrench_n_nm", sample.has_wrench_estimate ? sample.F_K_W_est : kNone);
  to.numbers("contact_wrench_n_nm", sample.has_contact_truth ? sample.F_K_W_true : kNone);
  to.numbers("q_rad", of_joints(sample.q));
  to.numbers("dq_rad_per_s", of_joints(sample.dq));
  to.numbers("tau_J_nm", of_joints(sample.tau_J));
  to.numbers("tau_J_d_nm", of_joints(sample.tau_J_d));
  to.numbers("tau_ext_nm", of_joints(sample.has_tau_ext ? sample.tau_ext : kNoJoints));
  to.numbers("tau_controllet_nm", of_joints(sample.tau_controllet));
  to.numbers("tau_feature_nm", of_joints(sample.tau_feature));
  to.numbers("tau_cmd_nm", of_joints(sample.tau_cmd));
}

}  // namespace multipanda
