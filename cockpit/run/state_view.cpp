#include "cockpit/run/state_view.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "runtime/live_input/request_handler.hpp"
#include "scene/build.hpp"

namespace multipanda::cockpit {

namespace {

// The cycle's fields that keep their names; `t_ns` and `total_ns` become t_s and total_us.
constexpr std::array<const char*, 3> kOfCycle{"cycle", "period_s", "overruns"};

bool is_of_cycle(const std::string& name) { return name.find('/') == std::string::npos; }

double unix_ms() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration<double, std::milli>(now).count();
}

}  // namespace

StateView::StateView(const Scene& scene, std::vector<std::shared_ptr<const ArmModel>> models,
                     const std::vector<RecordReader::Field>& fields)
    : models_(std::move(models)), bodies_(scene), near_(models_, fixed_obstacles(scene)) {
  const auto find = [&](const std::string& name) {
    const auto found = std::ranges::find(fields, name, &RecordReader::Field::name);
    if (found == fields.end()) throw std::invalid_argument("the records have no field '" + name + "'");
    return *found;
  };
  t_ns_ = find("t_ns");
  total_ns_ = find("total_ns");
  for (const char* name : kOfCycle) copies_.push_back({find(name), add(name, 1)});
  t_at_ = add("t_s", 1);
  sent_at_ = add("sent_ms", 1);
  since_at_ = add("since_cycle_s", 1);
  total_at_ = add("total_us", 1);
  bodies_at_ = add("bodies", SceneBodies::kPoseNumbers * bodies_.count());
  near_at_ = add("near", NearPairs::kMost * NearPairs::kNumbers);
  for (const auto& field : fields) {
    if (!is_of_cycle(field.name)) copies_.push_back({field, add(field.name, field.count)});
  }
  for (std::size_t i = 0; i < models_.size(); ++i) {
    const std::string prefix = scene.arms[i].name + "/";
    arms_.push_back({.q_start = scene.arms[i].q_start,
                     .q = find(prefix + "q_rad"),
                     .gripper = find(prefix + "gripper_width_m"),
                     .stiffness_frame = add(prefix + "stiffness_frame_m", 3),
                     .manipulability = add(prefix + "manipulability", 1),
                     .tracking_error = add(prefix + "tracking_error", 1),
                     .torque_use = add(prefix + "torque_use", 1),
                     .joint_limit = add(prefix + "nearest_joint_limit_rad", 1)});
    terms_.emplace_back(models_[i]);
  }
}

std::size_t StateView::add(const std::string& name, std::size_t count) {
  const std::size_t at = values_.size();
  described_.push_back({name, count});
  values_.resize(at + count, std::numeric_limits<double>::quiet_NaN());
  return at;
}

nlohmann::json StateView::bodies() {
  std::vector<SceneBodies::ArmPose> poses;
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    const JointVector& q = arms_[i].q_start;
    terms_[i].update(q, JointVector::Zero(q.size()));
    poses.push_back({&terms_[i], std::numeric_limits<double>::quiet_NaN()});
  }
  std::vector<double> start(SceneBodies::kPoseNumbers * bodies_.count());
  bodies_.place(poses, {}, start);
  return bodies_.describe(start);
}

std::span<const double> StateView::compute(const RecordReader::Record& record, double since_s,
                                           std::span<const More> more,
                                           std::span<const std::optional<Pose>> objects) {
  for (const Copy& copy : copies_) {
    for (std::size_t k = 0; k < copy.field.count; ++k)
      values_[copy.at + k] = RecordReader::number(record, copy.field, k);
  }
  values_[t_at_] = 1e-9 * RecordReader::number(record, t_ns_);
  values_[total_at_] = 1e-3 * RecordReader::number(record, total_ns_);
  values_[since_at_] = since_s;
  std::vector<SceneBodies::ArmPose> poses;
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    JointVector q(static_cast<Eigen::Index>(arm.q.count));
    for (std::size_t k = 0; k < arm.q.count; ++k)
      q[static_cast<Eigen::Index>(k)] = RecordReader::number(record, arm.q, k);
    terms_[i].set_config(more[i].frames, {}, {});
    terms_[i].update(q, JointVector::Zero(q.size()));
    const Vector3 p_K = terms_[i].X_WK().position;
    std::copy_n(p_K.data(), 3, values_.begin() + static_cast<std::ptrdiff_t>(arm.stiffness_frame));
    values_[arm.manipulability] = terms_[i].manipulability();
    values_[arm.tracking_error] = more[i].tracking_error;
    values_[arm.torque_use] = more[i].torque_use;
    const ArmLimits& limits = models_[i]->limits();
    values_[arm.joint_limit] = (q - limits.q_min).cwiseMin(limits.q_max - q).minCoeff();
    poses.push_back({&terms_[i], RecordReader::number(record, arm.gripper)});
  }
  const std::span all(values_);
  bodies_.place(poses, objects, all.subspan(bodies_at_, SceneBodies::kPoseNumbers * bodies_.count()));
  near_.find(terms_, all.subspan(near_at_, NearPairs::kMost * NearPairs::kNumbers));
  values_[sent_at_] = unix_ms();
  return values_;
}

