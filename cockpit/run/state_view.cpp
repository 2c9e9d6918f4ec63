#include "cockpit/run/state_view.hpp"

#include <algorithm>
#include <chrono>
#include <limits>

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

}  // namespace multipanda::cockpit
