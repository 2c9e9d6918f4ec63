// The same scene on other backends: simulated, virtual, both kinds mixed, and one of them lost.
#include "runtime/backends.hpp"

#include <cmath>
#include <condition_variable>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <sched.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "fci/server/virtual_arms.hpp"
#include "runtime/live_input/client.hpp"
#include "runtime/mixed_backend.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::backends_test {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;

const Registry& registry() {
  static const Registry all = Registry::with_builtins();
  return all;
}

Scene two_arms(const std::string& rest = "", const std::string& of_right = "") {
  return parse_scene(
      "arms:\n"
      "  - {name: left, base: {position_m: [0, 0.4, 0]}}\n"
      "  - {name: right, base: {position_m: [0, -0.4, 0]}, start_rad: [0.1, -0.6, 0, -2.2, 0, 1.6, 0.8]" +
          of_right +
          "}\n"
          "controllets:\n"
          "  - {name: left_pose, type: cartesian_impedance, arms: left}\n"
          "  - {name: right_joints, type: joint_impedance, arms: right}\n"
          "active: [left_pose, right_joints]\n" +
          rest,
      "test.yaml", registry());
}

const char* kMotion =
    "timeline:\n"
    "  - {at_s: 0.05, reference: {controllet: left_pose, input: pose, position_m: [0.4, 0.35, 0.5], rpy_rad: "
    "[pi, 0, 0.2], duration_s: 0.6}}\n"
    "  - {at_s: 0.10, reference: {controllet: right_joints, input: joints, q_rad: [0.3, -0.5, 0.1, -2.0, "
    "0.1, "
    "1.5, 0.6], duration_s: 0.6}}\n";

// Loopback addresses that other programs do not use: the ports are fixed by libfranka.
std::string address(int arm) {
  const int id = static_cast<int>(getpid());
  return "127." + std::to_string(64 + (id >> 8) % 64) + "." + std::to_string(id % 256) + "." +
         std::to_string(arm + 1);
}

fci::VirtualArmOptions lockstep(std::size_t arms) {
  fci::VirtualArmOptions options;
  for (std::size_t i = 0; i < arms; ++i) options.places.push_back({.address = address(static_cast<int>(i))});
  options.pace = fci::WorldPace::lockstep;
  options.grippers = false;  // fingers stay closed, as in the simulation
  options.idle_stands_still = true;
  return options;
}

