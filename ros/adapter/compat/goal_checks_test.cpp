// Which goals of multipanda_ros2 an arm takes: only near it, while it is known where it is, under the name
// that was asked for, and those of a pair for both hands or none. The loop stands still, so nothing here
// depends on time. Bases are turned and off the origin.
#include <chrono>
#include <cmath>
#include <compat_test_msgs/msg/cartesian_impedance_goal.hpp>
#include <compat_test_msgs/msg/dual_cartesian_impedance_goal.hpp>
#include <compat_test_msgs/msg/joint_goal.hpp>
#include <compat_test_msgs/msg/velocity_goal.hpp>
#include <map>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ros/adapter/compat/goals.hpp"
#include "ros/adapter/state/testing/state_fixture.hpp"

namespace multipanda::ros::goal_checks_test {
namespace {

using namespace compat_test_msgs;
using std::chrono::nanoseconds;
using testing::HasSubstr;

constexpr const char* kScene =
    "arms:\n"
    "  - {name: left, base: {position_m: [0.1, 0.5, 0.2], rpy_rad: [0.2, -0.3, 1.1]}}\n"
    "  - {name: right, base: {position_m: [-0.2, -0.7, 0.1], rpy_rad: [-0.3, 0.2, -2.0]}}\n"
    "controllets:\n"
    "  - {name: joint, type: joint_impedance, arms: left}\n"
    "  - {name: hand, type: cartesian_impedance, arms: right}\n"
    "  - {name: both, type: dual_cartesian_impedance, arms: [left, right], parameters: {goals: separate}}\n"
    "active: [joint, hand]\n"
    "ros: {node: mc, compat: multipanda_ros2}\n";

const std::string kJoint = "panda_joint_impedance_controller", kVelocity = "panda_joint_velocity_controller",
                  kHand = "panda_cartesian_impedance_controller",
                  kDual = "dual_cartesian_impedance_controller",
                  kTwin = "twin_cartesian_impedance_controller";

geometry_msgs::msg::Pose message_of(const Pose& X) {
  geometry_msgs::msg::Pose pose;
  const Quaternion q = X.quaternion();
  pose.position.x = X.position.x(), pose.position.y = X.position.y(), pose.position.z = X.position.z();
  pose.orientation.w = q.w(), pose.orientation.x = q.x();
  pose.orientation.y = q.y(), pose.orientation.z = q.z();
  return pose;
}

class Goals : public testing::Test {
 protected:
  // Events go to both parts, records only as at() says.
  struct Events : AdapterPart {
    explicit Events(Goals& goals) : to(goals) {}
    void take(const Event& event) override {
      to.names->take(event);
      to.goals.take(event);
    }
    Goals& to;
  };

  Goals() {
    parts.push_back(std::make_unique<Events>(*this));
    run(5);
    at(0);
    fixture.executor().start();
  }
  ~Goals() override { fixture.executor().stop(); }

  void run(std::size_t cycles) {
    fixture.run(cycles, parts, [&](const CycleRecord& made) { record = made; });
  }
  // The arms' state is this old. Fresh ones are of a time to come, so that a slow computer does not age them.
  void at(double age_s) {
    record.start = host_now() + nanoseconds(std::llround(1e9 * (age_s > 0 ? -age_s : 100)));
    goals.take(record);
  }
  InstanceIndex find(const char* name) const { return modes.find(name); }
  void activate(std::initializer_list<const char*> names_of_ours) {
    Request request{.kind = Request::Kind::switch_controllets};
    for (const char* name : names_of_ours) request.activate |= bit(find(name));
    std::uint64_t ticket = 0;
    ASSERT_EQ(modes.post(std::span(&request, 1), ticket), Verdict::accepted);
    run(3);
    Answer answer;
    ASSERT_TRUE(modes.poll(ticket, answer) && answer.accepted());
    at(0);
  }
  InputPort& port(const std::string& name) {
    for (const auto& one : inputs.ports()) {
      if (one->name() == name) return *one;
    }
    throw std::invalid_argument(name);
  }
  std::uint64_t taken(const std::string& name) {
    const auto counts = port(name).counts();
    return counts.received - counts.refused;
  }
  Pose end_effector(ArmIndex arm) const {  // in the arm's base
    ModelTerms terms(fixture.run_context().models[arm]);
    const ArmConfig config = arm_config(fixture.scene().arms[arm]);
    terms.set_config(config.frames, config.tool, config.load);
    const JointVector q = Eigen::Map<const Eigen::VectorXd>(record.arms[arm].q.data(), 7);
    terms.update(q, JointVector::Zero(7));
    return terms.model().X_WB().inverse() * terms.X_WE();
  }

