#include "motion_generators/circular_field/course.hpp"

#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace multipanda::circular_field::course_test {
namespace {

const char* const kGood = R"(name: test
hands:
  - name: left
    start: {position_m: [0.4, 0, 0.5], rpy_rad: [pi, 0, 0]}
    goals: [{position_m: [0.5, 0, 0.5], rpy_rad: [pi, 0, 0]}, {position_m: [0.4, 0, 0.5], rpy_rad: [pi, 0, 0]}]
    publish: [{controllet: dual, input: first_pose, offset_m: [0, 0.1, 0]}]
obstacles:
  - {name: a, radius_m: 0.05, position_m: [1, 2, 3], velocity_m_per_s: [0.1, 0, 0], amplitude_m: [0, 1, 0], period_s: 4}
field: {cruise_m_per_s: 0.3}
limits: {speed_m_per_s: 0.45}
)";

class CourseFile : public ::testing::Test {
 protected:
  void SetUp() override {
    file_ =
        std::filesystem::temp_directory_path() / ("multipanda_course_" + std::to_string(getpid()) + ".yaml");
  }
  void TearDown() override { std::filesystem::remove(file_); }
  Course load(const std::string& text) {
    std::ofstream(file_) << text;
    return load_course(file_);
  }
  // The text of the refusal; empty if there was none.
  std::string refusal(const std::string& from, const std::string& to) {
    std::string text = kGood;
    text.replace(text.find(from), from.size(), to);
    try {
      load(text);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  }
  std::filesystem::path file_;
};

TEST_F(CourseFile, IsRead) {
  const Course course = load(kGood);
  EXPECT_EQ(course.name, "test");
  ASSERT_EQ(course.hands.size(), 1u);
  EXPECT_EQ(course.hands[0].goals.size(), 2u);
  EXPECT_EQ(course.hands[0].publish[0].input, "first_pose");
  EXPECT_EQ(course.hands[0].publish[0].offset, Vector3(0, 0.1, 0));
  EXPECT_EQ(course.gains.cruise, 0.3);
  EXPECT_EQ(course.limits.speed, 0.45);
  EXPECT_FALSE(course.repeat);
  const Ball at_1 = course.obstacles.at(0).at(1);  // a quarter of a period
  EXPECT_LT((at_1.position - Vector3(1.1, 3, 3)).norm(), 1e-12);
  EXPECT_LT((at_1.velocity - Vector3(0.1, 0, 0)).norm(), 1e-12);
}

TEST_F(CourseFile, RefusalsNameTheLine) {
  EXPECT_THAT(refusal("radius_m", "radius"), ::testing::HasSubstr(".yaml:8:"));
  EXPECT_THAT(refusal("input: first_pose", "inputs: first_pose"), ::testing::HasSubstr(".yaml:6:"));
  EXPECT_THAT(refusal("cruise_m_per_s: 0.3", "cruise_m_per_s: 0.5"), ::testing::HasSubstr("cruise"));
  EXPECT_THAT(refusal("    start: {position_m: [0.4, 0, 0.5], rpy_rad: [pi, 0, 0]}\n", ""),
              ::testing::HasSubstr("start_at"));
  EXPECT_THAT(refusal("name: test", "nam: test"), ::testing::HasSubstr(".yaml:1:"));
  EXPECT_THROW(load_course("/nowhere.yaml"), std::invalid_argument);
}

TEST_F(CourseFile, GoalsAreReachedInOrder) {
  Course course = load(kGood);
  const auto finish = [](const Course& c, double seconds) {
    CourseRun run(c, {*c.hands[0].start});
    while (run.time() < seconds && !run.finished()) run.step(1e-3);
    return run.goals_reached(0);
  };
  EXPECT_EQ(finish(course, 60), 2u);
  course.repeat = true;
  EXPECT_GT(finish(course, 30), 4u);
}

TEST(ShippedCourses, RunWithoutTouchingAndReachGoals) {
  for (const char* name : {"two_hands", "common_target"}) {
    const Course course = load_course(std::filesystem::path(MULTIPANDA_SOURCE_DIR) / "config" / "courses" /
                                      (std::string(name) + ".yaml"));
    std::vector<Pose> starts;
    for (const auto& hand : course.hands) starts.push_back(*hand.start);
    CourseRun run(course, starts);
    double least = 1;
    while (run.time() < 60) {
      run.step(1e-3);
      least = std::min(least, run.clearance());
    }
    EXPECT_GE(least, 0.02) << name;
    for (std::size_t i = 0; i < starts.size(); ++i) EXPECT_GE(run.goals_reached(i), 6u) << name;
  }
}

}  // namespace
}  // namespace multipanda::circular_field::course_test
