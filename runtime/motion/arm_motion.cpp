#include "runtime/motion/arm_motion.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "core/model/model_terms.hpp"
#include "core/model/prismatic_joints.hpp"
#include "core/state/arm_state.hpp"
#include "core/types/carriage_speed.hpp"
#include "runtime/request_text.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

constexpr double kProgressEvery = 0.05;  // [s]
constexpr double kSettleTime = 1.0;      // for the set-point to come to rest at the goal [s]
constexpr double kLatest = 0.05;         // largest delay of a record that is compensated [s]
// Time between two checks of the hand's speed along a motion [s], and the largest number of checks of a
// long one.
constexpr double kHandSpeedStep = 0.005, kMostHandSpeeds = 5000;
constexpr int kSlowerRounds = 8;
// A carriage accelerates with this share of the force that the bounds for contact allow it: a heavy one could
// not follow a faster set-point.
constexpr double kCarriageShare = 0.5;
constexpr double kAtGoal = 1e-3, kAtRest = 1e-3;
// Look-ahead of a motion that takes over from another [s]: planning must be finished by then, so longer ones
// are tried if it was too slow.
constexpr double kLeads[] = {0.03, 0.1, 0.4, 2.0};

std::int64_t to_ns(double s) { return static_cast<std::int64_t>(std::llround(s * 1e9)); }
double to_s(std::int64_t ns) { return static_cast<double>(ns) * 1e-9; }

double duration_of(const auto& motion) {
  return std::visit([](const auto& m) { return m.duration(); }, motion);
}

JointVector joints_of(const JointArray& values, std::size_t n) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(n));
}

// Name of a joint in messages, counted from 1 as in the joints' names.
std::string joint_text(const std::string& arm, Eigen::Index joint) {
  return fmt::format("{}_joint{}", arm, joint + 1);
}

}  // namespace

ArmMotion::ArmMotion(const RunContext& run, ArmIndex arm, bool paced)
    : run_(run), arm_(arm), n_(run.models[arm]->joint_count()), paced_(paced) {
  references_.reserve(kMaxFeatures);
}

ArmMotion::~ArmMotion() {
  const std::lock_guard lock(mutex_);
  if (runs_.empty()) return;
  Run& run = runs_.front();
  if (!run.goal_sent && t_ >= run.t0 && run.t0 != kNow) {
    brake(run, MotionResult::lost, "");
    post(run, duration_of(run.motion), Delivery::goal);
  }
  end(MotionResult::lost, "the run's interfaces are closed");
}

const InputSpec& ArmMotion::spec(const Input& input) const {
  return run_.modes->instance(input.instance).inputs()[input.input].spec();
}

std::optional<ArmMotion::Input> ArmMotion::active_input(Quantity quantity) const {
  const InstanceSet active = run_.modes->active();
  for (InstanceIndex i = 0; i < run_.modes->instance_count(); ++i) {
    const Instance& instance = run_.modes->instance(i);
    if ((active & bit(i)) == 0 || !instance.arms().contains(arm_)) continue;
    std::optional<Input> found;
    std::size_t count = 0;
    for (std::size_t k = 0; k < instance.inputs().size(); ++k) {
      const InputSpec& each = instance.inputs()[k].spec();
      if (each.quantity != quantity || instance.arm_list()[each.arm] != arm_) continue;
      if (quantity == Quantity::pose && each.frame != "world") continue;
      found = {i, k};
      ++count;
    }
    if (count == 1) return found;
  }
  return {};
}