  // Sends one message; returns "" if all these inputs took it, otherwise why the first of them refused it.
  template <class M>
  std::string answer(const std::string& resource, const std::string& controllet, const M& message,
                     const std::vector<std::string>& to) {
    auto& kept = publishers["/" + resource + "/" + controllet + "/desired_pose"];
    if (!kept) {
      kept = std::make_shared<Publisher<M>>(sender, "/" + resource + "/" + controllet + "/desired_pose",
                                            Qos::reliable(1), Doc{});
    }
    auto& publisher = *std::static_pointer_cast<Publisher<M>>(kept);
    const auto received = [&] {
      std::uint64_t count = 0;
      for (const auto& name : to) count += port(name).counts().received;
      return count;
    };
    const std::uint64_t before = received();
    EXPECT_TRUE(test::wait_for([&] { return publisher.subscribers() > 0; })) << publisher.topic();
    // The first one is lost while the subscription has not seen the publisher yet.
    const auto come = [&] { return received() >= before + to.size(); };
    for (int k = 0; k < 20 && !come(); ++k) {
      publisher.publish(message);
      (void)test::wait_for(come, 1);
    }
    EXPECT_TRUE(come()) << publisher.topic();
    return port(to[0]).counts().last_accepted ? "" : port(to[0]).counts().last_reason;
  }
  std::string joints(const JointVector& away) {
    msg::JointGoal goal;
    for (Eigen::Index i = 0; i < 7; ++i) {
      const auto k = static_cast<std::size_t>(i);
      goal.q[k] = record.arms[0].q[k] + away[i];
    }
    return answer("left", kJoint, goal, {"joint/joints"});
  }
  std::string velocity(double dq) {
    msg::VelocityGoal goal;
    goal.qd.fill(dq);
    return answer("left", kVelocity, goal, {"joint/joints"});
  }
  std::string hand(const geometry_msgs::msg::Pose& pose) {
    msg::CartesianImpedanceGoal goal;
    goal.pose = pose;
    return answer("right", kHand, goal, {"hand/pose"});
  }
  std::string pair(const Pose& X_left, const Pose& X_right) {
    msg::DualCartesianImpedanceGoal goal;
    goal.l_pose = message_of(X_left);
    goal.r_pose = message_of(X_right);
    return answer("left_and_right", kDual, goal, {"both/first_pose", "both/second_pose"});
  }
  std::string twin() {
    msg::CartesianImpedanceGoal goal;
    goal.pose = message_of(end_effector(0));
    return answer("left_and_right", kTwin, goal, {"both/first_pose", "both/second_pose"});
  }

