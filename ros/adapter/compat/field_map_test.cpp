// Types are found by name and compared with the generated structures of the same messages.
#include <compat_test_msgs/msg/franka_robot_state.hpp>
#include <compat_test_msgs/msg/franka_state.hpp>
#include <compat_test_msgs/msg/variant_state.hpp>
#include <compat_test_msgs/srv/get_controllers.hpp>
#include <compat_test_msgs/srv/set_controllers.hpp>
#include <numeric>
#include <random>
#include <rosidl_typesupport_introspection_cpp/field_types.hpp>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ros/adapter/compat/message_type.hpp"

namespace multipanda::ros::field_map_test {
namespace {

using namespace compat_test_msgs;
using testing::ElementsAre;
using testing::ElementsAreArray;
using testing::HasSubstr;

constexpr const char* kPackage = "compat_test_msgs";

template <class F>
std::string refusal(F f) {
  try {
    f();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(MessageType, ReadsWhatTheGeneratedStructureHolds) {
  const auto type = MessageType::find(kPackage, "FrankaState");
  EXPECT_EQ(type.name(), "compat_test_msgs/msg/FrankaState");
  std::mt19937 random(3);
  std::uniform_real_distribution<> number(-10, 10);
  msg::FrankaState message;
  for (auto& value : message.tau_j) value = number(random);
  for (auto& value : message.o_t_ee) value = number(random);
  message.header.stamp.sec = 7;
  message.robot_mode = 5;
  message.current_errors.joint_reflex = true;
  EXPECT_THAT(Numbers(type, {"tau_j"}, 7).read(&message), ElementsAreArray(message.tau_j));
  EXPECT_THAT(Numbers(type, {"o_t_ee"}, 16).read(&message), ElementsAreArray(message.o_t_ee));
  EXPECT_THAT(Numbers(type,
                      {"header.stamp.sec", "robot_mode", "current_errors.joint_reflex",
                       "last_motion_errors.joint_reflex"},
                      4)
                  .read(&message),
              ElementsAre(7, 5, 1, 0));
}

TEST(MessageType, MakesAMessageWithTheDefaultsOfItsType) {
  const auto type = MessageType::find(kPackage, "FrankaRobotState");
  const auto message = type.make();
  EXPECT_EQ(*static_cast<msg::FrankaRobotState*>(message.get()), msg::FrankaRobotState());
}

// What each writes, the other reads: single precision, sequences of any length, bounded ones, integers.
TEST(Numbers, ConvertsToTheTypeOfTheField) {
  const auto type = MessageType::find(kPackage, "VariantState");
  const auto made = type.make();
  auto& message = *static_cast<msg::VariantState*>(made.get());
  const std::vector<double> q{0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7};
  for (int again = 0; again < 2; ++again) {
    Numbers(type, {"q"}, 7).write(made.get(), q);
    Numbers(type, {"dq"}, 7).write(made.get(), q);
    Numbers(type, {"tau_j"}, 7).write(made.get(), q);
    std::vector<double> X(16);
    std::iota(X.begin(), X.end(), 1.0);
    Numbers(type, {"o_t_ee"}, 16).write(made.get(), X);
    ASSERT_EQ(message.q.size(), 7u);
    for (std::size_t i = 0; i < 7; ++i) {
      EXPECT_EQ(message.q[i], static_cast<float>(q[i]));
      EXPECT_EQ(message.dq[i], static_cast<float>(q[i]));
    }
    EXPECT_THAT(message.tau_j, ElementsAreArray(q));
    EXPECT_THAT(std::vector<double>(message.o_t_ee.begin(), message.o_t_ee.end()), ElementsAreArray(X));
  }
  message.tau_j.resize(6);
  EXPECT_THAT(refusal([&] { (void)Numbers(type, {"tau_j"}, 7).read(made.get()); }),
              HasSubstr("VariantState.tau_j: found 6 numbers, expected 7"));
  const auto state = MessageType::find(kPackage, "FrankaState");
  msg::FrankaState other;
  for (const auto& [value, found] : std::vector<std::pair<double, int>>{{3.4, 3}, {-1, 0}, {999, 255}}) {
    Numbers(state, {"robot_mode"}, 1).write(&other, std::vector{value});
    EXPECT_EQ(other.robot_mode, found);
  }
}

TEST(Numbers, RefusesWhatDoesNotFit) {
  const auto type = MessageType::find(kPackage, "TooShortState");
  EXPECT_THAT(refusal([&] { Numbers(type, {"q"}, 7); }),
              HasSubstr("TooShortState.q: found float64[6], expected 7 numbers"));
  EXPECT_THAT(refusal([&] { Numbers(type, {"tau_j"}, 7); }), HasSubstr("found string, expected 7 numbers"));
  EXPECT_THAT(refusal([&] { Numbers(type, {"dq"}, 7); }), HasSubstr("has no field 'dq'; found q, tau_j"));
  EXPECT_THAT(refusal([&] { Numbers(type, {"q.x"}, 1); }), HasSubstr("has no field 'q.x'"));
  const auto variant = MessageType::find(kPackage, "VariantState");
  EXPECT_THAT(refusal([&] { Numbers(variant, {"o_t_ee"}, 17); }), HasSubstr("found float64[<=16]"));
  EXPECT_THAT(refusal([&] { Text(variant, "history"); }),
              HasSubstr("found compat_test_msgs/msg/Errors[], expected a string"));
  EXPECT_THAT(refusal([&] { Parts(variant, "q"); }), HasSubstr("found float32[], expected a sequence of"));
}

// What is written later would not fit, and an answer would be missing in the run.
TEST(MessageType, TextsAndPartsWithBoundsAreRefused) {
  using namespace rosidl_typesupport_introspection_cpp;
  MessageMember fields[4]{};
  fields[0].name_ = "text", fields[0].string_upper_bound_ = 8;
  fields[1].name_ = "texts", fields[1].is_array_ = true;
  fields[1].array_size_ = 3, fields[1].is_upper_bound_ = true;
  fields[2].name_ = "short_texts", fields[2].is_array_ = true, fields[2].string_upper_bound_ = 8;
  fields[3].name_ = "free", fields[3].is_array_ = true;
  for (auto& field : fields) field.type_id_ = ROS_TYPE_STRING;
  MessageMembers members{};
  members.member_count_ = 4;
  members.members_ = fields;
  const MessageType type("a/msg/B", &members);
  EXPECT_THAT(refusal([&] { Text(type, "text"); }), HasSubstr("found string<=8, expected a string without"));
  EXPECT_THAT(refusal([&] { Texts(type, "texts"); }), HasSubstr("found string[<=3], expected a sequence of"));
  EXPECT_THAT(refusal([&] { Texts(type, "short_texts"); }), HasSubstr("found string<=8[]"));
  EXPECT_EQ(refusal([&] { Texts(type, "free"); }), "");
  const auto variant = MessageType::find(kPackage, "VariantState");
  EXPECT_EQ(refusal([&] { Parts(variant, "history"); }), "");
  fields[3] = *variant.place("history")->field;
  fields[3].array_size_ = 3, fields[3].is_upper_bound_ = true;
  EXPECT_THAT(refusal([&] { Parts(type, "history"); }), HasSubstr("Errors[<=3], expected a sequence of"));
}

TEST(MessageType, MissingPackagesAndTypesAreRefused) {
  EXPECT_THAT(refusal([] { MessageType::find("no_such_msgs", "FrankaState"); }),
              HasSubstr("'no_such_msgs' was not found when multipanda was built"));
  EXPECT_THAT(refusal([] { MessageType::find(kPackage, "State"); }), HasSubstr("has no type 'msg/State'"));
  EXPECT_THAT(refusal([] { ServiceType::find(kPackage, "Set"); }), HasSubstr("has no type 'srv/Set'"));
}

TEST(Parts, GoThroughMessagesInMessages) {
  const auto type = ServiceType::find(kPackage, "SetControllers");
  srv::SetControllers::Request request;
  request.controllers.resize(2);
  request.controllers[1].name = "dual";
  request.controllers[1].resources = {"left&right", "a"};
  const Parts controllers(type.request, "controllers");
  ASSERT_EQ(controllers.size(&request), 2u);
  const void* second = controllers.at(static_cast<const void*>(&request), 1);
  EXPECT_EQ(Text(controllers.type(), "name").read(second), "dual");
  EXPECT_THAT(Texts(controllers.type(), "resources").read(second), ElementsAre("left&right", "a"));

  const auto list = ServiceType::find(kPackage, "GetControllers");
  const auto made = list.response.make();
  const Parts answers(list.response, "controllers");
  answers.resize(made.get(), 1);
  Text(answers.type(), "name").write(answers.at(made.get(), 0), "soft");
  Texts(answers.type(), "resources").write(answers.at(made.get(), 0), {"left"});
  const auto& response = *static_cast<srv::GetControllers::Response*>(made.get());
  EXPECT_EQ(response.controllers[0].name, "soft");
  EXPECT_THAT(response.controllers[0].resources, ElementsAre("left"));
  EXPECT_TRUE(type.response.paths().empty()) << "an empty message";
}

struct Joints {
  std::vector<double> q;
};

FieldRule<Joints> rule(const std::string& path, std::size_t count, bool needed) {
  return {
      {path},
      count,
      [](const Joints& from, std::span<double> out) { std::copy_n(from.q.begin(), out.size(), out.begin()); },
      needed};
}

TEST(FieldMap, FillsWhatItKnowsAndNamesTheRest) {
  const auto type = MessageType::find(kPackage, "VariantState");
  FieldMap<Joints> map(type, {rule("q", 7, true), rule("not_there", 7, false), rule("robot_mode", 1, true)});
  EXPECT_THAT(map.unknown(), ElementsAre("dq", "tau_j", "o_t_ee", "frame", "history"));
  const auto made = type.make();
  map.fill({{1, 2, 3, 4, 5, 6, 7}}, made.get());
  const auto& message = *static_cast<msg::VariantState*>(made.get());
  EXPECT_THAT(message.q, ElementsAre(1, 2, 3, 4, 5, 6, 7));
  EXPECT_EQ(message.robot_mode, 1);
  EXPECT_TRUE(message.tau_j.empty());
  EXPECT_THAT(refusal([&] { FieldMap<Joints>(type, {rule("not_there", 7, true)}); }),
              HasSubstr("has no field 'not_there'; found q, dq"));
}

}  // namespace
}  // namespace multipanda::ros::field_map_test
