// What the adapter publishes about arms and world: content compared with independent computations, rates, and
// the relay of records.
#include <atomic>
#include <cmath>
#include <latch>
#include <limits>
#include <map>
#include <numeric>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/testing/drawn_sample.hpp"
#include "logs/arm_state_fields.hpp"
#include "models/testing/two_engines.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/record_relay.hpp"
#include "ros/adapter/state/arm_models.hpp"
#include "ros/adapter/state/arm_topics.hpp"
#include "ros/adapter/state/loop_topics.hpp"
#include "ros/adapter/state/messages.hpp"
#include "ros/adapter/state/simulation_services.hpp"
#include "ros/adapter/state/testing/state_fixture.hpp"

namespace multipanda::ros::state_test {
namespace {

using test::Received;
using test::StateFixture;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

// Two arms on rotated bases, one with a hand and its own stiffness frame, one without.
const std::string kArms =
    "arms:\n"
    "  - name: left\n"
    "    base: {position_m: [0.1, 0.5, 0.2], rpy_rad: [0.4, -0.3, 1.1]}\n"
    "    stiffness_frame: {position_m: [0.02, 0.01, 0.05], rpy_rad: [0.3, 0.2, -0.5]}\n"
    "  - name: right\n"
    "    hand: false\n"
    "    base: {position_m: [-0.2, -0.7, 0.1], rpy_rad: [-0.6, 0.2, -2.0]}\n";

RecordLayout small_layout() {
  RecordLayout layout;
  layout.arms.push_back({"arm", 7});
  return layout;
}

CycleRecord numbered(std::uint64_t cycle) {
  CycleRecord record(1, 0, 0);
  record.cycle = cycle;
  return record;
}

struct Listener : AdapterPart {
  std::function<void(std::uint64_t)> on_record;
  std::vector<std::uint64_t> cycles;
  std::size_t events = 0;
  std::atomic<std::size_t> count{0};
  void take(const CycleRecord& record) override {
    cycles.push_back(record.cycle);
    if (on_record) on_record(record.cycle);
    ++count;
  }
  void take(const Event&) override { ++events; }
};

TEST(RecordRelay, KeepsOrderAndCountsDroppedRecords) {
  AdapterParts parts;
  parts.push_back(std::make_unique<Listener>());
  parts.push_back(std::make_unique<Listener>());
  auto &first = static_cast<Listener&>(*parts[0]), &second = static_cast<Listener&>(*parts[1]);
  std::latch reached(1), go_on(1);
  first.on_record = [&](std::uint64_t cycle) {
    if (cycle != 1) return;
    reached.count_down();
    go_on.wait();
  };
  {
    RecordRelay relay(small_layout(), parts);
    relay.take(numbered(1));
    reached.wait();  // the publisher's thread blocks in the first record, which keeps its place in the ring
    constexpr std::size_t kTooMany = 40;
    for (std::uint64_t cycle = 2; cycle <= RecordRelay::kRecords + kTooMany; ++cycle)
      relay.take(numbered(cycle));
    EXPECT_EQ(relay.dropped(), kTooMany);
    relay.take(Event{});
    go_on.count_down();
    ASSERT_TRUE(test::wait_for([&] { return relay.handed_on() == RecordRelay::kRecords; }));
    relay.take(numbered(1000));
    // The destructor delivers what is left.
  }
  ASSERT_EQ(first.cycles.size(), RecordRelay::kRecords + 1);
  for (std::size_t i = 0; i < RecordRelay::kRecords; ++i) EXPECT_EQ(first.cycles[i], i + 1);
  EXPECT_EQ(first.cycles.back(), 1000u);
  EXPECT_EQ(second.cycles, first.cycles);
  EXPECT_EQ(first.events, 1u);
}

TEST(RecordRelay, APartThatThrowsDoesNotAffectOthers) {
  AdapterParts parts;
  parts.push_back(std::make_unique<Listener>());
  parts.push_back(std::make_unique<Listener>());
  auto &bad = static_cast<Listener&>(*parts[0]), &good = static_cast<Listener&>(*parts[1]);
  bad.on_record = [](std::uint64_t) { throw std::runtime_error("no room left"); };
  std::vector<std::string> failures;
  {
    RecordRelay relay(small_layout(), parts, [&](const std::string& text) { failures.push_back(text); });
    for (std::uint64_t cycle = 1; cycle <= 20; ++cycle) relay.take(numbered(cycle));
  }
  EXPECT_EQ(good.cycles.size(), 20u);
  EXPECT_THAT(failures, ElementsAre("no room left"));  // once
}

TEST(LoopWindow, FiguresOfSyntheticRecords) {
  std::mt19937_64 random(7);
  LoopWindow window;
  std::int64_t start = 5'000'000'000;
  std::vector<double> periods, works;
  CycleRecord record(0, 0, 0);
  const auto add = [&](std::uint64_t cycle, bool next) {
    const std::int64_t period = std::uniform_int_distribution<std::int64_t>(900'000, 1'300'000)(random);
    start += next ? period : 10 * period;
    if (next) periods.push_back(1e-9 * static_cast<double>(period));
    record.cycle = cycle;
    record.start.ns = start;
    record.stages.total = std::uniform_int_distribution<std::int32_t>(5'000, 90'000)(random);
    works.push_back(1e-9 * record.stages.total);
    record.overruns = cycle / 100;
    window.add(record);
  };
  const auto expect = [](const LoopWindow::Durations& found, std::vector<double> values) {
    std::sort(values.begin(), values.end());
    // The smallest value that is not exceeded by at least this fraction of all values.
    const auto share = [&](double of) {
      return *std::find_if(values.begin(), values.end(), [&](double v) {
        const auto below = std::upper_bound(values.begin(), values.end(), v) - values.begin();
        return static_cast<double>(below) >= of * static_cast<double>(values.size());
      });
    };
    EXPECT_DOUBLE_EQ(found.median, share(0.5));
    EXPECT_DOUBLE_EQ(found.p99, share(0.99));
    EXPECT_DOUBLE_EQ(found.worst, values.back());
  };

  add(1, false);
  for (std::uint64_t cycle = 2; cycle <= 500; ++cycle) add(cycle, true);
  const std::int64_t begin = start;
  LoopWindow::Figures figures = window.finish();
  EXPECT_EQ(figures.cycle, 500u);
  EXPECT_EQ(figures.cycles, 500u);
  EXPECT_EQ(figures.overruns, 5u);
  EXPECT_NEAR(figures.rate_hz, 499 / std::accumulate(periods.begin(), periods.end(), 0.0), 1e-6);
  expect(figures.period, periods);
  expect(figures.cycle_time, works);

  // The next window begins with the last cycle. Records 701 to 730 are missing, so no period spans them.
  periods.clear();
  works.clear();
  for (std::uint64_t cycle = 501; cycle <= 700; ++cycle) add(cycle, true);
  add(731, false);
  for (std::uint64_t cycle = 732; cycle <= 1000; ++cycle) add(cycle, true);
  figures = window.finish();
  EXPECT_EQ(figures.cycles, 500u);
  EXPECT_EQ(figures.overruns, 10u);
  EXPECT_EQ(figures.overruns_window, 5u);
  EXPECT_NEAR(figures.window_s, 1e-9 * static_cast<double>(start - begin), 1e-12);
  EXPECT_NEAR(figures.rate_hz, 500 / figures.window_s, 1e-6);
  expect(figures.period, periods);
  expect(figures.cycle_time, works);
}

TEST(LoopWindow, HasNoFiguresWithoutRecords) {
  LoopWindow window;
  const LoopWindow::Figures figures = window.finish();
  EXPECT_EQ(figures.cycles, 0u);
  EXPECT_EQ(figures.rate_hz, 0);
  EXPECT_TRUE(std::isnan(figures.period.median) && std::isnan(figures.cycle_time.worst));
}

JointArray random_joints(std::mt19937_64& random, double most) {
  JointArray joints{};
  for (double& value : joints) value = std::uniform_real_distribution<double>(-most, most)(random);
  return joints;
}

struct Arms : testing::Test {
  explicit Arms(const std::string& text = kArms) : scene(parse_scene(text, "test.yaml", registry)) {
    for (const auto& arm : scene.arms) run.models.push_back(build_arm_model(arm));
    run.scene = &scene;
    view.emplace(run);
  }
  void fill_first(const CycleRecord& record, multipanda_msgs::msg::RobotState& state) {
    const ArmModels::Arm& arm = view->arms()[0];
    fill_state(record.arms[0], arm.frames, arm.tool, arm.load, view->terms(0), state);
  }
  CycleRecord random_record(std::mt19937_64& random) {
    CycleRecord record(scene.arms.size(), 0, 0);
    for (auto& arm : record.arms) {
      arm.q = random_joints(random, 1.5);
      arm.dq = random_joints(random, 1);
      arm.tau_J = random_joints(random, 40);
      arm.has_gripper = true;
      arm.gripper_width = std::uniform_real_distribution<double>(0, 0.08)(random);
    }
    return record;
  }
  Registry registry = Registry::with_builtins();
  Scene scene;
  RunContext run;
  std::optional<ArmModels> view;
};

TEST_F(Arms, JointStatesNameAllJointsAndFingers) {
  std::mt19937_64 random(1);
  sensor_msgs::msg::JointState message;
  fill_names(view->arms(), message);
  EXPECT_THAT(message.name, ElementsAre("left_joint1", "left_joint2", "left_joint3", "left_joint4",
                                        "left_joint5", "left_joint6", "left_joint7", "left_finger_joint1",
                                        "left_finger_joint2", "right_joint1", "right_joint2", "right_joint3",
                                        "right_joint4", "right_joint5", "right_joint6", "right_joint7"));
  const CycleRecord record = random_record(random);
  fill(view->arms(), record, message);
  EXPECT_EQ(message.position[3], record.arms[0].q[3]);
  EXPECT_EQ(message.position[7], record.arms[0].gripper_width / 2);
  EXPECT_EQ(message.position[8], record.arms[0].gripper_width / 2);
  EXPECT_EQ(message.position[9 + 6], record.arms[1].q[6]);
  EXPECT_EQ(message.velocity[9 + 2], record.arms[1].dq[2]);
  EXPECT_EQ(message.effort[1], record.arms[0].tau_J[1]);
  ASSERT_EQ(message.position.size(), message.name.size());
}

// All frames of tf, chained from `world`, agree with Pinocchio's, computed from robot_description
// and joint_states.
TEST_F(Arms, TransformsAgreeWithTheRobotDescription) {
  std::mt19937_64 random(2);
  for (int trial = 0; trial < 3; ++trial) {
    const CycleRecord record = random_record(random);
    view->take(record);
    sensor_msgs::msg::JointState joints;
    fill_names(view->arms(), joints);
    fill(view->arms(), record, joints);

    std::map<std::string, Pose> placed{{"world", Pose()}};
    for (std::size_t i = 0; i < view->arms().size(); ++i) {
      std::vector<Placed> frames = fixed_frames(view->arms()[i], scene.arms[i].X_WB), moving;
      moving_frames(view->arms()[i], record.arms[i], view->terms(i), moving);
      frames.insert(frames.end(), moving.begin(), moving.end());
      for (std::size_t left = frames.size(); left > 0; --left) {  // parents come in any order
        for (const auto& frame : frames) {
          if (placed.count(frame.parent) > 0) placed.emplace(frame.child, placed[frame.parent] * frame.X);
        }
      }
    }

    std::map<std::string, double> positions;
    for (std::size_t i = 0; i < joints.name.size(); ++i) positions[joints.name[i]] = joints.position[i];
    multipanda::test::PinocchioArm robot(scene_urdf(scene), "world", {"left_joint1"}, positions);
    ASSERT_EQ(robot.joints(), 1);
    std::vector<std::string> names;
    for (const std::string arm : {"left_", "right_"}) {
      for (int link = 0; link <= 8; ++link) names.push_back(arm + "link" + std::to_string(link));
    }
    for (const char* name : {"left_hand", "left_hand_tcp", "left_leftfinger", "left_rightfinger"})
      names.push_back(name);
    const Eigen::VectorXd q = Eigen::VectorXd::Constant(1, positions["left_joint1"]);
    const auto terms = robot.terms(q, Eigen::VectorXd::Zero(1), names);
    for (std::size_t i = 0; i < names.size(); ++i) {
      ASSERT_EQ(placed.count(names[i]), 1u) << names[i];
      const Pose& X = placed[names[i]];
      EXPECT_LT((X.position - terms.poses[i].position).norm(), 1e-12) << names[i];
      EXPECT_LT((X.rotation - terms.poses[i].rotation).norm(), 1e-12) << names[i];
    }
    // The configured frames agree with the model.
    EXPECT_LT((placed["left_ee"].position - view->terms(0).X_WE().position).norm(), 1e-12);
    EXPECT_LT((placed["left_k"].position - view->terms(0).X_WK().position).norm(), 1e-12);
    EXPECT_LT((placed["left_k"].rotation - view->terms(0).X_WK().rotation).norm(), 1e-12);
    EXPECT_GT((placed["left_k"].position - placed["left_ee"].position).norm(), 0.03);
    EXPECT_EQ(placed.size(), 1 + names.size() + 4);  // and there are no others
  }
}

// On a rotated base M stays the same; Jacobian and poses rotate with the base.
TEST_F(Arms, ModelOnARotatedBaseIsTheModelRotated) {
  std::mt19937_64 random(3);
  const CycleRecord record = random_record(random);
  view->take(record);
  multipanda_msgs::msg::RobotModel model;
  fill_model(view->terms(0), model);

  SceneArm upright = scene.arms[0];
  const Pose X_WB = upright.X_WB;
  upright.X_WB = Pose();
  ModelTerms terms(build_arm_model(upright));
  const ArmConfig config = arm_config(upright);
  terms.set_config(config.frames, config.tool, config.load);
  terms.update(JointVector(Eigen::Map<const Eigen::VectorXd>(record.arms[0].q.data(), 7)),
               JointVector(Eigen::Map<const Eigen::VectorXd>(record.arms[0].dq.data(), 7)));
  ASSERT_EQ(model.mass.size(), 49u);
  ASSERT_EQ(model.jacobian.size(), 42u);
  for (std::size_t row = 0; row < 7; ++row) {
    const auto r = static_cast<Eigen::Index>(row);
    EXPECT_NEAR(model.coriolis[row], terms.c()[r], 1e-10);
    for (std::size_t column = 0; column < 7; ++column) {
      const auto c = static_cast<Eigen::Index>(column);
      EXPECT_NEAR(model.mass[7 * row + column], terms.M()(r, c), 1e-12);
    }
  }
  for (std::size_t column = 0; column < 7; ++column) {
    const auto c = static_cast<Eigen::Index>(column);
    const Vector3 linear = X_WB.rotation * terms.J_V_WE().col(c).head<3>(),
                  angular = X_WB.rotation * terms.J_V_WE().col(c).tail<3>();
    for (std::size_t row = 0; row < 3; ++row) {
      EXPECT_NEAR(model.jacobian[7 * row + column], linear[static_cast<Eigen::Index>(row)], 1e-12);
      EXPECT_NEAR(model.jacobian[7 * (row + 3) + column], angular[static_cast<Eigen::Index>(row)], 1e-12);
    }
  }
  const auto expect_pose = [](const geometry_msgs::msg::Pose& found, const Pose& X) {
    const Pose Y =
        Pose::from({found.position.x, found.position.y, found.position.z},
                   {found.orientation.w, found.orientation.x, found.orientation.y, found.orientation.z});
    EXPECT_LT((Y.position - X.position).norm() + (Y.rotation - X.rotation).norm(), 1e-12);
  };
  expect_pose(model.flange, X_WB * terms.X_WF());
  expect_pose(model.pose, X_WB * terms.X_WE());
  expect_pose(model.stiffness, X_WB * terms.X_WK());
  EXPECT_NEAR(model.manipulability, terms.manipulability(), 1e-12);

  // The state has its twist in world axes, and one value per joint.
  multipanda_msgs::msg::RobotState state;
  fill_first(record, state);
  const Vector3 v = X_WB.rotation * terms.V_WE().linear();
  EXPECT_LT((Vector3(state.twist.linear.x, state.twist.linear.y, state.twist.linear.z) - v).norm(), 1e-12);
  EXPECT_EQ(state.q.size(), 7u);
  EXPECT_TRUE(state.tau_ext.empty());  // the arm does not report it
  expect_pose(state.stiffness, scene.arms[0].X_EK);
}

TEST_F(Arms, SettingsFollowTheArmsReport) {
  CycleRecord record(2, 0, 0);
  record.arms[0].errors = (1ull << 6) | (1ull << 25);
  view->take(record);
  multipanda_msgs::msg::RobotState state;
  fill_first(record, state);
  EXPECT_THAT(state.error_names, ElementsAre("joint_reflex", "communication_constraints_violation"));
  const JointVector gravity_before = view->terms(0).g();

  Event event{.kind = EventKind::arm_config, .arm = 0};
  const std::vector<double> values{0,   0,    0.2, 1,   0, 0,   0,                // X_FE
                                   0,   0.1,  0,   0,   1, 0,   0,                // X_EK: half a turn about x
                                   0.5, 0,    0,   0.1, 1, 0,   0,   2, 0,   3,   // tool
                                   1.5, 0.02, 0,   0.1, 4, 0.1, 0.2, 5, 0.3, 6};  // payload
  std::copy(values.begin(), values.end(), event.values.begin());
  event.size = static_cast<std::uint8_t>(values.size());
  view->take(event);
  fill_first(record, state);
  EXPECT_EQ(state.end_effector.position.z, 0.2);
  EXPECT_NEAR(std::abs(state.stiffness.orientation.x), 1, 1e-12);
  EXPECT_EQ(state.load.mass, 1.5);
  EXPECT_EQ(state.load.center.x, 0.02);
  EXPECT_THAT(state.load.inertia, ElementsAre(4, 0.1, 0.2, 5, 0.3, 6));
  EXPECT_THAT(state.tool.inertia, ElementsAre(1, 0, 0, 2, 0, 3));
  EXPECT_GT((view->terms(0).g() - gravity_before).norm(), 0.5);  // and the model carries the load

  record.arms[0].errors = 0;
  fill_first(record, state);
  EXPECT_TRUE(state.error_names.empty());
}

// Every field of the message that the table of core/state/arm_sample.hpp names; the poses in the base are
// not: the message has them in the world.
TEST_F(Arms, StateHoldsEveryQuantityOfTheArm) {
  std::mt19937_64 random(8);
  CycleRecord record(2, 0, 0);
  for (const bool reports : {true, true, false}) {
    const multipanda::test::DrawnSample drawn = multipanda::test::draw_sample(random, 7, reports);
    record.arms[0] = drawn.sample;
    view->take(record);
    multipanda_msgs::msg::RobotState state;
    fill_first(record, state);
    set_commanded(state, record.arms[0], 7);
    std::map<std::string, std::vector<double>> found;
    for_each_number(state, [&](const char* name, const auto& numbers) { found[name] = numbers; });
    for (const auto& [name, expected] : drawn.numbers) {
      if (drawn.in_message.at(name) == "no_message" || name.starts_with("X_BE_")) continue;
      if (!reports && drawn.known.at(name) != "always") {  // empty, or zeros where the place is fixed
        if (name != "last_motion_errors" && !name.starts_with("gripper_")) {
          EXPECT_THAT(found[name], testing::Each(0)) << name;
        }
        continue;
      }
      ASSERT_EQ(found[name].size(), expected.size()) << name;
      for (std::size_t k = 0; k < expected.size(); ++k) EXPECT_EQ(found[name][k], expected[k]) << name;
    }
  }
}

// The report's bits become flags of joints and axes; its poses, given in the base, are in the world.
TEST_F(Arms, ReportHasFlagsAndPosesInTheWorld) {
  std::mt19937_64 random(4);
  CycleRecord record = random_record(random);
  ArmSample& sample = record.arms[0];
  view->take(record);
  multipanda_msgs::msg::RobotState state;
  fill_first(record, state);
  EXPECT_FALSE(state.has_report);
  EXPECT_TRUE(state.q_d.empty() && state.theta.empty() && state.joint_contact.empty());

  // Half a turn about x, then a quarter about z, written by hand: columns of the rotation.
  const std::array<double, 12> X_BE{0.3, -0.2, 0.5, 0, 1, 0, 1, 0, 0, 0, 0, -1};
  sample.has_report = true;
  sample.q_d = random_joints(random, 2);
  sample.dq_d = random_joints(random, 1);
  sample.theta = random_joints(random, 2);
  sample.X_BE_d = X_BE;
  sample.X_BE_c = X_BE;
  sample.X_BE_c[2] = 0.7;
  sample.elbow = {0.25, -1};
  sample.joint_contact = 0b1010010;
  sample.joint_collision = 0b0000010;
  sample.cartesian_contact = 0b100001;
  sample.cartesian_collision = 0b000100;
  sample.last_motion_errors = 1ull << 7;
  fill_first(record, state);
  EXPECT_TRUE(state.has_report);
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_EQ(state.q_d.at(i), sample.q_d[i]);
    EXPECT_EQ(state.dq_d.at(i), sample.dq_d[i]);
    EXPECT_EQ(state.theta.at(i), sample.theta[i]);
  }
  EXPECT_THAT(state.elbow, ElementsAre(0.25, -1));
  EXPECT_THAT(state.joint_contact, ElementsAre(false, true, false, false, true, false, true));
  EXPECT_THAT(state.joint_collision, ElementsAre(false, true, false, false, false, false, false));
  EXPECT_THAT(state.cartesian_contact, ElementsAre(true, false, false, false, false, true));
  EXPECT_THAT(state.cartesian_collision, ElementsAre(false, false, true, false, false, false));
  EXPECT_THAT(state.last_motion_error_names, ElementsAre("cartesian_reflex"));

  const Pose& X_WB = scene.arms[0].X_WB;
  const auto expect_pose = [&](const geometry_msgs::msg::Pose& found, double z) {
    const Vector3 p = X_WB.position + X_WB.rotation * Vector3(0.3, -0.2, z);
    EXPECT_LT((Vector3(found.position.x, found.position.y, found.position.z) - p).norm(), 1e-12);
    const Quaternion q(found.orientation.w, found.orientation.x, found.orientation.y, found.orientation.z);
    EXPECT_LT((q * Vector3::UnitX() - X_WB.rotation * Vector3::UnitY()).norm(), 1e-12);
    EXPECT_LT((q * Vector3::UnitZ() + X_WB.rotation * Vector3::UnitZ()).norm(), 1e-12);
  };
  expect_pose(state.pose_desired, 0.5);
  expect_pose(state.pose_commanded, 0.7);

  sample.last_motion_errors = 0;
  fill_first(record, state);
  EXPECT_TRUE(state.last_motion_error_names.empty());
}

// A value in the middle of the widest gap between the sizes of these numbers.
double in_widest_gap(const Eigen::VectorXd& numbers, double& gap) {
  std::vector<double> sizes;
  for (const double number : numbers) sizes.push_back(std::abs(number));
  std::sort(sizes.begin(), sizes.end());
  gap = 0;
  double middle = 0;
  for (std::size_t i = 1; i < sizes.size(); ++i) {
    if (sizes[i] - sizes[i - 1] <= gap) continue;
    gap = sizes[i] - sizes[i - 1];
    middle = (sizes[i] + sizes[i - 1]) / 2;
  }
  return middle;
}

// An arm on a rotated base holds an undeclared payload. Which joints and axes report contact, and later a
// collision, follows from the payload's weight by finite differences of its height.
TEST(State, FlagsOfContactAndCollisionFollowFromAWeight) {
  StateFixture fixture(
      "arms:\n"
      "  - name: left\n"
      "    base: {position_m: [0, 0, 1], rpy_rad: [0.5, -0.4, 1.0]}\n"
      "    stiffness_frame: {position_m: [0.05, 0.02, 0.03], rpy_rad: [0.3, 0.2, -0.5]}\n"
      "    load_present: {mass_kg: 1.2, com_m: [0.03, -0.02, 0.15], inertia_kg_m2: {xx: 0.001, yy: 0.001, "
      "zz: 0.001}}\n");
  const ArmConfig config = arm_config(fixture.scene().arms[0]);
  ModelTerms terms(fixture.run_context().models[0]);
  terms.set_config(config.frames, config.tool, config.load);
  const JointVector zero = JointVector::Zero(7);
  ArmSample sample;
  const auto run = [&](std::size_t cycles) {
    fixture.run(cycles, {}, [&](const CycleRecord& record) { sample = record.arms[0]; });
    terms.update(JointVector(Eigen::Map<const Eigen::VectorXd>(sample.q.data(), 7)), zero);
    multipanda_msgs::msg::RobotState state;
    fill_state(sample, config.frames, config.tool, config.load, terms, state);
    return state;
  };
  multipanda_msgs::msg::RobotState state = run(4000);  // comes to rest
  EXPECT_THAT(state.joint_contact, testing::Each(false));

  constexpr double kWeight = 9.81 * 1.2;  // [N]
  const JointVector q = Eigen::Map<const Eigen::VectorXd>(sample.q.data(), 7);
  Eigen::VectorXd expected(7);
  for (int i = 0; i < 7; ++i) {
    const auto height = [&](double step) {
      JointVector moved = q;
      moved[i] += step;
      terms.update(moved, zero);
      return (terms.X_WF() * Vector3(0.03, -0.02, 0.15)).z();
    };
    expected[i] = kWeight * (height(1e-6) - height(-1e-6)) / 2e-6;
  }
  terms.update(q, zero);
  const Eigen::VectorXd force = terms.X_WK().rotation.transpose() * Vector3(0, 0, kWeight);
  double gap = 0, force_gap = 0;
  const double torque_limit = in_widest_gap(expected, gap), force_limit = in_widest_gap(force, force_gap);
  ASSERT_GT(gap, 0.5);
  ASSERT_GT(force_gap, 0.8);

  ContactThresholds thresholds;
  thresholds.torque_lower = JointVector::Constant(7, torque_limit);
  thresholds.torque_upper = JointVector::Constant(7, 80);
  thresholds.wrench_lower << force_limit, force_limit, force_limit, 100, 100, 100;
  thresholds.wrench_upper = Vector6::Constant(100);
  (void)fixture.backend().request(
      ArmIndex{0}, ArmRequest(SetCollisionThresholds{.nominal = thresholds, .acceleration = {}}));
  state = run(300);
  EXPECT_EQ(state.mode, multipanda_msgs::msg::RobotState::MODE_MOVE);
  ASSERT_EQ(state.joint_contact.size(), 7u);
  for (std::size_t i = 0; i < 7; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    EXPECT_EQ(state.joint_contact[i], std::abs(expected[k]) > torque_limit) << "joint " << i + 1;
  }
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(state.cartesian_contact[i],
              i < 3 && std::abs(force[static_cast<Eigen::Index>(i)]) > force_limit)
        << "axis " << i;
  }
  EXPECT_THAT(state.joint_collision, testing::Each(false));
  EXPECT_EQ(state.last_motion_errors, 0u);
  // The desired pose is that of the desired joints.
  terms.update(JointVector(Eigen::Map<const Eigen::VectorXd>(state.q_d.data(), 7)), zero);
  const auto& p = state.pose_desired.position;
  EXPECT_LT((Vector3(p.x, p.y, p.z) - terms.X_WE().position).norm(), 1e-3);
  EXPECT_NEAR(state.elbow[0], state.q_d[2], 1e-2);