  test::StateFixture fixture{kScene};
  MultimodeController& modes = *fixture.run_context().modes;
  std::shared_ptr<AskedNames> names = std::make_shared<AskedNames>(modes);
  Inputs inputs{fixture.run_context(), {}};
  CompatGoals goals{fixture.run_context(),
                    {RosSection::Compat::multipanda_ros2, "compat_test_msgs", "compat_test_msgs"},
                    inputs,
                    names};
  Node sender{fixture.context(), "sender"};
  std::map<std::string, std::shared_ptr<void>> publishers;
  AdapterParts parts;
  CycleRecord record;
};

// The distances at which multipanda_ros2 drops goals; just below they are taken.
TEST_F(Goals, FarFromTheArmAreRefused) {
  std::mt19937 random(11);
  std::normal_distribution<> normal;
  const auto direction = [&] { return Vector3(normal(random), normal(random), normal(random)).normalized(); };
  const Pose X = end_effector(1);
  EXPECT_THAT(hand(geometry_msgs::msg::Pose()), HasSubstr("away from the end effector")) << "not filled in";
  EXPECT_THAT(hand(message_of(fixture.run_context().models[1]->X_WB() * X)), HasSubstr("out of reach"))
      << "in the world";
  for (int k = 0; k < 5; ++k) {
    Pose X_goal = X;
    X_goal.position += 0.101 * direction();
    EXPECT_THAT(hand(message_of(X_goal)), HasSubstr("0.101 m away from the end effector"));
    X_goal = X;
    X_goal.rotation = Eigen::AngleAxisd(0.152, direction()) * X.rotation;
    EXPECT_THAT(hand(message_of(X_goal)), HasSubstr("turned by 0.152 rad"));
    X_goal.rotation = Eigen::AngleAxisd(0.148, direction()) * X.rotation;
    X_goal.position += 0.099 * direction();
    EXPECT_EQ(hand(message_of(X_goal)), "");
    geometry_msgs::msg::Pose negative = message_of(X_goal);  // the same rotation
    negative.orientation.w *= -1, negative.orientation.x *= -1;
    negative.orientation.y *= -1, negative.orientation.z *= -1;
    EXPECT_EQ(hand(negative), "");
  }
  for (Eigen::Index i = 0; i < 7; ++i) {
    JointVector away = JointVector::Zero(7);
    away[i] = 0.101;
    EXPECT_THAT(joints(away), HasSubstr("joint " + std::to_string(i + 1) + ": the goal is 0.101 rad away"));
    away[i] = -0.099;
    EXPECT_EQ(joints(away), "");
  }
}

// A set-point from an old position would drive the arm back there, and no distance from it means anything.
TEST_F(Goals, AreRefusedWhileTheArmsStateIsOld) {
  names->accept(find("joint"), kVelocity, Answer{.cycle = record.cycle});
  at(0.2);
  EXPECT_THAT(velocity(0), HasSubstr("s old, more than 0.05"));
  EXPECT_THAT(hand(message_of(end_effector(1))), HasSubstr("s old, more than 0.05"));
  names->accept(find("joint"), kJoint, Answer{.cycle = record.cycle});
  EXPECT_THAT(joints(JointVector::Zero(7)), HasSubstr("s old"));
  EXPECT_EQ(fixture.run_context().counters->samples_accepted.load(), 0u);
  run(1);
  for (const char* name : {"joint", "hand"}) EXPECT_FALSE(modes.instance(find(name)).inputs()[0].streaming());
  at(0);
  EXPECT_EQ(joints(JointVector::Zero(7)), "");
  EXPECT_EQ(hand(message_of(end_effector(1))), "");
  // The arm's own silence counts, too.
  record.arms[1].age_s = 200;
  at(0);
  EXPECT_THAT(hand(message_of(end_effector(1))), HasSubstr("s old"));
}

// While another topic streams to one hand, the pair takes nothing, whichever hand it is.
TEST_F(Goals, OfAPairAreTakenByBothHandsOrNone) {
  activate({"both"});
  const Pose X_left = end_effector(0), X_right = end_effector(1);
  const int native = 0;
  for (const std::string first : {"both/first_pose", "both/second_pose"}) {
    const std::string other = first == "both/first_pose" ? "both/second_pose" : "both/first_pose";
    const ArmIndex arm = first == "both/first_pose" ? 0 : 1;
    const Pose X = end_effector(arm);
    const auto own = port(first).admits({X.position.x(), X.position.y(), X.position.z(), X.quaternion().w(),
                                         X.quaternion().x(), X.quaternion().y(), X.quaternion().z()},
                                        arm == 0 ? "left_link0" : "right_link0", 0, &native, host_now());
    ASSERT_EQ(own.why, "");
    ASSERT_TRUE(port(first).post(own.target, &native, host_now() + std::chrono::hours(1)));
    const std::uint64_t before = taken(other);
    for (int k = 0; k < 3; ++k) EXPECT_THAT(pair(X_left, X_right), HasSubstr(first + ": another topic"));
    EXPECT_EQ(taken(other), before);
    ASSERT_TRUE(port(first).post(own.target, &native, HostTime{}));  // it lets go
  }
  Pose X_far = X_right;
  X_far.position.y() += 0.11;
  const std::uint64_t before = taken("both/first_pose");
  EXPECT_THAT(pair(X_left, X_far), HasSubstr("both/second_pose: the goal is 0.11 m away"));
  X_far.position.y() = NAN;
  EXPECT_THAT(pair(X_left, X_far), HasSubstr("both/second_pose: number 1 of 7 is not finite"));
  EXPECT_EQ(taken("both/first_pose"), before);
  EXPECT_EQ(pair(X_left, X_right), "");
  EXPECT_EQ(taken("both/first_pose"), before + 1);

  // Both hands are free for another topic at the same nanosecond: no message in between gets one of them.
  const auto free_at = [&](const std::string& name, const Pose& X, const std::string& frame) {
    const auto is_free = [&](HostTime now) {
      const Quaternion q = X.quaternion();
      return port(name)
          .admits({X.position.x(), X.position.y(), X.position.z(), q.w(), q.x(), q.y(), q.z()}, frame, 0,
                  &native, now)
          .why.empty();
    };
    HostTime locked{}, open = host_now() + std::chrono::hours(1);
    EXPECT_TRUE(!is_free(locked) && is_free(open));
    while (open - locked > nanoseconds(1)) {
      const HostTime middle = locked + (open - locked) / 2;
      (is_free(middle) ? open : locked) = middle;
    }
    return open.ns;
  };
  EXPECT_EQ(free_at("both/first_pose", X_left, "left_link0"),
            free_at("both/second_pose", X_right, "right_link0"));
}

// Several of their names are one controllet here. The goals of the others move nothing.
TEST_F(Goals, AreTakenUnderTheNameThatWasAskedForOnly) {
  const JointVector here = JointVector::Zero(7);
  const InstanceIndex joint = find("joint");
  // Never asked for: the name with positions.
  EXPECT_EQ(joints(here), "");
  EXPECT_THAT(velocity(0), HasSubstr("'joint' is active as '" + kJoint + "': request '" + kVelocity));
  names->ask(bit(joint));
  EXPECT_THAT(joints(here), HasSubstr("about to start"));
  names->answered(bit(joint));
  names->accept(joint, kVelocity, Answer{.cycle = record.cycle});
  EXPECT_THAT(joints(here), HasSubstr("is active as '" + kVelocity));
  // The other topic has streamed until now, which keeps the input for 0.1 s.
  EXPECT_TRUE(test::wait_for([&] { return velocity(0).empty(); }));
  names->accept(joint, "comless_" + kJoint, Answer{.cycle = record.cycle});
  EXPECT_THAT(joints(here), HasSubstr("is active as 'comless_"));
  EXPECT_THAT(velocity(0), HasSubstr("is active as 'comless_"));
  EXPECT_EQ(names->name(joint), "comless_" + kJoint);
  // Any other way in ends it, also if it starts the same one again.
  activate({"left_hold"});
  EXPECT_THAT(joints(here), HasSubstr("not active"));
  activate({"joint"});
  EXPECT_EQ(names->name(joint), kJoint);
  EXPECT_TRUE(test::wait_for([&] { return joints(here).empty(); }));

  activate({"both"});
  names->accept(find("both"), kTwin, Answer{.cycle = record.cycle});
  EXPECT_THAT(pair(end_effector(0), end_effector(1)), HasSubstr("is active as '" + kTwin));
  names->accept(find("both"), kDual, Answer{.cycle = record.cycle});
  EXPECT_THAT(twin(), HasSubstr("is active as '" + kDual));
  EXPECT_EQ(pair(end_effector(0), end_effector(1)), "");
}

}  // namespace
}  // namespace multipanda::ros::goal_checks_test
