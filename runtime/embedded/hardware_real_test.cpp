// A hardware component for real arms, on virtual arms behind the same protocol. Their world waits for
// commands, so that a slow machine loses none.
#include <cmath>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/rt/guard/loop_guard.hpp"
#include "core/rt/pacer.hpp"
#include "fci/server/virtual_arms.hpp"
#include "runtime/embedded/testing/hosted_fixture.hpp"
#include "scene/load.hpp"

namespace multipanda::hardware_real_test {
namespace {

using test::HostedFixture;

const Registry& builtins() {
  static const Registry registry = Registry::with_builtins();
  return registry;
}

// Loopback addresses of this process alone, since the protocol fixes the port.
std::string address(int arm) {
  const int id = static_cast<int>(::getpid());
  return "127." + std::to_string(17 + id / 250 % 200) + "." + std::to_string(1 + id % 250) + "." +
         std::to_string(1 + arm);
}

std::string arms() {
  const auto fci = [](int i) { return ", fci: {address: " + address(i) + ", gripper: false}}\n"; };
  return "arms:\n  left: {model: fer, hand: false, base: {position_m: [0, 0.6, 0]}" + fci(0) +
         "  right: {model: fr3, hand: false, base: {position_m: [0, -0.6, 0]}" + fci(1);
}

class RealHardware : public testing::Test {
 protected:
  void SetUp() override {
    scene = parse_scene(arms(), "test", builtins());
    fci::VirtualArmOptions options;
    options.places = {{.address = address(0)}, {.address = address(1)}};
    options.grippers = false;
    options.pace = fci::WorldPace::lockstep;
    world = std::make_unique<fci::VirtualArms>(scene, options);
    world->start();
    hardware = std::make_unique<HardwareSystem>(scene, lockstep_arms(scene, [this](const std::string& text) {
                                                  const std::lock_guard lock(mutex);
                                                  messages += text + "\n";
                                                }));
    hardware->connect();
    fixture = std::make_unique<HostedFixture>(*hardware);
    fixture->fresh_only_ = true;
  }
  void TearDown() override {
    if (hardware) hardware->disconnect();
    hardware.reset();
    world.reset();
  }
  // At 1 kHz of the wall clock, as in a controller_manager.
  template <typename Condition>
  bool until(Condition condition, double deadline_s = 20) {
    Pacer pacer;
    pacer.start();
    const HostTime start = host_now();
    while (!condition()) {
      if (seconds(host_now() - start) > deadline_s) return false;
      fixture->step();
      pacer.wait();
    }
    return true;
  }
  void run(double s) {
    const HostTime start = host_now();
    (void)until([&] { return seconds(host_now() - start) > s; });
  }
  RequestAnswer ask(ArmIndex arm, ArmRequest request) {
    auto answer = hardware->backend().request(arm, std::move(request));
    EXPECT_TRUE(until([&] { return answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }));
    return answer.get();
  }
  ArmMode mode(ArmIndex arm) const { return hardware->state(arm).mode; }

