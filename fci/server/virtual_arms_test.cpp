// Several arms in one world, exact values of the simulation, and commands from other threads.
#include "fci/server/virtual_arms.hpp"

#include <algorithm>
#include <cstdlib>

#include "backends/mujoco/testing/test_scenes.hpp"
#include "fci/server/testing/test_program.hpp"

namespace multipanda::fci::virtual_arms_test {
namespace {

using multipanda::test::arm_named;
using multipanda::test::pose;
using multipanda::test::scene_of;
using test::own_address;
using test::TestProgram;

bool in_mode(const RobotState& s, RobotMode mode) { return s.robot_mode == static_cast<std::uint8_t>(mode); }

Scene two_arms() {
  Scene scene = scene_of({arm_named("left", pose(0, 0.5, 0)), arm_named("right", pose(0, -0.5, 0, 0, 0, 1))});
  SceneObject box;
  box.name = "box";
  box.fixed = false;
  box.X_WO.position = {0.6, 0, 0.5};  // it falls
  scene.objects.push_back(box);
  return scene;
}

VirtualArmOptions options(WorldPace pace, bool stands_still = false) {
  VirtualArmOptions result;
  for (int i = 0; i < 2; ++i) {
    result.places.push_back({.address = own_address(i),
                             .port = 0,
                             .gripper_port = 0,
                             .vacuum_port = 0,
                             .versions = VersionRange{}});
  }
  result.pace = pace;
  result.idle_stands_still = stands_still;
  return result;
}

// One program with both arms, in one thread: it starts one after the other.
TEST(VirtualArms, bothArmsMoveInTheSamePeriods) {
  VirtualArms arms(two_arms(), options(WorldPace::lockstep, true));
  arms.start();
  TestProgram left(arms.place(0)), right(arms.place(1));
  left.read();
  right.read();
  const auto start = [](TestProgram& program) {
    const auto id = program.send(MoveRequest{});
    EXPECT_EQ(program.reply(id), Status::motion_started);
  };
  start(left);
  start(right);
  const auto moves = [](const RobotState& s) { return in_mode(s, RobotMode::move); };
  RobotState l = left.read_until(moves), r = right.read_until(moves);
  l = l.message_id < r.message_id ? left.read() : l;
  r = r.message_id < l.message_id ? right.read() : r;
  for (int i = 0; i < 200; ++i) {
    ASSERT_EQ(l.message_id, r.message_id);
    left.command(left.torques(l));
    right.command(right.torques(r));
    l = left.read();
    r = right.read();
  }
  for (ArmIndex i = 0; i < 2; ++i) {
    EXPECT_EQ(arms.statistics(i).commands_used, 200u);
    EXPECT_EQ(arms.statistics(i).commands_missed, 0u);
  }
  // The true value for comparison: a free fall in semi-implicit steps, as MuJoCo saw it at the beginning of
  // the last.
  auto truth = arms.view().make_snapshot();
  ASSERT_EQ(arms.view().period_of(0, l.message_id), l.message_id);
  ASSERT_TRUE(arms.view().read(l.message_id, truth));
  EXPECT_EQ(truth.period, l.message_id);
  const auto n = static_cast<double>(l.message_id - 2);
  EXPECT_NEAR(truth.X_WO.at(0).position.z(), 0.5 - 9.81e-6 * n * (n + 1) / 2, 1e-6);
  EXPECT_EQ(truth.F_K_W_true.size(), 2u);
  EXPECT_FALSE(arms.view().read(l.message_id + 1, truth));
}

// An arm whose clock is fast numbers its states ahead of the world; the exact values are those of the period
// in which it measured, however far the numbers part.
TEST(VirtualArms, exactValuesAreFoundWhateverAnArmsClockCounts) {
  VirtualArmOptions own = options(WorldPace::realtime);
  own.clocks = {{.phase_s = 0, .drift_ppm = 0}, {.phase_s = 0.0003, .drift_ppm = 10'000}};
  VirtualArms arms(two_arms(), own);
  arms.start();
  TestProgram left(arms.place(0)), right(arms.place(1));
  // The clock gains ten states per second; a stall of the computer moves the numbers the other way at once.
  constexpr std::int64_t kApart = 10;
  constexpr int kMostReads = 60'000;
  auto truth = arms.view().make_snapshot();
  std::uint64_t before = 0;
  std::size_t seen = 0;
  std::int64_t ahead_at_first = 0, parted = 0;
  for (int reads = 0; reads < kMostReads && (seen <= 300 || parted < kApart); ++reads) {
    const RobotState r = right.read();
    const auto period = arms.view().period_of(1, r.message_id);
    if (!period || !arms.view().read(*period, truth)) continue;  // this test was late by more than kKept
    const auto ahead = static_cast<std::int64_t>(r.message_id) - static_cast<std::int64_t>(*period);
    if (seen == 0) ahead_at_first = ahead;
    parted = std::max(parted, std::abs(ahead - ahead_at_first));
    ++seen;
    EXPECT_GE(*period, before);
    EXPECT_LE(*period, arms.view().newest());
    before = *period;
    const double n = static_cast<double>(*period) - 2;
    EXPECT_NEAR(truth.X_WO.at(0).position.z(), 0.5 - 9.81e-6 * n * (n + 1) / 2, 1e-6 * std::abs(n) + 1e-6);
  }
  EXPECT_GE(parted, kApart);
  EXPECT_GT(seen, 300u);
}

// One program stops answering: its arm stops, and the other one is not affected.
TEST(VirtualArms, aSilentProgramStopsOnlyItsOwnArm) {
  VirtualArms arms(two_arms(), options(WorldPace::lockstep));
  arms.start();
  TestProgram left(arms.place(0)), right(arms.place(1));
  RobotState l = left.begin_torques();
  RobotState r = right.start_torques();  // stops answering after that
  l = left.step_in(l);
  for (int i = 0; i < 200; ++i) l = left.exchange(l);
  EXPECT_TRUE(in_mode(l, RobotMode::move));
  EXPECT_EQ(arms.statistics(0).commands_missed, 0u);
  r = right.read_until([](const auto& s) { return !in_mode(s, RobotMode::move); });
  EXPECT_TRUE(in_mode(r, RobotMode::reflex));
  EXPECT_EQ(arms.statistics(1).commands_missed, 20u);
}

// One thread, as libfranka programs do it: start, start, then read, read, write, write. The
// second start has taken a state that the first arm's reading has not, but the program synchronizes.
TEST(VirtualArms, oneThreadStartsOneArmAfterTheOther) {
  VirtualArms arms(two_arms(), options(WorldPace::lockstep));
  arms.start();
  TestProgram left(arms.place(0)), right(arms.place(1));
  RobotState l = left.begin_torques(), r = right.begin_torques();
  const auto next = [](TestProgram& program, const RobotState& before) {
    const RobotState newest = program.read_newest_or(before);
    return newest.message_id > before.message_id ? newest : program.read();
  };
  // The worst case: one arm's state is older than the other's.
  l = left.read_newest_or(l);
  r = right.read_until([&](const RobotState& s) { return s.message_id > l.message_id; });
  for (int i = 0; i < 200; ++i) {
    left.command(left.torques(l));
    right.command(right.torques(r));
    l = next(left, l);
    r = next(right, r);
  }
  EXPECT_EQ(l.message_id, r.message_id);
  EXPECT_EQ(l.control_command_success_rate, 1);
  EXPECT_EQ(r.control_command_success_rate, 1);
  EXPECT_EQ(arms.statistics(0).commands_missed, 0u);
  EXPECT_EQ(arms.statistics(1).commands_missed, 0u);
}

// A program that ends one arm's motion before it answers the other one sees that end: nothing is
// missed meanwhile.
TEST(VirtualArms, theEndOfAMotionIsVisibleBeforeTheOtherArmIsAnswered) {
  VirtualArms arms(two_arms(), options(WorldPace::lockstep, true));
  arms.start();
  TestProgram left(arms.place(0)), right(arms.place(1));
  left.read();
  right.read();
  for (TestProgram* program : {&left, &right}) {
    EXPECT_EQ(program->reply(program->send(MoveRequest{})), Status::motion_started);
  }
  const auto moves = [](const RobotState& s) { return in_mode(s, RobotMode::move); };
  RobotState l = left.read_until(moves), r = right.read_until(moves);
  const auto both = std::max(l.message_id, r.message_id);
  while (l.message_id < both) l = left.read();
  while (r.message_id < both) r = right.read();
  for (int i = 0; i < 20; ++i) {
    left.command(left.torques(l));
    right.command(right.torques(r));
    l = left.read();
    r = right.read();
  }
  l = left.exchange(l, true);  // the right one still waits
  EXPECT_TRUE(in_mode(l, RobotMode::idle));
  EXPECT_EQ(l.message_id, r.message_id + 1);
  EXPECT_EQ(l.controller_mode, static_cast<std::uint8_t>(ControllerMode::other));
  const auto next = right.exchange(r);
  EXPECT_EQ(next.message_id, r.message_id + 1);
  EXPECT_EQ(arms.statistics(1).commands_missed, 0u);
}

TEST(VirtualArms, realTimeTakesCommandsOfTheLastState) {
  VirtualArms arms(two_arms(), options(WorldPace::realtime));
  arms.start();
  TestProgram program(arms.place(0), 5);
  RobotState state = program.start_torques();
  std::uint64_t used = 0;
  for (int i = 0; i < 300; ++i) {
    const RobotState next = program.exchange(state);
    ASSERT_GT(next.message_id, state.message_id);
    if (!in_mode(next, RobotMode::move)) break;  // the computer was so busy that 20 were missed
    state = next;
    ++used;
  }
  EXPECT_GT(used, 0u);
  const auto counts = arms.statistics(0);
  EXPECT_GE(counts.states_sent, used);
  EXPECT_GT(counts.commands_used, 0u);
  EXPECT_LE(counts.commands_used + counts.commands_late, counts.commands_received);
}

// 20 N pull the flange down: the arm resists and reports that it pulls the environment up.
TEST(VirtualArms, aPushIsFelt) {
  VirtualArms arms(two_arms(), options(WorldPace::lockstep));
  arms.start();
  TestProgram program(arms.place(0));
  RobotState state = program.read();
  EXPECT_EQ(control(arms, "push left 0 0 -20 1"), "ok");
  double force = 0;
  for (const auto until = state.message_id + 500; state.message_id < until; state = program.read()) {
    force = state.O_F_ext_hat_K[2];
  }
  EXPECT_NEAR(force, 20, 1);
}

TEST(VirtualArms, commandsAnswerInOneLine) {
  VirtualArms arms(two_arms(), options(WorldPace::lockstep));
  arms.start();
  TestProgram program(arms.place(0));
  program.read();
  EXPECT_EQ(control(arms, ""), "");
  EXPECT_EQ(control(arms, "  user-stop   left on "), "ok");
  program.read_until([](const auto& s) { return in_mode(s, RobotMode::user_stopped); });
  EXPECT_EQ(control(arms, "user-stop left off"), "ok");
  EXPECT_EQ(control(arms, "guide left on"), "ok");
  program.read_until([](const auto& s) { return in_mode(s, RobotMode::guiding); });
  EXPECT_EQ(control(arms, "guide left off"), "ok");
  EXPECT_EQ(control(arms, "reflex left cartesian_reflex"), "ok");
  program.read_until([](const auto& s) { return in_mode(s, RobotMode::reflex) && s.errors[7] == 1; });
  EXPECT_EQ(control(arms, "recover left"), "ok");
  program.read_until([](const auto& s) { return in_mode(s, RobotMode::idle); });
  EXPECT_EQ(control(arms, "loss left 0.25"), "ok");
  EXPECT_EQ(control(arms, "latency left 500"), "ok");
  EXPECT_EQ(arms.faults(0).loss, 0.25);
  EXPECT_NEAR(arms.faults(0).latency_s, 5e-4, 1e-12);
  EXPECT_EQ(arms.faults(1).loss, 0);

  EXPECT_EQ(control(arms, "loss left 2"), "loss, duplicate and reorder must be between 0 and 1");
  EXPECT_EQ(control(arms, "loss left much"), "expected a share, found 'much'");
  EXPECT_EQ(control(arms, "loss middle 0.1"), "there is no arm 'middle'; there are left, right");
  EXPECT_EQ(control(arms, "jump left"), "unknown command 'jump'; 'help' lists them");
  EXPECT_EQ(control(arms, "guide left"), "expected guide ARM on|off");
  EXPECT_EQ(control(arms, "reflex left tiredness"), "there is no error 'tiredness'; one is joint_reflex");
  EXPECT_EQ(control(arms, "help").find('\n'), std::string::npos);
}

TEST(VirtualArms, refusesInvalidOptions) {
  Scene scene = two_arms();
  VirtualArms first(scene, options(WorldPace::lockstep));
  first.start();
  VirtualArmOptions same = options(WorldPace::lockstep);
  same.places[0] = first.place(0);
  VirtualArms second(scene, same);
  try {
    second.start();
    FAIL() << "two on one port";
  } catch (const std::runtime_error& error) {
    const std::string what = error.what();
    EXPECT_NE(what.find(own_address(0) + ":" + std::to_string(first.place(0).port)), std::string::npos)
        << what;
    EXPECT_NE(what.find("arm 'left'"), std::string::npos) << what;
    EXPECT_NE(what.find("--bind"), std::string::npos) << what;
  }
  auto wrong = options(WorldPace::lockstep);
  wrong.faults.loss = 1.5;
  EXPECT_THROW(VirtualArms(scene, wrong), std::invalid_argument);
  wrong = options(WorldPace::lockstep);
  wrong.places.push_back(wrong.places[0]);
  EXPECT_THROW(VirtualArms(scene, wrong), std::invalid_argument);
  wrong = options(WorldPace::lockstep);
  wrong.places[0].address = "left";
  EXPECT_THROW(VirtualArms(scene, wrong).start(), std::exception);
}

// --- the bad network itself ---

std::vector<std::byte> datagram(std::size_t number) {
  return std::vector<std::byte>(8, static_cast<std::byte>(number));
}

TEST(FaultyLine, sharesAndSeed) {
  const DatagramFaults faults{.loss = 0.2, .duplicate = 0.1};
  std::vector<int> fates[2];
  for (auto& seen : fates) {
    FaultyLine line(7);
    line.set(faults);
    for (std::size_t i = 0; i < 5000; ++i) {
      line.put(datagram(i), HostTime{static_cast<std::int64_t>(i)});
      int arrived = 0;
      line.deliver(HostTime{static_cast<std::int64_t>(i)}, [&](auto) { ++arrived; });
      seen.push_back(arrived);
    }
  }
  EXPECT_EQ(fates[0], fates[1]);
  // Of 5000: 1000 lost (deviation 28), 400 of the others twice (deviation 19); 5 deviations.
  EXPECT_NEAR(static_cast<double>(std::count(fates[0].begin(), fates[0].end(), 0)), 1000, 140);
  EXPECT_NEAR(static_cast<double>(std::count(fates[0].begin(), fates[0].end(), 2)), 400, 95);
}

TEST(FaultyLine, delaysAndOvertakes) {
  FaultyLine line(1);
  line.set({.latency_s = 2e-6});
  line.put(datagram(1), HostTime{1000});
  int arrived = 0;
  line.deliver(HostTime{2999}, [&](auto) { ++arrived; });
  EXPECT_EQ(arrived, 0);
  EXPECT_EQ(line.next_due()->ns, 3000);
  line.deliver(HostTime{3000}, [&](auto) { ++arrived; });
  EXPECT_EQ(arrived, 1);
  EXPECT_FALSE(line.next_due());

  line.set({.reorder = 1});
  line.put(datagram(1), HostTime{0});
  line.set({});
  line.put(datagram(2), HostTime{1'000'000});  // the next period
  std::vector<std::byte> order;
  line.deliver(HostTime{2'000'000}, [&](auto bytes) { order.push_back(bytes[0]); });
  EXPECT_EQ(order, (std::vector{std::byte{2}, std::byte{1}}));
}

}  // namespace
}  // namespace multipanda::fci::virtual_arms_test
