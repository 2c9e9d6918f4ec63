#include "generators/circular_field/course.hpp"
#include "generators/yaml_pose.hpp"

// The course file's keys; what they mean stands in docs/motion_generator.md.
namespace multipanda::circular_field {
namespace {

void read(const CheckedYaml& map, const char* key, double& value) {
  if (const auto entry = map.find(key)) value = entry->positive();
}

void read(const CheckedYaml& map, const char* key, Vector3& value) {
  if (const auto entry = map.find(key)) value = entry->vector3();
}

bool read_switch(const CheckedYaml& map, const char* key) {
  const auto entry = map.find(key);
  return entry && entry->one_of({"true", "false"}, "switch") == "true";
}

Workspace read_workspace(const CheckedYaml& map) {
  map.allow_keys({"min_m", "max_m"});
  Workspace box{map.at("min_m").vector3(), map.at("max_m").vector3()};
  if (!((box.max - box.min).array() > 0).all()) map.refuse("expected max_m above min_m on every axis");
  return box;
}

CourseHand read_hand(const CheckedYaml& map) {
  map.allow_keys({"name", "radius_m", "workspace", "start_at", "start", "goals", "publish"});
  CourseHand hand;
  hand.spec.name = map.at("name").text();
  read(map, "radius_m", hand.spec.radius);
  if (const auto box = map.find("workspace")) hand.spec.workspace.push_back(read_workspace(*box));
  if (const auto arms = map.find("start_at")) {
    for (const auto& arm : arms->items()) hand.start_at.push_back(arm.text());
  }
  if (const auto start = map.find("start")) hand.start = read_pose(*start);
  if (hand.start_at.empty() && !hand.start)
    map.refuse("expected 'start_at' (arms of a run) or 'start' (a pose)");
  for (const auto& goal : map.at("goals").items()) hand.goals.push_back(read_pose(goal));
  if (hand.goals.empty()) map.at("goals").refuse("expected at least one goal");
  if (const auto list = map.find("publish")) {
    for (const auto& entry : list->items()) {
      entry.allow_keys({"controllet", "input", "offset_m"});
      Destination to{.controllet = entry.at("controllet").text(), .input = entry.at("input").text()};
      read(entry, "offset_m", to.offset);
      hand.publish.push_back(std::move(to));
    }
  }
  return hand;
}

MovingBall read_obstacle(const CheckedYaml& map) {
  map.allow_keys(
      {"name", "radius_m", "position_m", "velocity_m_per_s", "amplitude_m", "period_s", "phase_rad"});
  MovingBall ball;
  ball.name = map.at("name").text();
  ball.radius = map.at("radius_m").positive();
  ball.position = map.at("position_m").vector3();
  read(map, "velocity_m_per_s", ball.velocity);
  read(map, "amplitude_m", ball.amplitude);
  read(map, "period_s", ball.period);
  if (const auto phase = map.find("phase_rad")) ball.phase = read_angle(*phase);
  return ball;
}

void read_gains(const CheckedYaml& map, FieldGains& gains) {
  map.allow_keys({"cruise_m_per_s", "approach_per_s", "pull_per_s", "range_m", "turn_rate_rad_per_s",
                  "clearance_m", "braking_per_s"});
  read(map, "cruise_m_per_s", gains.cruise);
  read(map, "approach_per_s", gains.approach);
  read(map, "pull_per_s", gains.pull);
  read(map, "range_m", gains.range);
  read(map, "turn_rate_rad_per_s", gains.turn_rate);
  read(map, "clearance_m", gains.clearance);
  read(map, "braking_per_s", gains.braking);
}

void read_limits(const CheckedYaml& map, Limits& limits) {
  map.allow_keys({"speed_m_per_s", "acceleration_m_per_s2", "jerk_m_per_s3", "angular_speed_rad_per_s",
                  "arrived_m", "arrived_rad", "arrived_m_per_s"});
  read(map, "speed_m_per_s", limits.speed);
  read(map, "acceleration_m_per_s2", limits.acceleration);
  read(map, "jerk_m_per_s3", limits.jerk);
  read(map, "angular_speed_rad_per_s", limits.angular_speed);
  read(map, "arrived_m", limits.arrived);
  read(map, "arrived_rad", limits.arrived_angle);
  read(map, "arrived_m_per_s", limits.arrived_speed);
}

}  // namespace

Course load_course(const std::filesystem::path& file) {
  const CheckedYaml root = CheckedYaml::load(file);
  root.allow_keys({"name", "hands", "obstacles", "field", "limits", "repeat"});
  Course course;
  course.name = root.at("name").text();
  for (const auto& hand : root.at("hands").items()) course.hands.push_back(read_hand(hand));
  if (const auto obstacles = root.find("obstacles")) {
    for (const auto& obstacle : obstacles->items()) course.obstacles.push_back(read_obstacle(obstacle));
  }
  if (const auto field = root.find("field")) read_gains(*field, course.gains);
  if (const auto limits = root.find("limits")) read_limits(*limits, course.limits);
  course.repeat = read_switch(root, "repeat");
  try {
    const Planner tried(course.specs(), course.gains, course.limits);
  } catch (const std::invalid_argument& error) {
    root.refuse(error.what());
  }
  return course;
}

}  // namespace multipanda::circular_field
