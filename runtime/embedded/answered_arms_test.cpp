// Arms that a thread of their own answers, on virtual arms behind the real arms' protocol. Their world waits
// for every answer and runs as fast as it gets them, far ahead of this program, which is always late: only
// the threads keep the arms in their motions.
#include <array>
#include <cmath>
#include <mutex>
#include <sys/mman.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/rt/guard/loop_guard.hpp"
#include "fci/client/fci_backend.hpp"
#include "fci/server/virtual_arms.hpp"
#include "runtime/embedded/answered_arm.hpp"
#include "runtime/embedded/testing/hosted_fixture.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::answered_arms_test {
namespace {

using test::HostedFixture;

const Registry& builtins() {
  static const Registry registry = Registry::with_builtins();
  return registry;
}

// Loopback addresses of this process alone, since the protocol fixes the port.
std::string address(int arm) {
  const int id = static_cast<int>(::getpid());
  return "127." + std::to_string(41 + id / 250 % 200) + "." + std::to_string(1 + id % 250) + "." +
         std::to_string(11 + arm);
}

std::string arms() {
  const auto fci = [](int i) { return ", fci: {address: " + address(i) + ", gripper: false}}\n"; };
  return "arms:\n  left: {model: fer, hand: false, base: {position_m: [0, 0.6, 0]}" + fci(0) +
         "  right: {model: fr3, hand: false, base: {position_m: [0, -0.6, 0]}" + fci(1);
}

class AnsweredArms : public testing::Test {
 protected:
  void SetUp() override {
    scene = parse_scene(arms(), "test", builtins());
    start_world();
    hardware = std::make_unique<HardwareSystem>(scene, answered_arms(scene, [this](const std::string& text) {
                                                  const std::lock_guard lock(mutex);
                                                  messages += text + "\n";
                                                }));
    hardware->connect();
    fixture = std::make_unique<HostedFixture>(*hardware);
  }
  void start_world() {
    fci::VirtualArmOptions options;
    options.places = {{.address = address(0)}, {.address = address(1)}};
    options.grippers = false;
    options.pace = fci::WorldPace::lockstep;
    world = std::make_unique<fci::VirtualArms>(scene, options);
    world->start();
  }
  void TearDown() override {
    if (hardware) hardware->disconnect();
    hardware.reset();
    world.reset();
  }
  // The program's cycles, stamped with the arm's time: it sees a world that jumps.
  void step() {
    (void)hardware->read();
    if (command) command();
    (void)hardware->write(hardware->state(0).t_robot.ns);
  }
  template <typename Condition>
  bool until(Condition condition, double deadline_s = 60) {
    const HostTime start = host_now();
    while (!condition()) {
      if (seconds(host_now() - start) > deadline_s) return false;
      step();
      std::this_thread::yield();
    }
    return true;
  }
  // So many packets of the left arm.
  void packets(std::uint64_t count) {
    const std::uint64_t first = hardware->state(0).sequence;
    EXPECT_TRUE(until([&] { return hardware->state(0).sequence >= first + count; }));
  }
  ArmMode mode(ArmIndex arm) const { return hardware->state(arm).mode; }
  // What the arm's thread has received and sent at one instant. It goes on: two equal readings are one.
  ConnectionStatistics counted(ArmIndex arm) const {
    for (;;) {
      const auto first = hardware->backend().connection(arm), second = hardware->backend().connection(arm);
      if (first->received == second->received && first->sent == second->sent) return *first;
    }
  }
  bool goes(ArmIndex arm) {
    return until([&] { return mode(arm) == ArmMode::move; });
  }

