// A component that closes its connections takes none of its program's time.

#include <atomic>
#include <future>

#include <gtest/gtest.h>

#include "core/modes/registry.hpp"
#include "runtime/embedded/hardware_system.hpp"
#include "scene/load.hpp"

namespace multipanda::tear_down_test {
namespace {

// An arm whose connection closes when the test allows it.
class SlowArms final : public HardwareArms, public Backend {
 public:
  explicit SlowArms(std::shared_future<void> may_close) : may_close_(std::move(may_close)) {}
  Backend& backend() override { return *this; }
  void connect() override { ++connected; }
  void disconnect() override {
    may_close_.wait();
    ++closed;
  }
  ArmSet update() noexcept override { return ArmSet::of(0); }
  void set_drive(ArmIndex, ArmDrive drive) noexcept override { selected = drive; }
  bool is_driven(ArmIndex, ArmDrive) noexcept override { return true; }
  Desired desired(ArmIndex) const noexcept override { return {}; }
  void command(ArmIndex, const InterfaceCommand&) noexcept override {}
  void stop(ArmIndex) noexcept override {}
  void write(ArmSet, std::span<const ArmCommand>) noexcept override { ++written; }

  std::size_t arm_count() const override { return 1; }
  Capabilities capabilities(ArmIndex) const override { return {}; }
  ArmSet wait() override { return {}; }
  LoopTime now() const override { return {}; }
  void read(ArmSet, std::span<ArmState> states) override {
    states[0].q = states[0].dq = states[0].tau_J = states[0].tau_J_d = joint_constant(7, 0.1);
    states[0].mode = ArmMode::move;
  }
  std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return {}; }
  using Backend::request;

  std::atomic<int> connected{0}, closed{0};
  int written = 0;
  ArmDrive selected = ArmDrive::none;

 private:
  std::shared_future<void> may_close_;
};

TEST(TearDown, AComponentThatClosesCostsItsProgramNoTime) {
  std::promise<void> open;
  auto arms = std::make_unique<SlowArms>(open.get_future().share());
  SlowArms& slow = *arms;
  const Registry registry = Registry::with_builtins();
  HardwareSystem system(parse_scene("arms: {left: {model: fer}}", "test", registry), std::move(arms));
  system.connect();
  std::vector<std::string> efforts;
  for (int j = 1; j <= 7; ++j) efforts.push_back("left_joint" + std::to_string(j) + "/effort");
  system.perform_switch(efforts, {});
  EXPECT_EQ(slow.selected, ArmDrive::effort);
  EXPECT_EQ(system.write(), HardwareSystem::Result::ok);
  EXPECT_EQ(slow.written, 1);

  // disconnect() would wait here for ever.
  system.disconnect_later();
  EXPECT_EQ(slow.closed, 0);
  EXPECT_FALSE(system.is_connected());
  EXPECT_EQ(slow.selected, ArmDrive::none);  // released at once
  // Calls of a manager that is not through with its cycle reach no arm.
  EXPECT_EQ(system.read(), HardwareSystem::Result::ok);
  EXPECT_EQ(system.write(), HardwareSystem::Result::ok);
  system.perform_switch(efforts, {});
  EXPECT_EQ(slow.selected, ArmDrive::none);
  system.perform_switch({}, efforts);
  EXPECT_EQ(slow.written, 1);

  open.set_value();
  system.connect();  // waits for the end of the other
  EXPECT_EQ(slow.closed, 1);
  EXPECT_EQ(slow.connected, 2);
  system.perform_switch(efforts, {});
  EXPECT_EQ(slow.selected, ArmDrive::effort);
  EXPECT_EQ(system.write(), HardwareSystem::Result::ok);
  EXPECT_EQ(slow.written, 2);
}

TEST(TearDown, WaitsForTheOneBefore) {
  std::atomic<int> ended{0};
  {
    multipanda::TearDown tear_down;
    tear_down.start([&] { ++ended; });
    tear_down.start([&] {
      EXPECT_EQ(ended, 1);
      ++ended;
    });
  }
  EXPECT_EQ(ended, 2);
}

}  // namespace
}  // namespace multipanda::tear_down_test