ArmMotion::Input ArmMotion::find_input(Quantity quantity) const {
  if (const auto found = active_input(quantity)) return *found;
  std::vector<std::string> others;
  for (InstanceIndex i = 0; i < run_.modes->instance_count(); ++i) {
    const Instance& instance = run_.modes->instance(i);
    if (instance.arms().contains(arm_) &&
        std::ranges::count_if(instance.inputs(), [&](const Reference& each) {
          return each.spec().quantity == quantity && instance.arm_list()[each.spec().arm] == arm_;
        }) == 1)
      others.push_back(instance.name());
  }
  const std::string what = quantity == Quantity::joints ? "joint positions" : "a pose";
  const std::string cure =
      others.empty()
          ? fmt::format("the scene has no controllet for it: add one of the type {} to its controllets",
                        quantity == Quantity::joints ? "joint_impedance" : "cartesian_impedance")
          : fmt::format("switch to {}", fmt::join(others, " or "));
  throw MotionRefused(
      fmt::format("no active controllet takes {1} of '{0}'; {2}", run_.modes->arm_name(arm_), what, cure));
}

bool ArmMotion::ready(Quantity quantity, HostTime since) const {
  const auto input = active_input(quantity);
  const std::lock_guard lock(mutex_);
  return t_ != kNow && start_ >= since && (!input || latest(*input) != nullptr);
}

JointMotionLimits ArmMotion::joint_limits(const Input& input) const {
  const ArmModel& model = *run_.models[arm_];
  const ArmLimits& arm = model.limits();
  JointMotionLimits limits{.velocity = arm.dq_max.cwiseMin(spec(input).max_speed),
                           .acceleration = arm.ddq_max.cwiseMin(kAcceleration),
                           .jerk = joint_constant(n_, kJerk)};
  const double force = run_.modes->instance(input.instance).contact().spring_force;
  for (std::size_t i = 0; i < n_; ++i) {
    if (!model.is_prismatic(i)) continue;
    const auto k = static_cast<Eigen::Index>(i);
    limits.acceleration[k] =
        std::min(limits.acceleration[k], kCarriageShare * force / model.least_inertia()[k]);
  }
  return limits;
}

PoseMotionLimits ArmMotion::pose_limits(const Input& input) const {
  return {.speed = spec(input).max_speed,
          .acceleration = kLinearAcceleration,
          .jerk = kLinearJerk,
          .angular_speed = spec(input).max_angular_speed,
          .angular_acceleration = kAcceleration,
          .angular_jerk = kJerk};
}

double ArmMotion::allowed_hand_speed(const Input& input) const {
  return run_.modes->instance(input.instance).contact().hand_speed;
}

double ArmMotion::top_hand_speed(const JointMotion& motion) const {
  const ArmConfig config = arm_config(run_.scene->arms[arm_]);
  ModelTerms terms(run_.models[arm_]);
  terms.set_config(config.frames, config.tool, config.load);
  const double step = std::max(kHandSpeedStep, motion.duration() / kMostHandSpeeds);
  double fastest = 0;
  for (double t = 0; t < motion.duration(); t += step) {
    const JointSample sample = motion.sample(t);
    terms.update(sample.position, sample.velocity);
    const double carriage = carriage_speed(terms.J_V_WE(), sample.velocity);
    fastest = std::max({fastest, terms.V_WE().linear().norm(), carriage});
  }
  return fastest;
}

// Slowed down as a whole until the hand's speed is within its bound. A moving start is braked first at
// any scale.
JointMotion ArmMotion::via_motion(const JointSample& start, std::span<const JointVector> via,
                                  const Input& input, double scale) const {
  const double allowed = allowed_hand_speed(input);
  JointMotion motion = joint_via_motion(start, via, joint_limits(input), scale);
  if (!std::isfinite(allowed)) return motion;
  double fastest = top_hand_speed(motion);
  for (int round = 0; round < kSlowerRounds && fastest > allowed; ++round) {
    scale *= std::max(0.1, 0.99 * allowed / fastest);
    motion = joint_via_motion(start, via, joint_limits(input), scale);
    fastest = top_hand_speed(motion);
  }
  return motion;
}

const char* ArmMotion::unit_of(Eigen::Index joint) const {
  return run_.models[arm_]->is_prismatic(static_cast<std::size_t>(joint)) ? "m" : "rad";
}

