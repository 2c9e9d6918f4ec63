#include "study/run_figures.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include <fmt/format.h>

namespace multipanda {
namespace {

double norm3(const std::array<double, 6>& wrench) { return std::hypot(wrench[0], wrench[1], wrench[2]); }

}  // namespace

// FNV-1a (Fowler, Noll, Vo) over the numbers' bytes: two runs with the same digest agree to the bit, but for
// one case in 2^64.
void RunFigures::digest(const double* values, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, values + i, sizeof(bits));
    for (int byte = 0; byte < 8; ++byte) {
      digest_ = (digest_ ^ (bits >> (8 * byte) & 0xff)) * 0x100000001b3ULL;
    }
  }
}

void RunFigures::take_arm(const ArmSample& sample, std::size_t joints, Arm& arm) {
  for (std::size_t j = 0; j < joints; ++j) {
    arm.speed = std::max(arm.speed, std::abs(sample.dq[j]));
    arm.torque = std::max(arm.torque, std::abs(sample.tau_cmd[j]));
    arm.torque_squares += sample.tau_cmd[j] * sample.tau_cmd[j];
  }
  if (sample.has_contact_truth) {
    arm.has_force = true;
    arm.force = std::max(arm.force, norm3(sample.F_K_W_true));
    arm.force_sum += norm3(sample.F_K_W_true);
  }
  if (sample.has_wrench_estimate) {
    arm.has_estimate = true;
    arm.estimate = std::max(arm.estimate, norm3(sample.F_K_W_est));
  }
  arm.interventions = sample.interventions;
  arm.q.assign(sample.q.begin(), sample.q.begin() + static_cast<std::ptrdiff_t>(joints));
  digest(sample.q.data(), joints);
  digest(sample.dq.data(), joints);
  digest(sample.tau_cmd.data(), joints);
}

void RunFigures::take(const CycleRecord& record) {
  ++cycles_;
  t_s_ = record.t.seconds();
  for (std::size_t i = 0; i < arms_.size(); ++i)
    take_arm(record.arms[i], layout_.arms[i].joint_count, arms_[i]);
  for (std::size_t i = 0; i < outputs_.size(); ++i) {
    for (std::size_t k = 0; k < outputs_[i].size(); ++k) {
      const auto& spec = layout_.instances[i].outputs[k];
      const double value = record.outputs[spec.offset];
      if (spec.size != 1 || std::isnan(value)) continue;
      Output& output = outputs_[i][k];
      output.low = output.cycles == 0 ? value : std::min(output.low, value);
      output.high = output.cycles == 0 ? value : std::max(output.high, value);
      output.last = value;
      ++output.cycles;
    }
  }
}

nlohmann::ordered_json RunFigures::json() const {
  nlohmann::ordered_json json{{"cycles", cycles_}, {"time_s", t_s_}};
  const auto cycles = static_cast<double>(std::max<std::uint64_t>(cycles_, 1));
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    const Arm& arm = arms_[i];
    const std::string name = layout_.arms[i].name + "/";
    const auto joints = static_cast<double>(layout_.arms[i].joint_count);
    json[name + "speed_max_rad_per_s"] = arm.speed;
    json[name + "torque_max_nm"] = arm.torque;
    json[name + "torque_rms_nm"] = std::sqrt(arm.torque_squares / (cycles * joints));
    if (arm.has_force) {
      json[name + "force_max_n"] = arm.force;
      json[name + "force_mean_n"] = arm.force_sum / cycles;
    }
    if (arm.has_estimate) json[name + "force_est_max_n"] = arm.estimate;
    json[name + "interventions"] = arm.interventions;
    json[name + "q_end_rad"] = arm.q;
  }
  for (std::size_t i = 0; i < outputs_.size(); ++i) {
    for (std::size_t k = 0; k < outputs_[i].size(); ++k) {
      const Output& output = outputs_[i][k];
      // A feature that is off has outputs of 0.
      if (output.cycles == 0 || (output.low == 0 && output.high == 0)) continue;
      const auto& instance = layout_.instances[i];
      const std::string name = instance.name + "/" + instance.outputs[k].name;
      json[name + "/min"] = output.low;
      json[name + "/max"] = output.high;
      json[name + "/end"] = output.last;
    }
  }
  json["digest"] = fmt::format("{:016x}", digest_);
  return json;
}

}  // namespace multipanda
