#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/reference/target.hpp"
#include "core/types/joints.hpp"

namespace multipanda {

// The way from a generator to a run: its live-input socket (LiveLink) or ROS topics. One thread. Members
// throw std::invalid_argument with the run's refusal (no such arm, controllet or input), std::runtime_error
// where the run does not answer.
class SetPointLink {
 public:
  struct Arm {
    Pose X_WE;
    JointVector q;  // (n x 1) [rad]
  };
  using Stream = std::size_t;  // counts from 0

  virtual ~SetPointLink() = default;
  // Where these arms are now.
  virtual std::vector<Arm> arms(const std::vector<std::string>& names) = 0;
  // Set-points for an input, in the world where it is a pose.
  virtual Stream open(const std::string& controllet, const std::string& input, Quantity quantity) = 0;
  // The newest set-point, values as in a Target. Never waits; false: it did not get through. Does not throw.
  virtual bool send(Stream stream, std::span<const double> values, std::int64_t time_ns) = 0;
  // Makes each stream's newest set-point a goal, so that an input that falls silent has not lost its
  // publisher. Inputs whose controllet does not run are left out.
  virtual void rest() = 0;
  // One object per stream, in order: what became of it, as far as this way lets the publisher know.
  virtual nlohmann::json channels() = 0;
};

// A pose as a Target's values: x y z qw qx qy qz.
inline std::vector<double> values_of(const Pose& X) {
  const Quaternion q = X.quaternion();
  return {X.position.x(), X.position.y(), X.position.z(), q.w(), q.x(), q.y(), q.z()};
}

}  // namespace multipanda
