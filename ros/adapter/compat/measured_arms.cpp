#include "ros/adapter/compat/measured_arms.hpp"

#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "core/record/arm_config.hpp"
#include "scene/build.hpp"

namespace multipanda::ros {

MeasuredArms::MeasuredArms(const RunContext& run) {
  for (std::size_t i = 0; i < run.models.size(); ++i) {
    arms_.push_back({run.models[i]->q_home(), 0, arm_config(run.scene->arms.at(i)).frames.X_FE});
    terms_.emplace_back(run.models[i]);
  }
}

void MeasuredArms::take(const CycleRecord& record) {
  const std::lock_guard lock(mutex_);
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    const ArmSample& sample = record.arms[i];
    arms_[i].q = Eigen::Map<const Eigen::VectorXd>(sample.q.data(), arms_[i].q.size());
    arms_[i].age_s = sample.age_s;
  }
  start_ = record.start;
  seen_ = true;
}

void MeasuredArms::take(const Event& event) {
  ArmFrames frames;
  Load tool, load;
  if (event.arm >= arms_.size() || !read_arm_config(event, frames, tool, load)) return;
  const std::lock_guard lock(mutex_);
  arms_[event.arm].X_FE = frames.X_FE;
}

MeasuredArms::Joints MeasuredArms::joints(ArmIndex arm, HostTime now) const {
  const std::lock_guard lock(mutex_);
  if (!seen_) throw std::invalid_argument("the run has not begun");
  return {arms_[arm].q, arms_[arm].age_s + seconds(now - start_)};
}

Pose MeasuredArms::end_effector(ArmIndex arm, HostTime now) {
  const Joints at = joints(arm, now);
  check_age(at.age_s);
  terms_[arm].update(at.q, JointVector::Zero(at.q.size()));
  const std::lock_guard lock(mutex_);
  return terms_[arm].X_WF() * arms_[arm].X_FE;
}

void check_age(double age_s) {
  if (age_s <= kOldestState) return;
  throw std::invalid_argument(fmt::format(
      "the newest state of the arm is {:.3g} s old, more than {:g}: the run is paused, or this computer is "
      "overloaded",
      age_s, kOldestState));
}

std::string too_far(const Pose& X_goal, const Pose& X_measured) {
  const Vector6 away = pose_error(X_goal, X_measured);
  const double position = away.head<3>().norm(), rotation = away.tail<3>().norm();
  if (!(position <= kFarthestPosition)) {
    return fmt::format(
        "the goal is {:.3g} m away from the end effector, more than {:g}: send goals from where the arm is",
        position, kFarthestPosition);
  }
  if (!(rotation <= kFarthestRotation)) {
    return fmt::format(
        "the goal is turned by {:.3g} rad from the end effector, more than {:g}: send goals from where the "
        "arm is",
        rotation, kFarthestRotation);
  }
  return {};
}

std::string too_far(std::span<const double> q_goal, const JointVector& q_measured) {
  for (std::size_t i = 0; i < q_goal.size(); ++i) {
    const double away = std::abs(q_goal[i] - q_measured[static_cast<Eigen::Index>(i)]);
    if (!(away <= kFarthestJoint)) {
      return fmt::format(
          "joint {}: the goal is {:.3g} rad away from the arm, more than {:g}: send goals from where the arm "
          "is",
          i + 1, away, kFarthestJoint);
    }
  }
  return {};
}

}  // namespace multipanda::ros
