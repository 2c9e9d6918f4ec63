#include "motion_generators/publish.hpp"

#include <gtest/gtest.h>

#include "motion_generators/testing/seeded_course.hpp"

namespace multipanda::publish_test {
namespace {

using circular_field::Course;
using circular_field::CourseRun;
using circular_field::seeded_course;

class Memory final : public PoseSink {
 public:
  bool publish(std::size_t hand, const Pose& X_W, std::int64_t) override {
    if (refuses) return false;
    if (hand == 0) positions.push_back(X_W.position);
    return true;
  }
  std::vector<Vector3> positions;
  bool refuses = false;
};

CourseRun run_of(const Course& course) { return {course, starts_of(course)}; }

TEST(Publish, KeepsUpWithTheClockAndEndsAtRest) {
  CourseRun run = run_of(seeded_course(5));
  Memory memory;
  const PublishReport report = publish_course(run, memory, {.seconds = 0.4});
  EXPECT_EQ(report.ended_by, "duration");
  EXPECT_EQ(report.samples, memory.positions.size());
  EXPECT_EQ(report.unsent, 0u);
  EXPECT_TRUE(run.at_rest());
  EXPECT_GE(report.clearance_m, 0.02);
  EXPECT_LE(report.speed_m_per_s, 0.5);
  // Planned time is wall time: every period of the grid was planned, the published and the missed ones.
  EXPECT_NEAR(run.time(), static_cast<double>(report.samples + report.missed) * 1e-3, 1e-9);
  EXPECT_GE(report.elapsed_s, run.time() - 1e-6);
}

TEST(Publish, EndsWhenStoppedFinishedOrNotDelivered) {
  std::atomic<bool> stop{true};
  CourseRun stopped = run_of(seeded_course(5));
  Memory memory;
  EXPECT_EQ(publish_course(stopped, memory, {.stop = &stop}).ended_by, "stopped");
  EXPECT_TRUE(stopped.at_rest());

  memory.refuses = true;
  CourseRun alone = run_of(seeded_course(5));
  const PublishReport report = publish_course(alone, memory, {.patience_s = 0.5});
  EXPECT_EQ(report.ended_by, "no_receiver");
  EXPECT_EQ(report.unsent, 2 * report.samples);

  CourseRun rehearsed = run_of(seeded_course(5));
  const PublishReport whole = rehearse_course(rehearsed, {});
  EXPECT_EQ(whole.ended_by, "goals");
  EXPECT_EQ(whole.goals_reached, (std::vector<std::size_t>{1, 1}));
  EXPECT_GT(whole.speed_m_per_s, 0.2);
}

TEST(Publish, MidwayIsHalfWay) {
  const Pose a{rotation_from_rpy({0, 0, 0.2}), {0, 0.3, 0}},
      b{rotation_from_rpy({0, 0, 1.0}), {0.2, -0.3, 1}};
  const Pose m = midway({a, b});
  EXPECT_LT((m.position - Vector3(0.1, 0, 0.5)).norm(), 1e-12);
  EXPECT_LT((m.rotation - rotation_from_rpy({0, 0, 0.6})).norm(), 1e-12);
}

}  // namespace
}  // namespace multipanda::publish_test