  Scene scene;
  std::unique_ptr<fci::VirtualArms> world;
  std::unique_ptr<HardwareSystem> hardware;
  std::unique_ptr<HostedFixture> fixture;
  std::function<void()> command;
  std::mutex mutex;
  std::string messages;
};

TEST_F(AnsweredArms, EveryPacketIsAnsweredHoweverLateTheProgramIs) {
  ASSERT_EQ(fixture->change(fixture->efforts("left")), "");
  ASSERT_EQ(fixture->change(HostedFixture::joint_names("right", "position")), "");
  ASSERT_TRUE(goes(0)) << messages;
  ASSERT_TRUE(goes(1)) << messages;
  const JointVector q0 = hardware->state(0).q, q1 = hardware->state(1).q;
  const std::array<ConnectionStatistics, 2> start{counted(0), counted(1)};
  packets(1000);
  // A program that does nothing at all for 3,000 packets: its arms are held.
  const std::uint64_t before = hardware->state(0).sequence;
  const auto sent = hardware->backend().connection(0)->sent;
  while (hardware->backend().connection(0)->received < sent + 3000) std::this_thread::yield();
  (void)hardware->read();
  EXPECT_GE(hardware->state(0).sequence, before + 2000);
  EXPECT_EQ(mode(0), ArmMode::move) << messages;
  EXPECT_EQ(mode(1), ArmMode::move) << messages;
  (void)hardware->write(hardware->state(0).t_robot.ns);
  EXPECT_EQ(fixture->state("left/following"), 0);
  EXPECT_EQ(fixture->state("right/following"), 0);
  EXPECT_LT((hardware->state(0).q - q0).lpNorm<Eigen::Infinity>(), 1e-2);
  EXPECT_LT((hardware->state(1).q - q1).lpNorm<Eigen::Infinity>(), 1e-2);
  EXPECT_EQ(hardware->state(0).command_success_rate, 1);
  EXPECT_EQ(hardware->state(1).command_success_rate, 1);
  for (ArmIndex i : {0u, 1u}) {
    const ConnectionStatistics end = counted(i);
    EXPECT_GE(end.received - start[i].received, 3000u) << i;
    EXPECT_GE(end.sent - start[i].sent + 1, end.received - start[i].received) << i;  // one is being answered
    EXPECT_EQ(end.not_sent, 0u) << i;
  }
  // Nothing is left to wait for: the connections close, and open again.
  hardware->disconnect_later();
  hardware->connect();
  EXPECT_EQ(mode(0), ArmMode::idle) << messages;
  EXPECT_EQ(mode(1), ArmMode::idle) << messages;
}

// Positions and velocities that jump from cycle to cycle, since the program is always late by many packets.
TEST_F(AnsweredArms, MotionsOfALateProgramAreNoDiscontinuity) {
  ASSERT_EQ(fixture->change(HostedFixture::joint_names("left", "position")), "");
  ASSERT_EQ(fixture->change(fixture->all("right_ee_cartesian_velocity")), "");
  ASSERT_TRUE(goes(0)) << messages;
  ASSERT_TRUE(goes(1)) << messages;
  const double start = *fixture->command("left_joint4/position");
  const std::int64_t begin = hardware->state(0).t_robot.ns;
  command = [&] {
    const double t = 1e-9 * static_cast<double>(hardware->state(0).t_robot.ns - begin);
    const double s = std::clamp(t / 3, 0.0, 1.0);
    *fixture->command("left_joint4/position") = start + 0.3 * s * s * s * (10 + s * (6 * s - 15));
    *fixture->command("right_ee_cartesian_velocity/tz") = t < 2 ? 0.03 * std::sin(3 * t) : 0.0;
  };
  packets(8000);
  EXPECT_EQ(mode(0), ArmMode::move) << messages;
  EXPECT_EQ(mode(1), ArmMode::move) << messages;
  // A program that was silent for too long begins again near its command; here it was not farther than that.
  EXPECT_EQ(fixture->state("left/error"), 0);
  EXPECT_EQ(fixture->state("right/error"), 0);
  EXPECT_GT(hardware->state(0).q[3], start - 0.01);
  EXPECT_LT(hardware->state(0).q[3], start + 0.31);
}

TEST_F(AnsweredArms, AControllerThatEndsInMotionLeavesNoArmUnanswered) {
  ASSERT_EQ(fixture->change(fixture->efforts("left")), "");
  ASSERT_TRUE(goes(0)) << messages;
  command = [&] { *fixture->command("left_joint1/effort") = 4; };
  ASSERT_TRUE(until([&] { return std::abs(hardware->state(0).dq[0]) > 0.05 || mode(0) != ArmMode::move; }));
  ASSERT_EQ(mode(0), ArmMode::move) << messages;
  command = {};
  ASSERT_EQ(fixture->change(HostedFixture::joint_names("left", "velocity"), fixture->efforts("left")), "");
  ASSERT_TRUE(until([&] { return fixture->state("left/following") == 1; })) << messages;
  EXPECT_EQ(fixture->state("left/error"), 0);
  ASSERT_EQ(fixture->change({}, HostedFixture::joint_names("left", "velocity")), "");
  EXPECT_TRUE(until([&] { return mode(0) == ArmMode::idle; })) << messages;
  EXPECT_LT(hardware->state(0).dq.lpNorm<Eigen::Infinity>(), 0.05);
}

TEST_F(AnsweredArms, AFaultAndARecoveryAreOneArmsOwn) {
  ASSERT_EQ(fixture->change(fixture->efforts("left")), "");
  ASSERT_EQ(fixture->change(fixture->all("right_ee_cartesian_position")), "");
  ASSERT_TRUE(goes(0)) << messages;
  ASSERT_TRUE(until([&] { return fixture->state("right/following") == 1; })) << messages;
  world->raise(0, ArmError::joint_reflex);
  ASSERT_TRUE(until([&] { return mode(0) == ArmMode::reflex; }));
  EXPECT_EQ(fixture->state("left/error"), 1);
  EXPECT_EQ(mode(1), ArmMode::move);
  auto answer = hardware->backend().request(0, RecoverFromError{});
  ASSERT_TRUE(until([&] { return answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }));
  const RequestAnswer recovered = answer.get();
  EXPECT_TRUE(recovered.success) << recovered.reason;
  EXPECT_TRUE(goes(0)) << messages;
  packets(500);
  EXPECT_EQ(mode(0), ArmMode::move);

  // All arms lost is the component's only error.
  world->stop();
  EXPECT_TRUE(until([&] { return hardware->read() == HardwareSystem::Result::lost; }));
  hardware->disconnect_later();
  world.reset();
  EXPECT_THROW(hardware->connect(), std::runtime_error);
  start_world();
  hardware->connect();
  EXPECT_EQ(mode(0), ArmMode::idle);
}

// On the program's side of the threads: read and write of a manager's cycle, with each kind of command, while
// the arms' threads go on.
TEST_F(AnsweredArms, ReadAndWriteNeitherAllocateNorLock) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  ASSERT_EQ(fixture->change(fixture->efforts("left")), "");
  ASSERT_EQ(fixture->change(fixture->all("right_ee_cartesian_velocity")), "");
  ASSERT_TRUE(goes(0)) << messages;
  ASSERT_TRUE(goes(1)) << messages;
  const auto watched = [&](int cycles, const char* during) {
    const std::uint64_t first = hardware->state(0).sequence;
    LoopGuard::arm();
    for (int i = 0; i < cycles || hardware->state(0).sequence < first + 100; ++i) step();
    const LoopGuardCounts counts = LoopGuard::disarm();
    EXPECT_EQ(counts.heap_calls, 0u) << during;
    EXPECT_EQ(counts.lock_calls, 0u) << during;
  };
  watched(300, "in motion");
  world->raise(0, ArmError::joint_reflex);
  watched(300, "while an arm stops itself");
  EXPECT_TRUE(until([&] { return mode(0) == ArmMode::reflex; }));
  EXPECT_EQ(mode(1), ArmMode::move) << messages;
}

