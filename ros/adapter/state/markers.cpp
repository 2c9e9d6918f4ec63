#include "ros/adapter/state/markers.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/state/messages.hpp"

namespace multipanda::ros {
namespace {

using Marker = visualization_msgs::msg::Marker;
using Rgba = std::array<double, 4>;

constexpr Rgba kRed{0.85, 0.15, 0.1, 1}, kGreen{0.15, 0.7, 0.2, 1}, kBlue{0.15, 0.35, 0.9, 1},
    kOrange{0.95, 0.55, 0.1, 1}, kGray{0.5, 0.5, 0.5, 1};
const Vector3 kArrow{0.01, 0.02, 0};  // diameters of shaft and head [m]
constexpr double kAxis = 0.1;         // length of a target's axes [m]
constexpr double kPlane = 4;          // edge of the drawn part of a plane [m]
constexpr double kSheet = 0.002;      // its thickness [m]
constexpr double kThin = 1e-4;        // smallest size of a shape, since viewers reject 0 [m]
constexpr double kLetter = 0.04;      // height of text [m]

std_msgs::msg::ColorRGBA color(const Rgba& rgba) {
  std_msgs::msg::ColorRGBA out;
  out.r = static_cast<float>(rgba[0]);
  out.g = static_cast<float>(rgba[1]);
  out.b = static_cast<float>(rgba[2]);
  out.a = static_cast<float>(rgba[3]);
  return out;
}

Pose along_z(double z) { return {Matrix3::Identity(), {0, 0, z}}; }

// Available without a world, as with real arms and under ros2_control.
std::vector<std::optional<Pose>> places_of_fixed(const std::vector<SceneObject>& objects) {
  std::vector<std::optional<Pose>> X_WO(objects.size());
  for (std::size_t i = 0; i < objects.size(); ++i) {
    if (objects[i].fixed) X_WO[i] = objects[i].X_WO;
  }
  return X_WO;
}

}  // namespace

Markers::Markers(const AdapterContext& run)
    : run_(run),
      models_(run),
      turn_(run.options->rates_hz.markers, run.backend->period()),
      publisher_(
          *run.node, "~/markers", Qos::reliable(),
          Doc{turn_.text(run.backend->period()),
              "For viewers such as rviz: objects, targets and tanks of active controllets, forces (1 m "
              "for 200 N)."}),
      every_(turn_),
      X_WO_(places_of_fixed(run.scene->objects)),
      newest_(X_WO_) {
  for (std::size_t i = 0; i < X_WO_.size(); ++i) add_object(run.scene->objects[i], i);
  for (InstanceIndex i = 0; i < run.modes->instance_count(); ++i) {
    add_targets(run.modes->instance(i));
    add_tanks(run.modes->instance(i), run.layout->instances[i]);
  }
  for (const auto& model : run.models) {
    at_targets_.emplace_back(model);
    contact_.push_back(add("contact_forces", Marker::ARROW, kArrow, kRed, kWorldFrame));
    estimated_.push_back(add("estimated_forces", Marker::ARROW, kArrow, kOrange, kWorldFrame));
  }
}

std::size_t Markers::add(const std::string& ns, std::int32_t type, const Vector3& scale, const Rgba& rgba,
                         const std::string& frame) {
  auto& markers = message_.markers;
  Marker marker;
  marker.header.frame_id = frame;
  marker.ns = ns;
  marker.id = static_cast<std::int32_t>(
      std::count_if(markers.begin(), markers.end(), [&](const Marker& m) { return m.ns == ns; }));
  marker.type = type;
  set_vector(marker.scale, scale);
  marker.color = color(rgba);
  // Removes the markers of a run that has ended.
  const double period = 1 / run_.options->rates_hz.markers;  // [s]
  marker.lifetime.sec = std::max(2, static_cast<std::int32_t>(std::ceil(2 * period)));
  markers.push_back(std::move(marker));
  return markers.size() - 1;
}

void Markers::add_object(const SceneObject& object, std::size_t index) {
  const auto part = [&](std::int32_t type, const Vector3& size, const Pose& X_OM) {
    parts_.push_back({add("objects", type, size, object.rgba, kWorldFrame), index, X_OM});
  };
  const double diameter = object.size.x(), length = object.size.z();
  switch (object.shape) {
    case ShapeType::plane:
      return part(Marker::CUBE, {kPlane, kPlane, kSheet}, along_z(-0.5 * kSheet));
    case ShapeType::box:
      return part(Marker::CUBE, object.size, {});
    case ShapeType::sphere:
      return part(Marker::SPHERE, Vector3::Constant(diameter), {});
    case ShapeType::capsule:  // not a marker type
      part(Marker::SPHERE, Vector3::Constant(diameter), along_z(0.5 * length));
      part(Marker::SPHERE, Vector3::Constant(diameter), along_z(-0.5 * length));
      [[fallthrough]];
    case ShapeType::cylinder:
      return part(Marker::CYLINDER, {diameter, diameter, length}, {});
  }
}

void Markers::add_targets(const Instance& instance) {
  auto& targets = targets_.emplace_back();
  for (const Reference& input : instance.inputs()) {
    const InputSpec& spec = input.spec();
    targets.emplace_back();
    const ArmIndex arm = instance.arm_list()[spec.arm];
    if (spec.quantity == Quantity::pose || spec.quantity == Quantity::joints) {
      const std::string frame = spec.quantity == Quantity::pose ? spec.frame : kWorldFrame;
      const std::size_t axes = add("targets", Marker::LINE_LIST, {0.005, 0, 0}, kGray, frame);
      targets.back() = {axes, spec.quantity, arm};
      Marker& marker = message_.markers[axes];
      for (const auto& [axis, rgba] : {std::pair(0, kRed), std::pair(1, kGreen), std::pair(2, kBlue)}) {
        marker.points.emplace_back();
        set_vector(marker.points.emplace_back(), Vector3(kAxis * Vector3::Unit(axis)));
        marker.colors.insert(marker.colors.end(), 2, color(rgba));
      }
    } else if (spec.quantity == Quantity::wrench && spec.frame == kWorldFrame) {
      targets.back() = {add("targets", Marker::ARROW, kArrow, kGreen, kWorldFrame), spec.quantity, arm};
    }
  }
}

void Markers::add_tanks(const Instance& instance, const RecordLayout::Instance& layout) {
  const std::size_t greatest = instance.find_parameter("tank_max_j");
  if (greatest == instance.parameter_count()) return;
  std::size_t k = 0;
  for (const auto& output : layout.outputs) {
    if (!output.name.ends_with("_tank_j") || output.size != 1) continue;
    Pose X_WT = run_.models[instance.arm_list().front()]->X_WB();
    X_WT.position = X_WT * tank_place(k++);
    tanks_.push_back({.bar = add("tanks", Marker::CYLINDER, {0.04, 0.04, kThin}, kBlue, kWorldFrame),
                      .text = add("tanks", Marker::TEXT_VIEW_FACING, {0, 0, kLetter}, kGray, kWorldFrame),
                      .output = output.offset,
                      .name = output.name.substr(0, output.name.size() - 2),
                      .instance = &instance,
                      .greatest = greatest,
                      .X_WT = X_WT});
  }
}

Markers::Marker& Markers::show(std::size_t marker, const Pose& X) {
  Marker& out = message_.markers[marker];
  out.action = Marker::ADD;
  set_pose(out.pose, X);
  return out;
}

void Markers::show_arrow(std::size_t marker, const Vector3& from, const double* force) {
  const Eigen::Map<const Vector3> f(force);
  if (!(f.norm() >= kLeastForce)) return;
  Marker& out = show(marker, {});
  out.points.resize(2);
  set_vector(out.points[0], from);
  set_vector(out.points[1], Vector3(from + kMetersPerNewton * f));
}

void Markers::show_target(const Target& target, const ReferenceSample& sample) {
  const double* v = sample.values.data();
  switch (target.quantity) {
    case Quantity::pose:
      show(target.marker, Pose::from(v));
      return;
    case Quantity::joints: {
      const ArmModels::Arm& arm = models_.arms()[target.arm];
      ModelTerms& terms = at_targets_[target.arm];
      terms.set_config(arm.frames, arm.tool, arm.load);
      const auto n = static_cast<Eigen::Index>(arm.joint_count);
      terms.update(JointVector(Eigen::Map<const Eigen::VectorXd>(v, n)), JointVector(JointVector::Zero(n)));
      show(target.marker, terms.X_WE());
      return;
    }
    case Quantity::wrench:
      return show_arrow(target.marker, models_.terms(target.arm).X_WE().position, v);
    case Quantity::twist:
    case Quantity::scalar:
      return;
  }
}

void Markers::show_forces(const CycleRecord& record) {
  for (std::size_t i = 0; i < record.arms.size(); ++i) {
    const ArmSample& sample = record.arms[i];
    if (!sample.has_contact_truth && !sample.has_wrench_estimate) continue;
    const Vector3 p_WK = models_.terms(i).X_WK().position;
    if (sample.has_contact_truth) show_arrow(contact_[i], p_WK, sample.F_K_W_true.data());
    if (sample.has_wrench_estimate) show_arrow(estimated_[i], p_WK, sample.F_K_W_est.data());
  }
}

void Markers::show_tank(const Tank& tank, double energy) {
  if (!std::isfinite(energy)) return;  // not active
  const double greatest = tank.instance->parameter(tank.greatest).front();
  const double level = greatest > 0 ? std::clamp(energy / greatest, 0.0, 1.0) : 0;
  const double height = std::max(kThin, kTankHeight * level);
  show(tank.bar, tank.X_WT * along_z(0.5 * height)).scale.z = height;
  show(tank.text, tank.X_WT * along_z(kTankHeight + kLetter)).text =
      fmt::format("{} {:.2f} J", tank.name, energy);
}

void Markers::on_loop(const Tick& tick, const Backend& backend) {
  if (!every_.due(tick.cycle) || !watched_.load(std::memory_order_relaxed)) return;
  const auto& objects = run_.scene->objects;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    if (const auto X_WO = backend.object_pose(objects[i].name); X_WO || !objects[i].fixed) X_WO_[i] = X_WO;
  }
  newest_.write(X_WO_);
}

void Markers::take(const CycleRecord& record) {
  if (!turn_.due(record.cycle)) return;
  const bool watched = publisher_.subscribers() > 0;
  watched_.store(watched, std::memory_order_relaxed);
  if (!watched) return;
  models_.take(record);
  const auto stamp = to_time(run_.stamps.of(record));
  for (Marker& marker : message_.markers) {
    marker.header.stamp = stamp;
    marker.action = Marker::DELETE;
  }
  (void)newest_.take();
  for (const Part& part : parts_) {
    if (const auto& X_WO = newest_.value()[part.object]) show(part.marker, *X_WO * part.X_OM);
  }
  for (std::size_t k = 0; k < record.reference_count; ++k) {
    const ReferenceSample& sample = record.references[k];
    if (const auto& target = targets_.at(sample.instance).at(sample.input)) show_target(*target, sample);
  }
  show_forces(record);
  for (const Tank& tank : tanks_) show_tank(tank, record.outputs[tank.output]);
  publisher_.publish(message_);
}

}  // namespace multipanda::ros
