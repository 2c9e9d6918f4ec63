#include "runtime/session.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <sys/mman.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "runtime/faulty.hpp"
#include "runtime/live_input/client.hpp"
#include "runtime/live_input/socket_path.hpp"
#include "runtime/live_input/testing/live_fixture.hpp"
#include "runtime/object_poses.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::session_test {

namespace {

using testing::ElementsAre;
using testing::HasSubstr;

Registry registry_with_faulty() {
  Registry registry = Registry::with_builtins();
  registry.add(faulty_controllet());
  return registry;
}

class SessionTest : public testing::Test {
 protected:
  Scene scene(const std::string& controllets, const std::string& rest = "") {
    return parse_scene(
        "arms:\n"
        "  - {name: left, base: {position_m: [0, 0.4, 0]}}\n"
        "  - {name: right, base: {position_m: [0, -0.4, 0]}, "
        "start_rad: [0.1, -0.6, 0, -2.2, 0, 1.6, 0.8]}\n"
        "controllets:\n" +
            controllets + rest,
        "test.yaml", registry_);
  }
  Scene two_poses(const std::string& rest = "") {
    return scene(
        "  - {name: left_pose, type: cartesian_impedance, arms: left}\n"
        "  - {name: right_joints, type: joint_impedance, arms: right}\n"
        "active: [left_pose, right_joints]\n",
        rest);
  }