void ArmMotion::check_goal(const Input& input, const Target& goal) const {
  Request request{.kind = Request::Kind::set_target, .instance = input.instance};
  request.index = static_cast<std::uint16_t>(input.input);
  request.target = goal;
  if (const Verdict verdict = run_.modes->check(request); verdict != Verdict::accepted)
    throw MotionRefused(
        fmt::format("'{}': {}", run_.modes->arm_name(arm_), reason(*run_.modes, request, verdict)));
}

void ArmMotion::check_joints(const Input& input, const JointVector& q) const {
  Target goal;
  goal.set({q.data(), static_cast<std::size_t>(q.size())});
  check_goal(input, goal);
}

namespace {

void check_scale(double scale) {
  if (!(scale > 0 && scale <= 1))
    throw MotionRefused(fmt::format("the velocity scale must be above 0 and at most 1, not {:.4g}", scale));
}

}  // namespace

void ArmMotion::through_joints(std::span<const JointVector> via, double scale,
                               std::shared_ptr<MotionListener> listener) {
  check_scale(scale);
  if (via.empty()) throw MotionRefused("expected at least one joint position to move through");
  begin(
      Quantity::joints,
      [&](const Start& start, const Input& input) -> Motion {
        for (const JointVector& q : via) check_joints(input, q);
        return via_motion(std::get<JointSample>(start), via, input, scale);
      },
      {}, std::move(listener));
}

void ArmMotion::through_poses(std::span<const ViaPose> via, double scale,
                              std::shared_ptr<MotionListener> listener) {
  check_scale(scale);
  if (via.empty()) throw MotionRefused("expected at least one pose to move through");
  begin(
      Quantity::pose,
      [&](const Start& start, const Input& input) -> Motion {
        std::vector<Pose> poses;
        Matrix3 before = std::get<PoseSample>(start).X.rotation;
        for (const ViaPose& each : via) {
          before = each.R_WE.value_or(before);
          poses.push_back({before, each.p_WE});
          check_goal(input, pose_target(poses.back()));
        }
        return pose_via_motion(std::get<PoseSample>(start), poses, pose_limits(input), scale);
      },
      {}, std::move(listener));
}

void ArmMotion::follow(const TrajectoryGoal& goal, std::shared_ptr<MotionListener> listener) {
  if (goal.points.empty()) throw MotionRefused("the trajectory has no point");
  begin(
      Quantity::joints,
      [&](const Start& from, const Input& input) -> Motion {
        const auto& start = std::get<JointSample>(from);
        std::vector<TrajectoryPoint> points = goal.points;
        for (TrajectoryPoint& point : points) {
          for (Eigen::Index j = 0; j < point.position.size(); ++j) {
            if (std::isnan(point.position[j])) point.position[j] = start.position[j];
          }
          check_joints(input, point.position);
        }
        if (points.front().time_s <= 0) {
          Eigen::Index worst = 0;
          const double off = (points.front().position - start.position).cwiseAbs().maxCoeff(&worst);
          if (off > kStartTolerance)
            throw MotionRefused(fmt::format(
                "the trajectory starts at {0:.4g} {1} for {2}, whose set-point is at {3:.4g} {1}; "
                "expected within {4} {1}",
                points.front().position[worst], unit_of(worst), joint_text(run_.modes->arm_name(arm_), worst),
                start.position[worst], kStartTolerance));
          points.erase(points.begin());
          if (points.empty())
            throw MotionRefused(
                "the trajectory has a single point at time 0; give it the time at which the arm should "
                "arrive");
        }
        const JointMotion motion = joint_trajectory(points, start);
        check_trajectory(motion, input);
        return motion;
      },
      goal, std::move(listener));
}

