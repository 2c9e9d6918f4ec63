#include "cli/reduced_run.hpp"

#include <fstream>
#include <limits>
#include <string>
#include <unistd.h>

#include <gtest/gtest.h>

namespace multipanda::cli {
namespace {

class ReducedRunTest : public testing::Test {
 protected:
  void TearDown() override { std::filesystem::remove_all(folder_); }
  const std::filesystem::path folder_ = std::filesystem::path(testing::TempDir()) / std::to_string(getpid());
  const std::filesystem::path memory_ = folder_ / "state/first_runs";
};

Scene scene_with(const std::string& address) {
  Scene scene;
  scene.name = "table";
  scene.text = "arms: 1";
  scene.arms.resize(2);
  if (!address.empty()) scene.arms[1].fci.emplace().address = address;
  scene.controllets.resize(1);
  scene.timeline = {{.at_s = 1, .what = TimelineEvent::What::set_reference, .duration_s = 2},
                    {.at_s = 4, .what = TimelineEvent::What::set_reference, .duration_s = 5}};
  scene.controllets[0].contact = scene.contact_bounds = {.hand_speed = 1, .spring_force = 20};
  return scene;
}

// A run of the scene above in which the second arm moves between two times. Owner 0
// takes no commands, owner 1 does.
struct Course {
  double from_s = 0, to_s = 0, end_s = 0;
  double speed = 0.1;  // [rad/s]
  std::uint16_t owner = 1;
  ArmIndex arm = 1;
};

SeenRun seen(const Scene& scene, const Course& course) {
  RecordLayout layout;
  layout.arms = {{.name = "near", .joint_count = 7}, {.name = "far", .joint_count = 7}};
  layout.instances.resize(2);
  layout.instances[0].name = "follow";
  layout.instances[1].inputs.resize(1);
  SeenRun run(scene);
  run.begin(layout);
  CycleRecord record(2, 0, 0);
  for (int k = 0; 0.005 * k <= course.end_s + 1e-9; ++k) {
    record.t = LoopTime::from_seconds(0.005 * k);
    record.arms[course.arm].owner = course.owner;
    record.arms[course.arm].dq[3] =
        record.t.seconds() > course.from_s && record.t.seconds() <= course.to_s ? -course.speed : 0;
    run.take(record);
  }
  return run;
}

TEST_F(ReducedRunTest, AChangedPluginIsAnotherScene) {
  std::filesystem::create_directories(folder_);
  const std::string plugin = folder_ / "law.so";
  const auto compile = [&](const std::string& text) { std::ofstream(plugin) << text; };
  Scene scene = scene_with("172.16.0.2");
  scene.plugins = {plugin};
  compile("one law");
  const ReducedRun first(scene, Reduction::as_usual, memory_);
  EXPECT_EQ(first.remember(seen(scene, {1, 9.5, 10})), "");
  EXPECT_FALSE(ReducedRun(scene, Reduction::as_usual, memory_).reduced());
  compile("two law");  // of the same size
  EXPECT_TRUE(ReducedRun(scene, Reduction::as_usual, memory_).reduced());
  compile("one law");
  EXPECT_FALSE(ReducedRun(scene, Reduction::as_usual, memory_).reduced());
}

// Limits, inertia and reach of the arms are in their models, also in files that these name; and who stands
// beside other arms has not seen the scene on them.
TEST_F(ReducedRunTest, AChangedModelOrAnotherArmIsAnotherScene) {
  std::filesystem::create_directories(folder_);
  const auto write = [&](const std::string& name, const std::string& base, const char* more = "") {
    std::ofstream(folder_ / (name + ".yaml"))
        << "name: " << name << "\ntitle: Mine\nbase: " << base << more << '\n';
  };
  const auto restore = [&] {
    write("own", "between");
    write("between", "fer");
  };
  restore();
  Scene scene = scene_with("172.16.0.2");
  scene.arms[1].model = folder_ / "own.yaml";
  const ReducedRun first(scene, Reduction::as_usual, memory_);
  ASSERT_EQ(first.remember(seen(scene, {1, 9.5, 10})), "");
  const auto reduced = [&] { return ReducedRun(scene, Reduction::as_usual, memory_).reduced(); };
  EXPECT_FALSE(reduced());
  write("own", "between", "\n# of another day");
  EXPECT_TRUE(reduced());
  restore();
  write("between", "fer", "\nrated_payload_kg: 1");
  EXPECT_TRUE(reduced());
  restore();
  EXPECT_FALSE(reduced());
  scene.arms[1].fci->address = "172.16.1.2";
  EXPECT_TRUE(reduced());
  scene.arms[1].fci->address = "172.16.0.2";
  EXPECT_FALSE(reduced());
}

TEST_F(ReducedRunTest, FirstRunOnPhysicalArmsUntilOneSucceeded) {
  Scene scene = scene_with("172.16.0.2");
  const ReducedRun first(scene, Reduction::as_usual, memory_);
  EXPECT_TRUE(first.reduced());
  EXPECT_NE(first.text().find("--full-speed"), std::string::npos);
  first.apply(scene);
  EXPECT_EQ(scene.controllets[0].contact.hand_speed, 0.1);
  EXPECT_EQ(scene.controllets[0].contact.spring_force, 20);  // never higher than the scene's
  EXPECT_EQ(scene.contact_bounds.hand_speed, 0.1);
  // Not remembered before it succeeded.
  EXPECT_TRUE(ReducedRun(scene, Reduction::as_usual, memory_).reduced());
  // The last motion begins at 4 s and lasts 5 s.
  for (const Course& course : {Course{1, 3.9, 3.9}, Course{1, 4, 4.5}, Course{1, 8.9, 8.9}}) {
    EXPECT_NE(first.remember(seen(scene, course)).find("the timeline's last motion at 9.0 s"),
              std::string::npos);
    EXPECT_TRUE(ReducedRun(scene, Reduction::as_usual, memory_).reduced()) << course.end_s;
  }
  // With lower bounds it takes longer.
  EXPECT_NE(first.remember(seen(scene, {1, 20, 20.2})).find("before the arms came to rest"),
            std::string::npos);
  EXPECT_TRUE(ReducedRun(scene, Reduction::as_usual, memory_).reduced());
  EXPECT_EQ(first.remember(seen(scene, {1, 9.5, 10})), "");
  EXPECT_FALSE(ReducedRun(scene, Reduction::as_usual, memory_).reduced());
  EXPECT_TRUE(ReducedRun(scene, Reduction::asked, memory_).reduced());
  scene.text += " ";  // changed: another scene
  EXPECT_TRUE(ReducedRun(scene, Reduction::as_usual, memory_).reduced());
  EXPECT_FALSE(ReducedRun(scene, Reduction::refused, memory_).reduced());
}

// The leader's motion says nothing of its follower, whose law takes no commands.
TEST_F(ReducedRunTest, FollowersHaveToMoveThemselves) {
  Scene scene = scene_with("172.16.0.2");
  scene.arms[0].fci.emplace().address = "172.16.0.3";
  scene.arms[0].name = "near";
  scene.controllets[0].name = "follow";
  scene.controllets[0].arms = {0};
  scene.controllets[0].observes = {1};
  scene.active = {"follow"};
  EXPECT_NE(seen(scene, {1, 9.5, 10}).missing().find("moved arm 'near', which follows, for 0.0 s"),
            std::string::npos);
  EXPECT_EQ(seen(scene, {1, 9.5, 10, 0.1, 0, 0}).missing(), "");
  scene.active.clear();  // no matter when it begins
  EXPECT_EQ(seen(scene, {1, 9.5, 10}).missing(), "");
  scene.timeline.push_back(
      {.at_s = 1, .what = TimelineEvent::What::switch_controllets, .activate = {"follow"}});
  EXPECT_NE(seen(scene, {1, 9.5, 10}).missing(), "");
  scene.timeline.clear();  // led by hand
  scene.arms[1].fci.reset();
  EXPECT_NE(seen(scene, {0, 5, 6, 0.1, 0, 0}).missing(), "");
  EXPECT_EQ(seen(scene, {0, 11, 12, 0.1, 0, 0}).missing(), "");
}

TEST_F(ReducedRunTest, ArmsOfThisComputerAreNotReduced) {
  for (const std::string address : {"", "127.0.0.3", "localhost"}) {
    Scene scene = scene_with(address);
    const ReducedRun run(scene, Reduction::as_usual, memory_);
    EXPECT_FALSE(run.reduced()) << address;
    EXPECT_EQ(run.text(), "");
    run.apply(scene);
    EXPECT_EQ(scene.controllets[0].contact.hand_speed, 1);
    EXPECT_EQ(run.remember(seen(scene, {1, 9.5, 10})), "");
    EXPECT_FALSE(std::filesystem::exists(memory_));
  }
}

TEST_F(ReducedRunTest, ARunThatMovedNothingDoesNotCount) {
  const Scene scene = scene_with("172.16.0.2");
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(seen(scene, {1, 2.1, 10}).missing(), "");
  for (const Course& course : {Course{1, 1.9, 10},              // too short
                               Course{1, 9, 10, 0.01},          // too slow: it sways
                               Course{1, 9, 10, kNaN},          // not measured
                               Course{1, 9, 10, 0.1, 0},        // in hold, or led by hand
                               Course{1, 9, 10, 0.1, 0xFFFF},   // by nobody
                               Course{1, 9, 10, 0.1, 1, 0}}) {  // the arm of this computer
    EXPECT_NE(seen(scene, course).missing(), "") << course.speed << " " << course.owner;
  }
}

// Its motions are those of programs, and these may begin late, or with one arm.
TEST_F(ReducedRunTest, WithoutATimelineEveryPhysicalArmMustHaveMoved) {
  Scene scene = scene_with("172.16.0.2");
  for (const bool switches : {false, true}) {
    scene.timeline.clear();
    if (switches) scene.timeline = {{.at_s = 1, .what = TimelineEvent::What::switch_controllets}};
    scene.arms[0].fci.reset();
    EXPECT_NE(seen(scene, {0, 0, 1}).missing(), "");
    EXPECT_NE(seen(scene, {0, 0, 1000}).missing(), "");
    EXPECT_NE(seen(scene, {1, 10.9, 100}).missing(), "");
    EXPECT_EQ(seen(scene, {1, 11.1, 12}).missing(), "");
    scene.arms[0].fci.emplace().address = "172.16.1.2";
    EXPECT_NE(seen(scene, {1, 11.1, 12}).missing(), "");
  }
}

}  // namespace
}  // namespace multipanda::cli