  const Registry registry_ = registry_with_faulty();
};

// A separate folder that is removed after the test.
class Folder {
 public:
  Folder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "session_test_XXXXXX").string();
    path_ = mkdtemp(pattern.data());
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

TEST_F(SessionTest, RunsExactlyItsDuration) {
  std::vector<std::uint64_t> cycles;
  SessionOptions options{.paced = false, .duration_s = 0.5};
  options.observer = [&](const CycleRecord& record) { cycles.push_back(record.cycle); };
  Session session(two_poses(), registry_, options);
  session.start();
  const RunSummary summary = session.finish();
  EXPECT_EQ(summary.cycles, 500u);
  EXPECT_DOUBLE_EQ(summary.time_s, 0.5);
  EXPECT_EQ(summary.end, RunEnd::duration);
  EXPECT_THAT(summary.faults(), ElementsAre());
  ASSERT_EQ(cycles.size(), 500u);  // every cycle was seen, in order
  for (std::size_t i = 0; i < cycles.size(); ++i) EXPECT_EQ(cycles[i], i + 1);
  EXPECT_GT(summary.cycle_us.median, 0);
  EXPECT_LE(summary.cycle_us.median, summary.cycle_us.p99);
  EXPECT_LE(summary.cycle_us.p999, summary.cycle_us.worst);
}

TEST_F(SessionTest, TheScenesDurationIsTheDefault) {
  Session session(two_poses("duration_s: 0.05\n"), registry_, {.paced = false});
  session.start();
  EXPECT_EQ(session.finish().cycles, 50u);
}

// The log is slower than the loop (its ring has room for 100 cycles only): the loop waits, nothing is lost.
TEST_F(SessionTest, AnUnpacedRunLosesNoRecord) {
  const Folder folder;
  Session session(two_poses(), registry_,
                  {.paced = false, .duration_s = 4, .record = folder.path(), .ring_cycles = 100});
  session.start();
  const RunSummary summary = session.finish();
  EXPECT_EQ(summary.records_lost, 0u);
  EXPECT_THAT(summary.missing, ElementsAre());
  EXPECT_TRUE(std::filesystem::is_regular_file(summary.log));
  EXPECT_EQ(summary.log.parent_path().parent_path(), folder.path());
}

TEST_F(SessionTest, AStopEndsInHold) {
  Session* running = nullptr;
  std::vector<std::pair<std::uint16_t, std::uint16_t>> owners;
  SessionOptions options{.paced = false, .duration_s = 0};
  options.observer = [&](const CycleRecord& record) {
    owners.emplace_back(record.arms[0].owner, record.arms[1].owner);
    if (record.cycle == 100) running->stop();
  };
  Session session(two_poses(), registry_, options);
  running = &session;
  session.start();
  const RunSummary summary = session.finish();
  EXPECT_EQ(summary.end, RunEnd::stopped);
  EXPECT_THAT(summary.faults(), ElementsAre());  // stopping on request is not a failure
  std::size_t held = 0;
  while (held < owners.size() &&
         owners[owners.size() - 1 - held] == std::pair<std::uint16_t, std::uint16_t>(0, 1))
    ++held;
  EXPECT_EQ(held, 200u);  // hold_s
  EXPECT_GT(owners.size(), 300u);
  EXPECT_EQ(session.modes().stopped(), ArmSet::all(2));
}

// From any start configuration, a controllet first holds it.
TEST_F(SessionTest, NothingJumpsAtTheStart) {
  const Scene two = two_poses();
  double moved = 0;
  SessionOptions options{.paced = false, .duration_s = 0.3};
  options.observer = [&](const CycleRecord& record) {
    for (std::size_t arm = 0; arm < 2; ++arm) {
      for (Eigen::Index j = 0; j < two.arms[arm].q_start.size(); ++j) {
        moved = std::max(
            moved, std::abs(record.arms[arm].q[static_cast<std::size_t>(j)] - two.arms[arm].q_start[j]));
      }
    }
  };
  Session session(two, registry_, options);
  session.start();
  const RunSummary summary = session.finish();
  EXPECT_LT(moved, 1e-4);
  ASSERT_FALSE(summary.switches.empty());
  EXPECT_EQ(summary.switches[0].cause, "start");
  for (const auto& step : summary.switches[0].steps) EXPECT_LT(step.requested_nm, 0.05) << step.arm;
}

TEST_F(SessionTest, TwoRunsAreBitByBitTheSame) {
  const std::string motion =
      "timeline:\n"
      "  - {at_s: 0.02, reference: {controllet: left_pose, input: pose, position_m: [0.4, 0.4, 0.5], "
      "rpy_rad: [pi, 0, 0]}}\n"
      "  - {at_s: 0.2, switch: {deactivate: [left_pose]}}\n"
      "plant: {fidelity: realistic}\n";
  std::vector<JointArray> runs[2];
  for (auto& run : runs) {
    SessionOptions options{.paced = false, .duration_s = 0.4};
    options.observer = [&](const CycleRecord& record) {
      for (const auto& arm : record.arms) {
        run.push_back(arm.q);
        run.push_back(arm.tau_cmd);
      }
    };
    Session session(two_poses(motion), registry_, options);
    session.start();
    (void)session.finish();
  }
  ASSERT_EQ(runs[0].size(), 1600u);
  EXPECT_EQ(runs[0], runs[1]);
  EXPECT_NE(runs[0].front(), runs[0][runs[0].size() - 4]);  // it did move
}

class FaultTest : public SessionTest,
                  public testing::WithParamInterface<std::pair<const char*, Intervention>> {};

TEST_P(FaultTest, IsSurvivedAndReported) {
  const auto [fault, rule] = GetParam();
  Scene broken = scene(
      std::string("  - {name: left_faulty, type: faulty, arms: left, parameters: {after_s: 0.1, fault: ") +
      fault + "}}\n" +
      "  - {name: right_joints, type: joint_impedance, arms: right}\n"
      "active: [left_faulty, right_joints]\n");
  std::uint16_t left = 99, right = 99;
  SessionOptions options{.paced = false, .duration_s = 0.3};
  options.observer = [&](const CycleRecord& record) {
    left = record.arms[0].owner;
    right = record.arms[1].owner;
  };
  Session session(std::move(broken), registry_, options);
  session.start();
  RunSummary summary = session.finish();
  EXPECT_EQ(summary.cycles, 300u);
  EXPECT_EQ(left, session.modes().find("left_hold"));
  EXPECT_EQ(right, session.modes().find("right_joints"));
  ASSERT_EQ(summary.interventions.size(), 1u);
  EXPECT_EQ(summary.interventions[0].rule, rule);
  EXPECT_EQ(summary.interventions[0].arm, "left");
  EXPECT_EQ(summary.interventions[0].controllet, "left_faulty");
  EXPECT_EQ(summary.interventions[0].count, 1u);
  EXPECT_NEAR(summary.interventions[0].first_s, 0.1, 0.0015);
  ASSERT_EQ(summary.faults().size(), 1u);
  EXPECT_THAT(summary.faults()[0], HasSubstr("left_faulty"));
  summary.expected_interventions = {{"left", rule}};
  EXPECT_TRUE(summary.success());
}

INSTANTIATE_TEST_SUITE_P(AllFaults, FaultTest,
                         testing::Values(std::pair("nan", Intervention::torque_not_finite),
                                         std::pair("infinity", Intervention::torque_not_finite),
                                         std::pair("implausible", Intervention::torque_implausible),
                                         std::pair("exception", Intervention::controllet_threw),
                                         std::pair("report", Intervention::controllet_fault)),
                         [](const auto& fault) { return fault.param.first; });

TEST_F(SessionTest, AnUnpacedLoopNeverAsksForFifo) {
  SessionOptions options{.paced = false, .duration_s = 0.01};
  options.thread = {.lock_memory = false, .fifo_priority = 10, .cpu = 0};
  Session session(two_poses(), registry_, options);
  session.start();
  const RunSummary summary = session.finish();
  ASSERT_EQ(summary.thread.size(), 1u);
  EXPECT_EQ(summary.thread[0].what, "affinity to core 0");
}

TEST_F(SessionTest, MissingResourcesAreReported) {
  SessionOptions options{.paced = false, .duration_s = 0.01};
  options.thread = {.lock_memory = false, .fifo_priority = {}, .cpu = 1000};
  Session session(two_poses(), registry_, options);
  session.start();
  const RunSummary summary = session.finish();
  ASSERT_EQ(summary.thread.size(), 1u);
  EXPECT_FALSE(summary.thread[0].done);
  EXPECT_THAT(summary.thread[0].reason, HasSubstr("core 1000"));
  EXPECT_TRUE(summary.success());  // never fatal in simulation
}

TEST_F(SessionTest, AnUnusableLogFolderIsRefusedBeforeAnythingMoves) {
  EXPECT_THROW(Session(two_poses(), registry_, {.paced = false, .record = "/proc/no/such"}),
               std::runtime_error);
}

// A backend that ends by an exception: it reaches the caller, not std::terminate.
class Unreachable final : public Backend {
 public:
  explicit Unreachable(std::size_t arms) : arms_(arms) {}
  std::size_t arm_count() const override { return arms_; }
  Capabilities capabilities(ArmIndex) const override { return {}; }
  void start() override { throw std::runtime_error("no arm answers"); }
  ArmSet wait() override { return {}; }
  LoopTime now() const override { return {}; }
  void read(ArmSet, std::span<ArmState>) override {}
  void write(ArmSet, std::span<const ArmCommand>) override {}
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return {}; }

