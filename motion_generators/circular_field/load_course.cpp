#include "motion_generators/circular_field/course.hpp"
#include "yaml_reader/archive.hpp"

// The keys of a course file; docs/motion_generator.md explains them.
namespace multipanda::circular_field {
namespace {

void visit_whole_pose(Archive& archive, Pose& X) {
  Vector3 rpy = Vector3::Zero();
  archive(Key("position_m").required(), X.position);
  archive(Key("rpy_rad").required(), rpy);
  X.rotation = rotation_from_rpy(rpy);
}

}  // namespace

void visit_pose_part(Archive& archive, Key key, std::optional<Pose>& X) {
  Pose read;
  archive.part(key, [&](Archive& inner) { visit_whole_pose(inner, read); });
  if (archive.has(key.name)) X = read;
}

void visit_poses(Archive& archive, Key key, std::vector<Pose>& poses) {
  archive.items(std::move(key), [&](Archive& inner) {
    Pose X;
    visit_whole_pose(inner, X);
    if (inner.reading()) poses.push_back(X);
  });
}

void visit(Archive& archive, Destination& to) {
  archive(Key("controllet").required(), to.controllet);
  archive(Key("input").required(), to.input);
  archive(Key("offset_m"), to.offset);
}

void visit(Archive& archive, Workspace& box) {
  archive(Key("min_m").required(), box.min);
  archive(Key("max_m").required(), box.max);
  if (archive.reading() && !((box.max - box.min).array() > 0).all())
    archive.self().refuse("expected max_m above min_m on every axis");
}

void visit(Archive& archive, CourseHand& hand) {
  archive(Key("name").required(), hand.spec.name);
  archive(Key("radius_m").above(0), hand.spec.radius);
  std::optional<Workspace> workspace;
  archive.section(Key("workspace"), workspace);
  if (workspace) hand.spec.workspace.push_back(*workspace);
  archive(Key("start_at"), hand.start_at);
  visit_pose_part(archive, Key("start"), hand.start);
  visit_poses(archive, Key("goals").each("goal").required(), hand.goals);
  archive.list(Key("publish").each("destination"), hand.publish);
  if (!archive.reading()) return;
  if (hand.start_at.empty() && !hand.start)
    archive.self().refuse("expected 'start_at' (arms of a run) or 'start' (a pose)");
  if (hand.goals.empty()) archive.at("goals").refuse("expected at least one goal");
}

void visit(Archive& archive, MovingBall& ball) {
  archive(Key("name").required(), ball.name);
  archive(Key("radius_m").above(0).required(), ball.radius);
  archive(Key("position_m").required(), ball.position);
  archive(Key("velocity_m_per_s"), ball.velocity);
  archive(Key("amplitude_m"), ball.amplitude);
  archive(Key("period_s").above(0), ball.period);
  archive(Key("phase_rad"), ball.phase);
}

void visit(Archive& archive, FieldGains& gains) {
  archive(Key("cruise_m_per_s").above(0), gains.cruise);
  archive(Key("approach_per_s").above(0), gains.approach);
  archive(Key("pull_per_s").above(0), gains.pull);
  archive(Key("range_m").above(0), gains.range);
  archive(Key("turn_rate_rad_per_s").above(0), gains.turn_rate);
  archive(Key("clearance_m").above(0), gains.clearance);
  archive(Key("braking_per_s").above(0), gains.braking);
}

void visit(Archive& archive, Limits& limits) {
  archive(Key("speed_m_per_s").above(0), limits.speed);
  archive(Key("acceleration_m_per_s2").above(0), limits.acceleration);
  archive(Key("jerk_m_per_s3").above(0), limits.jerk);
  archive(Key("angular_speed_rad_per_s").above(0), limits.angular_speed);
  archive(Key("arrived_m").above(0), limits.arrived);
  archive(Key("arrived_rad").above(0), limits.arrived_angle);
  archive(Key("arrived_m_per_s").above(0), limits.arrived_speed);
}

void visit(Archive& archive, Course& course) {
  archive(Key("name").required(), course.name);
  archive.list(Key("hands").each("hand").required(), course.hands);
  archive.list(Key("obstacles").each("obstacle"), course.obstacles);
  archive.section(Key("field"), course.gains);
  archive.section(Key("limits"), course.limits);
  archive(Key("repeat"), course.repeat);
}

Course load_course(const std::filesystem::path& file) {
  const Node root = Node::load(file.string());
  Course course;
  Archive::read(root, course);
  try {
    const Planner tried(course.specs(), course.gains, course.limits);
  } catch (const std::invalid_argument& error) {
    root.refuse(error.what());
  }
  return course;
}

}  // namespace multipanda::circular_field