  thresholds.torque_upper = thresholds.torque_lower;
  (void)fixture.backend().request(
      ArmIndex{0}, ArmRequest(SetCollisionThresholds{.nominal = thresholds, .acceleration = {}}));
  state = run(300);
  EXPECT_EQ(state.mode, multipanda_msgs::msg::RobotState::MODE_REFLEX);
  for (std::size_t i = 0; i < 7; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    EXPECT_EQ(state.joint_collision[i], std::abs(expected[k]) > torque_limit) << "joint " << i + 1;
  }
  EXPECT_THAT(state.cartesian_collision, testing::Each(false));
  EXPECT_THAT(state.last_motion_error_names, ElementsAre("joint_reflex"));
}

std::string with_rates(const std::string& rates) { return kArms + "ros: {rates_hz: {" + rates + "}}\n"; }

TEST(State, EveryNthCycleIsPublishedAndStamped) {
  StateFixture fixture(
      with_rates("joint_states: 250, tf: 100, clock: 1000, robot_state: 0, object_poses: 0"));
  const AdapterParts parts = make_state(fixture.run_context());
  Node listener(fixture.context(), "listener");
  Received<sensor_msgs::msg::JointState> joints(fixture, listener, "/joint_states");
  Received<tf2_msgs::msg::TFMessage> tf(fixture, listener, "/tf"),
      fixed(fixture, listener, "/tf_static", Qos::latched());
  Received<rosgraph_msgs::msg::Clock> clock(fixture, listener, "/clock");
  Received<std_msgs::msg::String> urdf(fixture, listener, "/robot_description", Qos::latched());
  fixture.executor().start();
  // A publisher has a subscriber only after discovery; messages are counted from the first one received.
  LoopTime newest;
  const auto run = [&](std::size_t cycles) {
    fixture.run(cycles, parts, [&](const CycleRecord& record) { newest = record.t; });
  };
  ASSERT_TRUE(test::wait_for([&] {
    run(20);
    return joints.count() > 0 && tf.count() > 0 && clock.count() > 0;
  }));
  ASSERT_TRUE(test::wait_for([&] { return fixed.count() > 0 && urdf.count() > 0; }));
  // From here on so slowly that no message is replaced by a newer one.
  const auto ns = [](const auto& stamp) { return stamp.sec * 1'000'000'000ll + stamp.nanosec; };
  const std::int64_t begin = newest.ns;
  const auto since = [&] {
    const std::lock_guard lock(joints.mutex);
    return static_cast<std::size_t>(
        std::count_if(joints.messages.begin(), joints.messages.end(),
                      [&](const auto& message) { return ns(message.header.stamp) > begin; }));
  };
  for (std::size_t turn = 1; turn <= 50; ++turn) {
    run(8);
    ASSERT_TRUE(test::wait_for([&] { return since() >= 2 * turn; })) << turn;
  }
  EXPECT_TRUE(test::wait_for([&] {
    const std::lock_guard lock(clock.mutex);
    return ns(clock.messages.back().clock) == newest.ns;
  }));
  fixture.executor().stop();
  EXPECT_EQ(since(), 100u);
  const std::size_t count = tf.messages.size();
  ASSERT_GT(count, 30u);
  EXPECT_EQ(ns(tf.messages[count - 1].transforms[0].header.stamp) -
                ns(tf.messages[count - 11].transforms[0].header.stamp),
            100'000'000);
  for (std::size_t i = joints.messages.size() - 99; i < joints.messages.size(); ++i) {
    EXPECT_EQ(ns(joints.messages[i].header.stamp) - ns(joints.messages[i - 1].header.stamp), 4'000'000);
  }
  EXPECT_EQ(tf.messages.back().transforms.size(), 7u + 2 + 2 + 7 + 2);
  ASSERT_EQ(fixed.messages.size(), 1u);
  EXPECT_EQ(fixed.messages[0].transforms.size(), 4u + 2);
  ASSERT_EQ(urdf.messages.size(), 1u);
  EXPECT_EQ(urdf.messages[0].data, scene_urdf(fixture.scene()));
  for (const auto& entity : fixture.node().entities())
    EXPECT_THAT(entity.name, Not(HasSubstr("robot_state")));
}

// An arm on a rotated base holds an undeclared payload. Its wrench topic must report the weight straight up
// in the world, and the weight's moment about K.
TEST(State, WrenchOfAWeightIsVerticalInTheWorld) {
  const double mass = 1.2;
  StateFixture fixture(
      "arms:\n"
      "  - name: left\n"
      "    base: {position_m: [0, 0, 1], rpy_rad: [0.5, -0.4, 1.0]}\n"
      "    stiffness_frame: {position_m: [0.05, 0.02, 0.03], rpy_rad: [0.3, 0.2, -0.5]}\n"
      "    load_present: {mass_kg: 1.2, com_m: [0.03, -0.02, 0.15], inertia_kg_m2: {xx: 0.001, yy: 0.001, "
      "zz: 0.001}}\n"
      "ros: {rates_hz: {wrench: 1000}}\n");
  const AdapterParts parts = make_state(fixture.run_context());
  Node listener(fixture.context(), "listener");
  Received<geometry_msgs::msg::WrenchStamped> received(fixture, listener, "/left/wrench");
  fixture.executor().start();
  ArmSample sample;
  fixture.run(4000, {}, [&](const CycleRecord& record) { sample = record.arms[0]; });  // comes to rest
  ASSERT_TRUE(test::wait_for([&] {
    fixture.run(20, parts, [&](const CycleRecord& record) { sample = record.arms[0]; });
    return received.count() > 0;
  }));
  fixture.executor().stop();

  ModelTerms terms(fixture.run_context().models[0]);
  const ArmConfig config = arm_config(fixture.scene().arms[0]);
  terms.set_config(config.frames, config.tool, config.load);
  terms.update(JointVector(Eigen::Map<const Eigen::VectorXd>(sample.q.data(), 7)),
               JointVector(Eigen::Map<const Eigen::VectorXd>(sample.dq.data(), 7)));
  const Vector3 weight(0, 0, -9.81 * mass), p_WC = terms.X_WF() * Vector3(0.03, -0.02, 0.15);
  // of the wrench that the arm exerts, about K
  const Vector3 moment = (p_WC - terms.X_WK().position).cross(-weight);
  const auto& wrench = received.messages.back().wrench;
  EXPECT_EQ(received.messages.back().header.frame_id, "world");
  EXPECT_LT((Vector3(wrench.force.x, wrench.force.y, wrench.force.z) + weight).norm(), 0.02 * weight.norm());
  EXPECT_LT((Vector3(wrench.torque.x, wrench.torque.y, wrench.torque.z) - moment).norm(), 0.1);
  EXPECT_GT(moment.norm(), 0.2);  // so that a moment about another point would be noticed
}

const std::string kBall =
    "objects:\n"
    "  - {name: floor, shape: plane}\n"
    "  - {name: ball, shape: sphere, diameter_m: 0.1, position_m: [0.5, 0, 1], fixed: false, mass_kg: 1}\n";

TEST(State, ObjectsFallInTheirTopicAsInPhysics) {
  StateFixture fixture("arms:\n  - name: left\n" + kBall + "ros: {rates_hz: {object_poses: 1000}}\n");
  const AdapterParts parts = make_state(fixture.run_context());
  Node listener(fixture.context(), "listener");
  Received<multipanda_msgs::msg::ObjectPoses> received(fixture, listener, "/simulation/object_poses");
  fixture.executor().start();
  ASSERT_TRUE(test::wait_for([&] {
    fixture.run(5, parts);
    return received.count() > 0;
  }));
  (void)fixture.backend().request(ResetSimulation{});
  const std::size_t before = received.count();
  for (std::size_t cycles = 5; cycles <= 150; cycles += 5) {
    fixture.run(5, parts);
    ASSERT_TRUE(test::wait_for([&] { return received.count() + 5 >= before + cycles; }));
  }
  fixture.executor().stop();
  const auto& last = received.messages.back();
  EXPECT_THAT(last.names, ElementsAre("ball"));
  const double height = last.poses[0].position.z;
  // The number of messages since the reset gives the duration of the fall.
  std::size_t begin = received.messages.size() - 1;
  while (begin > 0 &&
         received.messages[begin - 1].poses[0].position.z >= received.messages[begin].poses[0].position.z)
    --begin;
  const auto time = [](const auto& stamp) { return stamp.sec + 1e-9 * stamp.nanosec; };
  const double fallen = time(last.header.stamp) - time(received.messages[begin].header.stamp);
  EXPECT_GT(fallen, 0.05);
  EXPECT_NEAR(height, 1 - 0.5 * 9.81 * fallen * fallen, 0.02);
}

TEST(State, DiagnosticsReportProblems) {
  StateFixture fixture(kArms);
  LoopTopics loop(fixture.run_context());
  const auto line = [&](const std::string& name) {
    for (const auto& each : loop.diagnostics()) {
      if (each.name == name) return each;
    }
    return Diagnostic{.name = "missing"};
  };
  EXPECT_EQ(line("loop").level, Diagnostic::Level::warn);
  EXPECT_EQ(line("loop").message, "has not started");
  CycleRecord record(2, 0, 0);
  record.cycle = 1;
  record.start = host_now();
  for (auto& arm : record.arms) arm.mode = static_cast<std::uint8_t>(ArmMode::move);
  loop.take(record);
  EXPECT_EQ(line("loop").level, Diagnostic::Level::ok);
  EXPECT_EQ(line("left").level, Diagnostic::Level::ok);
  record.cycle = 2;
  record.arms[1].mode = static_cast<std::uint8_t>(ArmMode::reflex);
  record.arms[1].errors = 1ull << 6;
  loop.take(record);
  EXPECT_EQ(line("left").level, Diagnostic::Level::ok);
  EXPECT_EQ(line("right").level, Diagnostic::Level::error);
  EXPECT_THAT(line("right").message, HasSubstr("joint_reflex"));
  record.cycle = 3;
  record.start = host_now() + std::chrono::seconds(-2);
  loop.take(record);
  EXPECT_EQ(line("loop").level, Diagnostic::Level::error);
  EXPECT_THAT(line("loop").message, HasSubstr("no cycle for"));
  EXPECT_EQ(line("ros").level, Diagnostic::Level::ok);
  fixture.run_context().counters->records_dropped = 3;
  EXPECT_EQ(line("ros").level, Diagnostic::Level::warn);
}

TEST(State, EventsAreNamed) {
  StateFixture fixture(kArms +
                       "controllets:\n"
                       "  - {name: still, type: joint_impedance, arms: left}\n"
                       "timeline:\n"
                       "  - {at_s: 0.02, switch: {activate: [still]}}\n"
                       "  - {at_s: 0.03, stop: [left]}\n");
  const AdapterParts parts = make_state(fixture.run_context());
  Node listener(fixture.context(), "listener");
  fixture.run(60, parts);
  // Late subscribers receive them as well.
  Received<multipanda_msgs::msg::Switch> switches(fixture, listener, "/multipanda/switch_events",
                                                  Qos::latched(50));
  Received<multipanda_msgs::msg::Event> events(fixture, listener, "/multipanda/events", Qos::latched(50));
  fixture.executor().start();
  const auto stopped = [&] {
    const std::lock_guard lock(events.mutex);
    return std::any_of(events.messages.begin(), events.messages.end(),
                       [](const auto& event) { return event.kind == "stopped"; });
  };
  EXPECT_TRUE(test::wait_for([&] { return switches.count() >= 2 && stopped(); }));
  fixture.executor().stop();
  const auto switched = std::find_if(switches.messages.begin(), switches.messages.end(),
                                     [](const auto& each) { return !each.started.empty(); });
  ASSERT_NE(switched, switches.messages.end());
  const auto& first = *switched;
  EXPECT_TRUE(first.accepted);
  EXPECT_THAT(first.started, ElementsAre("still"));
  EXPECT_THAT(first.stopped, ElementsAre("left_hold"));
  EXPECT_THAT(first.arms, ElementsAre("left"));
  for (const auto& event : events.messages) {
    if (event.kind == "stopped") {
      EXPECT_THAT(event.arms, ElementsAre("left"));
    }
  }
}

TEST(Placements, AreTransformedToTheWorldOrRefused) {
  const Pose X_WB = Pose::from({1, 2, 3}, Quaternion(0.9, 0.1, -0.3, 0.2));
  multipanda_msgs::srv::PlaceObjects::Request request;
  request.frame_id = "left_link0";
  request.names = {"ball"};
  request.poses.resize(1);
  request.poses[0].position.x = 0.4;
  request.poses[0].orientation.w = 1;
  const auto place = [&] { return placements(request, {{"left_link0", X_WB}}); };
  ASSERT_EQ(place().size(), 1u);
  EXPECT_LT((place()[0].X_WO.position - X_WB * Vector3(0.4, 0, 0)).norm(), 1e-12);
  EXPECT_LT((place()[0].X_WO.rotation - X_WB.rotation).norm(), 1e-12);
  const auto refusal = [&]() -> std::string {
    try {
      place();
      return "accepted";
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
  };
  request.frame_id = "moon";
  EXPECT_THAT(refusal(), HasSubstr("unknown frame 'moon'"));
  request.frame_id = "";
  EXPECT_EQ(refusal(), "accepted");
  request.poses[0].position.y = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(refusal(), HasSubstr("finite"));
  request.poses[0].position.y = 0;
  request.poses[0].orientation.w = 0.5;
  EXPECT_THAT(refusal(), HasSubstr("quaternion of length 1"));
  request.poses.clear();
  EXPECT_THAT(refusal(), HasSubstr("1 names and 0 poses"));
}

TEST(State, ServicesControlTheSimulatedWorld) {
  StateFixture fixture("arms:\n  - name: left\n" + kBall);
  const AdapterParts parts = make_state(fixture.run_context());
  Node listener(fixture.context(), "listener");
  Client<std_srvs::srv::SetBool> pause(fixture.executor(), listener, "/simulation/pause");
  Client<multipanda_msgs::srv::StepSimulation> step(fixture.executor(), listener, "/simulation/step");
  Client<multipanda_msgs::srv::PlaceObjects> place(fixture.executor(), listener, "/simulation/place_objects");
  Client<std_srvs::srv::Trigger> reset(fixture.executor(), listener, "/simulation/reset");
  fixture.executor().start();
  ASSERT_TRUE(pause.wait_until_ready(20) && step.wait_until_ready(20) && place.wait_until_ready(20) &&
              reset.wait_until_ready(20));
  const auto answer_of = [&](auto& client, const auto& request) {
    auto answer = client.call(request);
    EXPECT_TRUE(test::wait_for([&] {
      fixture.run(2, parts);
      return answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
    }));
    return answer.get();
  };
  const auto height = [&] { return fixture.backend().object_pose("ball")->position.z(); };

  multipanda_msgs::srv::PlaceObjects::Request there;
  there.names = {"ball", "cube"};
  there.poses.resize(2);
  there.poses[0].position.x = there.poses[1].position.x = 0.6;
  there.poses[0].position.z = there.poses[1].position.z = 5;
  there.poses[0].orientation.w = there.poses[1].orientation.w = 1;
  const auto placed = answer_of(place, there);
  EXPECT_FALSE(placed.success);
  EXPECT_THAT(placed.placed, ElementsAre(true, false));
  EXPECT_THAT(placed.error, HasSubstr("cube"));
  EXPECT_GT(height(), 3);

  std_srvs::srv::SetBool::Request on;
  on.data = true;
  EXPECT_TRUE(answer_of(pause, on).success);
  const double still = height();
  fixture.run(20, parts);
  EXPECT_EQ(height(), still);
  multipanda_msgs::srv::StepSimulation::Request steps;
  steps.periods = 10;
  EXPECT_TRUE(answer_of(step, steps).success);
  EXPECT_LT(height(), still);
  on.data = false;
  EXPECT_TRUE(answer_of(pause, on).success);
  const auto refused = answer_of(step, steps);
  EXPECT_FALSE(refused.success);
  EXPECT_FALSE(refused.error.empty());
  EXPECT_TRUE(answer_of(reset, std_srvs::srv::Trigger::Request{}).success);
  EXPECT_NEAR(height(), 1, 0.05);
  EXPECT_EQ(fixture.run_context().counters->requests, 6u);
  EXPECT_EQ(fixture.run_context().counters->requests_refused, 2u);
  fixture.executor().stop();
}

// Every entity is described, with its rate.
TEST(State, EveryEntityIsDocumented) {
  StateFixture fixture(kArms + kBall);
  const AdapterParts parts = make_state(fixture.run_context());
  const auto entities = fixture.node().entities();
  EXPECT_GT(entities.size(), 15u);
  for (const auto& entity : entities) {
    EXPECT_FALSE(entity.type.empty() || entity.doc.empty()) << entity.name;
    if (entity.kind == "publisher") {
      EXPECT_FALSE(entity.qos.empty() || entity.rate.empty()) << entity.name;
    }
  }
}

}  // namespace
}  // namespace multipanda::ros::state_test