 private:
  std::size_t arms_;
};

TEST_F(SessionTest, AnUnreachableWorldIsReported) {
  SessionOptions options;
  options.thread = {.lock_memory = false, .fifo_priority = {}, .cpu = {}};
  options.make_backend = [](const Scene& s) { return std::make_unique<Unreachable>(s.arms.size()); };
  Session session(two_poses(), registry_, options);
  session.start();
  EXPECT_THROW((void)session.finish(), std::runtime_error);
}

// Refused when the run is built, so that `check` refuses it, too.
TEST(SessionTimeline, AGoalOutOfReachIsRefused) {
  const Registry registry = Registry::with_builtins();
  const auto scene = [&](const char* x) {
    return parse_scene(
        "arms:\n  - {name: arm}\ncontrollets:\n  - {name: pose, type: cartesian_impedance, arms: arm}\n"
        "active: [pose]\ntimeline:\n  - {at_s: 1.5, reference: {controllet: pose, input: pose, "
        "position_m: [" +
            std::string(x) + ", 0, 0.4], rpy_rad: [pi, 0, 0]}}\n",
        "test.yaml", registry);
  };
  for (const char* far : {"2", "5"}) {
    try {
      const Session session(scene(far), registry, {.paced = false});
      ADD_FAILURE() << "accepted " << far << " m";
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find("the event at 1.5 s is refused: 'pose'"), std::string::npos)
          << error.what();
      EXPECT_NE(std::string(error.what()).find("out of reach"), std::string::npos) << error.what();
    }
  }
  EXPECT_NO_THROW(Session(scene("0.5"), registry, {.paced = false}));
}

