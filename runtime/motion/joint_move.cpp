#include "runtime/motion/joint_move.hpp"

#include <algorithm>
#include <chrono>

#include "core/model/model_terms.hpp"
#include "core/trajectory/quintic.hpp"
#include "core/types/carriage_speed.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

double most_hand_way(const JointVector& from, const JointVector& goal, const SceneArm& scene_arm) {
  constexpr int kPieces = 200;
  ModelTerms terms(build_arm_model(scene_arm));
  const ArmConfig config = arm_config(scene_arm);
  terms.set_config(config.frames, config.tool, config.load);
  const JointVector way = goal - from;
  double most = 0;
  for (int k = 0; k <= kPieces; ++k) {
    terms.update(from + k * way / kPieces, way);
    most = std::max({most, terms.V_WE().linear().norm(), carriage_speed(terms.J_V_WE(), way)});
  }
  return most;
}

}  // namespace

void JointMove::plan(const JointVector& start, double speed, const SceneArm& scene_arm, double most) {
  from = start;
  hand_way = most_hand_way(from, goal, scene_arm);
  duration_s = rest_to_rest_duration(hand_way, most);
  for (Eigen::Index j = 0; j < goal.size(); ++j) {
    duration_s =
        std::max(duration_s, rest_to_rest_duration(std::abs(goal[j] - from[j]), speed * slowest_joint));
  }
}

double JointMove::joint_speed() const {
  return duration_s > 0 ? rest_to_rest_speed(largest_way(), duration_s) : 0;
}

double JointMove::hand_speed() const { return duration_s > 0 ? rest_to_rest_speed(hand_way, duration_s) : 0; }

std::string move_controllet(const SceneArm& arm) { return arm.name + "_move"; }

JointMove add_joint_move(Scene& scene, ArmIndex index, JointVector goal) {
  const SceneArm& arm = scene.arms.at(index);
  JointMove move{.arm = index, .from = {}, .goal = std::move(goal)};
  move.slowest_joint = arm.safety.joints.dq_max.minCoeff();
  InputSpec joints{.name = "joints", .quantity = Quantity::joints};
  joints.max_speed = JointMove::kLargestSpeed * move.slowest_joint;
  scene.controllets.push_back({.name = move_controllet(arm),
                               .type = "joint_impedance",
                               .arms = {index},
                               .inputs = {joints},
                               .contact = scene.contact_bounds});
  scene.active.push_back(move_controllet(arm));
  return move;
}

void MeasuredJoints::take(const CycleRecord& record) {
  const std::lock_guard lock(mutex_);
  for (std::size_t i = 0; i < q_.size(); ++i) q_[i] = record.arms[i].q;
  t_ = record.t.seconds();
  seen_ = seen_ || std::all_of(record.arms.begin(), record.arms.end(),
                               [](const ArmSample& arm) { return arm.sequence > 0; });
  changed_.notify_all();
}

std::vector<JointArray> MeasuredJoints::q() const {
  const std::lock_guard lock(mutex_);
  return q_;
}

JointVector MeasuredJoints::q(const JointMove& move) const {
  const std::lock_guard lock(mutex_);
  return Eigen::Map<const Eigen::VectorXd>(q_[move.arm].data(), move.goal.size());
}

double MeasuredJoints::t() const {
  const std::lock_guard lock(mutex_);
  return t_;
}

template <typename Holds>
bool MeasuredJoints::wait(Holds holds, const std::function<bool()>& stopped) {
  std::unique_lock lock(mutex_);
  while (!holds()) {
    lock.unlock();
    if (stopped()) return false;
    lock.lock();
    changed_.wait_for(lock, std::chrono::milliseconds(50), holds);
  }
  return true;
}

bool MeasuredJoints::wait_for_all(const std::function<bool()>& stopped) {
  return wait([this] { return seen_; }, stopped);
}

bool MeasuredJoints::wait_until(double t_s, const std::function<bool()>& stopped) {
  return wait([this, t_s] { return t_ >= t_s; }, stopped);
}

}  // namespace multipanda