// The work of the arm's thread, on this one: each kind of motion with commands, without them for long enough
// to be held, with them again, and while the next kind is asked for.
TEST(AnsweredArm, ItsCycleNeitherAllocatesNorLocksNorFaults) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  const bool faults_count = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
  const Scene scene = parse_scene(arms(), "test", builtins());
  fci::VirtualArmOptions options;
  options.places = {{.address = address(0)}, {.address = address(1)}};
  options.grippers = false;
  options.pace = fci::WorldPace::lockstep;
  fci::VirtualArms world(scene, options);
  world.start();
  const SceneArm& left = scene.arms[0];
  AnsweredArm arm(fci::fci_arm_config(left, left.fci->address), left, {});
  arm.backend().start();
  const auto cycle = [&] {
    arm.cycle();
    (void)arm.take_report();
    (void)arm.take_restart();
  };
  const auto expect_none = [&](const LoopGuardCounts& counts, const char* during, ArmDrive drive) {
    EXPECT_EQ(counts.heap_calls, 0u) << during << static_cast<int>(drive);
    EXPECT_EQ(counts.lock_calls, 0u) << during << static_cast<int>(drive);
    if (faults_count) {
      EXPECT_EQ(counts.page_faults, 0u) << during << static_cast<int>(drive);
    }
  };
  for (int k = 0; k < 50; ++k) cycle();  // every page has been touched
  for (const ArmDrive drive :
       {ArmDrive::effort, ArmDrive::joint_position, ArmDrive::joint_velocity, ArmDrive::cartesian_pose,
        ArmDrive::cartesian_velocity, ArmDrive::effort, ArmDrive::none}) {
    LoopGuard::arm();
    arm.set_drive(drive);
    const HostTime start = host_now();
    while (arm.report().running != drive && seconds(host_now() - start) < 30) cycle();
    expect_none(LoopGuard::disarm(), "change to ", drive);
    ASSERT_EQ(arm.report().running, drive);
    // Where the arm is, at rest: no torque, no velocity.
    const bool joints = drive == ArmDrive::joint_position, pose = drive == ArmDrive::cartesian_pose;
    std::array<double, 16> values{};
    if (joints) std::copy_n(arm.report().desired.q_d.begin(), 7, values.begin());
    if (pose) values = arm.report().desired.O_T_EE_d;
    const std::size_t size = pose ? 16 : drive == ArmDrive::cartesian_velocity ? 6 : 7;
    LoopGuard::arm();
    for (int k = 0; k < 300; ++k) {
      if (k < 100 || k > 200) {
        arm.command(arm.report().state.t_robot.ns, std::span<const double>(values).first(size));
      }
      cycle();
    }
    expect_none(LoopGuard::disarm(), "motion ", drive);
    EXPECT_EQ(arm.report().running, drive);
  }
  arm.backend().finish();
  munlockall();
}

}  // namespace
}  // namespace multipanda::answered_arms_test