void ArmMotion::check_trajectory(const JointMotion& motion, const Input& input) const {
  const double allowed = allowed_hand_speed(input);
  if (const double fastest = std::isfinite(allowed) ? top_hand_speed(motion) : 0; fastest > 1.001 * allowed)
    throw MotionRefused(fmt::format(
        "the trajectory moves the hand{} of '{}' at {:.3g} m/s, but at most {:.3g} m/s are allowed beside "
        "people; use {:.2g} times the duration, or raise hand_speed_m_per_s in the scene's contact_bounds",
        has_prismatic_joints(*run_.models[arm_]) ? " or a carriage" : "", run_.modes->arm_name(arm_), fastest,
        allowed, fastest / allowed));
  const JointPeaks peaks = motion.peaks();
  const ArmLimits& limits = run_.models[arm_]->limits();
  const std::string& arm = run_.modes->arm_name(arm_);
  constexpr double kRounding = 1 + 1e-6;
  for (Eigen::Index j = 0; j < peaks.velocity.size(); ++j) {
    const std::string joint = joint_text(arm, j);
    const char* const unit = unit_of(j);
    if (peaks.lowest[j] < limits.q_min[j] - 1e-6 || peaks.highest[j] > limits.q_max[j] + 1e-6)
      throw MotionRefused(
          fmt::format("between its points the trajectory takes {} to {:.4g} {}: expected {:.4g} to {:.4g}",
                      joint, peaks.lowest[j] < limits.q_min[j] ? peaks.lowest[j] : peaks.highest[j], unit,
                      limits.q_min[j], limits.q_max[j]));
    if (peaks.velocity[j] > kRounding * limits.dq_max[j])
      throw MotionRefused(fmt::format("the trajectory moves {} at {:.4g} {}/s; the arm's limit is {:.4g}",
                                      joint, peaks.velocity[j], unit, limits.dq_max[j]));
    if (peaks.velocity[j] > kRounding * spec(input).max_speed)
      throw MotionRefused(
          fmt::format("the trajectory moves {} at {:.4g} {}/s; the limit of the input {}/{} is {:.4g} "
                      "(max_speed_rad_per_s of the controllet's `inputs:` in the scene); give it more time",
                      joint, peaks.velocity[j], unit, run_.modes->instance(input.instance).name(),
                      spec(input).name, spec(input).max_speed));
    if (peaks.acceleration[j] > kRounding * limits.ddq_max[j])
      throw MotionRefused(
          fmt::format("the trajectory accelerates {} at {:.4g} {}/s^2; the arm's limit is {:.4g}", joint,
                      peaks.acceleration[j], unit, limits.ddq_max[j]));
  }
}

void ArmMotion::begin(Quantity quantity, const std::function<Motion(const Start&, const Input&)>& plan,
                      TrajectoryGoal watch, std::shared_ptr<MotionListener> listener) {
  const Input input = find_input(quantity);
  for (const double lead : kLeads) {
    Run run{.input = input, .motion = JointMotion(JointVector()), .watch = watch};
    Start start;
    bool takes_over = false;
    std::int64_t last_t0 = kNow;
    {
      const std::lock_guard lock(mutex_);
      if (t_ == kNow || latest(input) == nullptr)
        throw MotionRefused("the arm's controllet has not run yet; try again");
      start = start_of(input);
      if (watch.delay_s > 0) run.t0 = t_ + to_ns(watch.delay_s);
      if (!runs_.empty() && runs_.back().input.instance == input.instance &&
          runs_.back().input.input == input.input) {
        const Run& last = runs_.back();
        takes_over = true;
        last_t0 = last.t0;
        const std::int64_t start_ns = last.t0 == kNow ? t_ : last.t0;
        run.t0 = std::max({t_, start_ns, run.t0}) + to_ns(lead);
        std::visit([&](const auto& motion) { start = motion.sample(to_s(run.t0 - start_ns)); }, last.motion);
      }
    }
    try {
      run.motion = plan(start, input);
    } catch (const MotionRefused&) {
      throw;
    } catch (const std::invalid_argument& error) {
      throw MotionRefused(error.what());
    }
    run.knots = std::visit([](const auto& motion) { return motion.knots(); }, run.motion);
    const std::lock_guard lock(mutex_);
    // The plan was too late for a take-over, or the earlier motion has ended: start from the present state.
    if (takes_over && (runs_.empty() || runs_.back().t0 != last_t0 || run.t0 <= t_)) continue;
    if (!runs_.empty()) {
      Run& last = runs_.back();
      if (last.listener) last.listener->over(MotionResult::preempted, "a newer motion took over");
      last.listener = nullptr;
      // The earlier motion used another input, which keeps a goal for its next use.
      if (!takes_over && !last.goal_sent && last.t0 != kNow && t_ >= last.t0)
        post(last, to_s(t_ - last.t0), Delivery::goal);
      if (!takes_over) runs_.clear();
    }
    run.listener = std::move(listener);
    runs_.push_back(std::move(run));
    return;
  }
  throw MotionRefused("planning the motion takes too long; try again when the arm is at rest");
}

