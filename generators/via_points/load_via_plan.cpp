#include "generators/via_points/via_plan.hpp"
#include "generators/yaml_pose.hpp"

// The file's keys; what they mean stands in docs/motion_generator.md.
namespace multipanda {
namespace {

void read(const CheckedYaml& map, const char* key, double& value) {
  if (const auto entry = map.find(key)) value = entry->positive();
}

JointVector read_joints(const CheckedYaml& list) {
  const auto items = list.items();
  if (items.empty() || items.size() > kMaxJoints)
    list.refuse("expected one angle [rad] per joint, at most " + std::to_string(kMaxJoints));
  JointVector q(static_cast<Eigen::Index>(items.size()));
  for (std::size_t i = 0; i < items.size(); ++i) q[static_cast<Eigen::Index>(i)] = read_angle(items[i]);
  return q;
}

void read_limits(const CheckedYaml& map, ViaPlan& plan) {
  map.allow_keys({"velocity_rad_per_s", "acceleration_rad_per_s2", "jerk_rad_per_s3", "speed_m_per_s",
                  "acceleration_m_per_s2", "jerk_m_per_s3", "angular_speed_rad_per_s",
                  "angular_acceleration_rad_per_s2", "angular_jerk_rad_per_s3"});
  read(map, "velocity_rad_per_s", plan.joint_limits.velocity);
  read(map, "acceleration_rad_per_s2", plan.joint_limits.acceleration);
  read(map, "jerk_rad_per_s3", plan.joint_limits.jerk);
  read(map, "speed_m_per_s", plan.pose_limits.speed);
  read(map, "acceleration_m_per_s2", plan.pose_limits.acceleration);
  read(map, "jerk_m_per_s3", plan.pose_limits.jerk);
  read(map, "angular_speed_rad_per_s", plan.pose_limits.angular_speed);
  read(map, "angular_acceleration_rad_per_s2", plan.pose_limits.angular_acceleration);
  read(map, "angular_jerk_rad_per_s3", plan.pose_limits.angular_jerk);
}

ViaTrack read_track(const CheckedYaml& map) {
  map.allow_keys({"arm", "joints_rad", "poses", "publish"});
  ViaTrack track;
  track.arm = map.at("arm").text();
  if (map.has("joints_rad") == map.has("poses")) map.refuse("expected either 'joints_rad' or 'poses'");
  if (const auto joints = map.find("joints_rad")) {
    for (const auto& point : joints->items()) {
      track.joints.push_back(read_joints(point));
      if (track.joints.back().size() != track.joints.front().size())
        point.refuse("expected as many angles as in the first via point, " +
                     std::to_string(track.joints.front().size()));
    }
    if (track.joints.empty()) joints->refuse("expected at least one via point");
  }
  if (const auto poses = map.find("poses")) {
    for (const auto& point : poses->items()) track.poses.push_back(read_pose(point));
    if (track.poses.empty()) poses->refuse("expected at least one via point");
  }
  for (const auto& entry : map.at("publish").items()) {
    entry.allow_keys({"controllet", "input", "offset_m"});
    circular_field::Destination to{.controllet = entry.at("controllet").text(),
                                   .input = entry.at("input").text()};
    if (const auto offset = entry.find("offset_m")) {
      if (track.poses.empty()) offset->refuse("goes with 'poses' only");
      to.offset = offset->vector3();
    }
    track.publish.push_back(std::move(to));
  }
  if (track.publish.empty()) map.at("publish").refuse("expected at least one controllet and input");
  return track;
}

}  // namespace

ViaPlan load_via_plan(const std::filesystem::path& file) {
  const CheckedYaml root = CheckedYaml::load(file);
  root.allow_keys({"name", "scale", "repeat", "limits", "tracks"});
  ViaPlan plan;
  plan.name = root.at("name").text();
  if (const auto scale = root.find("scale")) {
    plan.scale = scale->positive();
    if (plan.scale > 1) scale->refuse("expected a number above 0 and at most 1");
  }
  if (const auto repeat = root.find("repeat"))
    plan.repeat = repeat->one_of({"true", "false"}, "switch") == "true";
  if (const auto limits = root.find("limits")) read_limits(*limits, plan);
  for (const auto& track : root.at("tracks").items()) plan.tracks.push_back(read_track(track));
  if (plan.tracks.empty()) root.at("tracks").refuse("expected at least one track");
  return plan;
}

}  // namespace multipanda
