// Leaders and followers of different kinds in one loop: simulated ones, and virtual ones behind the arms'
// control interface, through which real arms are driven, too. All in lock-step, so each mixture must move as
// the scene whose arms are all simulated.
#include <algorithm>
#include <cmath>
#include <unistd.h>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "fci/server/virtual_arms.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::teleoperation {
namespace {

// Nobody leads by hand here: an undeclared load draws the leaders down, and the followers follow them.
const char* const kScene = R"(
plant: {rotor_inertia_hidden: 0}  # as of virtual arms
arms:
  - {name: lead_one, base: {position_m: [0, 1, 0]}, load_present: {mass_kg: 0.3}}
  - {name: one, base: {position_m: [0, -1, 0]}}
  - {name: lead_two, base: {position_m: [2, 1, 0], rpy_rad: [0, 0, 0.4]}, load_present: {mass_kg: 0.2}}
  - {name: two, base: {position_m: [2, -1, 0]}}
controllets:
  - {name: both, type: teleoperation, arms: [lead_one, one]}
  - {name: guide, type: gravity_compensation, arms: lead_two}
  - {name: follow, type: pose_follower, arms: two, observes: lead_two}
active: [both, guide, follow]
)";

const Registry& registry() {
  static const Registry all = Registry::with_builtins();
  return all;
}

// Loopback addresses that other programs do not use: the ports are fixed by libfranka.
std::string address(std::size_t arm) {
  const int id = static_cast<int>(getpid());
  return "127." + std::to_string(128 + (id >> 8) % 64) + "." + std::to_string(id % 256) + "." +
         std::to_string(arm + 1);
}

struct Moved {
  std::vector<CycleRecord> records;
  std::vector<std::string> faults;
};

Moved record(const Scene& scene, BackendOptions backend, double seconds = 1.0) {
  Moved run;
  SessionOptions options{.paced = false, .backend = std::move(backend), .duration_s = seconds};
  options.observer = [&run](const CycleRecord& record) { run.records.push_back(record); };
  Session session(scene, registry(), std::move(options));
  session.start();
  run.faults = session.finish().faults();
  return run;
}

// These arms stand in a world of their own, behind their control interface.
Moved record_mixed(const Scene& scene, const std::vector<std::string>& names) {
  Scene there = scene;
  std::erase_if(there.arms, [&](const SceneArm& arm) {
    return std::find(names.begin(), names.end(), arm.name) == names.end();
  });
  there.timeline.clear();
  fci::VirtualArmOptions options;
  BackendOptions mixed{.kind = BackendKind::as_scene, .addresses = {}};
  for (std::size_t i = 0; i < there.arms.size(); ++i) {
    options.places.push_back({.address = address(i)});
    mixed.addresses.emplace_back(there.arms[i].name, address(i));
  }
  options.pace = fci::WorldPace::lockstep;
  options.grippers = false;
  options.idle_stands_still = true;
  fci::VirtualArms world(there, options);
  world.start();
  return record(scene, std::move(mixed));
}

double way(const Moved& run, std::size_t arm) {
  double largest = 0;
  for (std::size_t j = 0; j < 7; ++j)
    largest = std::max(largest, std::abs(run.records.back().arms[arm].q[j] - run.records[0].arms[arm].q[j]));
  return largest;
}

double difference(const Moved& a, const Moved& b) {
  double largest = 0;
  for (std::size_t i = 0; i < std::min(a.records.size(), b.records.size()); ++i) {
    for (std::size_t arm = 0; arm < 4; ++arm) {
      for (std::size_t j = 0; j < 7; ++j)
        largest = std::max(largest, std::abs(a.records[i].arms[arm].q[j] - b.records[i].arms[arm].q[j]));
    }
  }
  return largest;
}

TEST(MixedTeleoperation, MovesAlikeWhateverArmsAreSimulatedAndVirtual) {
  const Scene scene = parse_scene(kScene, "mixture.yaml", registry());
  const Moved simulated = record(scene, {.kind = BackendKind::mujoco, .addresses = {}});
  EXPECT_THAT(simulated.faults, testing::IsEmpty());
  ASSERT_EQ(simulated.records.size(), 1000u);
  for (std::size_t arm = 0; arm < 4; ++arm) EXPECT_GT(way(simulated, arm), 0.02) << arm;

  // An arm behind its interface carries the undeclared load itself until its first torque: a leader sags by
  // less than 2 mrad more or less. Followers answer to nothing but their leaders; the interface sends some
  // numbers as floats.
  constexpr double kLeaders = 2e-3, kFollowers = 1e-5;
  std::vector<std::pair<Moved, double>> mixtures;
  mixtures.emplace_back(record_mixed(scene, {"one", "two"}), kFollowers);
  mixtures.emplace_back(record(scene, {.kind = BackendKind::virtual_arms, .addresses = {}}), kLeaders);
  mixtures.emplace_back(record_mixed(scene, {"lead_one", "two"}), kLeaders);
  for (std::size_t i = 0; i < mixtures.size(); ++i) {
    SCOPED_TRACE(i);
    const auto& [moved, tolerance] = mixtures[i];
    EXPECT_THAT(moved.faults, testing::IsEmpty());
    EXPECT_EQ(moved.records.size(), 1000u);
    EXPECT_LT(difference(simulated, moved), tolerance);
  }
}

// A clutch opens and closes, and at the end a pair changes from following to teleoperation.
TEST(ShippedScene, OfLeadersAndFollowersRunsWithoutAFault) {
  const Scene scene = load_scene("leaders_and_followers", registry());
  const Moved run = record(scene, {.kind = BackendKind::mujoco, .addresses = {}}, scene.duration_s);
  EXPECT_THAT(run.faults, testing::IsEmpty());
  for (std::size_t arm = 0; arm < 4; ++arm) EXPECT_GT(way(run, arm), 0.1) << arm;
}

}  // namespace
}  // namespace multipanda::teleoperation
