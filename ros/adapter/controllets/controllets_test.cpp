// What follows from controllet descriptors, without a ROS graph: conversion of messages to set-points,
// parameters, answers.
#include <cmath>
#include <random>
#include <rcl_interfaces/msg/parameter_type.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/testing/test_world.hpp"
#include "core/testing/wrong_goals.hpp"
#include "ros/adapter/controllets/input_port.hpp"
#include "ros/adapter/controllets/inputs.hpp"
#include "ros/adapter/controllets/mode_services.hpp"
#include "ros/adapter/controllets/parameter_services.hpp"
#include "ros/adapter/topic.hpp"
#include "ros/rcl/executor.hpp"

namespace multipanda::ros::controllets_test {
namespace {

using geometry_msgs::msg::PoseStamped;
using geometry_msgs::msg::TwistStamped;
using geometry_msgs::msg::WrenchStamped;
using sensor_msgs::msg::JointState;
using std_msgs::msg::Float64;
using testing::ElementsAre;
using testing::HasSubstr;
using Type = rcl_interfaces::msg::ParameterType;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

InstanceConfig config(std::string name, std::string type, std::vector<ArmIndex> arms) {
  InstanceConfig config;
  config.name = std::move(name);
  config.type = std::move(type);
  config.arms = std::move(arms);
  return config;
}

// Two arms on rotated bases ("arm0", "arm1"), and the context of adapter parts without a node.
struct Fixture {
  Fixture()
      : loop(2,
             {config("pose0", "cartesian_impedance", {0}), config("pose1", "cartesian_impedance", {1}),
              config("joint1", "joint_impedance", {1}), config("both", "dual_cartesian_impedance", {0, 1}),
              config("ufic0", "ufic", {0})},
             Registry::with_builtins(), 64) {
    run.modes = &loop.modes();
    run.backend = &loop.world;
    run.models = loop.models;
    run.counters = &counters;
    run.executor = &executor;
    run.stops = &stops;
    run.warn = [this](const std::string&, const std::string& text) { warnings.push_back(text); };
  }
  InputReader reader(Quantity quantity, std::size_t arm, std::string frame = "world") {
    InputSpec spec;
    spec.name = "x";
    spec.quantity = quantity;
    spec.frame = std::move(frame);
    return {spec, {{"arm0", loop.models[0]}, {"arm1", loop.models[1]}}, arm};
  }

