#pragma once

#include <algorithm>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "runtime/embedded/hardware_system.hpp"
#include "runtime/embedded/hosted_cycle.hpp"

namespace multipanda::test {

// Waits for another thread; returns false after the deadline.
template <typename Condition>
bool eventually(Condition condition, double deadline_s = 10) {
  const HostTime start = host_now();
  while (!condition()) {
    if (seconds(host_now() - start) > deadline_s) return false;
    std::this_thread::yield();
  }
  return true;
}

// One cycle of a controller_manager: read, update of the controllers, write, with the numbers copied between
// them as the controller does.
class HostedFixture {
 public:
  explicit HostedFixture(HardwareSystem& world) : world_(world) {}

  double* command(const std::string& full_name) { return find(world_.commands(), full_name); }
  double state(const std::string& full_name) { return *find(world_.states(), full_name); }

  std::vector<std::string> efforts(const std::string& arm, std::size_t joints = 7) const {
    return joint_names(arm, "effort", joints);
  }
  static std::vector<std::string> joint_names(const std::string& arm, const std::string& kind,
                                              std::size_t joints = 7) {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < joints; ++i) {
      names.push_back(arm + "_joint" + std::to_string(i + 1) + "/" + kind);
    }
    return names;
  }
  std::vector<std::string> all(const std::string& prefix) const {
    std::vector<std::string> names;
    for (const auto& number : world_.commands()) {
      if (number.prefix == prefix) names.push_back(number.full_name());
    }
    return names;
  }
  // As the controller_manager: first prepares, then performs. Returns an empty string, or the reason for
  // a refusal.
  std::string change(const std::vector<std::string>& start, const std::vector<std::string>& stop = {}) {
    std::string why;
    if (!world_.prepare_switch(start, stop, why)) return why.empty() ? "refused" : why;
    world_.perform_switch(start, stop);
    return "";
  }

  void activate(HostedCycle& cycle) {
    cycle_ = &cycle;
    bind();
    take_in();
    cycle.activate();
  }
  void deactivate() {
    cycle_->deactivate();
    put_out();
    cycle_ = nullptr;
  }
  void step() {
    (void)world_.read();
    if (fresh_only_) {
      std::uint64_t packets = 0;
      for (ArmIndex i = 0; i < world_.arm_count(); ++i) packets += world_.state(i).sequence;
      if (packets == packets_) return;
      packets_ = packets;
    }
    if (cycle_ != nullptr) {
      take_in();
      last_ = cycle_->step(0.001);
      put_out();
    }
    if (between_) between_();
    (void)world_.write();
  }
  void steps(std::size_t n) {
    for (std::size_t i = 0; i < n; ++i) step();
  }
  // Steps until the condition holds, up to a limit, and gives the relay time.
  template <typename Condition>
  bool steps_until(Condition condition, std::size_t most = 20000) {
    for (std::size_t i = 0; i < most; ++i) {
      if (condition()) return true;
      step();
      std::this_thread::yield();
    }
    return condition();
  }
  bool last() const { return last_; }
  std::function<void()> between_;  // another controller
  // Counts only steps in which the world moved: for worlds that wait for their commands, on slow machines.
  bool fresh_only_ = false;

 private:
  static double* find(const std::vector<HardwareNumber>& numbers, const std::string& full_name) {
    for (const auto& number : numbers) {
      if (number.full_name() == full_name) return number.value;
    }
    throw std::invalid_argument("no interface " + full_name);
  }
  void bind() {
    bound_.clear();
    for (ArmIndex i = 0; i < cycle_->arm_count(); ++i) {
      Bound& bound = bound_.emplace_back();
      for (const auto& joint : cycle_->joint_names(i)) {
        bound.q.push_back(find(world_.states(), joint + "/position"));
        bound.dq.push_back(find(world_.states(), joint + "/velocity"));
        bound.tau.push_back(find(world_.states(), joint + "/effort"));
        bound.out.push_back(find(world_.commands(), joint + "/effort"));
      }
      cycle_->signals(i).shared = shared_arm_state(state(cycle_->scene().arms[i].name + "/multipanda_state"));
      cycle_->signals(i).has_effort = true;
    }
  }
  void take_in() {
    for (ArmIndex i = 0; i < bound_.size(); ++i) {
      for (std::size_t k = 0; k < bound_[i].q.size(); ++k) {
        cycle_->signals(i).position[k] = *bound_[i].q[k];
        cycle_->signals(i).velocity[k] = *bound_[i].dq[k];
        cycle_->signals(i).effort[k] = *bound_[i].tau[k];
      }
    }
  }
  void put_out() {
    for (ArmIndex i = 0; i < bound_.size(); ++i) {
      for (std::size_t k = 0; k < bound_[i].out.size(); ++k) {
        *bound_[i].out[k] = cycle_->signals(i).effort_command[k];
      }
    }
  }

  struct Bound {
    std::vector<double*> q, dq, tau, out;
  };
  HardwareSystem& world_;
  HostedCycle* cycle_ = nullptr;
  std::vector<Bound> bound_;
  bool last_ = false;
  std::uint64_t packets_ = 0;
};

}  // namespace multipanda::test
