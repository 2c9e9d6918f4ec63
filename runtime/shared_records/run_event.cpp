#include "runtime/shared_records/run_event.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "arm_interface/arm_error.hpp"

namespace multipanda {
namespace {

// Force at the end effector [N]: from the simulator's contacts if known, which have no offset.
double force_of(const ArmSample& sample) {
  const auto& F = sample.has_contact_truth ? sample.F_K_W_true : sample.F_K_W_est;
  if (!sample.has_contact_truth && !sample.has_wrench_estimate) return 0;
  return std::hypot(F[0], F[1], F[2]);
}

// Largest external torque of a joint [N m] and the joint, from 0.
std::pair<double, std::size_t> torque_of(const ArmSample& sample, std::size_t joints) {
  std::pair<double, std::size_t> largest{0, 0};
  for (std::size_t j = 0; sample.has_tau_ext && j < joints; ++j) {
    if (std::abs(sample.tau_ext[j]) > largest.first) largest = {std::abs(sample.tau_ext[j]), j};
  }
  return largest;
}

}  // namespace

RunEvents::RunEvents(const RecordLayout& layout) : layout_(layout) {
  for (const auto& arm : layout.arms) arms_.push_back({.name = arm.name, .joints = arm.joint_count});
}

std::vector<RunEvent> RunEvents::take(const Event& event) {
  RunEvent out{.cycle = event.cycle, .t = event.t, .kind = std::string(to_string(event.kind))};
  out.text = words_.of(event);
  out.arm = words_.arm_name(event.arm);
  if (event.kind == EventKind::intervention) {  // as in the summary of a run
    out.text = to_string(event.intervention);
    std::replace(out.text.begin(), out.text.end(), ' ', '_');
  }
  std::vector<RunEvent> all;
  if (event.kind != EventKind::stopped && event.kind != EventKind::resumed) {
    all.push_back(std::move(out));
    return all;
  }
  for (const std::string& arm : words_.arm_names(event.arms)) {  // one per arm
    out.arm = arm;
    out.text = event.kind == EventKind::stopped ? "held until resume" : "switches are allowed again";
    all.push_back(out);
  }
  return all;
}

void RunEvents::add(std::vector<RunEvent>& out, const CycleRecord& record, const Arm& arm, const char* kind,
                    std::string text) const {
  out.push_back(
      {.cycle = record.cycle, .t = record.t, .kind = kind, .arm = arm.name, .text = std::move(text)});
}

std::vector<RunEvent> RunEvents::take(const CycleRecord& record,
                                      const std::map<std::string, std::string>& reasons) {
  std::vector<RunEvent> out;
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    const ArmSample& sample = record.arms[i];
    if (arm.known && sample.owner != arm.owner) {
      add(out, record, arm, "controllet",
          words_.instance_name(sample.owner) + " after " + words_.instance_name(arm.owner));
    }
    const std::uint64_t before = arm.known ? arm.errors : 0;
    if (sample.errors != before) {
      if (sample.errors == 0) {
        add(out, record, arm, "recovered", "no errors left");
      } else {
        const auto known = reasons.find(arm.name);
        add(out, record, arm, "error", known != reasons.end() ? known->second : error_names(sample.errors));
      }
    }
    if (arm.known && sample.has_gripper && sample.gripper_grasped != arm.grasped) {
      add(out, record, arm, sample.gripper_grasped ? "grasped" : "released",
          fmt::format("{:.1f} mm", 1e3 * sample.gripper_width));
    }
    watch_contact(out, record, arm, sample);
    arm.owner = sample.owner;
    arm.errors = sample.errors;
    arm.grasped = sample.gripper_grasped;
    arm.known = true;
  }
  return out;
}

void RunEvents::watch_contact(std::vector<RunEvent>& out, const CycleRecord& record, Arm& arm,
                              const ArmSample& sample) const {
  const double force = force_of(sample);
  const auto [torque, joint] = torque_of(sample, arm.joints);
  if (force >= kForce * kRelease || torque >= kTorque * kRelease) arm.pressed = record.t;
  if (!arm.in_contact && (force >= kForce || torque >= kTorque)) {
    arm.in_contact = true;
    add(out, record, arm, "contact",
        force >= kForce ? fmt::format("{:.1f} N at the end effector", force)
                        : fmt::format("{:.1f} N m at joint {}", torque, joint + 1));
  } else if (arm.in_contact && seconds(record.t - arm.pressed) >= kRest) {
    arm.in_contact = false;
    add(out, record, arm, "contact_ended", fmt::format("{:.1f} N at the end effector", force));
  }
}

}  // namespace multipanda