// A backend that fails while the arms are in motion: they are still left as at any end.
class FailsInMotion final : public Backend {
 public:
  FailsInMotion(std::unique_ptr<Backend> arms, int& finished, bool fails_again)
      : arms_(std::move(arms)), finished_(finished), fails_again_(fails_again) {}
  std::size_t arm_count() const override { return arms_->arm_count(); }
  Capabilities capabilities(ArmIndex arm) const override { return arms_->capabilities(arm); }
  void start() override { arms_->start(); }
  void finish() override {
    ++finished_;
    arms_->finish();
    if (fails_again_) throw std::runtime_error("and again");
  }
  ArmSet wait() override {
    if (++steps_ == 50) throw std::runtime_error("out of memory");
    return arms_->wait();
  }
  LoopTime now() const override { return arms_->now(); }
  void read(ArmSet due, std::span<ArmState> states) override { arms_->read(due, states); }
  void write(ArmSet due, std::span<const ArmCommand> commands) override { arms_->write(due, commands); }
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return {}; }

 private:
  std::unique_ptr<Backend> arms_;
  int& finished_;
  bool fails_again_;
  int steps_ = 0;
};

TEST_F(SessionTest, AfterAFailureInMotionTheArmsAreLeftAsAtAnyEnd) {
  for (const bool fails_again : {false, true}) {
    int finished = 0;
    SessionOptions options{.paced = false, .duration_s = 0.2};
    options.make_backend = [&](const Scene& s) {
      return std::make_unique<FailsInMotion>(
          make_backend(s, registry_, {.kind = BackendKind::mujoco}, {.paced = false}).backend, finished,
          fails_again);
    };
    Session session(two_poses(), registry_, options);
    session.start();
    try {
      (void)session.finish();
      FAIL();
    } catch (const std::runtime_error& error) {
      EXPECT_THAT(error.what(), HasSubstr("out of memory"));
    }
    EXPECT_EQ(finished, 1);
  }
}

// Arms that take a while to connect, and a request meanwhile.
class ConnectsSlowly final : public Backend {
 public:
  ConnectsSlowly(std::unique_ptr<Backend> arms, bool simulated, std::function<void()> meanwhile)
      : arms_(std::move(arms)), simulated_(simulated), meanwhile_(std::move(meanwhile)) {}
  std::size_t arm_count() const override { return arms_->arm_count(); }
  Capabilities capabilities(ArmIndex arm) const override {
    Capabilities can = arms_->capabilities(arm);
    can.simulated = simulated_;
    return can;
  }
  void start() override {
    arms_->start();
    meanwhile_();
  }
  void finish() override { arms_->finish(); }
  ArmSet wait() override { return arms_->wait(); }
  LoopTime now() const override { return arms_->now(); }
  void read(ArmSet due, std::span<ArmState> states) override { arms_->read(due, states); }
  void write(ArmSet due, std::span<const ArmCommand> commands) override { arms_->write(due, commands); }
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return {}; }

 private:
  std::unique_ptr<Backend> arms_;
  bool simulated_;
  std::function<void()> meanwhile_;
};

TEST_F(SessionTest, WhatIsAskedWhileRealArmsConnectMovesNone) {
  for (const bool simulated : {false, true}) {
    Session* running = nullptr;
    std::uint64_t ticket = 0;
    SessionOptions options{.paced = false, .duration_s = 0.05};
    options.make_backend = [&](const Scene& s) {
      return std::make_unique<ConnectsSlowly>(
          make_backend(s, registry_, {.kind = BackendKind::mujoco}, {.paced = false}).backend, simulated,
          [&] {
            Request request{.kind = Request::Kind::switch_controllets};
            request.deactivate = InstanceSet{1} << running->modes().find("left_pose");
            ASSERT_EQ(running->modes().post(std::span(&request, 1), ticket), Verdict::accepted);
          });
    };
    Session session(two_poses(), registry_, options);
    running = &session;
    session.start();
    const RunSummary summary = session.finish();
    Answer answer;
    ASSERT_TRUE(session.modes().poll(ticket, answer));
    EXPECT_EQ(answer.verdict, simulated ? Verdict::accepted : Verdict::timeout);
    ASSERT_EQ(summary.switches.size(), 2u);  // that of the start, and this one
    EXPECT_EQ(summary.switches.back().accepted(), simulated);
  }
}