// The newest records, for threads that wait for them.
class Watch {
 public:
  void take(const CycleRecord& record) {
    const std::lock_guard lock(mutex_);
    last_ = record;
    changed_.notify_all();
  }
  // The first record from now on for which `holds` is true; the test fails if there is none within 20 s.
  template <typename Holds>
  CycleRecord wait(Holds holds) {
    std::unique_lock lock(mutex_);
    EXPECT_TRUE(
        changed_.wait_for(lock, std::chrono::seconds(20), [&] { return last_.cycle > 0 && holds(last_); }));
    return last_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  CycleRecord last_;
};

struct Recorded {
  RunSummary summary;
  std::vector<CycleRecord> records;
};

Recorded record(const Scene& scene, BackendOptions backend, double seconds) {
  Recorded run;
  SessionOptions options{.paced = false, .backend = std::move(backend), .duration_s = seconds};
  options.observer = [&run](const CycleRecord& record) { run.records.push_back(record); };
  Session session(scene, registry(), std::move(options));
  session.start();
  run.summary = session.finish();
  return run;
}

double largest_difference(const Recorded& a, const Recorded& b, std::size_t arm_of_a, std::size_t arm_of_b) {
  double largest = 0;
  EXPECT_EQ(a.records.size(), b.records.size());
  for (std::size_t i = 0; i < std::min(a.records.size(), b.records.size()); ++i) {
    for (std::size_t j = 0; j < 7; ++j) {
      largest =
          std::max(largest, std::abs(a.records[i].arms[arm_of_a].q[j] - b.records[i].arms[arm_of_b].q[j]));
    }
  }
  return largest;
}

TEST(BackendKind, TellWhichArmsAreReal) {
  const Scene scene = two_arms("", ", fci: 172.16.0.7");
  Scene as = with_connections(scene, {});
  EXPECT_FALSE(as.arms[0].fci);
  EXPECT_EQ(as.arms[1].fci->address, "172.16.0.7");
  as = with_connections(scene, {.kind = BackendKind::as_scene, .addresses = {{"left", "10.0.0.1"}}});
  EXPECT_EQ(as.arms[0].fci->address, "10.0.0.1");
  as = with_connections(scene, {.kind = BackendKind::fci, .addresses = {}});
  EXPECT_EQ(as.arms[0].fci->address, "127.0.0.1");
  EXPECT_EQ(as.arms[1].fci->address, "172.16.0.7");
  for (const auto arms : {BackendKind::mujoco, BackendKind::virtual_arms}) {
    as = with_connections(scene, {.kind = arms, .addresses = {}});
    EXPECT_FALSE(as.arms[0].fci || as.arms[1].fci);
  }
}

TEST(BackendKind, RefusesInvalidAddresses) {
  const auto refusal = [](const BackendOptions& options) {
    try {
      (void)with_connections(two_arms(), options);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(refusal({.kind = BackendKind::fci, .addresses = {{"lefd", "10.0.0.1"}}}),
              HasSubstr("did you mean 'left'"));
  EXPECT_THAT(refusal({.kind = BackendKind::mujoco, .addresses = {{"left", "10.0.0.1"}}}),
              HasSubstr("this run has no real arms"));
  EXPECT_THAT(refusal({.kind = BackendKind::fci, .addresses = {{"left", "10.0.0.1"}, {"right", "10.0.0.1"}}}),
              HasSubstr("same address 10.0.0.1"));
  EXPECT_THAT(refusal({.kind = BackendKind::fci, .addresses = {{"left", "127.0.0.2"}}}),
              HasSubstr("same address 127.0.0.2"));
}

TEST(BackendKind, TakeForceSensorsWhereTheyAreReadOrSimulated) {
  Scene scene = two_arms();
  for (SceneArm& arm : scene.arms) arm.force_sensor.emplace();
  const auto refusal = [&](BackendKind kind) {
    try {
      (void)with_connections(scene, {.kind = kind});
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(refusal(BackendKind::mujoco), "");
  for (const BackendKind kind : {BackendKind::virtual_arms, BackendKind::pinocchio})
    EXPECT_THAT(refusal(kind), HasSubstr("arm 'left' has a force sensor, and the backend '" + name_of(kind)));
  EXPECT_THAT(refusal(BackendKind::fci), HasSubstr("have the same address 192.168.1.1"));
  scene.arms[1].force_sensor->address = "192.168.1.2";
  EXPECT_EQ(refusal(BackendKind::fci), "");
  EXPECT_FALSE(with_connections(scene, {.kind = BackendKind::replay}).arms[0].force_sensor);
}

// The interface carries the simulation's values, so both runs move alike. The difference: states are in
// single precision (6e-8 rad at pi/2), and the controllets react to these states. In a motion of 0.45 rad
// that makes 1.3e-7 rad.
// An arm that does not wait for the run would be without commands whenever the run waits.
TEST(RealArms, AreNotRunAsFastAsPossible) {
  const auto refusal = [](const char* address, bool paced) -> std::string {
    const Scene scene =
        with_connections(two_arms(), {.kind = BackendKind::as_scene, .addresses = {{"right", address}}});
    try {
      (void)make_backend(scene, registry(), {.kind = BackendKind::as_scene}, {.paced = paced, .report = {}});
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  for (const char* address : {"172.16.0.2", "128.0.0.1", "12.7.0.1", "arm.example", "127.arm.example"}) {
    EXPECT_THAT(refusal(address, false),
                testing::AllOf(HasSubstr("'right'"), HasSubstr(address), HasSubstr("Omit --fast")));
  }
  EXPECT_EQ(refusal("127.0.0.2", false), "");
  EXPECT_EQ(refusal("127.255.9.1", false), "");
  EXPECT_EQ(refusal("172.16.0.2", true), "");
}

// Its states come in time, as those of real arms do, while others use every core several times over.
TEST(VirtualBackend, KeepsItsTimeBesideABusyComputer) {
  const sched_param priority{.sched_priority = 1};
  if (sched_setscheduler(0, SCHED_FIFO, &priority) != 0) GTEST_SKIP() << "SCHED_FIFO is not permitted here";
  const sched_param ordinary{.sched_priority = 0};
  ASSERT_EQ(sched_setscheduler(0, SCHED_OTHER, &ordinary), 0);
  std::vector<std::jthread> busy;
  for (unsigned k = 0; k < 6 * std::thread::hardware_concurrency(); ++k)
    busy.emplace_back([](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
      }
    });
  Session session(two_arms(kMotion), registry(),
                  {.paced = true, .backend = {.kind = BackendKind::virtual_arms}, .duration_s = 5});
  session.start();
  while (!session.wait_for_end(0.1)) {
  }
  EXPECT_THAT(session.finish().faults(), ElementsAre());
}

// The loop is scheduled in real time and pinned; in lock-step, where it waits for them, the arms' world and
// the client's helpers are not.
TEST(VirtualBackend, ItsThreadsAreOrdinaryInLockStep) {
  cpu_set_t allowed;
  ASSERT_EQ(sched_getaffinity(0, sizeof(allowed), &allowed), 0);
  if (CPU_COUNT(&allowed) < 2) GTEST_SKIP() << "one core only: all threads are pinned to it";
  int core = 0;
  while (!CPU_ISSET(core, &allowed)) ++core;
  SessionOptions options{.backend = {.kind = BackendKind::virtual_arms, .lockstep = true}, .duration_s = 60};
  options.thread.cpu = core;
  Session session(two_arms(), registry(), std::move(options));
  session.start();
  while (session.status().cycles == 0 && !session.wait_for_end(0.01)) {
  }
  int pinned = 0, real_time = 0, threads = 0;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    const pid_t id = std::stoi(task.path().filename().string());
    cpu_set_t cpus;
    if (sched_getaffinity(id, sizeof(cpus), &cpus) != 0) continue;
    ++threads;
    pinned += CPU_COUNT(&cpus) == 1;
    real_time += (sched_getscheduler(id) & ~SCHED_RESET_ON_FORK) == SCHED_FIFO;
  }
  session.stop();
  (void)session.finish();
  EXPECT_GE(threads, 4);
  EXPECT_EQ(pinned, 1);
  EXPECT_LE(real_time, 1);  // none where the machine does not allow it
}

TEST(VirtualBackend, MovesLikeTheSimulation) {
  const Scene scene =
      two_arms(std::string("plant: {rotor_inertia_hidden: 0}\n") + kMotion);  // as of virtual arms
  const Recorded direct = record(scene, {.kind = BackendKind::mujoco, .addresses = {}}, 1.0);
  const Recorded wire = record(scene, {.kind = BackendKind::virtual_arms, .addresses = {}}, 1.0);
  EXPECT_THAT(wire.summary.faults(), ElementsAre());
  EXPECT_EQ(wire.summary.cycles, 1000u);
  EXPECT_EQ(wire.summary.backend, "virtual");
  for (std::size_t arm = 0; arm < 2; ++arm) {
    EXPECT_LT(largest_difference(direct, wire, arm, arm), 2e-6) << arm;  // [rad]
    // It moved; otherwise the comparison would be meaningless.
    EXPECT_GT(std::abs(wire.records.back().arms[arm].q[3] - wire.records.front().arms[arm].q[3]), 0.01);
    EXPECT_TRUE(wire.records.back().arms[arm].has_contact_truth);
  }
  // Lock-step: a second run is the same to the bit.
  const Recorded again = record(scene, {.kind = BackendKind::virtual_arms, .addresses = {}}, 1.0);
  EXPECT_EQ(largest_difference(wire, again, 0, 0), 0);
  EXPECT_EQ(largest_difference(wire, again, 1, 1), 0);
}

// In real time the arms would stop themselves after 20 periods without a command.
TEST(VirtualBackend, AWorldInLockStepMissesNothingIfTheLoopStalls) {
  SessionOptions options{
      .paced = true, .backend = {.kind = BackendKind::virtual_arms, .lockstep = true}, .duration_s = 0.3};
  options.on_loop = [](const Tick& tick, const Backend&) {
    if (tick.cycle % 100 == 50) std::this_thread::sleep_for(std::chrono::milliseconds(60));
  };
  std::vector<CycleRecord> records;
  options.observer = [&records](const CycleRecord& record) { records.push_back(record); };
  Session session(two_arms(kMotion), registry(), std::move(options));
  session.start();
  const RunSummary summary = session.finish();
  EXPECT_THAT(summary.faults(), ElementsAre());
  EXPECT_EQ(summary.cycles, 300u);
  EXPECT_GE(summary.elapsed_s, 0.29 + 3 * 0.059);  // by the clock, and three stalls that are not caught up
  EXPECT_GE(summary.overruns, 3u * 58);
  ASSERT_EQ(records.size(), 300u);
  for (std::size_t i = 1; i < records.size(); ++i) {
    EXPECT_EQ(records[i].arms[0].sequence, records[i - 1].arms[0].sequence + 1) << i;
    EXPECT_EQ(records[i].arms[1].sequence, records[i].arms[0].sequence) << i;
  }
}

// Data that no arm reports are read directly, and the timeline's `place` happens in the loop's time.
TEST(VirtualBackend, ShowsItsObjects) {
  const Scene scene = two_arms(
      "objects:\n  - {name: ball, shape: sphere, diameter_m: 0.1, fixed: false, mass_kg: 1, position_m: [2, "
      "0, "
      "5]}\n"
      "timeline:\n  - {at_s: 0.1, place: {object: ball, position_m: [2, 0, 8]}}\n");
  std::vector<std::pair<double, double>> heights;
  SessionOptions options{.paced = false, .backend = {BackendKind::virtual_arms, {}}, .duration_s = 0.3};
  options.on_loop = [&](const Tick& tick, const Backend& backend) {
    const auto X_WO = backend.object_pose("ball");
    if (X_WO) heights.emplace_back(tick.t.seconds(), X_WO->position.z());
  };
  Session session(scene, registry(), std::move(options));
  session.start();
  EXPECT_THAT(session.finish().faults(), ElementsAre());
  ASSERT_GT(heights.size(), 250u);
  for (const auto& [t, z] :
       heights) {  // free fall; the engine's own integration is a little off the parabola
    const double fallen = t <= 0.1 ? t : t - 0.1;
    EXPECT_NEAR(z, (t <= 0.1 ? 5 : 8) - 0.5 * 9.81 * fallen * fallen, 0.02) << t;
  }
}

// A simulated arm and a virtual one of another world in one loop, all in lock-step.
TEST(MixedBackend, DrivesBothKinds) {
  const Scene scene = two_arms(kMotion);
  Scene there = scene;
  there.arms.erase(there.arms.begin());  // the right arm alone
  there.timeline.clear();
  fci::VirtualArms world(there, lockstep(1));
  world.start();
  const Recorded mixed =
      record(scene, {.kind = BackendKind::as_scene, .addresses = {{"right", address(0)}}}, 1.0);
  EXPECT_THAT(mixed.summary.faults(), ElementsAre());
  EXPECT_EQ(mixed.summary.cycles, 1000u);
  EXPECT_THAT(mixed.summary.backend, HasSubstr("left mujoco, right fci 127."));
  const Recorded direct = record(scene, {.kind = BackendKind::mujoco, .addresses = {}}, 1.0);
  EXPECT_EQ(largest_difference(direct, mixed, 0, 0), 0);  // nothing of it changed for the simulated arm
  EXPECT_LT(largest_difference(direct, mixed, 1, 1), 2e-6);
  EXPECT_TRUE(mixed.records.back().arms[0].has_contact_truth);
  EXPECT_FALSE(mixed.records.back().arms[1].has_contact_truth);
}

// Notes when it starts and finishes.
class NotedBackend final : public Backend {
 public:
  NotedBackend(std::string name, std::vector<std::string>& notes, bool fails)
      : name_(std::move(name)), notes_(notes), fails_(fails) {}
  std::size_t arm_count() const override { return 1; }
  Capabilities capabilities(ArmIndex) const override { return {}; }
  void start() override {
    if (fails_) throw std::runtime_error(name_ + " cannot start");
    notes_.push_back(name_ + " starts");
  }
  void finish() override { notes_.push_back(name_ + " ends"); }
  ArmSet wait() override { return {}; }
  LoopTime now() const override { return {}; }
  void read(ArmSet, std::span<ArmState>) override {}
  void write(ArmSet, std::span<const ArmCommand>) override {}
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return refuse_request("none"); }
  std::future<RequestAnswer> request(WorldRequest) override {
    notes_.push_back(name_ + " world asked");
    return answer_now({.success = true, .reason = {}});
  }

 private:
  std::string name_;
  std::vector<std::string>& notes_;
  bool fails_;
};

// A real arm that has begun needs an answer each millisecond: nothing may come, or fail, after it.
TEST(MixedBackend, RealArmsBeginLast) {
  std::vector<std::string> notes;
  const auto mixed = [&](bool real_fails, bool simulated_fails) {
    notes.clear();
    MixedBackend::Parts parts;
    parts.real = std::make_unique<NotedBackend>("real", notes, real_fails);
    parts.simulated = std::make_unique<NotedBackend>("simulated", notes, simulated_fails);
    parts.real_arms = {1};
    parts.simulated_arms = {0};
    return std::make_unique<MixedBackend>(std::move(parts));
  };
  mixed(false, false)->start();
  EXPECT_THAT(notes, ElementsAre("simulated starts", "real starts"));
  EXPECT_THROW(mixed(false, true)->start(), std::runtime_error);
  EXPECT_THAT(notes, ElementsAre());
  EXPECT_THROW(mixed(true, false)->start(), std::runtime_error);
  EXPECT_THAT(notes, ElementsAre("simulated starts", "simulated ends"));
}

// Laws can couple a simulated arm to a real one: of the simulated world only objects are placed.
TEST(MixedBackend, ItsWorldIsNeitherPushedNorResetNorPaused) {
  std::vector<std::string> notes;
  MixedBackend::Parts parts;
  parts.real = std::make_unique<NotedBackend>("real", notes, false);
  parts.simulated = std::make_unique<NotedBackend>("simulated", notes, false);
  parts.real_arms = {1};
  parts.simulated_arms = {0};
  MixedBackend mixed(std::move(parts));
  for (const WorldRequest& refused :
       {WorldRequest(PushObject{.object = "ball"}), WorldRequest(ResetSimulation{}),
        WorldRequest(PauseSimulation{}), WorldRequest(StepSimulation{})}) {
    const RequestAnswer answer = mixed.request(refused).get();
    EXPECT_FALSE(answer.success) << refused.index();
    EXPECT_THAT(answer.reason, HasSubstr("this run has real arms")) << refused.index();
  }
  EXPECT_THAT(notes, ElementsAre());
  EXPECT_TRUE(mixed.request(PlaceObject{.object = "ball"}).get().success);
  EXPECT_THAT(notes, ElementsAre("simulated world asked"));
}

TEST(RealArms, OneIsRecoveredWhileTheOtherContinues) {
  const Scene scene = two_arms();
  fci::VirtualArms world(scene, lockstep(2));
  world.start();
  std::string pattern = (std::filesystem::temp_directory_path() / "backends_test_XXXXXX").string();
  const std::filesystem::path folder = mkdtemp(pattern.data());
  Watch watch;
  SessionOptions options{
      .paced = false,
      .backend = {.kind = BackendKind::fci, .addresses = {{"left", address(0)}, {"right", address(1)}}},
      .duration_s = 0.0,
      .socket = folder / "s.sock"};
  options.observer = [&watch](const CycleRecord& record) { watch.take(record); };
  Session session(scene, registry(), std::move(options));
  const InstanceIndex left_hold = session.modes().find("left_hold"),
                      right_joints = session.modes().find("right_joints");
  const auto mode = [](const CycleRecord& record, ArmIndex arm) {
    return static_cast<ArmMode>(record.arms[arm].mode);
  };
  session.start();
  LiveClient client(folder / "s.sock");
  const CycleRecord before = watch.wait([&](const CycleRecord& r) { return r.cycle > 50; });
  EXPECT_NE(before.arms[0].owner, left_hold);

  json answer = client.ask({{"do", "recover"}, {"arm", "left"}});
  EXPECT_FALSE(answer["ok"].get<bool>());  // nothing to recover from
  EXPECT_EQ(answer["verdict"], "arm_refused");

  ASSERT_TRUE(world.raise(0, ArmError::joint_reflex));
  const CycleRecord lost = watch.wait(
      [&](const CycleRecord& r) { return mode(r, 0) == ArmMode::reflex && r.cycle > before.cycle; });
  EXPECT_EQ(lost.arms[0].owner, left_hold);
  EXPECT_EQ(lost.arms[1].owner, right_joints);
  const CycleRecord later = watch.wait([&](const CycleRecord& r) { return r.cycle > lost.cycle + 50; });
  EXPECT_EQ(mode(later, 1), ArmMode::move);  // the other one continues
  EXPECT_EQ(later.arms[1].owner, right_joints);
  EXPECT_EQ(later.arms[1].sequence - lost.arms[1].sequence, later.cycle - lost.cycle);

  answer = client.ask({{"do", "recover"}, {"arm", "left"}});
  EXPECT_TRUE(answer["ok"].get<bool>()) << answer;
  const CycleRecord back = watch.wait([&](const CycleRecord& r) { return mode(r, 0) == ArmMode::move; });
  EXPECT_EQ(back.arms[0].owner, left_hold);  // to hold, not back into the controllet
  EXPECT_EQ(back.arms[1].owner, right_joints);
  answer = client.ask({{"do", "switch"}, {"activate", {"left_pose"}}});
  EXPECT_TRUE(answer["ok"].get<bool>()) << answer;
  session.stop();
  const RunSummary summary = session.finish();
  EXPECT_EQ(summary.end, RunEnd::stopped);
  std::filesystem::remove_all(folder);
}

TEST(RealArms, AMissingArmIsReportedAtOnce) {
  Session session(
      two_arms(), registry(),
      {.paced = true,
       .backend = {.kind = BackendKind::fci, .addresses = {{"left", address(8)}, {"right", address(9)}}},
       .duration_s = 1.0});
  session.start();
  try {
    (void)session.finish();
    FAIL() << "ran without arms";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr(address(8)));
    EXPECT_THAT(error.what(), HasSubstr("left"));
  }
}

}  // namespace
}  // namespace multipanda::backends_test
