#pragma once

#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/types/capacity.hpp"
#include "core/types/codes.hpp"
#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// Declares one parameter of a controllet or feature. Scene files, the socket, ROS and the docs use it.
struct ParameterSpec {
  static constexpr std::size_t kPerJoint = 0;  // as `size`: one number per joint of the arm

  std::string name = {};             // with its unit: "stiffness_n_per_m"
  std::string unit = {};             // "N/m"; empty for pure numbers
  std::size_t size = 1;              // count of numbers, or kPerJoint
  std::vector<double> initial = {};  // `size` numbers, or one for all
  double min = 0, max = 0;           // bounds of each number
  std::string doc = {};
  // Names of the values 0, 1, 2, ... of a choice; {"false", "true"} for a switch. Empty: a plain number.
  std::vector<std::string> choices = {};
};

inline ParameterSpec choice_parameter(std::string name, std::vector<std::string> choices, std::string doc,
                                      std::size_t initial = 0) {
  const auto last = static_cast<double>(choices.size() - 1);
  return {.name = std::move(name),
          .initial = {static_cast<double>(initial)},
          .max = last,
          .doc = std::move(doc),
          .choices = std::move(choices)};
}
inline ParameterSpec switch_parameter(std::string name, bool initial, std::string doc) {
  return choice_parameter(std::move(name), {"false", "true"}, std::move(doc), initial ? 1 : 0);
}

// The parameter values of one instance. A new value is approached linearly within kRamp, so that setting a
// stiffness causes no torque step. Choices and switches change at once.
class ParameterSet {
 public:
  static constexpr double kRamp = 0.2;  // [s]

  // `joint_count`, that of the instance's first arm, is the size of per-joint parameters.
  ParameterSet(std::vector<ParameterSpec> specs, std::size_t joint_count);

  // --- any thread: fixed data ---
  std::size_t size() const { return specs_.size(); }
  const ParameterSpec& spec(std::size_t i) const { return specs_[i]; }
  std::size_t value_size(std::size_t i) const { return entries_[i].size; }
  // Index of `name`, or size().
  std::size_t find(std::string_view name) const;
  Verdict check(std::size_t i,
                std::span<const double> values) const;  // wrong_size, not_finite, out_of_bounds
  // Upper bound of number k: the spec's, or the lower one of this arm.
  double max(std::size_t i, std::size_t k) const { return entries_[i].max[k]; }
  // Reason for bounds below those of the spec; empty: none are.
  const std::string& bound_reason(std::size_t i) const { return entries_[i].bound_reason; }
  // The target value. Any thread except the loop's, since it allocates. While another thread sets it, some
  // numbers may still be old.
  std::vector<double> target(std::size_t i) const;

  // --- before the loop ---
  // Lowers the upper bound of each number to what this arm is stable with. An initial value above it is
  // lowered, too. Never raises a bound.
  void lower_max(std::size_t i, std::span<const double> max, std::string reason);

  // --- loop thread, or before the loop ---
  void set(std::size_t i,
           std::span<const double> values);  // values that passed check(); approached within kRamp
  void set_now(std::size_t i, std::span<const double> values);  // at once
  void advance(double dt);
  void finish();  // ends all ramps at their goals; for a start, which needs no ramps
  // Changes with any current value, so that caches of derived terms can compare it.
  std::uint32_t version() const { return version_; }

  double number(std::size_t i) const { return entries_[i].now[0]; }
  bool flag(std::size_t i) const { return entries_[i].now[0] > 0.5; }
  std::size_t choice(std::size_t i) const {
    return static_cast<std::size_t>(std::lround(entries_[i].now[0]));
  }
  std::span<const double> values(std::size_t i) const { return {entries_[i].now.data(), entries_[i].size}; }
  // The value that a ramp approaches.
  Vector3 goal_vector3(std::size_t i) const {
    const auto at = [&](std::size_t k) { return entries_[i].goal[k].load(std::memory_order_relaxed); };
    return {at(0), at(1), at(2)};
  }
  Vector3 vector3(std::size_t i) const { return Eigen::Map<const Vector3>(entries_[i].now.data()); }
  Vector6 vector6(std::size_t i) const { return Eigen::Map<const Vector6>(entries_[i].now.data()); }
  JointVector joints(std::size_t i) const {
    return Eigen::Map<const Eigen::VectorXd>(entries_[i].now.data(),
                                             static_cast<Eigen::Index>(entries_[i].size));
  }

 private:
  struct Entry {
    std::size_t size = 1;
    std::array<double, kMaxParameterSize> now{}, rate{}, max{};
    std::array<std::atomic<double>, kMaxParameterSize> goal{};  // written by the loop only
    double remaining_s = 0;
    std::string bound_reason;
  };
  void arrive(Entry& entry);

  std::vector<ParameterSpec> specs_;
  std::vector<Entry> entries_;
  std::size_t ramping_ = 0;  // entries with remaining time
  std::uint32_t version_ = 1;
};

}  // namespace multipanda