// A program that moves real arms by itself has no socket for commands, and is stopped like any other run.
TEST_F(SessionTest, ARunOfRealArmsIsAlwaysStoppedFromOutside) {
  const test::PrivateFolder folder;
  ASSERT_EQ(setenv("XDG_RUNTIME_DIR", folder.path().c_str(), 1), 0);
  for (const bool simulated : {false, true}) {
    SessionOptions options{.duration_s = 0.0};
    options.make_backend = [&](const Scene& s) {
      return std::make_unique<ConnectsSlowly>(
          make_backend(s, registry_, {.kind = BackendKind::mujoco}, {.paced = true}).backend, simulated,
          [] {});
    };
    Session session(two_poses(), registry_, options);
    EXPECT_EQ(session.socket().empty(), simulated);
    if (simulated) continue;
    session.start();
    const auto found = all_running_sockets();
    EXPECT_NE(std::ranges::find(found, session.socket()), found.end());
    LiveClient client(session.socket());
    EXPECT_EQ(client.ask({{"do", "switch"}, {"activate", {"left_pose"}}})["verdict"], "malformed");
    EXPECT_EQ(stop_run(session.socket(), {})["ok"], true);
    EXPECT_EQ(session.modes().stopped(), ArmSet::all(2));
    session.stop();
    (void)session.finish();
  }
  unsetenv("XDG_RUNTIME_DIR");
}

TEST_F(SessionTest, TheSummaryIsOneJsonObject) {
  Session session(two_poses("timeline:\n  - {at_s: 0.02, switch: {deactivate: [left_pose]}}\n"), registry_,
                  {.paced = false, .duration_s = 0.05});
  session.start();
  const auto json = nlohmann::json::parse(to_json(session.finish()));
  EXPECT_EQ(json.at("cycles"), 50);
  EXPECT_EQ(json.at("overruns"), 0);
  for (const char* key : {"median", "p99", "p999", "worst"})
    EXPECT_GT(json.at("cycle_us").at(key), 0.0) << key;
  ASSERT_EQ(json.at("switches").size(), 2u);
  EXPECT_EQ(json.at("switches")[1].at("started"), nlohmann::json::array({"left_hold"}));
  EXPECT_EQ(json.at("switches")[1].at("kept"), nlohmann::json::array({"right_joints"}));
  EXPECT_EQ(json.at("switches")[1].at("cause"), "timeline");
  EXPECT_DOUBLE_EQ(json.at("switches")[1].at("t_s"), 0.02);
  EXPECT_TRUE(json.at("interventions").empty());
  EXPECT_TRUE(json.at("log").is_null());
  EXPECT_TRUE(json.at("report").is_null());
}

TEST_F(SessionTest, TheStatusFollowsTheRun) {
  Session session(two_poses(), registry_, {.paced = false, .duration_s = 0.2});
  session.start();
  EXPECT_TRUE(session.wait_for_end(60));
  (void)session.finish();
  const RunStatus status = session.status();
  EXPECT_EQ(status.cycles, 200u);
  ASSERT_EQ(status.arms.size(), 2u);
  EXPECT_EQ(status.arms[0].controllet, "left_pose");
  EXPECT_STREQ(status.arms[0].tracking_unit, "m");
  EXPECT_STREQ(status.arms[1].tracking_unit, "rad");
  for (const auto& arm : status.arms) {
    ASSERT_TRUE(arm.tracking_error.has_value());
    EXPECT_LT(*arm.tracking_error, 1e-3);
    EXPECT_LT(arm.torque_use, 0.2);
  }
}

}  // namespace

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

}  // namespace multipanda::session_test