bool ArmMotion::cancel(const MotionListener& listener) {
  const std::lock_guard lock(mutex_);
  if (runs_.empty() || runs_.back().listener.get() != &listener) return false;
  Run& run = runs_.back();
  if (run.t0 == kNow || run.t0 > t_) {  // not started yet
    if (runs_.size() > 1) {             // the motion before it still moves
      runs_[runs_.size() - 2].listener = std::move(run.listener);
      runs_.pop_back();
      brake(runs_.back(), MotionResult::canceled, "canceled");
    } else {
      end(MotionResult::canceled, "canceled before it started");
    }
    return true;
  }
  brake(run, MotionResult::canceled, "canceled");
  return true;
}

const ReferenceSample* ArmMotion::latest(const Input& input) const {
  for (const ReferenceSample& each : references_) {
    if (each.instance == input.instance && each.input == input.input) return &each;
  }
  return nullptr;
}

// Returns the set-point and its velocity; the unrecorded acceleration is assumed to be zero.
ArmMotion::Start ArmMotion::start_of(const Input& input) const {
  const ReferenceSample& now = *latest(input);
  if (spec(input).quantity == Quantity::joints) {
    JointSample start;
    start.position = joints_of(now.values, n_);
    start.velocity = joints_of(now.rates, n_);
    start.acceleration = joint_constant(n_, 0);
    return start;
  }
  PoseSample start;
  start.X = Pose::from(now.values.data());
  start.V.vector = Eigen::Map<const Vector6>(now.rates.data());
  return start;
}

void ArmMotion::brake(Run& run, MotionResult end, std::string why) {
  if (run.braking) return;
  run.braking = true;
  run.end = end;
  run.why = std::move(why);
  if (run.goal_sent) return;  // practically at rest
  const double t = run.t0 == kNow ? 0 : to_s(t_ - run.t0);
  if (const auto* joints = std::get_if<JointMotion>(&run.motion)) {
    run.motion = joint_brake(joints->sample(t), joint_limits(run.input));
  } else {
    run.motion = pose_brake(std::get<PoseMotion>(run.motion).sample(t), pose_limits(run.input));
  }
  if (run.t0 != kNow) run.t0 = t_;
}

void ArmMotion::end(MotionResult end, const std::string& why) {
  for (Run& run : runs_) {
    if (run.listener) run.listener->over(end, why);
  }
  runs_.clear();
}

bool ArmMotion::post(const Run& run, double t, Delivery delivery) {
  Target target;
  if (const auto* joints = std::get_if<JointMotion>(&run.motion)) {
    const JointSample sample = joints->sample(t);
    target.delivery = delivery;
    target.size = static_cast<std::uint8_t>(n_);
    std::copy_n(sample.position.data(), n_, target.values.begin());
  } else {
    target = pose_target(std::get<PoseMotion>(run.motion).sample(t).X, 0, delivery);
  }
  return run_.modes->instance(run.input.instance).inputs()[run.input.input].post(target) == Verdict::accepted;
}

