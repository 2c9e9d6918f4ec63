#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "motion_generators/circular_field/planner.hpp"

namespace multipanda {
class Archive;
struct Key;
}  // namespace multipanda

namespace multipanda::circular_field {

// An obstacle's motion in closed form: p(t) = position + velocity t + amplitude sin(2 pi t / period + phase).
struct MovingBall {
  std::string name;
  double radius = 0.06;                 // [m]
  Vector3 position = Vector3::Zero();   // [m]
  Vector3 velocity = Vector3::Zero();   // [m/s]
  Vector3 amplitude = Vector3::Zero();  // [m]
  double period = 10;                   // [s]
  double phase = 0;                     // [rad]

  Ball at(double t) const;  // t [s] since the start
};

// Input of a controllet that follows a hand.
struct Destination {
  std::string controllet, input;
  Vector3 offset = Vector3::Zero();  // from the hand's pose, world axes [m]
};

struct CourseHand {
  HandSpec spec;
  // Arms of a run: the hand begins at the mean pose of their end effectors.
  std::vector<std::string> start_at;
  std::optional<Pose> start;  // used without a run
  std::vector<Pose> goals;    // in order, in the world
  std::vector<Destination> publish;
};

// A course as read from its file.
struct Course {
  std::string name;
  std::vector<CourseHand> hands;
  std::vector<MovingBall> obstacles;
  FieldGains gains;
  Limits limits;
  bool repeat = false;  // after its last goal a hand returns to its first

  std::vector<HandSpec> specs() const;
};

// Reads a course file (docs/motion_generator.md). Throws std::invalid_argument with "file:line: cause".
Course load_course(const std::filesystem::path& file);

// Parts common to the files of generators: a pose {position_m, rpy_rad}, both required; a list of them.
void visit_pose_part(Archive& archive, Key key, std::optional<Pose>& X);
void visit_poses(Archive& archive, Key key, std::vector<Pose>& poses);
void visit(Archive& archive, Destination& to);

// Executes a course: planner, motion of the obstacles and goals of the hands. One thread.
class CourseRun {
 public:
  // `starts` has one pose per hand. Throws std::invalid_argument if the count differs.
  CourseRun(Course course, const std::vector<Pose>& starts);

  void step(double dt);
  void brake();  // hands come to rest and ignore their goals

  double time() const { return time_; }  // [s]
  const Course& course() const { return course_; }
  const Planner& planner() const { return planner_; }
  const std::vector<Ball>& obstacles() const { return balls_; }
  std::size_t goals_reached(std::size_t hand) const { return reached_[hand]; }
  bool finished() const;  // every hand has reached its last goal; always false if the course repeats
  bool at_rest() const;   // slower than 1 mm/s and 1 mrad/s
  double clearance() const { return planner_.clearance(balls_); }  // [m]

 private:
  void move_obstacles();

  Course course_;
  Planner planner_;
  std::vector<Ball> balls_;
  std::vector<std::size_t> next_goal_, reached_;
  double time_ = 0;
};

}  // namespace multipanda::circular_field
