#include "runtime/object_poses.hpp"

#include <sys/mman.h>

#include <gtest/gtest.h>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::object_poses_test {
namespace {

// What the session does in the loop makes no heap call, takes no lock, and passes the world's poses on.
TEST(ObjectPoses, ComeFromTheLoopWithoutHeapAndLocks) {
  const Registry registry = Registry::with_builtins();
  const Scene scene = load_scene("one_arm", registry);
  MujocoBackend backend(scene, {.pace = Pace::unpaced});
  ObjectPoses poses(scene);
  const bool locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
  backend.start();
  ControlCycle cycle(build_cycle_config(scene), registry, backend);
  LoopGuardCounts all;
  for (int k = 0; k < 400; ++k) {
    cycle.step(backend.wait());
    if (kLoopGuardWorks) LoopGuard::arm();
    poses.take([&](const std::string& name) { return backend.object_pose(name); });
    if (!kLoopGuardWorks) continue;
    const LoopGuardCounts counts = LoopGuard::disarm();
    all.heap_calls += counts.heap_calls;
    all.lock_calls += counts.lock_calls;
    all.page_faults += counts.page_faults;
  }
  munlockall();
  EXPECT_EQ(all.heap_calls, 0u);
  EXPECT_EQ(all.lock_calls, 0u);
  EXPECT_TRUE(!locked || all.page_faults == 0u) << all.page_faults;
  // The box has fallen onto the table meanwhile; the table stays.
  ASSERT_EQ(poses.count(), scene.objects.size());
  for (std::size_t i = 0; i < poses.count(); ++i) {
    const auto read = poses.read(i);
    ASSERT_NE(read.has_value(), scene.objects[i].fixed) << scene.objects[i].name;
    if (!read) continue;
    EXPECT_EQ(read->position, backend.object_pose(poses.name(i))->position);
    EXPECT_GT((read->position - scene.objects[i].X_WO.position).norm(), 1e-5);
  }
}

}  // namespace
}  // namespace multipanda::object_poses_test