// Distance of the set-point from the goal and from rest, as a fraction of the tolerance.
double ArmMotion::off_goal(const Run& run) const {
  const ReferenceSample* now = latest(run.input);
  if (now == nullptr) return 1e9;
  const Start at = start_of(run.input);
  if (const auto* joints = std::get_if<JointMotion>(&run.motion)) {
    const auto& sample = std::get<JointSample>(at);
    const JointVector goal = joints->sample(joints->duration()).position;
    return std::max((sample.position - goal).lpNorm<Eigen::Infinity>() / kAtGoal,
                    sample.velocity.lpNorm<Eigen::Infinity>() / kAtRest);
  }
  const auto& motion = std::get<PoseMotion>(run.motion);
  const auto& sample = std::get<PoseSample>(at);
  return std::max(
      pose_error(motion.sample(motion.duration()).X, sample.X).lpNorm<Eigen::Infinity>() / kAtGoal,
      sample.V.vector.lpNorm<Eigen::Infinity>() / kAtRest);
}

// Returns false if the arm left the path; then it brakes.
bool ArmMotion::watch_path(Run& run, const ArmSample& arm, double t) {
  const auto* joints = std::get_if<JointMotion>(&run.motion);
  if (joints == nullptr || run.braking) return true;
  const JointSample desired = joints->sample(t);
  const auto leaves = [&](const JointVector& tolerance, const JointVector& error, const char* rate) {
    for (Eigen::Index j = 0; j < tolerance.size(); ++j) {
      if (tolerance[j] <= 0 || std::abs(error[j]) <= tolerance[j]) continue;
      brake(run, MotionResult::path_tolerance,
            fmt::format("{} is {:.4g} {}{} off its path; the tolerance is {:.4g}",
                        joint_text(run_.modes->arm_name(arm_), j), std::abs(error[j]), unit_of(j), rate,
                        tolerance[j]));
      return true;
    }
    return false;
  };
  return !leaves(run.watch.path_position, desired.position - joints_of(arm.q, n_), "") &&
         !leaves(run.watch.path_velocity, desired.velocity - joints_of(arm.dq, n_), "/s");
}

void ArmMotion::notify(Run& run, const ArmSample& arm, double t) {
  if (!run.listener || run.braking) return;
  if (run.last_progress != kNow && t_ - run.last_progress < to_ns(kProgressEvery)) return;
  run.last_progress = t_;
  MotionProgress progress{.time_s = std::min(t, duration_of(run.motion)),
                          .duration_s = duration_of(run.motion)};
  progress.point = static_cast<std::size_t>(std::ranges::lower_bound(run.knots, t) - run.knots.begin());
  progress.point = std::min(progress.point, run.knots.empty() ? 0 : run.knots.size() - 1);
  progress.q = joints_of(arm.q, n_);
  progress.dq = joints_of(arm.dq, n_);
  if (const auto* joints = std::get_if<JointMotion>(&run.motion)) progress.desired = joints->sample(t);
  run.listener->progress(progress);
}