  Scene scene;
  std::unique_ptr<fci::VirtualArms> world;
  std::unique_ptr<HardwareSystem> hardware;
  std::unique_ptr<HostedFixture> fixture;
  std::mutex mutex;
  std::string messages;
};

TEST_F(RealHardware, TorquesOfOurControllerOnOneArmPositionsOnTheOther) {
  const Scene one = parse_scene(
      "arms: {left: {model: fer, hand: false, base: {position_m: [0, 0.6, 0]}}}\n"
      "controllets: {pose: {type: cartesian_impedance, arms: left}}\nactive: pose\n",
      "test", builtins());
  HostedCycle cycle(one, builtins(), HostedOptions{.arms = {{.name = "left"}}});
  EXPECT_EQ(mode(0), ArmMode::idle);  // no controller drives it yet
  ASSERT_EQ(fixture->change(fixture->efforts("left")), "");
  ASSERT_EQ(fixture->change(HostedFixture::joint_names("right", "position")), "");
  fixture->activate(cycle);
  EXPECT_EQ(cycle.check(), "");
  const InstanceIndex pose = cycle.modes().find("pose");
  ASSERT_TRUE(until([&] { return (cycle.modes().active() & bit(pose)) != 0; })) << messages;
  ASSERT_TRUE(until([&] { return fixture->state("right/following") == 1; })) << messages;
  const double q1 = hardware->state(1).q[0];
  const double c1 = *fixture->command("right_joint1/position");
  EXPECT_NEAR(c1, q1, 2e-3);
  run(0.3);
  EXPECT_EQ(mode(0), ArmMode::move);
  EXPECT_TRUE(fixture->last());

  // One arm's reflex; the other's controllet continues.
  world->raise(1, ArmError::joint_reflex);
  ASSERT_TRUE(until([&] { return mode(1) == ArmMode::reflex; }));
  EXPECT_EQ(fixture->state("right/error"), 1);
  run(0.1);
  EXPECT_EQ(hardware->read(), HardwareSystem::Result::ok);
  EXPECT_TRUE((cycle.modes().active() & bit(pose)) != 0);
  const RequestAnswer recovered = ask(1, RecoverFromError{});
  ASSERT_TRUE(recovered.success) << recovered.reason;
  ASSERT_TRUE(until([&] { return fixture->state("right/following") == 1; })) << messages;

  // Our controller is deactivated and the arm holds itself; then velocities drive it.
  fixture->deactivate();
  ASSERT_EQ(fixture->change(HostedFixture::joint_names("left", "velocity"), fixture->efforts("left")), "");
  ASSERT_TRUE(until([&] { return fixture->state("left/following") == 1; })) << messages;
  fixture->between_ = [&] { *fixture->command("left_joint1/velocity") = 0.05; };
  EXPECT_TRUE(
      until([&] { return fixture->state("left_joint1/velocity") > 0.02 || mode(0) != ArmMode::move; }));
  EXPECT_EQ(mode(0), ArmMode::move) << messages;
  fixture->between_ = {};
  ASSERT_EQ(fixture->change({}, HostedFixture::joint_names("left", "velocity")), "");
  EXPECT_TRUE(until([&] { return mode(0) == ArmMode::idle; })) << messages;
  // Disconnected with an arm in motion, and connected again.
  hardware->disconnect();
  hardware->connect();
  EXPECT_EQ(mode(0), ArmMode::idle);
  EXPECT_EQ(mode(1), ArmMode::idle);
}

// A real arm does not wait: answered in the program's cycles it would miss commands, and stop.
TEST(LockstepArms, AreOnThisComputer) {
  const auto refusal = [](const std::string& address) -> std::string {
    const Scene scene =
        parse_scene("arms: {left: {model: fer, hand: false, fci: " + address + "}}", "test", builtins());
    try {
      (void)lockstep_arms(scene, {});
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return {};
  };
  EXPECT_EQ(refusal("127.0.0.2"), "");
  for (const char* real : {"172.16.0.2", "127.arm.example"}) {
    EXPECT_THAT(refusal(real), testing::AllOf(testing::HasSubstr("'left'"), testing::HasSubstr(real),
                                              testing::HasSubstr("omit 'lockstep'")));
  }
}

TEST_F(RealHardware, ReadAndWriteNeverWaitAndLosingAllArmsIsTheOnlyError) {
  ASSERT_EQ(fixture->change(fixture->all("left_ee_cartesian_position")), "");
  ASSERT_TRUE(until([&] { return fixture->state("left/following") == 1; })) << messages;
  if (kLoopGuardWorks) {
    LoopGuard::arm();
    for (int i = 0; i < 100; ++i) {
      (void)hardware->read();
      (void)hardware->write();
    }
    const LoopGuardCounts counts = LoopGuard::disarm();
    EXPECT_EQ(counts.heap_calls, 0u);
    EXPECT_EQ(counts.lock_calls, 0u);
  }
  world->close_connection(0);
  ASSERT_TRUE(until([&] { return mode(0) == ArmMode::disconnected; }));
  EXPECT_EQ(hardware->read(), HardwareSystem::Result::ok);
  EXPECT_EQ(fixture->state("left/error"), 1);
  EXPECT_EQ(fixture->state("right/error"), 0);
  EXPECT_TRUE(ask(0, Reconnect{}).success);
  ASSERT_TRUE(until([&] { return fixture->state("left/following") == 1; }))
      << messages;  // it was at rest, so commands are accepted
  world->stop();
  ASSERT_TRUE(until([&] { return hardware->read() == HardwareSystem::Result::lost; }));
  EXPECT_FALSE(hardware->fault().empty());
}

}  // namespace
}  // namespace multipanda::hardware_real_test
