#include "motion_generators/testing/seeded_course.hpp"

#include <algorithm>
#include <numbers>
#include <random>

namespace multipanda::circular_field {
namespace {

constexpr double kHandRadius = 0.08;
const Workspace kWorkspace{{0.2, -0.6, 0.1}, {0.85, 0.6, 0.9}};  // of the hands' spheres

class Draw {
 public:
  explicit Draw(std::uint32_t seed) : engine_(seed) {}
  // The standard's distributions differ between libraries.
  double uniform(double a, double b) { return a + (b - a) * static_cast<double>(engine_()) / 4294967296.0; }
  Vector3 inside(const Workspace& box, double margin) {
    Vector3 p;
    for (int i = 0; i < 3; ++i) p[i] = uniform(box.min[i] + margin, box.max[i] - margin);
    return p;
  }
  Vector3 direction() {
    for (;;) {
      const Vector3 d(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
      if (d.norm() > 0.1 && d.norm() < 1) return d.normalized();
    }
  }

 private:
  std::mt19937 engine_;
};

Pose hand_pose(Draw& draw, const Vector3& position) {
  const double tilt = 0.3;  // from straight down
  return {rotation_from_rpy({std::numbers::pi + draw.uniform(-tilt, tilt), draw.uniform(-tilt, tilt),
                             draw.uniform(-0.8, 0.8)}),
          position};
}

// A goal is unreachable while it is inside an obstacle. It must be free for kFree without interruption
// between kWay, the time to get there, and kEnd.
bool attainable(const Course& course) {
  constexpr double kStep = 0.05, kWay = 3, kFree = 3, kEnd = 20;  // [s]
  for (const auto& hand : course.hands) {
    double free_s = 0, longest_s = 0;
    for (double t = kWay; t < kEnd; t += kStep) {
      bool free = true;
      for (const auto& obstacle : course.obstacles) {
        const Ball ball = obstacle.at(t);
        free = free && (ball.position - hand.goals[0].position).norm() >
                           ball.radius + kHandRadius + course.gains.clearance;
      }
      free_s = free ? free_s + kStep : 0;
      longest_s = std::max(longest_s, free_s);
    }
    if (longest_s < kFree) return false;
  }
  return true;
}

Course draw_course(Draw& draw, std::uint32_t seed, std::size_t obstacles) {
  Course course;
  course.name = "seed_" + std::to_string(seed);
  const double inside = kHandRadius + 0.05;
  for (const char* name : {"left", "right"}) {
    CourseHand hand;
    hand.spec = {name, kHandRadius, {kWorkspace}};
    const auto free = [&](const Vector3& p, bool goal) {
      for (const auto& other : course.hands) {
        const Vector3& q = goal ? other.goals[0].position : other.start->position;
        if ((p - q).norm() < 2 * kHandRadius + 0.1) return false;
      }
      return true;
    };
    Vector3 start, goal;
    do {
      start = draw.inside(kWorkspace, inside);
    } while (!free(start, false));
    do {
      goal = draw.inside(kWorkspace, inside);
    } while (!free(goal, true) || (goal - start).norm() < 0.3);
    hand.start = hand_pose(draw, start);
    hand.goals = {hand_pose(draw, goal)};
    course.hands.push_back(std::move(hand));
  }
  while (course.obstacles.size() < obstacles) {
    MovingBall ball;
    ball.name = "ball" + std::to_string(course.obstacles.size());
    ball.radius = draw.uniform(0.04, 0.08);
    ball.position = draw.inside(kWorkspace, 0);
    const double speed = draw.uniform(0.02, 0.1);
    if (draw.uniform(0, 1) < 0.5) {  // swings with the peak speed `speed`
      ball.amplitude = draw.uniform(0.05, 0.3) * draw.direction();
      ball.period = 2 * std::numbers::pi * ball.amplitude.norm() / speed;
      ball.phase = draw.uniform(0, 2 * std::numbers::pi);
    } else {
      ball.velocity = speed * draw.direction();
    }
    bool free = true;
    for (const auto& hand : course.hands) {
      const double gap = (ball.at(0).position - hand.start->position).norm() - ball.radius - kHandRadius;
      free = free && gap > 0.05;
    }
    if (free) course.obstacles.push_back(std::move(ball));
  }
  return course;
}

}  // namespace

Course seeded_course(std::uint32_t seed, std::size_t obstacles) {
  Draw draw(seed);
  for (;;) {
    Course course = draw_course(draw, seed, obstacles);
    if (attainable(course)) return course;
  }
}

}  // namespace multipanda::circular_field
