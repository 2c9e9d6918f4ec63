#include "cli/reduced_run.hpp"

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
  scene.timeline = {{.at_s = 1}, {.at_s = 4}};
  scene.controllets[0].contact = scene.contact_bounds = {.hand_speed = 1, .spring_force = 20};
  return scene;
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
  first.remember(3.9);  // what the timeline does at 4 s has not been seen
  EXPECT_TRUE(ReducedRun(scene, Reduction::as_usual, memory_).reduced());
  first.remember(4);
  EXPECT_FALSE(ReducedRun(scene, Reduction::as_usual, memory_).reduced());
  EXPECT_TRUE(ReducedRun(scene, Reduction::asked, memory_).reduced());
  scene.text += " ";  // changed: another scene
  EXPECT_TRUE(ReducedRun(scene, Reduction::as_usual, memory_).reduced());
  EXPECT_FALSE(ReducedRun(scene, Reduction::refused, memory_).reduced());
}

TEST_F(ReducedRunTest, ArmsOfThisComputerAreNotReduced) {
  for (const std::string address : {"", "127.0.0.3", "localhost"}) {
    Scene scene = scene_with(address);
    const ReducedRun run(scene, Reduction::as_usual, memory_);
    EXPECT_FALSE(run.reduced()) << address;
    EXPECT_EQ(run.text(), "");
    run.apply(scene);
    EXPECT_EQ(scene.controllets[0].contact.hand_speed, 1);
    run.remember(100);
    EXPECT_FALSE(std::filesystem::exists(memory_));
  }
}

}  // namespace
}  // namespace multipanda::cli
