#include "backends/mujoco/picture.hpp"

#include <filesystem>
#include <fstream>
#include <set>

#include <gtest/gtest.h>

#include "backends/mujoco/testing/test_scenes.hpp"

namespace multipanda::picture_test {
namespace {

using namespace test;

std::span<const double> positions(const MujocoBackend& backend) {
  const World& world = backend.world();
  return {world.data()->qpos, static_cast<std::size_t>(world.model()->nq)};
}

TEST(Picture, ShowsArmsAndIsWrittenAsPng) {
  Scene scene = scene_of({arm_named("left", pose(0, 0.26, 0)), arm_named("right", pose(0, -0.26, 0))});
  SceneObject table;
  table.name = "table";
  table.size = {0.5, 0.8, 0.2};
  table.X_WO.position = {0.6, 0, 0.1};
  SceneObject box = table;
  box.name = "box";
  box.size.setConstant(0.1);
  box.X_WO.position = {0.55, 0, 0.25};
  box.fixed = false;
  box.rgba = {0.2, 0.45, 0.75, 1};
  scene.objects = {table, box};
  MujocoBackend backend(scene, {.pace = Pace::unpaced, .looks = true});
  Painter painter(backend.world().model());
  if (!painter.works()) GTEST_SKIP() << painter.reason();
  const auto file = std::filesystem::path(MULTIPANDA_BINARY_DIR) / "picture_test.png";
  std::filesystem::remove(file);
  EXPECT_EQ(painter.paint(positions(backend), file), "");
  std::ifstream stream(file, std::ios::binary);
  char magic[4] = {};
  stream.read(magic, 4);
  EXPECT_EQ(std::string(magic + 1, 3), "PNG");
  const std::set<std::uint8_t> shades(painter.pixels().begin(), painter.pixels().end());
  EXPECT_GT(shades.size(), 50u);

  // A different configuration gives a different picture, and the same one the same picture.
  const auto first = painter.pixels();
  std::vector<double> moved(positions(backend).begin(), positions(backend).end());
  moved[static_cast<std::size_t>(backend.world().arm(0).qpos[0])] += 0.5;
  EXPECT_EQ(painter.paint(moved, file), "");
  const auto differing = [&] {
    std::size_t count = 0;
    for (std::size_t i = 0; i < first.size(); ++i) count += first[i] != painter.pixels()[i] ? 1 : 0;
    return static_cast<double>(count) / static_cast<double>(first.size());
  };
  EXPECT_GT(differing(), 0.01);
  EXPECT_EQ(painter.paint(positions(backend), file), "");
  EXPECT_LT(differing(), 0.001);  // the renderer's threads may round differently
}

TEST(Picture, RefusesMismatchedInput) {
  MujocoBackend backend(scene_of({arm_named("a")}), {.pace = Pace::unpaced, .looks = true});
  Painter large(backend.world().model(), {.width = 5000});
  EXPECT_FALSE(large.works());
  Painter painter(backend.world().model());
  if (!painter.works()) GTEST_SKIP() << painter.reason();
  EXPECT_NE(painter.paint(std::vector<double>(3), "unused.png"), "");
}

}  // namespace
}  // namespace multipanda::picture_test