namespace {

// Deceleration of the reference (core/reference/reference.hpp), and the shortest time that it takes.
constexpr double kBraking = 4, kTurnBraking = 8, kJointBraking = 5;  // [m/s^2], [rad/s^2]
constexpr double kLeastTime = 0.1;                                   // [s]

// Distance within which a speed is reduced to zero.
double way(double speed, double braking) { return speed * std::max(0.5 * kLeastTime, speed / (2 * braking)); }

Quaternion quaternion(const std::vector<double>& pose) { return {pose[3], pose[4], pose[5], pose[6]}; }

}  // namespace

std::vector<double> MovedInputs::resting_place(Quantity quantity, const std::vector<double>& before,
                                               const std::vector<double>& now, double dt) {
  std::vector<double> rest = now;
  switch (quantity) {
    case Quantity::twist:
    case Quantity::wrench:
      std::ranges::fill(rest, 0);
      break;
    case Quantity::scalar:
      break;
    case Quantity::joints:
      if (!(dt > 0)) break;
      for (std::size_t k = 0; k < now.size(); ++k) {
        const double speed = (now[k] - before[k]) / dt;
        rest[k] += std::copysign(way(std::abs(speed), kJointBraking), speed);
      }
      break;
    case Quantity::pose: {
      if (!(dt > 0)) break;
      const Vector3 v = (Vector3(now[0], now[1], now[2]) - Vector3(before[0], before[1], before[2])) / dt;
      const double speed = v.norm();
      for (Eigen::Index k = 0; speed > 0 && k < 3; ++k)
        rest[static_cast<std::size_t>(k)] += v[k] / speed * way(speed, kBraking);
      const Quaternion R = quaternion(now);
      Eigen::AngleAxisd turn(R * quaternion(before).inverse());  // in the world
      double angle = turn.angle();
      if (angle > M_PI) angle -= 2 * M_PI;
      const double rate = angle / dt;
      const double more = std::copysign(way(std::abs(rate), kTurnBraking), rate);
      const Quaternion end = Quaternion(Eigen::AngleAxisd(more, turn.axis())) * R;
      const std::array<double, 4> wxyz{end.w(), end.x(), end.y(), end.z()};
      std::ranges::copy(wxyz, rest.begin() + 3);
      break;
    }
  }
  return rest;
}

bool MovedInputs::bring_to_rest(Instance& instance, std::size_t index, const RecordReader& records) {
  Reference& input = instance.inputs()[index];
  const auto* field = records.find(instance.name() + "/" + input.spec().name);
  const auto* time = records.find("t_ns");
  RecordReader::Record newest, before;
  const std::uint64_t count = records.records();
  if (field == nullptr || count < 2 || !records.read(count - 1, newest) || !records.read(count - 2, before))
    return false;
  const auto values_of = [&](const RecordReader::Record& record) {
    std::vector<double> values(field->count);
    for (std::size_t k = 0; k < values.size(); ++k) values[k] = RecordReader::number(record, *field, k);
    return values;
  };
  const auto now = values_of(newest), then = values_of(before);
  double dt = 1e-9 * (RecordReader::number(newest, *time) - RecordReader::number(before, *time));
  const auto finite = [](const std::vector<double>& values) {
    return std::ranges::all_of(values, [](double x) { return std::isfinite(x); });
  };
  if (!finite(now)) return false;
  if (!finite(then)) dt = 0;  // it began with the newest record
  const auto rest = resting_place(input.spec().quantity, then, now, dt);
  Target goal;
  goal.size = static_cast<std::uint8_t>(rest.size());
  std::ranges::copy(rest, goal.values.begin());
  // Directly to the input, like samples of streams: it replaces every earlier sample.
  return input.post(goal) == Verdict::accepted;
}

bool MovedInputs::stands_still(const Instance& instance, std::uint64_t since,
                               const RecordReader& records) const {
  const auto* time = records.find("t_ns");
  RecordReader::Record record;
  double newest = std::nan("");
  for (std::uint64_t number = records.records(); number-- > since;) {
    if (!records.read(number, record)) return false;
    for (const ArmIndex arm : instance.arm_list()) {
      const auto* speeds = records.find(modes_.arm_name(arm) + "/dq_rad_per_s");
      for (std::size_t k = 0; k < speeds->count; ++k) {
        if (!(std::abs(RecordReader::number(record, *speeds, k)) < kStillest)) return false;
      }
    }
    const double t = 1e-9 * RecordReader::number(record, *time);
    if (std::isnan(newest)) newest = t;
    if (newest - t >= kStill) return true;
  }
  return false;
}

InstanceSet MovedInputs::come_to_rest(const RecordReader& records, bool deactivate) {
  for (const std::uint64_t ticket : tickets_) modes_.withdraw(ticket);
  tickets_.clear();
  InstanceSet ending = 0;
  const InstanceSet active = modes_.active();
  for (const auto& [place, unused] : inputs_) {
    const auto& [index, input] = place;
    if ((active & bit(index)) == 0) continue;
    const bool rests = bring_to_rest(modes_.instance(index), input, records);
    if (deactivate || !rests) ending |= bit(index);
  }
  inputs_.clear();
  for (const auto& [index, record] : std::exchange(changed_, {})) {
    const Instance& instance = modes_.instance(index);
    // Its start may have been taken and not be visible yet, so it ends whether it is active or not.
    if (deactivate || !(instance.descriptor().guided || stands_still(instance, record, records)))
      ending |= bit(index);
  }
  if (ending != 0) end_or_stop(modes_, ending);
  return deactivate ? 0 : ending & active;
}

}  // namespace multipanda::cockpit
