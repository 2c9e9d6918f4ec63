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

// What a controllet or feature says about one of its parameters. Adapters (YAML, socket, ROS, docs) are
// generated from it.
struct ParameterSpec {
  static constexpr std::size_t kPerJoint = 0;  // as `size`: one number per joint of the arm

  std::string name;             // with its unit: "stiffness_n_per_m"
  std::string unit;             // "N/m", "" for pure numbers
  std::size_t size = 1;         // numbers, or kPerJoint
  std::vector<double> initial;  // `size` numbers, or one for all
  double min = 0, max = 0;      // bounds of each number
  std::string doc;
  // Names of the values 0, 1, 2, ... of a choice; {"false", "true"} for a switch. Empty: a plain number.
  std::vector<std::string> choices = {};
};

inline ParameterSpec switch_parameter(std::string name, bool initial, std::string doc) {
  return {std::move(name), "", 1, {initial ? 1.0 : 0.0}, 0, 1, std::move(doc), {"false", "true"}};
}

// The values of one instance's parameters. New values are approached linearly within kRamp, then taken
// exactly, so that a stiffness set while running makes no step in torque; choices and switches change at
// once.
class ParameterSet {
 public:
  static constexpr double kRamp = 0.2;  // [s]

  // `joint_count` of the instance's first arm sizes per-joint parameters.
  ParameterSet(std::vector<ParameterSpec> specs, std::size_t joint_count);

  // --- before the loop, or any thread: fixed data ---
  std::size_t size() const { return specs_.size(); }
  const ParameterSpec& spec(std::size_t i) const { return specs_[i]; }
  std::size_t value_size(std::size_t i) const { return entries_[i].size; }
  // Index of `name`, or size().
  std::size_t find(std::string_view name) const;
  Verdict check(std::size_t i,
                std::span<const double> values) const;  // wrong_size, not_finite, out_of_bounds
  // The value aimed at. Any thread; allocates, so not the loop. While another thread sets it, single numbers
  // may still be the old ones.
  std::vector<double> target(std::size_t i) const;

  // --- loop thread (or before the loop) ---
  void set(std::size_t i, std::span<const double> values);      // checked values; approached within kRamp
  void set_now(std::size_t i, std::span<const double> values);  // at once
  void advance(double dt);
  void finish();  // ends all ramps at their goals: before a start, where there is nothing to keep smooth
  // Changes whenever a current value does: caches of derived terms compare it.
  std::uint32_t version() const { return version_; }

  double number(std::size_t i) const { return entries_[i].now[0]; }
  bool flag(std::size_t i) const { return entries_[i].now[0] > 0.5; }
  std::size_t choice(std::size_t i) const {
    return static_cast<std::size_t>(std::lround(entries_[i].now[0]));
  }
  std::span<const double> values(std::size_t i) const { return {entries_[i].now.data(), entries_[i].size}; }
  Vector3 vector3(std::size_t i) const { return Eigen::Map<const Vector3>(entries_[i].now.data()); }
  Vector6 vector6(std::size_t i) const { return Eigen::Map<const Vector6>(entries_[i].now.data()); }
  JointVector joints(std::size_t i) const {
    return Eigen::Map<const Eigen::VectorXd>(entries_[i].now.data(),
                                             static_cast<Eigen::Index>(entries_[i].size));
  }

 private:
  struct Entry {
    std::size_t size = 1;
    std::array<double, kMaxParameterSize> now{}, rate{};
    std::array<std::atomic<double>, kMaxParameterSize> goal{};  // written by the loop only
    double remaining_s = 0;
  };
  void arrive(Entry& entry);

  std::vector<ParameterSpec> specs_;
  std::vector<Entry> entries_;
  std::size_t ramping_ = 0;  // entries with remaining time
  std::uint32_t version_ = 1;
};

}  // namespace multipanda
