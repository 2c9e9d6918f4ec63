#include <atomic>
#include <limits>
#include <thread>

#include <gtest/gtest.h>

#include "backends/mujoco/testing/test_scenes.hpp"

namespace multipanda::requests_test {
namespace {

using namespace test;

// Runs the loop until the answer is there.
template <typename Request>
RequestAnswer ask(Loop& loop, Request request, std::size_t arm = 0) {
  std::future<RequestAnswer> future;
  if constexpr (std::is_convertible_v<Request, WorldRequest>) {
    future = loop.backend.request(WorldRequest(std::move(request)));
  } else {
    future = loop.backend.request(arm, std::move(request));
  }
  // The helper thread answers soon: an arm in motion must not run on into a reflex meanwhile.
  while (future.wait_for(std::chrono::milliseconds(5)) != std::future_status::ready) loop.step();
  return future.get();
}

// In motion under a constant torque, then `stop`: the arm must stop, hold, and discard the torque.
void expect_brakes(Loop& loop, ArmMode mode) {
  EXPECT_EQ(loop.state().mode, mode);
  loop.steps(1500);
  const JointVector q = loop.state().q;
  EXPECT_LT(loop.state().dq.cwiseAbs().maxCoeff(), 1e-3);
  loop.steps(1500);
  EXPECT_EQ(loop.state().mode, mode);
  EXPECT_LT((loop.state().q - q).cwiseAbs().maxCoeff(), 1e-4);
  EXPECT_LT(loop.state().tau_J_d.cwiseAbs().maxCoeff(), 0.05);
  EXPECT_EQ(loop.state().command_success_rate, 0);
}

void set_in_motion(Loop& loop) {
  JointVector tau = joint_constant(7, 0);
  tau[0] = 5;
  loop.lead_to(tau);
  loop.steps(95);
  ASSERT_EQ(loop.state().mode, ArmMode::move) << describe(loop.backend.arm(0).reflex_detail());
  ASSERT_GT(loop.state().dq.cwiseAbs().maxCoeff(), 0.2);
  ASSERT_EQ(loop.state().command_success_rate, 1);
}

TEST(Modes, IdleUntilTheFirstCommandThenMove) {
  Loop loop(scene_of({arm_named("a")}));
  EXPECT_EQ(loop.state().mode, ArmMode::idle);
  EXPECT_EQ(loop.state().sequence, 1u);
  loop.step();
  EXPECT_EQ(loop.state().mode, ArmMode::move);
  EXPECT_EQ(loop.state().sequence, 2u);
  EXPECT_EQ(loop.state().t_robot.ns, 2'000'000);
}

TEST(Modes, UserStopBrakesAndHolds) {
  Loop loop(scene_of({arm_named("a")}));
  set_in_motion(loop);
  EXPECT_TRUE(ask(loop, SetUserStop{true}).success);
  expect_brakes(loop, ArmMode::user_stopped);
  EXPECT_FALSE(ask(loop, RecoverFromError{}).success);
  loop.commands[0].tau_cmd.setZero();
  EXPECT_TRUE(ask(loop, SetUserStop{false}).success);
  loop.steps(2);
  EXPECT_EQ(loop.state().mode, ArmMode::move);
}

TEST(Modes, InvalidCommandIsRefused) {
  Loop loop(scene_of({arm_named("a")}));
  set_in_motion(loop);
  loop.commands[0].tau_cmd[3] = std::numeric_limits<double>::quiet_NaN();
  loop.step();
  EXPECT_EQ(loop.state().errors, error_bit(ArmError::controller_torque_discontinuity));
  loop.commands[0].tau_cmd.setZero();
  loop.commands[0].tau_cmd[0] = 5;
  expect_brakes(loop, ArmMode::reflex);
  loop.commands[0].tau_cmd.setZero();
  EXPECT_TRUE(ask(loop, RecoverFromError{}).success);
  loop.step();
  EXPECT_EQ(loop.state().mode, ArmMode::move);
  EXPECT_EQ(loop.state().errors, 0u);
  const RequestAnswer again = ask(loop, RecoverFromError{});
  EXPECT_FALSE(again.success);
  EXPECT_NE(again.reason.find("nothing to recover"), std::string::npos);
}

TEST(Modes, StopOnRequestHoldsUntilRecovered) {
  Loop loop(scene_of({arm_named("a")}, {.torque_bandwidth_hz = 50, .command_delay_s = 0.001}));
  set_in_motion(loop);
  EXPECT_TRUE(ask(loop, StopMotion{}).success);
  expect_brakes(loop, ArmMode::other);
  EXPECT_TRUE(ask(loop, RecoverFromError{}).success);
}

TEST(Modes, MissingCommandsAreRepeatedThenStopTheArm) {
  Loop loop(scene_of({arm_named("a")}));
  loop.commands[0].tau_cmd[0] = 1;
  loop.steps(100);
  for (int k = 0; k < SimulatedArm::kLostCommands - 1; ++k) {
    loop.backend.write(ArmSet(), loop.commands);
    loop.backend.read(loop.backend.wait(), loop.states);
    EXPECT_EQ(loop.state().tau_J_d[0], 1);
  }
  EXPECT_EQ(loop.state().mode, ArmMode::move);
  EXPECT_NEAR(loop.state().command_success_rate, 0.81, 1e-12);
  loop.backend.write(ArmSet(), loop.commands);
  loop.backend.read(loop.backend.wait(), loop.states);
  EXPECT_EQ(loop.state().mode, ArmMode::reflex);
  EXPECT_EQ(loop.state().errors, error_bit(ArmError::communication_constraints_violation));
}

TEST(Requests, AnsweredToOtherThreads) {
  Loop loop(scene_of({arm_named("a"), arm_named("b", pose(0, 2, 0))}));
  std::atomic<int> done{0}, good{0};
  std::vector<std::thread> askers;
  for (std::size_t t = 0; t < 4; ++t) {
    askers.emplace_back([&, t] {
      for (int i = 0; i < 20; ++i) {
        const Load load{.mass = 1e-3 * (i + 1) + 1e-4 * static_cast<double>(t),
                        .inertia_C = 1e-3 * Matrix3::Identity()};
        good += loop.backend.request(t % 2, SetLoad{load}).get().success ? 1 : 0;
      }
      ++done;
    });
  }
  while (done < 4) loop.step();
  for (auto& asker : askers) asker.join();
  EXPECT_EQ(good, 80);
  EXPECT_EQ(loop.state(0).config_version, 41u);
  EXPECT_NEAR(loop.state(1).load.mass, 0.0202, 1.001e-4);  // of the later of two
}

TEST(Requests, InvalidRequestsAreRefusedWithAReason) {
  Loop loop(scene_of({arm_named("a")}));
  Load negative;
  negative.mass = -1;
  EXPECT_FALSE(ask(loop, SetLoad{negative}).success);
  EXPECT_FALSE(ask(loop, SetJointStiffness{joint_constant(6, 100)}).success);
  EXPECT_FALSE(ask(loop, SetFrames{Pose{2 * Matrix3::Identity(), Vector3::Zero()}, {}}).success);
  EXPECT_FALSE(ask(loop, PlaceObject{"nothing", {}}).success);
  EXPECT_FALSE(ask(loop, StopMotion{}, 3).success);
  EXPECT_EQ(loop.state().config_version, 1u);
  loop.backend.finish();
  EXPECT_FALSE(loop.backend.request(0, StopMotion{}).get().success);
}

TEST(Requests, ObjectsArePlacedInFreeSpace) {
  Scene scene = scene_of({arm_named("a")});
  SceneObject table, box;
  table.name = "table";
  table.size = {1, 1, 0.1};
  table.X_WO.position = {2, 0, 0.5};
  box.name = "box";
  box.fixed = false;
  box.X_WO.position = {2, 0, 0.6};
  scene.objects = {table, box};
  Loop loop(scene);
  loop.steps(500);
  EXPECT_NEAR(loop.backend.world().X_WO(1).position.z(), 0.6, 1e-3);
  EXPECT_TRUE(ask(loop, PlaceObject{"box", pose(2.2, 0.1, 0.7, 0, 0, 0.5)}).success);
  loop.steps(1000);
  EXPECT_NEAR(loop.backend.world().X_WO(1).position.x(), 2.2, 5e-3);
  EXPECT_NEAR(loop.backend.world().X_WO(1).position.z(), 0.6, 2e-3);
  const RequestAnswer inside = ask(loop, PlaceObject{"box", pose(2, 0, 0.5)});
  EXPECT_FALSE(inside.success);
  EXPECT_NEAR(loop.backend.world().X_WO(1).position.x(), 2.2, 5e-3);
  EXPECT_FALSE(ask(loop, PlaceObject{"table", {}}).success);
}

// A ball above nothing, without gravity's part in the numbers: the momentum is the force's impulse, whatever
// the object weighs.
TEST(Requests, APushGivesItsImpulse) {
  Scene scene = scene_of({arm_named("a")});
  SceneObject table, ball;
  table.name = "table";
  table.X_WO.position = {2, 0, 0.5};
  ball.name = "ball";
  ball.shape = ShapeType::sphere;
  ball.size = {0.1, 0.1, 0.1};
  ball.mass = 2;
  ball.fixed = false;
  ball.X_WO.position = {3, 0, 5};
  scene.objects = {table, ball};
  Loop loop(scene);
  const auto velocity = [&] {
    const World& world = loop.backend.world();
    return Vector3(Eigen::Map<const Vector3>(world.data()->qvel + world.objects()[1].dof));
  };
  const Vector3 f(30, -40, 0);
  EXPECT_TRUE(ask(loop, PushObject{"ball", f, 0.25}).success);
  loop.steps(400);
  EXPECT_LT((velocity() - 0.25 * f / 2).head<2>().norm(), 1e-9);
  const Vector3 before = velocity();
  EXPECT_TRUE(ask(loop, PushObject{"ball", f, 2}).success);
  loop.steps(10);
  EXPECT_GT((velocity() - before).head<2>().norm(), 0.1);
  const RequestAnswer placed = ask(loop, PlaceObject{"ball", pose(3, 0, 5)});  // ends the push
  EXPECT_TRUE(placed.success) << placed.reason;
  loop.steps(100);
  EXPECT_LT(velocity().head<2>().norm(), 1e-9);
  EXPECT_NE(ask(loop, PushObject{"ball", Vector3(80, 80, 0), 0.1}).reason.find("100 N"), std::string::npos);
  EXPECT_NE(ask(loop, PushObject{"ball", f, 3}).reason.find("2 s"), std::string::npos);
  EXPECT_NE(ask(loop, PushObject{"table", f, 0.1}).reason.find("fixed"), std::string::npos);
  EXPECT_NE(ask(loop, PushObject{"bal", f, 0.1}).reason.find("no object 'bal'"), std::string::npos);
}

TEST(Requests, ResetRestoresTheStartAndDeactivatesTheControllets) {
  Loop loop(scene_of({arm_named("a")}, PlantFidelity::realistic()));
  set_in_motion(loop);
  const auto sequence = loop.state().sequence;
  auto future = loop.backend.request(ResetSimulation{});
  while (loop.state().mode == ArmMode::move) loop.step();
  EXPECT_TRUE(future.get().success);
  EXPECT_EQ(loop.state().mode, ArmMode::recovering);
  EXPECT_LT((loop.state().q - ready()).cwiseAbs().maxCoeff(), 1e-4);
  EXPECT_LT(loop.state().dq.cwiseAbs().maxCoeff(), 1e-2);
  EXPECT_GT(loop.state().sequence, sequence);
  loop.step();
  EXPECT_EQ(loop.state().mode, ArmMode::idle);
  EXPECT_LT(std::abs(loop.state().tau_J_d[0]), 0.1);  // the command of the `recovering` period was ignored
  loop.commands[0].tau_cmd.setZero();
  loop.step();
  EXPECT_EQ(loop.state().mode, ArmMode::move);
}

TEST(Requests, PauseStopsTheWorldAndItsClock) {
  Loop loop(scene_of({arm_named("a")}));
  set_in_motion(loop);
  EXPECT_TRUE(ask(loop, PauseSimulation{true}).success);
  const auto now = loop.backend.now();
  const JointVector q = loop.state().q;
  loop.steps(5);
  EXPECT_EQ(loop.backend.now(), now);
  EXPECT_EQ(loop.state().q, q);
  EXPECT_TRUE(ask(loop, PauseSimulation{false}).success);
  loop.step();
  EXPECT_GT(loop.backend.now(), now);
  EXPECT_NE(loop.state().q, q);
}

TEST(Requests, APausedWorldTakesTheRequestedSteps) {
  Loop loop(scene_of({arm_named("a")}));
  set_in_motion(loop);
  EXPECT_FALSE(ask(loop, StepSimulation{3}).success) << "it runs";
  EXPECT_TRUE(ask(loop, PauseSimulation{true}).success);
  const auto now = loop.backend.now();
  const JointVector q = loop.state().q;
  EXPECT_TRUE(ask(loop, StepSimulation{3}).success);
  EXPECT_EQ((loop.backend.now() - now).count(), 3'000'000);
  EXPECT_NE(loop.state().q, q);
  const JointVector stepped = loop.state().q;
  loop.steps(5);
  EXPECT_EQ(loop.state().q, stepped);
  EXPECT_EQ((loop.backend.now() - now).count(), 3'000'000);
}

// The asker may have given up. Requests of a patience of 0 s are too old whenever the loop looks.
TEST(RequestBox, RefusesWhatWaitedForTooLong) {
  RequestBox box(0), patient;
  auto late = box.post({.arm = 0, .request = ArmRequest(RecoverFromError{})});
  auto later = box.post({.arm = 0, .request = ArmRequest(RecoverFromError{})});
  EXPECT_EQ(box.front(), nullptr);
  for (auto* answer : {&late, &later}) {
    const RequestAnswer refused = answer->get();
    EXPECT_FALSE(refused.success);
    EXPECT_NE(refused.reason.find("was not executed"), std::string::npos) << refused.reason;
  }
  auto in_time = patient.post({.arm = 0, .request = ArmRequest(RecoverFromError{})});
  ASSERT_NE(patient.front(), nullptr);
  patient.answer(ArmReply::done);
  EXPECT_TRUE(in_time.get().success);
}

// Its asker has hung up, or waits for less time than the box would.
TEST(RequestBox, RefusesWhatItsAskerGaveUp) {
  RequestBox box;
  const auto limit = std::make_shared<std::atomic<std::int64_t>>(std::numeric_limits<std::int64_t>::max());
  ArmRequest request = RecoverFromError{};
  request.begin_by = limit;
  auto answer = box.post({.arm = 0, .request = request});
  ASSERT_NE(box.front(), nullptr);
  *limit = 0;
  EXPECT_EQ(box.front(), nullptr);
  EXPECT_FALSE(answer.get().success);
}

TEST(RequestBox, HasAPlaceForAStopWhenItIsFull) {
  RequestBox box;
  const auto waits = [](const std::future<RequestAnswer>& answer) {
    return answer.wait_for(std::chrono::seconds(0)) != std::future_status::ready;
  };
  std::vector<std::future<RequestAnswer>> others;
  do {
    others.push_back(box.post({.arm = 0, .request = ArmRequest(RecoverFromError{})}));
  } while (waits(others.back()) && others.size() < 1000);
  EXPECT_FALSE(others.back().get().success);
  EXPECT_TRUE(waits(box.post({.arm = 0, .request = GripperRequest(GripperStop{})})));
  EXPECT_TRUE(waits(box.post({.arm = 0, .request = ArmRequest(StopMotion{})})));
}

TEST(RequestBox, RefusesWhatCameBeforeTheProgramStoodStill) {
  for (const bool on_the_wall_clock : {true, false}) {
    RequestBox box;
    if (on_the_wall_clock) box.refuse_after_gaps();
    box.open();
    EXPECT_EQ(box.front(), nullptr);
    auto answer = box.post({.arm = 0, .request = ArmRequest(RecoverFromError{})});
    std::this_thread::sleep_for(GapWatch::kLongest + std::chrono::milliseconds(50));
    EXPECT_EQ(box.front() == nullptr, on_the_wall_clock);
    if (on_the_wall_clock) EXPECT_FALSE(answer.get().success);
    if (!on_the_wall_clock) box.answer(ArmReply::done);
    auto stop = box.post({.arm = 0, .request = GripperRequest(GripperStop{})});
    std::this_thread::sleep_for(GapWatch::kLongest + std::chrono::milliseconds(50));
    EXPECT_NE(box.front(), nullptr);
    box.answer(ArmReply::done);
    auto next = box.post({.arm = 0, .request = ArmRequest(RecoverFromError{})});
    EXPECT_NE(box.front(), nullptr);
  }
}

}  // namespace
}  // namespace multipanda::requests_test