// After the end of the plan: waits for the set-point to come to rest, then for the arm to arrive.
void ArmMotion::settle(Run& run, const ArmSample& arm, double t) {
  const double since = t - duration_of(run.motion);
  if (off_goal(run) > 1) {
    if (since > kSettleTime)
      end(MotionResult::lost,
          "the set-point did not reach the goal; check that no other client moves the same input");
    return;
  }
  if (run.end != MotionResult::reached) return end(run.end, run.why);
  const JointVector& position = run.watch.goal_position;
  const JointVector& velocity = run.watch.goal_velocity;
  const auto* joints = std::get_if<JointMotion>(&run.motion);
  if (joints != nullptr && (position.size() > 0 || velocity.size() > 0)) {
    const JointVector off = joints_of(arm.q, n_) - joints->sample(joints->duration()).position;
    for (Eigen::Index j = 0; j < static_cast<Eigen::Index>(n_); ++j) {
      const bool far = position.size() > 0 && position[j] > 0 && std::abs(off[j]) > position[j];
      const double speed = std::abs(arm.dq[static_cast<std::size_t>(j)]);
      const bool fast = velocity.size() > 0 && velocity[j] > 0 && speed > velocity[j];
      if (!far && !fast) continue;
      if (since < std::max(run.watch.goal_time_s, kSettleTime)) return;
      const std::string joint = joint_text(run_.modes->arm_name(arm_), j);
      return end(MotionResult::goal_tolerance,
                 far ? fmt::format("{} is {:.4g} {} off its goal; the tolerance is {:.4g}", joint,
                                   std::abs(off[j]), unit_of(j), position[j])
                     : fmt::format("{} moves at {:.4g} {}/s at its goal; the tolerance is {:.4g}", joint,
                                   speed, unit_of(j), velocity[j]));
    }
  }
  end(MotionResult::reached, "");
}

// Returns the loop's progress since the record [ns], in whole periods: a sample belongs to the loop's
// newest cycle, however late this thread runs. Fractions of a period would add this thread's jitter to
// the set-point.
std::int64_t ArmMotion::behind(const CycleRecord& record) const {
  const double period = run_.backend->period();
  if (!paced_ || record.start.ns == 0) return 0;
  const double age = std::clamp(seconds(host_now() - record.start), 0.0, kLatest);
  return to_ns(period * std::floor(age / period));
}

// A controllet that stops and starts again within one cycle drives the arm in every record, but begins at the
// arm's position.
void ArmMotion::take(const Event& event) {
  const std::lock_guard lock(mutex_);
  if (event.kind != EventKind::switched) return;
  for (const Run& run : runs_) {
    if ((event.stopped & bit(run.input.instance)) == 0) continue;
    return end(MotionResult::lost,
               fmt::format("'{}' no longer drives '{}' (switched, stopped, in error or started again)",
                           run_.modes->instance(run.input.instance).name(), run_.modes->arm_name(arm_)));
  }
}

void ArmMotion::take(const CycleRecord& record) {
  const std::lock_guard lock(mutex_);
  const std::int64_t before = t_;
  t_ = std::max(t_, record.t.ns + behind(record));
  start_ = record.start;
  references_.clear();
  for (std::size_t i = 0; i < record.reference_count; ++i) {
    const ReferenceSample& each = record.references[i];
    if (run_.modes->instance(each.instance).arms().contains(arm_)) references_.push_back(each);
  }
  if (runs_.empty()) return;
  while (runs_.size() > 1 && t_ >= runs_[1].t0) runs_.pop_front();
  Run& run = runs_.front();
  const ArmSample& arm = record.arms[arm_];
  if (arm.owner != run.input.instance) {
    end(MotionResult::lost,
        fmt::format("'{}' no longer drives '{}' (switched, stopped or in error; the arm is {})",
                    run_.modes->instance(run.input.instance).name(), run_.modes->arm_name(arm_),
                    to_string(static_cast<ArmMode>(arm.mode))));
    return;
  }
  if (run.t0 == kNow) run.t0 = t_;
  if (t_ < run.t0) return;

  // Measurements are compared at the record's own time.
  if (!run.goal_sent) watch_path(run, arm, to_s(record.t.ns - run.t0));
  const double t = to_s(t_ - run.t0);
  notify(run, arm, t);
  if (t < duration_of(run.motion)) {
    // Once per cycle, because the sequence numbers of a series count cycles.
    if (t_ != before && !post(run, t, Delivery::stream))
      end(MotionResult::lost, "the input refused a sample of the motion");
  } else if (!run.goal_sent) {
    run.goal_sent = true;
    if (!post(run, t, Delivery::goal)) end(MotionResult::lost, "the input refused the goal of the motion");
  } else if (runs_.size() == 1) {
    settle(run, arm, t);
  }
}

}  // namespace multipanda