  test::TestLoop loop;
  AdapterCounters counters;
  Executor executor, stops;
  AdapterContext run;
  std::vector<std::string> warnings;
};

InputCodec plain_codec(std::string controllet, std::string input, std::string topic) {
  return input_codec<PoseStamped>(
      std::move(controllet), std::move(input), [](const PoseStamped&, InputValues&) {}, std::move(topic));
}

struct Codecs : testing::Test, Fixture {};

TEST_F(Codecs, OfATypeServeEveryInputOfAQuantity) {
  const auto nothing = [](const PoseStamped&, InputValues&) {};
  const std::vector<InputCodec> codecs{plain_codec("cartesian_impedance", "pose", ""),
                                       plain_codec("cartesian_impedance", "pose", "second"),
                                       input_codec_for<PoseStamped>(Quantity::pose, "tracker", nothing)};
  const MultimodeController& modes = loop.modes();
  check_codecs(codecs, modes);
  for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
    const Instance& instance = modes.instance(i);
    const bool cartesian = instance.descriptor().type == "cartesian_impedance";
    for (const Reference& input : instance.inputs()) {
      std::vector<std::string> topics;
      for (const auto* codec : more_codecs_for(codecs, instance, input.spec()))
        topics.push_back(codec->topic);
      std::vector<std::string> expected;
      if (cartesian) expected.push_back("second");
      if (input.spec().quantity == Quantity::pose) expected.push_back("tracker");
      EXPECT_EQ(topics, expected) << instance.name() << "/" << input.spec().name;
      EXPECT_EQ(codec_for(codecs, instance, input.spec()) != nullptr, cartesian);
    }
  }
}

TEST_F(Codecs, ThatCannotBeServedAreRefused) {
  const auto nothing = [](const PoseStamped&, InputValues&) {};
  const auto refusal = [&](const std::vector<InputCodec>& codecs) -> std::string {
    try {
      check_codecs(codecs, loop.modes());
      return "accepted";
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
  };
  EXPECT_THAT(refusal({plain_codec("cartesian_impedance", "poes", "")}),
              testing::AllOf(HasSubstr("no input 'poes'"), HasSubstr("did you mean 'pose'")));
  EXPECT_EQ(refusal({plain_codec("virtual_wall", "wall", "")}), "accepted") << "no such controllet here";
  EXPECT_THAT(refusal({plain_codec("cartesian_impedance", "pose", "a"),
                       input_codec_for<PoseStamped>(Quantity::pose, "a", nothing)}),
              HasSubstr("the same topic of input 'pose'"));
  EXPECT_THAT(refusal({input_codec_for<PoseStamped>(Quantity::pose, "", nothing)}),
              HasSubstr("for a quantity needs one"));
  for (const char* topic : {"goal", "reference", "7th", "a/b", "a b", "a__b"})
    EXPECT_THAT(refusal({plain_codec("cartesian_impedance", "pose", topic)}), HasSubstr("expected letters"));
}

PoseStamped pose_message(const Pose& X, std::string frame) {
  PoseStamped message;
  message.header.frame_id = std::move(frame);
  message.pose.position.x = X.position.x();
  message.pose.position.y = X.position.y();
  message.pose.position.z = X.position.z();
  const Quaternion q = X.quaternion();
  message.pose.orientation.w = q.w();
  message.pose.orientation.x = q.x();
  message.pose.orientation.y = q.y();
  message.pose.orientation.z = q.z();
  return message;
}

// The same place given in the world and in each arm's base results in the same set-point.
TEST(Inputs, PosesAreAcceptedInTheWorldOrInABase) {
  Fixture fixture;
  const InputReader reader = fixture.reader(Quantity::pose, 0);
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> draw(-1, 1);
  for (int i = 0; i < 20; ++i) {
    const Pose X_WE{exp_rotation({draw(random), draw(random), draw(random)}),
                    {draw(random), draw(random), draw(random)}};
    for (const auto& [frame, X_WF] :
         std::vector<std::pair<std::string, Pose>>{{"", {}},
                                                   {"world", {}},
                                                   {"arm0_link0", fixture.loop.models[0]->X_WB()},
                                                   {"arm1_link0", fixture.loop.models[1]->X_WB()}}) {
      Target target;
      ASSERT_EQ(reader.read(pose_message(X_WF.inverse() * X_WE, frame), target), std::nullopt);
      EXPECT_EQ(target.size, 7);
      EXPECT_LT(pose_error(Pose::from(target.values.data()), X_WE).norm(), 1e-12) << frame;
    }
  }
  Target target;
  EXPECT_THAT(*reader.read(pose_message({}, "arm0_link8"), target),
              HasSubstr("there is no frame 'arm0_link8'"));
  EXPECT_THAT(reader.frames(), ElementsAre("world", "arm0_link0", "arm1_link0"));
  // An input with a frame of its own takes no other frame.
  EXPECT_THAT(*fixture.reader(Quantity::pose, 0, "object").read(pose_message({}, "world"), target),
              HasSubstr("no frame 'world'"));
}

// Rotation preserves the power of a wrench on a twist.
TEST(Inputs, TwistsAndWrenchesAreRotated) {
  Fixture fixture;
  TwistStamped twist;
  WrenchStamped wrench;
  twist.header.frame_id = wrench.header.frame_id = "arm1_link0";
  twist.twist.linear.x = 0.3;
  twist.twist.angular.z = -0.2;
  wrench.wrench.force.x = 5;
  wrench.wrench.force.y = 1;
  wrench.wrench.torque.z = 2;
  Target v, f;
  ASSERT_EQ(fixture.reader(Quantity::twist, 0).read(twist, v), std::nullopt);
  ASSERT_EQ(fixture.reader(Quantity::wrench, 0).read(wrench, f), std::nullopt);
  double power = 0;
  for (std::size_t i = 0; i < 6; ++i) power += v.values[i] * f.values[i];
  EXPECT_NEAR(power, 0.3 * 5 - 0.2 * 2, 1e-12);
  const Matrix3& R = fixture.loop.models[1]->X_WB().rotation;
  EXPECT_GT(std::abs(R(0, 1)), 0.1) << "otherwise nothing is rotated";
  for (int k = 0; k < 3; ++k)
    EXPECT_NEAR(f.values[static_cast<std::size_t>(k)], 5 * R(k, 0) + R(k, 1), 1e-12);
}

TEST(Inputs, JointsAreAcceptedByNameInAnyOrder) {
  Fixture fixture;
  const InputReader reader = fixture.reader(Quantity::joints, 1);
  const JointVector& home = fixture.loop.models[1]->q_home();
  JointState message;
  for (const int k : {3, 1, 7, 2, 6, 5, 4}) {
    message.name.push_back("arm1_joint" + std::to_string(k));
    message.position.push_back(home[k - 1]);
  }
  message.name.insert(message.name.begin() + 2, {"arm0_joint1", "arm1_finger_joint1"});  // of the other arm
  message.position.insert(message.position.begin() + 2, {9.0, 9.0});
  Target target;
  ASSERT_EQ(reader.read(message, target), std::nullopt);
  ASSERT_EQ(target.size, 7);
  for (int k = 0; k < 7; ++k) EXPECT_EQ(target.values[static_cast<std::size_t>(k)], home[k]);

  JointState wrong = message;
  wrong.name[0] = "arm1_joint33";
  EXPECT_THAT(*reader.read(wrong, target), HasSubstr("there is no joint 'arm1_joint33'"));
  wrong = message;
  wrong.name[1] = wrong.name[0];
  EXPECT_THAT(*reader.read(wrong, target), HasSubstr("twice"));
  wrong.name = {"arm1_joint1"};
  wrong.position = {0.1};
  EXPECT_THAT(*reader.read(wrong, target), HasSubstr("'arm1_joint2' is missing"));
  wrong.position.clear();
  EXPECT_THAT(*reader.read(wrong, target), HasSubstr("1 names with 0 positions"));

  JointState plain;  // without names: the arm's own order
  plain.position.assign(home.begin(), home.end());
  EXPECT_EQ(reader.read(plain, target), std::nullopt);
}

// As the socket, native worlds and a scene's timeline say it.
TEST(Inputs, WrongGoalsGetTheSentenceOfAllWaysIn) {
  Fixture fixture;
  for (const auto& goal : test::wrong_goals(*fixture.loop.models[1])) {
    if (goal.duration_s != 0) continue;  // a message has none
    const char* name = goal.quantity == Quantity::pose ? "pose1" : "joint1";
    ASSERT_TRUE(fixture.loop.activate({name}).accepted());
    InputPort port(fixture.run, fixture.loop.find(name), 0);
    for (const Delivery delivery : {Delivery::goal, Delivery::stream}) {
      EXPECT_FALSE(port.receive(goal.values, "", delivery));
      EXPECT_THAT(port.counts().last_reason, HasSubstr(goal.sentence));
    }
    // In a base, the same.
    if (goal.quantity != Quantity::pose || goal.values.size() != 7) continue;
    const auto& v = goal.values;
    Target turned;
    turned.set(v);
    turned.to_world(Quantity::pose, fixture.loop.models[1]->X_WB().inverse());
    EXPECT_FALSE(
        port.receive({turned.values.begin(), turned.values.begin() + 7}, "arm1_link0", Delivery::goal));
  }
}

// Of two topics that stream to one input, the first has it until it is silent: an operator who lets go finds
// the arm held, whatever another sender does.
TEST(Inputs, AnotherTopicsStreamIsRefusedWhileOneStreams) {
  Fixture fixture;
  InputPort port(fixture.run, fixture.loop.find("pose0"), 0);
  ASSERT_TRUE(fixture.loop.activate({"pose0"}).accepted());
  const Reference& reference = fixture.loop.modes().instance(fixture.loop.find("pose0")).inputs()[0];
  const Pose X = reference.pose();
  const int operators = 0, trackers = 0;
  port.receive(pose_message(X, ""), Delivery::stream, 0, &operators);
  port.receive(pose_message(X, ""), Delivery::stream, 0, &trackers);
  EXPECT_EQ(port.counts().refused, 1u);
  EXPECT_THAT(port.counts().last_reason, HasSubstr("another topic"));
  port.receive(pose_message(X, ""), Delivery::stream, 0, &operators);
  port.receive(pose_message(X, ""), Delivery::goal, 0, &trackers);
  EXPECT_EQ(port.counts().refused, 1u);
  const HostTime silent =
      host_now() + std::chrono::nanoseconds(std::llround(1.2e9 * reference.spec().timeout_s));
  while (host_now() < silent) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  port.receive(pose_message(X, ""), Delivery::stream, 0, &trackers);
  EXPECT_EQ(port.counts().refused, 1u);
}

// Asking first and then sending agree in every case, and asking changes nothing.
TEST(Inputs, AdmitWhatTheyThenTake) {
  Fixture fixture;
  InputPort port(fixture.run, fixture.loop.find("pose0"), 0);
  ASSERT_TRUE(fixture.loop.activate({"pose0"}).accepted());
  const Pose X = fixture.loop.modes().instance(fixture.loop.find("pose0")).inputs()[0].pose();
  const auto values = [](const Pose& pose) {
    const Quaternion q = pose.quaternion();
    const Vector3& p = pose.position;
    return std::vector<double>{p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()};
  };
  Pose far = X;
  far.position.x() += 5;
  std::vector<double> not_a_number = values(X), long_quaternion = values(X);
  not_a_number[1] = kNan;
  for (std::size_t i = 3; i < 7; ++i) long_quaternion[i] *= 2;
  const int first = 0, second = 0;
  struct Case {
    std::vector<double> values;
    std::string frame;
    double waited_s;
    const void* from;
    std::string why;
  };
  const auto compare = [&](const Case& c) {
    const auto before = port.counts();
    const auto found = port.admits(c.values, c.frame, c.waited_s, c.from, host_now());
    EXPECT_EQ(port.counts().received, before.received);
    EXPECT_THAT(found.why, HasSubstr(c.why));
    EXPECT_EQ(found.why.empty(), c.why.empty());
    EXPECT_EQ(port.receive(c.values, c.frame, Delivery::stream, c.waited_s, c.from), found.why.empty());
    EXPECT_EQ(port.counts().last_reason, c.why.empty() ? before.last_reason : found.why);
    EXPECT_EQ(port.counts().last_not_active, found.not_active);
  };
  ASSERT_TRUE(port.post(port.admits(values(X), "", 0, &first, host_now()).target, &first,
                        host_now() + std::chrono::hours(1)));
  for (const Case& c :
       {Case{values(X), "", 0, &second, "another topic"}, Case{values(far), "", 0, &first, "out of reach"},
        Case{not_a_number, "", 0, &first, "not finite"},
        Case{long_quaternion, "", 0, &first, "unit quaternion"},
        Case{values(X), "nowhere", 0, &first, "no frame"}, Case{values(X), "", 0.11, &first, "waited"},
        Case{{1, 2}, "", 0, &first, "expected 7 numbers, found 2"}, Case{values(X), "", 0, &first, ""}}) {
    compare(c);
  }
  ASSERT_TRUE(fixture.loop.activate({"arm0_hold"}).accepted());
  compare({values(X), "", 0, &first, "not active"});
}

// Only accepted messages reach the loop. Refused ones are counted, with the newest reason, and reported.
TEST(Inputs, PosesOutOfReachAreRefusedWithTheDistance) {
  Fixture fixture;
  InputPort port(fixture.run, fixture.loop.find("pose0"), 0);
  InputPort of_both(fixture.run, fixture.loop.find("both"), 0);
  ASSERT_TRUE(fixture.loop.activate({"pose0", "pose1"}).accepted());
  const Reference& reference = fixture.loop.modes().instance(fixture.loop.find("pose0")).inputs()[0];
  const Pose X_start = reference.pose();
  Pose far = X_start;
  far.position.x() += 5;
  for (const Delivery delivery : {Delivery::goal, Delivery::stream}) {
    const auto refused = port.counts().refused;
    port.receive(pose_message(far, ""), delivery);
    EXPECT_EQ(port.counts().refused, refused + 1);
    EXPECT_THAT(port.counts().last_reason, HasSubstr("out of reach"));
  }
  const auto refused = port.counts().refused;
  port.receive(pose_message(X_start, ""), Delivery::stream);
  EXPECT_EQ(port.counts().refused, refused);
  ASSERT_TRUE(fixture.loop.activate({"both"}).accepted());
  of_both.receive(pose_message(far, ""), Delivery::stream);
  EXPECT_THAT(of_both.counts().last_reason, HasSubstr("middle of the hands"));
}

// A message that waited for an overloaded computer was for an arm that was somewhere else.
TEST(Inputs, MessagesThatWaitedTooLongMoveNothing) {
  Fixture fixture;
  fixture.loop.steps(3);
  InputPort port(fixture.run, fixture.loop.find("pose0"), 0);
  ASSERT_TRUE(fixture.loop.activate({"pose0"}).accepted());
  fixture.loop.step();
  const Reference& reference = fixture.loop.modes().instance(fixture.loop.find("pose0")).inputs()[0];
  const double timeout = reference.spec().timeout_s;
  Pose X_goal = reference.pose();
  const Pose X_start = X_goal;
  X_goal.position.z() += 0.01;
  port.receive(pose_message(X_goal, ""), Delivery::stream, 1.01 * timeout);
  EXPECT_THAT(port.counts().last_reason, HasSubstr("waited"));
  port.receive(pose_message(X_goal, ""), Delivery::goal, 1.01);  // as a request to the loop
  fixture.loop.steps(200);
  EXPECT_EQ(port.counts().refused, 2u);
  EXPECT_FALSE(reference.streaming());
  EXPECT_LT(pose_error(reference.pose(), X_start).norm(), 1e-12);
  port.receive(pose_message(X_goal, ""), Delivery::goal, 0.99);
  fixture.loop.steps(1500);
  EXPECT_LT(pose_error(reference.pose(), X_goal).norm(), 1e-9);
  port.receive(pose_message(X_goal, ""), Delivery::stream, 0.99 * timeout);
  fixture.loop.step();
  EXPECT_TRUE(reference.streaming());
}

TEST(Inputs, RefusedMessagesAreCountedAndDoNotReachTheLoop) {
  Fixture fixture;
  fixture.loop.steps(3);
  InputPort port(fixture.run, fixture.loop.find("pose0"), 0);
  const Reference& reference = fixture.loop.modes().instance(fixture.loop.find("pose0")).inputs()[0];
  for (int i = 0; i < 5; ++i) port.receive(pose_message({}, ""), Delivery::stream);
  EXPECT_EQ(port.counts().refused, 5u) << "it does not run";
  EXPECT_THAT(port.counts().last_reason, HasSubstr("not active"));
  EXPECT_EQ(fixture.warnings.size(), 1u) << "reported once, since it is normal";
  EXPECT_EQ(port.diagnostic().level, Diagnostic::Level::ok);

  ASSERT_TRUE(fixture.loop.activate({"pose0"}).accepted());
  fixture.loop.step();
  const Pose X_start = reference.pose();
  port.receive(pose_message(X_start, "nowhere"), Delivery::stream);
  PoseStamped not_a_number = pose_message(X_start, "");
  not_a_number.pose.orientation.z = kNan;
  port.receive(not_a_number, Delivery::goal);
  fixture.loop.steps(200);
  EXPECT_EQ(port.counts().refused, 7u);
  EXPECT_EQ(port.diagnostic().level, Diagnostic::Level::warn);
  EXPECT_THAT(port.diagnostic().message, HasSubstr("not finite"));
  EXPECT_FALSE(reference.streaming());
  EXPECT_LT(pose_error(reference.pose(), X_start).norm(), 1e-12);
  EXPECT_EQ(fixture.loop.modes().owner(0), fixture.loop.find("pose0")) << "it had no stream to lose";

  Pose X_goal = X_start;
  X_goal.position.z() += 0.01;
  port.receive(pose_message(X_goal, "world"), Delivery::goal);
  fixture.loop.steps(1500);
  EXPECT_LT(pose_error(reference.pose(), X_goal).norm(), 1e-9);
  EXPECT_EQ(port.diagnostic().level, Diagnostic::Level::ok);
  EXPECT_EQ(fixture.counters.samples_accepted.load(), 1u);
  EXPECT_EQ(fixture.counters.samples_refused.load(), 7u);

  // A stream that consists of invalid messages counts as silence: the arm is held.
  for (int i = 0; i < 300; ++i) {
    PoseStamped next = pose_message(X_goal, i < 50 ? "" : "nowhere");
    port.receive(next, Delivery::stream);
    fixture.loop.step();
  }
  EXPECT_EQ(fixture.loop.modes().owner(0), fixture.loop.find("arm0_hold"));
}

TEST(Parameters, FollowDescriptors) {
  Fixture fixture;
  const ParameterTable table(fixture.loop.modes());
  const auto names = table.names();
  const Instance& instance = fixture.loop.modes().instance(fixture.loop.find("joint1"));
  std::size_t count = 0;
  for (const auto& name : names) count += name.starts_with("joint1.") ? 1 : 0;
  EXPECT_EQ(count, instance.parameter_count());
  for (const auto& name : names) {
    const auto descriptor = table.describe(name);
    EXPECT_NE(descriptor.type, Type::PARAMETER_NOT_SET) << name;
    EXPECT_FALSE(descriptor.description.empty()) << name;
    EXPECT_EQ(table.get(name).type, descriptor.type) << name;
    std::string reason;  // values that were read can be set
    rcl_interfaces::msg::Parameter parameter;
    parameter.name = name;
    parameter.value = table.get(name);
    EXPECT_TRUE(table.request(parameter, reason)) << reason;
  }
  EXPECT_EQ(table.describe("joint1.no_such_thing").type, Type::PARAMETER_NOT_SET);
  EXPECT_EQ(table.get("nobody.stiffness").type, Type::PARAMETER_NOT_SET);
}

struct TableTest : testing::Test {
  std::optional<Request> set(const std::string& name, const std::function<void(ParameterTable::Value&)>& to) {
    rcl_interfaces::msg::Parameter parameter;
    parameter.name = name;
    to(parameter.value);
    reason.clear();
    return table.request(parameter, reason);
  }
  std::optional<Request> set_number(const std::string& name, double value) {
    return set(name, [&](auto& v) {
      v.type = Type::PARAMETER_DOUBLE;
      v.double_value = value;
    });
  }
  // The first parameter that satisfies a condition.
  std::string find(const std::function<bool(const ParameterSpec&)>& matches) {
    for (InstanceIndex i = 0; i < fixture.loop.modes().instance_count(); ++i) {
      const Instance& instance = fixture.loop.modes().instance(i);
      for (std::size_t k = 0; k < instance.parameter_count(); ++k) {
        if (matches(instance.parameter_spec(k))) return instance.name() + "." + instance.parameter_names()[k];
      }
    }
    ADD_FAILURE() << "no controllet has such a parameter";
    return "";
  }
  Fixture fixture;
  ParameterTable table{fixture.loop.modes()};
  std::string reason;
};

TEST_F(TableTest, ChoicesAndSwitchesHaveNames) {
  const std::string choice =
      find([](const ParameterSpec& s) { return s.choices.size() == 2 && s.choices[0] == "passive"; });
  EXPECT_EQ(table.describe(choice).type, Type::PARAMETER_STRING);
  EXPECT_THAT(table.describe(choice).additional_constraints, HasSubstr("one of: passive, paper"));
  EXPECT_EQ(table.get(choice).string_value, "passive");
  const auto by_name = set(choice, [](auto& v) {
    v.type = Type::PARAMETER_STRING;
    v.string_value = "paper";
  });
  ASSERT_TRUE(by_name);
  EXPECT_EQ(by_name->values[0], 1);
  const auto by_number = set(choice, [](auto& v) {
    v.type = Type::PARAMETER_INTEGER;
    v.integer_value = 1;
  });
  ASSERT_TRUE(by_number);
  EXPECT_EQ(by_number->values[0], 1);
  EXPECT_FALSE(set(choice, [](auto& v) {
    v.type = Type::PARAMETER_STRING;
    v.string_value = "psasive";
  }));
  EXPECT_THAT(reason, HasSubstr("expected passive or paper"));
  EXPECT_FALSE(set_number(choice, 1)) << "a number without a name is no choice";

  const std::string flag =
      find([](const ParameterSpec& s) { return s.choices.size() == 2 && s.choices[0] == "false"; });
  EXPECT_EQ(table.describe(flag).type, Type::PARAMETER_BOOL);
  ASSERT_TRUE(set(flag, [](auto& v) {
    v.type = Type::PARAMETER_BOOL;
    v.bool_value = true;
  })) << reason;
}

TEST_F(TableTest, NumbersHaveBoundsAndSizes) {
  const std::string joints = find([](const ParameterSpec& s) { return s.size == ParameterSpec::kPerJoint; });
  const auto descriptor = table.describe(joints);
  EXPECT_EQ(descriptor.type, Type::PARAMETER_DOUBLE_ARRAY);
  EXPECT_THAT(descriptor.additional_constraints, HasSubstr("7 numbers, one per joint"));
  ASSERT_EQ(descriptor.floating_point_range.size(), 1u);
  const double max = descriptor.floating_point_range[0].to_value;
  EXPECT_EQ(table.get(joints).double_array_value.size(), 7u);
  const auto all = set_number(joints, max);  // one value for all joints
  ASSERT_TRUE(all) << reason;
  EXPECT_EQ(all->size, 7);
  EXPECT_EQ(all->values[6], max);
  EXPECT_FALSE(set_number(joints, max * 1.001 + 1));
  EXPECT_THAT(reason, HasSubstr("must be"));
  EXPECT_FALSE(set_number(joints, kNan));
  EXPECT_FALSE(set(joints, [](auto& v) {
    v.type = Type::PARAMETER_DOUBLE_ARRAY;
    v.double_array_value = {1, 2, 3};
  }));
  EXPECT_THAT(reason, HasSubstr("3 numbers; expected 7"));
  EXPECT_FALSE(set(joints, [](auto& v) {
    v.type = Type::PARAMETER_STRING;
    v.string_value = "stiff";
  }));
  EXPECT_THAT(reason, HasSubstr("expected 7 numbers, found a string"));
  EXPECT_FALSE(set_number("joint1.stifness", 1));
  EXPECT_THAT(reason, HasSubstr("'joint1' has no parameter 'stifness'"));
  EXPECT_FALSE(set_number("nobody", 1));
  EXPECT_THAT(reason, HasSubstr("there is no parameter 'nobody'"));
}

TEST_F(TableTest, ListsByPrefixAndDepth) {
  const auto all = table.list({}, 0);
  EXPECT_EQ(all.names.size(), table.names().size());
  const auto own = table.list({"pose0"}, 1);  // without the parameters of its features
  ASSERT_FALSE(own.names.empty());
  for (const auto& name : own.names) {
    EXPECT_TRUE(name.starts_with("pose0."));
    EXPECT_EQ(std::count(name.begin(), name.end(), '.'), 1);
  }
  EXPECT_THAT(own.prefixes, ElementsAre("pose0"));
  EXPECT_GT(table.list({"pose0"}, 0).names.size(), own.names.size());
  EXPECT_TRUE(table.list({"pose"}, 0).names.empty()) << "a prefix is a whole name";
  EXPECT_TRUE(table.list({}, 1).names.empty()) << "every parameter belongs to an instance";
}

// Set through the loop: the table reads what the event reports.
TEST_F(TableTest, EventsReportWhatWasSet) {
  fixture.loop.step();
  const std::string name = find([](const ParameterSpec& s) { return s.size == 3 || s.size == 6; });
  const auto request = set_number(name, table.describe(name).floating_point_range[0].from_value);
  ASSERT_TRUE(request) << reason;
  RecordRing& ring = *fixture.loop.cycle.record();
  while (ring.events.front() != nullptr) ring.events.pop();
  ASSERT_TRUE(fixture.loop.ask(*request).accepted());
  const Event* event = ring.events.front();
  ASSERT_NE(event, nullptr);
  ASSERT_EQ(event->kind, EventKind::parameter_set);
  EXPECT_EQ(table.changed(*event).name, name);
  EXPECT_EQ(table.changed(*event).value, table.get(name));
}

TEST(ModeMessages, SwitchResponsesHaveReasonsAndTimes) {
  Fixture fixture;
  fixture.loop.step();
  MultimodeController& modes = fixture.loop.modes();
  Refused refused;
  multipanda_msgs::srv::SwitchControllets::Request asked;
  EXPECT_FALSE(switch_request(modes, asked, refused));
  EXPECT_THAT(refused.reason, HasSubstr("switches nothing"));
  asked.activate = {"pose2"};
  EXPECT_FALSE(switch_request(modes, asked, refused));
  EXPECT_EQ(refused.verdict, "unknown_instance");
  EXPECT_THAT(refused.reason, HasSubstr("there is no controllet 'pose2'"));
  asked.activate = asked.deactivate = {"pose0"};
  EXPECT_FALSE(switch_request(modes, asked, refused));
  EXPECT_THAT(refused.reason, HasSubstr("in activate and in deactivate"));

  asked.deactivate.clear();
  asked.activate = {"pose0", "both"};
  auto request = switch_request(modes, asked, refused);
  ASSERT_TRUE(request);
  Answer answer;
  answer.verdict = modes.check(*request);
  auto response = switch_response(modes, *request, answer, host_now());
  EXPECT_FALSE(response.accepted);
  EXPECT_EQ(response.verdict, "two_owners");
  EXPECT_THAT(response.reason, HasSubstr("both own arm 'arm0'"));

  asked.activate = {"pose0"};
  const HostTime received = host_now();
  request = switch_request(modes, asked, refused);
  answer = fixture.loop.ask(*request);
  response = switch_response(modes, *request, answer, received);
  EXPECT_TRUE(response.accepted);
  EXPECT_EQ(response.verdict, "accepted");
  EXPECT_EQ(response.reason, "");
  EXPECT_THAT(response.started, ElementsAre("pose0"));
  EXPECT_THAT(response.stopped, ElementsAre("arm0_hold"));
  EXPECT_THAT(response.arms, ElementsAre("arm0"));
  EXPECT_EQ(response.torque_step.size(), 1u);
  EXPECT_EQ(response.first_torque_ns, answer.first_torque.ns);
  EXPECT_NEAR(response.waiting_s + response.computing_s, response.total_s, 1e-9);
  EXPECT_GT(response.computing_s, 0);
  EXPECT_GT(response.waiting_s, 0);
}

TEST(ModeMessages, FeaturesAndArmsAreFoundByName) {
  Fixture fixture;
  const MultimodeController& modes = fixture.loop.modes();
  Refused refused;
  multipanda_msgs::srv::SetFeatures::Request asked;
  asked.instance = "pose0";
  asked.features = {"joint_limits", "manipulability"};
  asked.on = {true, false};
  const auto requests = feature_requests(modes, asked, refused);
  ASSERT_TRUE(requests) << refused.reason;
  ASSERT_EQ(requests->size(), 2u);
  EXPECT_TRUE((*requests)[0].on);
  EXPECT_FALSE((*requests)[1].on);
  asked.on.pop_back();
  EXPECT_FALSE(feature_requests(modes, asked, refused));
  EXPECT_THAT(refused.reason, HasSubstr("2 features with 1 values"));
  asked.on.push_back(true);
  asked.features[1] = "joint_limit";
  EXPECT_FALSE(feature_requests(modes, asked, refused));
  EXPECT_EQ(refused.verdict, "unknown_feature");

  EXPECT_EQ(*arms_named(modes, {}, refused), ArmSet::all(2));
  EXPECT_EQ(*arms_named(modes, {"arm1"}, refused), ArmSet::of(1));
  EXPECT_FALSE(arms_named(modes, {"arm1", "arm2"}, refused));
  EXPECT_THAT(refused.reason, HasSubstr("there is no arm 'arm2'"));
}

TEST(RateDivider, DividesTheRateOfRecords) {
  RateDivider tenth(100, 0.001), each(5000, 0.001), never(0, 0.001);
  int tenths = 0, all = 0, none = 0;
  for (std::uint64_t cycle = 1; cycle <= 1000; ++cycle) {
    if (cycle % 7 == 0) continue;  // dropped records only cause a delay
    tenths += tenth.due(cycle) ? 1 : 0;
    all += each.due(cycle) ? 1 : 0;
    none += never.due(cycle) ? 1 : 0;
  }
  EXPECT_EQ(tenths, 101);  // the first record, then one in ten cycles
  EXPECT_EQ(all, 1000 - 142);
  EXPECT_EQ(none, 0);
  EXPECT_EQ(tenth.text(0.001), "100 Hz");
  EXPECT_EQ(each.text(0.001), "1000 Hz");
}

}  // namespace
}  // namespace multipanda::ros::controllets_test
