#include "motion_generators/via_points/via_plan.hpp"
#include "yaml_reader/archive.hpp"

// The keys of the file; docs/motion_generator.md explains them.
namespace multipanda {
namespace {

void read_joints(const Node& list, ViaTrack& track) {
  if (!list.is_list() || list.yaml().size() == 0) list.expected("a list of at least one via point");
  for (const auto& point : list.items()) {
    const auto angles = point.numbers(Key("joints_rad").any_turn().joints(0));
    if (angles.empty() || angles.size() > kMaxJoints) {
      point.refuse("expected one angle [rad] per joint, at most " + std::to_string(kMaxJoints) + ", found " +
                   std::to_string(angles.size()));
    }
    track.joints.emplace_back(Eigen::Map<const Eigen::VectorXd>(angles.data(), std::ssize(angles)));
    if (track.joints.back().size() != track.joints.front().size()) {
      point.refuse("expected as many angles as in the first via point, " +
                   std::to_string(track.joints.front().size()));
    }
  }
}

void visit_limits(Archive& archive, ViaPlan& plan) {
  archive(Key("velocity_rad_per_s").above(0), plan.joint_limits.velocity);
  archive(Key("acceleration_rad_per_s2").above(0), plan.joint_limits.acceleration);
  archive(Key("jerk_rad_per_s3").above(0), plan.joint_limits.jerk);
  archive(Key("speed_m_per_s").above(0), plan.pose_limits.speed);
  archive(Key("acceleration_m_per_s2").above(0), plan.pose_limits.acceleration);
  archive(Key("jerk_m_per_s3").above(0), plan.pose_limits.jerk);
  archive(Key("angular_speed_rad_per_s").above(0), plan.pose_limits.angular_speed);
  archive(Key("angular_acceleration_rad_per_s2").above(0), plan.pose_limits.angular_acceleration);
  archive(Key("angular_jerk_rad_per_s3").above(0), plan.pose_limits.angular_jerk);
}

}  // namespace

void visit(Archive& archive, ViaTrack& track) {
  archive(Key("arm").required(), track.arm);
  const auto joints = archive.open(Key("joints_rad"));
  circular_field::visit_poses(archive, Key("poses").each("pose"), track.poses);
  archive.list(Key("publish").each("destination").required(), track.publish);
  if (!archive.reading()) return;
  if (archive.has("joints_rad") == archive.has("poses"))
    archive.self().refuse("expected either 'joints_rad' or 'poses'");
  if (joints) read_joints(*joints, track);
  if (archive.has("poses") && track.poses.empty())
    archive.at("poses").refuse("expected at least one via point");
  if (track.publish.empty()) archive.at("publish").refuse("expected at least one controllet and input");
  for (const auto& to : track.publish) {
    if (track.poses.empty() && !to.offset.isZero(0))
      archive.at("publish").refuse("'offset_m' is valid with 'poses' only");
  }
}

void visit(Archive& archive, ViaPlan& plan) {
  archive(Key("name").required(), plan.name);
  archive(Key("scale").above(0).at_most(1), plan.scale);
  archive(Key("repeat"), plan.repeat);
  archive.part(Key("limits"), [&](Archive& inner) { visit_limits(inner, plan); });
  archive.list(Key("tracks").each("track").required(), plan.tracks);
  if (archive.reading() && plan.tracks.empty()) archive.at("tracks").refuse("expected at least one track");
}

ViaPlan load_via_plan(const std::filesystem::path& file) {
  ViaPlan plan;
  Archive::read(Node::load(file.string()), plan);
  return plan;
}

}  // namespace multipanda
