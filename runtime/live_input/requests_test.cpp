#include <cmath>
#include <random>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "arm_interface/arm_error.hpp"
#include "arm_interface/arm_interface.hpp"
#include "core/state/arm_state.hpp"
#include "core/testing/drawn_sample.hpp"
#include "core/testing/wrong_goals.hpp"
#include "runtime/live_input/backend_requests.hpp"
#include "runtime/live_input/request_handler.hpp"
#include "runtime/live_input/testing/live_fixture.hpp"
#include "runtime/request_text.hpp"

namespace multipanda::requests_test {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

class RequestsTest : public testing::Test {
 protected:
  RequestsTest() : handler_(fixture_.run()) { fixture_.steps(1); }

  // The answer after at most two cycles.
  json ask(const json& request) {
    try {
      RequestHandler::Pending pending;
      if (auto at_once = handler_.begin(request, pending)) return *at_once;
      fixture_.steps(2);
      if (auto later = handler_.poll(pending)) return *later;
      return {{"ok", false}, {"verdict", "nothing"}};
    } catch (const RequestRefused& refused) {
      return {{"ok", false}, {"verdict", refused.code}, {"reason", refused.what()}};
    }
  }
  json ask(const char* text) { return ask(json::parse(text)); }
  void expect_refused(const char* text, const std::string& verdict, const std::string& words) {
    const json answer = ask(text);
    EXPECT_EQ(answer["ok"], false) << text;
    EXPECT_EQ(answer.value("verdict", ""), verdict) << text;
    EXPECT_THAT(answer.value("reason", ""), HasSubstr(words)) << text;
  }
  std::string owner(ArmIndex arm) {
    return fixture_.loop.modes().instance(fixture_.loop.modes().owner(arm)).name();
  }
  std::vector<double> set_point(const char* name) {
    const Instance& instance = fixture_.loop.modes().instance(fixture_.loop.find(name));
    std::array<double, kMaxTargetValues> values{}, rates{};
    instance.inputs()[0].record(values.data(), rates.data());
    return {values.begin(), values.begin() + static_cast<std::ptrdiff_t>(instance.inputs()[0].size())};
  }

  test::LiveFixture fixture_;
  RequestHandler handler_;
};

// By the walk over the table of core/state/arm_sample.hpp. What the arm does not report is absent.
TEST(StateOf, HoldsEveryQuantityOfAnArm) {
  std::mt19937_64 random(3);
  for (const bool reports : {true, true, false}) {
    const test::DrawnSample drawn = test::draw_sample(random, 7, reports);
    const json state = state_of(drawn.sample, 7);
    for (const auto& [name, expected] : drawn.numbers) {
      if (name == "mode") continue;
      const bool of_gripper = name.starts_with("gripper_");
      const json& holder = of_gripper ? state.value("gripper", json::object()) : state;
      const std::string key = of_gripper ? name.substr(8) : name;
      ASSERT_EQ(holder.contains(key), reports || drawn.known.at(name) == "always") << name;
      if (!holder.contains(key)) continue;
      const json found = holder[key].is_array() ? holder[key] : json::array({holder[key]});
      ASSERT_EQ(found.size(), expected.size()) << name;
      for (std::size_t k = 0; k < found.size(); ++k) {
        const double value =
            found[k].is_boolean() ? (found[k].get<bool>() ? 1.0 : 0.0) : found[k].get<double>();
        EXPECT_NEAR(value, expected[k], 1e-14) << name;
      }
    }
    EXPECT_EQ(state["mode"], to_string(static_cast<ArmMode>(drawn.sample.mode)));
    EXPECT_EQ(state["error_names"], error_list(drawn.sample.errors));
    EXPECT_EQ(state["due"].type(), json::value_t::boolean);
    EXPECT_TRUE(state["q_rad"].is_array());
  }
}

TEST_F(RequestsTest, SwitchesAndReportsWhatAndWhen) {
  const json answer = ask(R"({"do":"switch","activate":["pose0"]})");
  EXPECT_EQ(answer["ok"], true) << answer;
  EXPECT_EQ(answer["started"], json::array({"pose0"}));
  EXPECT_EQ(answer["stopped"], json::array({"arm0_hold"}));
  EXPECT_EQ(answer["kept"], json::array({"arm1_hold"}));
  ASSERT_EQ(answer["torque_steps"].size(), 1u);
  EXPECT_EQ(answer["torque_steps"][0]["arm"], "arm0");
  EXPECT_GE(answer["times_ms"]["received_to_taken"], 0.0);
  EXPECT_GT(answer["times_ms"]["taken_to_first_torque"], 0.0);
  EXPECT_EQ(owner(0), "pose0");
  EXPECT_EQ(ask(R"({"do":"switch","activate":"both","only":true})")["ok"], true);
  EXPECT_EQ(owner(1), "both");
  EXPECT_EQ(ask(R"({"do":"switch","deactivate":"both"})")["ok"], true);
  EXPECT_EQ(owner(0), "arm0_hold");
}

// A goal that no configuration reaches is refused at once, not by the velocity limit on the way.
TEST_F(RequestsTest, GoalsOutOfReachAreRefused) {
  EXPECT_EQ(ask(R"({"do":"switch","activate":["pose0"]})")["ok"], true);
  const Vector3 p_WB = fixture_.loop.models[0]->X_WB().position;
  const auto goal = [&](double distance) {
    return json{{"do", "reference"},
                {"controllet", "pose0"},
                {"input", "pose"},
                {"position_m", {p_WB.x() + distance, p_WB.y(), p_WB.z()}},
                {"rpy_rad", {3.1, 0, 0}}};
  };
  fixture_.steps(3);
  for (const double far : {2.0, 5.0}) {
    const json answer = ask(goal(far));
    EXPECT_EQ(answer["verdict"], "out_of_bounds") << answer;
    EXPECT_THAT(answer.value("reason", ""), HasSubstr("out of reach"));
  }
  EXPECT_EQ(ask(goal(0.5))["ok"], true);
}

// The same for streams and for controllets of two arms; a longer tool that is declared meanwhile counts.
TEST_F(RequestsTest, StreamsAndPosesOfTwoArmsOutOfReachAreRefused) {
  ASSERT_EQ(ask(R"({"do":"switch","activate":["pose0"]})")["ok"], true);
  fixture_.steps(3);
  const ArmModel& model = *fixture_.loop.models[0];
  ModelTerms terms(fixture_.loop.models[0]);
  terms.update(model.q_home(), joint_constant(7, 0));
  const Vector3 base = terms.X_WJ(0).position;
  StreamChannel channel =
      handler_.open_channel(json::parse(R"({"do":"stream","controllet":"pose0","input":"pose"})"));
  StreamPacket packet{.channel = 1, .sequence = 0, .client_time_ns = 0, .count = 7, .values = {}};
  packet.values[3] = 1;
  const auto verdict_at = [&](const Vector3& p) {
    ++packet.sequence;
    for (std::size_t i = 0; i < 3; ++i) packet.values[i] = p[static_cast<Eigen::Index>(i)];
    handler_.deliver(packet, channel);
    return channel.verdict;
  };
  // The chain, counted another way: every joint turned at random, no end effector is farther away.
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> draw(-3, 3);
  double farthest = 0, nearest = 1e9;
  for (int k = 0; k < 2000; ++k) {
    JointVector q(7);
    for (Eigen::Index i = 0; i < 7; ++i) q[i] = draw(random);
    terms.update(q, joint_constant(7, 0));
    farthest = std::max(farthest, (terms.X_WE().position - base).norm());
    nearest = std::min(nearest, (terms.X_WE().position - base).norm());
    ASSERT_NE(verdict_at(terms.X_WE().position), Verdict::out_of_bounds) << q.transpose();
  }
  ASSERT_LT(nearest, 0.5 * farthest);
  EXPECT_EQ(verdict_at(base + Vector3(0, 0, 1.5 * farthest)), Verdict::out_of_bounds);
  EXPECT_EQ(verdict_at(base + Vector3(5, 0, 0)), Verdict::out_of_bounds);
  EXPECT_EQ(channel.refused, 2u);

  // Two arms: the middle of the hands, or one hand, by the input's arm.
  ASSERT_EQ(ask(R"({"do":"switch","activate":["both"],"only":true})")["ok"], true);
  fixture_.steps(3);
  const Vector3 middle =
      0.5 * (fixture_.loop.models[0]->X_WB().position + fixture_.loop.models[1]->X_WB().position);
  const auto goal = [&](const char* input, const Vector3& p) {
    return ask(json{{"do", "reference"},
                    {"controllet", "both"},
                    {"input", input},
                    {"position_m", {p.x(), p.y(), p.z()}},
                    {"rpy_rad", {0, 0, 0}}});
  };
  EXPECT_EQ(goal("common_pose", middle + Vector3(0.1, 0, 0.4))["ok"], true);
  for (const char* input : {"common_pose", "first_pose", "second_pose"}) {
    for (const double far : {2.5, 5.0}) {
      const json answer = goal(input, middle + Vector3(far, 0, 0.4));
      EXPECT_EQ(answer["verdict"], "out_of_bounds") << input << far;
      EXPECT_THAT(answer.value("reason", ""), HasSubstr("out of reach"));
    }
  }
}

// The asker is told "timeout" when the loop can no longer take the request, and only then.
TEST_F(RequestsTest, ATimedOutRequestIsNotExecutedLater) {
  const json activate = json::parse(R"({"do":"switch","activate":["pose0"]})");
  constexpr std::int64_t kTwoSeconds = 2'000'000'000;
  RequestHandler::Pending given_up, taken;
  ASSERT_FALSE(handler_.begin(activate, given_up));
  given_up.received.ns -= kTwoSeconds;
  const auto answer = handler_.poll(given_up);
  ASSERT_TRUE(answer);
  EXPECT_EQ((*answer)["verdict"], "timeout");
  EXPECT_THAT((*answer)["reason"].get<std::string>(), HasSubstr("will not be executed"));
  fixture_.steps(5);
  EXPECT_EQ(owner(0), "arm0_hold");

  // Answered by the loop at the last moment: its answer counts, however late the asker looks.
  ASSERT_FALSE(handler_.begin(activate, taken));
  fixture_.steps(1);
  taken.received.ns -= kTwoSeconds;
  const auto late = handler_.poll(taken);
  ASSERT_TRUE(late);
  EXPECT_EQ((*late)["ok"], true);
  EXPECT_EQ(owner(0), "pose0");
}

// What an arm has begun cannot be taken back: its asker is not told that it failed.
TEST_F(RequestsTest, ARequestThatAnArmHasBegunIsNotCalledFailed) {
  std::promise<RequestAnswer> arm;
  RequestHandler::Pending begun;
  begun.received = host_now();
  begun.answer = arm.get_future();
  begun.received.ns -= static_cast<std::int64_t>(1e9 * (kRequestPatience + 2 * kRequestSlack));
  const auto answer = handler_.poll(begun);
  ASSERT_TRUE(answer);
  EXPECT_EQ((*answer)["verdict"], "pending");
  EXPECT_THAT((*answer)["reason"].get<std::string>(), HasSubstr("may still be executed"));
}

// Whatever is wrong with it: all arms stop, and the answer says why.
TEST_F(RequestsTest, AStopIsNeverRefused) {
  for (const auto& [text, words] : std::vector<std::pair<const char*, const char*>>{
           {R"({"do":"stop","arms":["arm7"]})", "there is no arm 'arm7'"},
           {R"({"do":"stop","arms":["arm0","arm7"]})", "there is no arm 'arm7'"},
           {R"({"do":"stop","arms":[]})", "names of arms"},
           {R"({"do":"stop","arms":0})", "list of names"},
           {R"({"do":"stop","arm":"arm0"})", "unknown key 'arm'"},
           {R"({"do":"stop","asked_ns":-7,"patience_s":"no"})", ""}}) {
    const json answer = ask(text);
    EXPECT_EQ(answer["ok"], true) << text;
    EXPECT_EQ(answer["stopped"], json::array({"arm0", "arm1"})) << text;
    EXPECT_THAT(answer.value("message", ""), HasSubstr(words)) << text;
    EXPECT_EQ(answer.contains("message"), *words != '\0') << text;
    EXPECT_EQ(fixture_.loop.modes().stopped(), ArmSet::all(2)) << text;
    ASSERT_EQ(ask(R"({"do":"resume"})")["ok"], true);
  }
  EXPECT_EQ(ask(R"({"do":"stop","arms":"arm1"})")["stopped"], json::array({"arm1"}));
  EXPECT_EQ(fixture_.loop.modes().stopped(), ArmSet::of(1));
}

// A request that its asker has given up acts no more: when it comes, and at the last moment before it acts.
TEST_F(RequestsTest, RequestsAreAsOldAsTheirAskersPatience) {
  const auto request = [](double age_s, double patience_s) {
    return json{{"do", "switch"},
                {"activate", {"pose0"}},
                {"asked_ns", host_now().ns - static_cast<std::int64_t>(1e9 * age_s)},
                {"patience_s", patience_s}};
  };
  for (const auto& [age, patience] : {std::pair(10.5, 10.0), {0.3, 0.2}}) {
    const json answer = ask(request(age, patience));
    EXPECT_EQ(answer["verdict"], "timeout") << age;
    EXPECT_THAT(answer["reason"].get<std::string>(), HasSubstr("is not executed"));
  }
  EXPECT_EQ(owner(0), "arm0_hold");
  // In time when it comes, but the loop is late.
  RequestHandler::Pending pending;
  ASSERT_FALSE(handler_.begin(request(0.05, 0.1), pending));
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  fixture_.steps(2);
  EXPECT_EQ(handler_.poll(pending).value()["verdict"], "timeout");
  EXPECT_EQ(owner(0), "arm0_hold");
  // Without a time it is as old as its arrival.
  EXPECT_THROW(handler_.begin(json{{"do", "switch"}, {"activate", {"pose0"}}}, pending,
                              {host_now().ns - 1'100'000'000}),
               RequestRefused);
  expect_refused(R"({"do":"switch","activate":["pose0"],"asked_ns":9223372036854775807})", "malformed",
                 "CLOCK_MONOTONIC");
  expect_refused(R"({"do":"switch","activate":["pose0"],"asked_ns":-1})", "malformed", "CLOCK_MONOTONIC");
  expect_refused(R"({"do":"switch","activate":["pose0"],"asked_ns":1.5})", "malformed", "whole number");
  expect_refused(R"({"do":"switch","activate":["pose0"],"patience_s":0})", "malformed", "above 0");
  EXPECT_EQ(ask(request(9, 10))["ok"], true);
  EXPECT_EQ(owner(0), "pose0");
}

// A hand is in the gripper, or the arm runs: neither age nor a gap keeps what ends it from acting.
TEST_F(RequestsTest, WhatEndsAMotionIsNeverTooLate) {
  const HostTime now = host_now();
  for (const char* text :
       {R"({"do":"stop_motion","arm":"arm0"})", R"({"do":"user_stop","arm":"arm0","pressed":true})",
        R"({"do":"gripper","arm":"arm0","action":"stop"})",
        R"({"do":"vacuum","arm":"arm0","action":"stop"})"}) {
    RequestHandler::Pending pending;
    json request = json::parse(text);
    EXPECT_FALSE(handler_.begin(request, pending, {}, now)) << text;
    request.update({{"asked_ns", now.ns - 30'000'000'000}, {"patience_s", 1}});
    EXPECT_FALSE(handler_.begin(request, pending)) << text;
  }
  for (const char* text :
       {R"({"do":"user_stop","arm":"arm0","pressed":false})", R"({"do":"recover","arm":"arm0"})",
        R"({"do":"gripper","arm":"arm0","action":"homing"})"}) {
    RequestHandler::Pending pending;
    EXPECT_THROW(handler_.begin(json::parse(text), pending, {}, now), RequestRefused) << text;
  }
}

TEST_F(RequestsTest, WhatAGoneClientAskedDoesNotBegin) {
  RequestHandler::Pending pending;
  ASSERT_FALSE(handler_.begin(json::parse(R"({"do":"switch","activate":["pose0"]})"), pending));
  handler_.abandon(pending);
  fixture_.steps(3);
  EXPECT_EQ(owner(0), "arm0_hold");
  EXPECT_LT(*pending.begin_by, host_now().ns);  // for what waits for an arm
}

// The arms of a program that moves them by itself.
TEST_F(RequestsTest, OthersMayLookAndStop) {
  LiveInputContext run = fixture_.run();
  run.stops_only = true;
  RequestHandler handler(run);
  RequestHandler::Pending pending;
  for (const char* word : {"list", "state"})
    EXPECT_EQ(handler.begin({{"do", word}}, pending).value()["ok"], true);
  for (const json& request : {json{{"do", "resume"}}, json{{"do", "switch"}, {"activate", {"pose0"}}},
                              json{{"do", "recover"}, {"arm", "arm0"}}})
    EXPECT_THROW(handler.begin(request, pending), RequestRefused) << request;
  EXPECT_THROW((void)handler.open_channel({{"do", "stream"}, {"controllet", "pose0"}, {"input", "pose"}}),
               RequestRefused);
  EXPECT_FALSE(handler.begin({{"do", "stop"}}, pending));
  fixture_.steps(1);
  EXPECT_EQ(handler.poll(pending).value()["ok"], true);
}

TEST_F(RequestsTest, AnAcceptedLoadIsAnsweredWithWhatTheFlangeCarriesAndMayCarry) {
  LiveInputContext run = fixture_.run();
  run.flanges = {{.hand_and_tool = 0.7, .rated = 3, .allowed = {}},
                 {.hand_and_tool = 0, .rated = {}, .allowed = 5}};
  RequestHandler handler(run);
  const auto asked = [&](const char* request, bool accepted) {
    RequestHandler::Pending pending;
    EXPECT_FALSE(handler.begin(json::parse(request), pending));
    std::promise<RequestAnswer> arm;
    pending.answer = arm.get_future();
    arm.set_value({accepted, "no"});
    return handler.poll(pending).value();
  };
  const json left = asked(R"({"do":"set_load","arm":"arm0","mass_kg":0.3})", true);
  EXPECT_EQ(left["ok"], true);
  EXPECT_EQ(left["load"]["payload_kg"], 0.3);
  EXPECT_EQ(left["load"]["hand_and_tool_kg"], 0.7);
  EXPECT_EQ(left["load"]["carried_kg"], 1);
  EXPECT_EQ(left["load"]["rated_kg"], 3);
  EXPECT_EQ(left["load"]["allowed_kg"], 3);
  EXPECT_EQ(left["load"]["remaining_kg"], 2);
  EXPECT_THAT(left["message"].get<std::string>(), HasSubstr("arm0: a payload of 0.3 kg is declared"));
  const json right = asked(R"({"do":"set_load","arm":"arm1","mass_kg":2})", true);
  EXPECT_FALSE(right["load"].contains("rated_kg"));
  EXPECT_EQ(right["load"]["remaining_kg"], 3);
  const json refused = asked(R"({"do":"set_load","arm":"arm0","mass_kg":0.3})", false);
  EXPECT_FALSE(refused.contains("load"));
  EXPECT_FALSE(refused.contains("message"));
  const json other = asked(R"({"do":"stop_motion","arm":"arm0"})", true);
  EXPECT_EQ(other, (json{{"ok", true}}));
}

// Another load moves an arm that nothing holds in its place, and a stop is to leave the arm where it is.
TEST(Loads, AreRefusedWhileTheArmIsStoppedOrGuided) {
  test::TestLoop loop(2, {test::LiveFixture::config("guide", "gravity_compensation", {0})},
                      Registry::with_builtins());
  loop.steps(2);
  const auto answer = [&](ArmIndex arm) {
    return request_arm(loop.modes(), loop.world, arm, SetLoad{{.mass = 0.5}}).get().reason;
  };
  const std::string of_backend = loop.world.request(0, SetLoad{{.mass = 0.5}}).get().reason;
  EXPECT_EQ(answer(0), of_backend);
  ASSERT_TRUE(loop.activate({"guide"}).accepted());
  EXPECT_THAT(answer(0), HasSubstr("guided by hand by 'guide'"));
  EXPECT_EQ(answer(1), of_backend);
  std::uint8_t mode = 0;
  const auto of_gripper = [&](GripperRequest request) {
    return request_arm(loop.modes(), loop.world, 1, std::move(request), mode).get().reason;
  };
  mode = static_cast<std::uint8_t>(ArmMode::user_stopped);
  EXPECT_THAT(of_gripper(GripperMove{}), HasSubstr("is stopped by its button"));
  EXPECT_THAT(of_gripper(GripperStop{}), Not(HasSubstr("is stopped")));
  mode = static_cast<std::uint8_t>(ArmMode::move);
  EXPECT_THAT(of_gripper(GripperMove{}), Not(HasSubstr("is stopped")));
  loop.modes().stop(ArmSet::all(2));
  loop.step();
  for (const ArmIndex arm : {0, 1}) EXPECT_THAT(answer(arm), HasSubstr("is stopped"));
  EXPECT_THAT(of_gripper(GripperMove{}), HasSubstr("is stopped"));
  EXPECT_THAT(of_gripper(VacuumOn{}), HasSubstr("is stopped"));
  EXPECT_THAT(of_gripper(GripperStop{}), Not(HasSubstr("is stopped")));
}

TEST_F(RequestsTest, RefusalsSuggestTheNearestName) {
  expect_refused(R"({"do":"switch","activate":["pose00"]})", "unknown_instance", "did you mean 'pose0'");
  expect_refused(R"({"do":"switch","activate":["pose0","both"]})", "two_owners", "arm 'arm0'");
  expect_refused(R"({"do":"switch"})", "malformed", "switches nothing");
  expect_refused(R"({"do":"swich"})", "malformed", "did you mean 'switch'");
  expect_refused(R"({"do":"switch","activat":["pose0"]})", "malformed", "did you mean 'activate'");
  expect_refused(R"({"do":"switch","activate":[1]})", "malformed", "list of names");
  expect_refused(R"({"do":"switch","activate":["pose0"],"deactivate":["pose0"]})", "malformed",
                 "is in activate and in deactivate");
  expect_refused(R"([1,2])", "malformed", "expected an object");
  expect_refused(R"({"id":1})", "malformed", "'do' is missing");
  expect_refused(R"({"do":"parameter","controllet":"pose0","name":"stifness","value":1})",
                 "unknown_parameter", "no parameter 'stifness'");
  expect_refused(R"({"do":"feature","controllet":"pose0","name":"joint_limit","on":true})", "unknown_feature",
                 "joint_limits");
  expect_refused(
      R"({"do":"reference","controllet":"pose0","input":"pos","position_m":[0,0,0],"rpy_rad":[0,0,0]})",
      "unknown_input", "'pose'");
  expect_refused(R"({"do":"reference","controllet":"pose0","input":"pose","q_rad":[0]})", "malformed",
                 "carries a pose");
  expect_refused(R"({"do":"reference","controllet":"pose0","input":"pose","position_mm":[0,0,0]})",
                 "malformed", "position_m");
  expect_refused(
      R"({"do":"reference","controllet":"pose0","input":"pose","position_m":[0,0,0],"rpy_rad":[180,0,0]})",
      "malformed", "radians");
  expect_refused(
      R"({"do":"reference","controllet":"pose0","input":"pose","frame":"arm2_base","position_m":[0,0,0],"rpy_rad":[0,0,0]})",
      "malformed", "no frame 'arm2_base'");
  expect_refused(
      R"({"do":"reference","controllet":"pose0","input":"pose","position_m":[0,0,0],"rpy_rad":[0,0,0]})",
      "not_active", "'pose0' is not active");
  expect_refused(R"({"do":"recover","arm":"arm0"})", "arm_refused", "does not support requests");
}

TEST_F(RequestsTest, ParametersAndFeatures) {
  const Instance& pose = fixture_.loop.modes().instance(fixture_.loop.find("pose0"));
  const std::size_t index = pose.find_parameter("translational_stiffness_n_per_m");
  ASSERT_LT(index, pose.parameter_count());
  EXPECT_EQ(
      ask(R"({"do":"parameter","controllet":"pose0","name":"translational_stiffness_n_per_m","value":321})")
          ["ok"],
      true);
  EXPECT_EQ(pose.parameter(index), std::vector<double>(3, 321.0));  // one for all three axes
  EXPECT_EQ(
      ask(R"({"do":"parameter","controllet":"pose0","name":"translational_stiffness_n_per_m","value":[1,2,3]})")
          ["ok"],
      true);
  EXPECT_EQ(pose.parameter(index), (std::vector<double>{1, 2, 3}));
  expect_refused(
      R"({"do":"parameter","controllet":"pose0","name":"translational_stiffness_n_per_m","value":-1})",
      "out_of_bounds", "must be 0");
  expect_refused(
      R"({"do":"parameter","controllet":"pose0","name":"translational_stiffness_n_per_m","value":[1,2]})",
      "malformed", "3 numbers");
  const std::size_t feature = pose.find_feature("joint_limits");
  EXPECT_EQ(ask(R"({"do":"feature","controllet":"pose0","name":"joint_limits","on":true})")["ok"], true);
  EXPECT_TRUE(pose.feature_on(feature));
  EXPECT_EQ(ask(R"({"do":"feature","controllet":"pose0","name":"joint_limits","on":false})")["ok"], true);
  EXPECT_FALSE(pose.feature_on(feature));
}

// The same point, once given in the world and once in the other arm's base, computed by hand.
TEST_F(RequestsTest, AReferenceInABaseIsMovedIntoTheWorld) {
  ASSERT_EQ(ask(R"({"do":"switch","activate":["pose0"]})")["ok"], true);
  const auto start = set_point("pose0");
  // arm1 is at (0.1, 0.6, 0.05), turned by rpy (0.2, -0.1, 0.7): test_world.cpp.
  const double cr = std::cos(0.2), sr = std::sin(0.2), cp = std::cos(-0.1), sp = std::sin(-0.1);
  const double cy = std::cos(0.7), sy = std::sin(0.7);
  const double R[3][3] = {{cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr},
                          {sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr},
                          {-sp, cp * sr, cp * cr}};
  const double origin[3] = {0.1, 0.6, 0.05};
  const double goal[3] = {start[0] + 0.02, start[1] - 0.01, start[2] + 0.01};
  double in_base[3] = {0, 0, 0};
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) in_base[i] += R[k][i] * (goal[k] - origin[k]);
  }
  const json answer = ask({{"do", "reference"},
                           {"controllet", "pose0"},
                           {"input", "pose"},
                           {"frame", "arm1_base"},
                           {"position_m", {in_base[0], in_base[1], in_base[2]}},
                           {"rpy_rad", {0, 0, 0}},
                           {"duration_s", 0.2}});
  ASSERT_EQ(answer["ok"], true) << answer;
  fixture_.steps(6000);
  const auto reached = set_point("pose0");
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(reached[i], goal[i], 1e-9);
  // Turned as the base is: the first axis of the quaternion's matrix is the first column of R.
  const double w = reached[3], x = reached[4], y = reached[5], z = reached[6];
  EXPECT_NEAR(1 - 2 * (y * y + z * z), R[0][0], 1e-9);
  EXPECT_NEAR(2 * (x * y + w * z), R[1][0], 1e-9);
  EXPECT_NEAR(2 * (x * z - w * y), R[2][0], 1e-9);
}

// A goal, a sample in JSON, a sample of a binary stream: one sentence. Also of ROS, native worlds and a
// scene's timeline, whose tests use the same table; the page's requests are these.
TEST_F(RequestsTest, WrongGoalsGetTheSentenceOfAllWaysIn) {
  for (const auto& goal : test::wrong_goals(*fixture_.loop.models[0])) {
    const bool pose = goal.quantity == Quantity::pose;
    const char *name = pose ? "pose0" : "joint0", *input = pose ? "pose" : "joints";
    ASSERT_EQ(ask({{"do", "switch"}, {"activate", {name}}})["ok"], true);
    json request = {{"do", "reference"}, {"controllet", name}, {"input", input}, {"values", goal.values}};
    if (goal.duration_s != 0) request["duration_s"] = goal.duration_s;
    EXPECT_THAT(ask(request).value("reason", ""), HasSubstr(goal.sentence));
    if (pose && goal.values.size() == 7) {
      json named = {{"do", "reference"}, {"controllet", name}, {"input", input}};
      named["position_m"] = std::vector(goal.values.begin(), goal.values.begin() + 3);
      named["quaternion_wxyz"] = std::vector(goal.values.begin() + 3, goal.values.end());
      if (goal.duration_s != 0) named["duration_s"] = goal.duration_s;
      EXPECT_EQ(ask(named), ask(request));
    } else if (!pose) {
      EXPECT_EQ(ask({{"do", "reference"}, {"controllet", name}, {"input", input}, {"q_rad", goal.values}}),
                ask(request));
    }
    if (goal.duration_s != 0) continue;
    request["stream"] = true;
    EXPECT_THAT(ask(request).value("reason", ""), HasSubstr(goal.sentence));
    StreamChannel channel = handler_.open_channel({{"do", "stream"}, {"controllet", name}, {"input", input}});
    StreamPacket packet{.channel = 1, .sequence = 1, .client_time_ns = 0, .count = 0, .values = {}};
    packet.count = static_cast<std::uint16_t>(goal.values.size());
    std::ranges::copy(goal.values, packet.values.begin());
    handler_.deliver(packet, channel);
    EXPECT_THAT(handler_.describe(channel).value("reason", ""), HasSubstr(goal.sentence));
    ChunkPacket chunk{.head = packet, .chunk = {.size = static_cast<std::uint8_t>(packet.count), .count = 1}};
    chunk.head.sequence = 2;
    chunk.chunk.values[0] = packet.values;
    channel.reason.clear();
    handler_.deliver(chunk, channel);
    EXPECT_THAT(channel.reason, HasSubstr(goal.sentence));
  }
}

// Numbers of packets go on at 0 after the largest one; a first number near the end is no reason to ignore all
// that follow.
TEST_F(RequestsTest, SequenceNumbersWrap) {
  ASSERT_EQ(ask(R"({"do":"switch","activate":["joint0"]})")["ok"], true);
  StreamChannel channel =
      handler_.open_channel(json::parse(R"({"do":"stream","controllet":"joint0","input":"joints"})"));
  const auto start = set_point("joint0");
  StreamPacket packet{.channel = 1, .sequence = 0, .client_time_ns = 0, .count = 7, .values = {}};
  std::copy(start.begin(), start.end(), packet.values.begin());
  constexpr std::uint64_t kLast = ~std::uint64_t{0};
  for (const std::uint64_t number : {kLast - 1, kLast, std::uint64_t{0}, std::uint64_t{3}, kLast}) {
    packet.sequence = number;
    handler_.deliver(packet, channel);
  }
  EXPECT_EQ(channel.received, 4u);
  EXPECT_EQ(channel.lost, 2u);  // 1 and 2
  EXPECT_EQ(channel.late, 1u);
}

TEST_F(RequestsTest, JointsHaveNoFrame) {
  ASSERT_EQ(ask(R"({"do":"switch","activate":["joint0"]})")["ok"], true);
  json request = {{"do", "reference"}, {"controllet", "joint0"}, {"input", "joints"}};
  const auto start = set_point("joint0");
  request["q_rad"] = start;
  EXPECT_EQ(ask(request)["ok"], true);
  request["frame"] = "world";
  EXPECT_THAT(ask(request)["reason"].get<std::string>(), HasSubstr("has no frame"));
}

TEST_F(RequestsTest, StopHoldsUntilResumed) {
  ASSERT_EQ(ask(R"({"do":"switch","activate":["pose0","pose1"]})")["ok"], true);
  const json stop = ask(R"({"do":"stop","arms":"arm0"})");
  EXPECT_EQ(stop["stopped"], json::array({"arm0"}));
  EXPECT_EQ(owner(0), "arm0_hold");
  EXPECT_EQ(owner(1), "pose1");
  expect_refused(R"({"do":"switch","activate":["pose0"]})", "arm_stopped", "stopped: arm0");
  EXPECT_EQ(ask(R"({"do":"resume"})")["ok"], true);
  EXPECT_EQ(ask(R"({"do":"switch","activate":["pose0"]})")["ok"], true);
}

// Clamps of the hold that follows are not why the arm was taken from its law.
TEST(LatestState, KeepsWhyAnArmWasRemovedApartFromLaterClamps) {
  LatestState latest(2);
  const auto arm = [&](std::size_t i) {
    LatestState::Snapshot snapshot;
    latest.copy(snapshot);
    return snapshot.arms[i];
  };
  const auto switched = [&](InstanceSet started, InstanceSet stopped, Intervention rule, std::uint16_t of) {
    Event event{.kind = EventKind::switched, .intervention = rule, .arm = of};
    event.started = started;
    event.stopped = stopped;
    latest.take(event);
  };
  constexpr InstanceSet kHolds = 0b11, kLaw = 0b100;  // of both arms
  switched(kLaw, kHolds, Intervention::none, 0xFFFF);
  latest.take(
      Event{.kind = EventKind::intervention, .intervention = Intervention::joint_velocity_limit, .arm = 1});
  switched(kHolds, kLaw, Intervention::joint_velocity_limit, 1);
  for (std::uint16_t i = 0; i < 2; ++i)
    latest.take(
        Event{.kind = EventKind::intervention, .intervention = Intervention::torque_rate_clamped, .arm = i});
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(arm(i).removed_by, Intervention::joint_velocity_limit);
    EXPECT_EQ(arm(i).last_intervention, "torque_rate_clamped");
  }
  switched(kLaw, kHolds, Intervention::none, 0xFFFF);
  EXPECT_EQ(arm(0).removed_by, Intervention::none);
  switched(kHolds, kLaw, Intervention::none, 0xFFFF);  // as somebody asked
  EXPECT_EQ(arm(0).removed_by, Intervention::none);
}

TEST_F(RequestsTest, TheStateIsTheWorlds) {
  fixture_.steps(5);
  const json state = ask(R"({"do":"state"})")["state"];
  EXPECT_EQ(state["cycle"], 6);
  ASSERT_EQ(state["arms"].size(), 2u);
  ModelTerms terms(fixture_.loop.models[1]);
  const json& arm = state["arms"][1];
  const auto q = arm["q_rad"].get<std::vector<double>>();
  ASSERT_EQ(q.size(), 7u);
  terms.update(Eigen::Map<const Eigen::VectorXd>(q.data(), 7), joint_constant(7, 0));
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_DOUBLE_EQ(arm["position_m"][i], terms.X_WE().position[static_cast<Eigen::Index>(i)]);
  EXPECT_EQ(arm["controllet"], "arm1_hold");
  EXPECT_EQ(arm["mode"], "move");
}

TEST_F(RequestsTest, TheListIsComplete) {
  const json list = ask(R"({"do":"list"})");
  EXPECT_EQ(list["scene"], "fixture");
  EXPECT_EQ(list["arms"].size(), 2u);
  ASSERT_EQ(list["controllets"].size(), 6u);  // the holds included
  const json& pose = list["controllets"][2];
  EXPECT_EQ(pose["name"], "pose0");
  EXPECT_EQ(pose["active"], false);
  EXPECT_EQ(pose["inputs"][0]["keys"][0], "position_m");
  EXPECT_FALSE(pose["parameters"].empty());
}

// One sample per cycle: the set-point follows the series, what is missing is counted, silence ends in hold.
TEST_F(RequestsTest, ABinaryStreamAtOneKilohertz) {
  ASSERT_EQ(ask(R"({"do":"switch","activate":["joint0"]})")["ok"], true);
  StreamChannel channel =
      handler_.open_channel(json::parse(R"({"do":"stream","controllet":"joint0","input":"joints"})"));
  const auto start = set_point("joint0");
  constexpr std::size_t kSamples = 1000;
  StreamPacket packet{.channel = 1, .sequence = 0, .client_time_ns = 0, .count = 7, .values = {}};
  std::copy(start.begin(), start.end(), packet.values.begin());
  const auto sample = [&](std::size_t k) {  // a slow swing from rest [rad]
    return start[3] + 0.05 * (1 - std::cos(2 * M_PI * static_cast<double>(k) / kSamples));
  };
  for (std::size_t k = 0; k < kSamples; ++k) {
    ++packet.sequence;
    if (k == 500) packet.sequence += 3;  // three were lost
    packet.values[3] = sample(k);
    handler_.deliver(packet, channel);
    if (k == 600) handler_.deliver(packet, channel);  // the same once more
    fixture_.steps(1);
    if (k > 100) {
      EXPECT_NEAR(set_point("joint0")[3], sample(k), 2e-3) << k;
    }
  }
  EXPECT_EQ(channel.received, kSamples);
  EXPECT_EQ(channel.lost, 3u);
  EXPECT_EQ(channel.late, 1u);
  EXPECT_EQ(channel.refused, 0u);
  EXPECT_EQ(owner(0), "joint0");
  fixture_.steps(150);  // the input's timeout is 0.1 s
  EXPECT_EQ(owner(0), "arm0_hold");
  EXPECT_EQ(ask(R"({"do":"state"})")["state"]["arms"][0]["last_intervention"], "reference_stale");
  ++packet.sequence;
  handler_.deliver(packet, channel);
  EXPECT_EQ(channel.verdict, Verdict::not_active);
  EXPECT_EQ(channel.refused, 1u);
}

// What waited in the socket for longer than the input's timeout moves nothing: the sender may have fallen
// silent meanwhile.
TEST_F(RequestsTest, SamplesThatComeTooLateAreDroppedAndCounted) {
  ASSERT_EQ(ask(R"({"do":"switch","activate":["joint0"]})")["ok"], true);
  StreamChannel channel =
      handler_.open_channel(json::parse(R"({"do":"stream","controllet":"joint0","input":"joints"})"));
  const auto start = set_point("joint0");
  StreamPacket packet{.channel = 1, .sequence = 0, .client_time_ns = 0, .count = 7, .values = {}};
  std::copy(start.begin(), start.end(), packet.values.begin());
  const auto deliver = [&](double offset, double age_s) {
    ++packet.sequence;
    packet.values[3] = start[3] + offset;
    handler_.deliver(packet, channel, age_s);
  };
  deliver(0, 0.099);  // late, but inside the input's timeout of 0.1 s
  EXPECT_EQ(channel.verdict, Verdict::accepted);
  fixture_.steps(1);
  // A server that was starved drains a second of samples at once: only those of the last 0.1 s count, and of
  // them the newest.
  constexpr int kQueued = 1000;
  for (int k = 0; k < kQueued; ++k) deliver(k < 900 ? -0.4 : 1e-5 * (k - 900), 1e-3 * (kQueued - k) - 5e-4);
  EXPECT_EQ(channel.expired, 900u);
  EXPECT_EQ(channel.refused, 0u);
  EXPECT_EQ(channel.received, 1001u);
  double furthest = 0;
  for (int k = 0; k < 90; ++k) {
    fixture_.steps(1);
    furthest = std::max(furthest, std::abs(set_point("joint0")[3] - start[3]));
  }
  EXPECT_LT(furthest, 0.01);
  EXPECT_NEAR(set_point("joint0")[3], start[3] + 99e-5, 1e-3);

  // Nothing but old samples is silence.
  for (int k = 0; k < 150; ++k) {
    deliver(-0.4, 0.3);
    fixture_.steps(1);
  }
  EXPECT_EQ(channel.verdict, Verdict::timeout);
  EXPECT_EQ(owner(0), "arm0_hold");
  EXPECT_EQ(ask(R"({"do":"state"})")["state"]["arms"][0]["last_intervention"], "reference_stale");
  EXPECT_EQ(handler_.describe(channel)["expired"], 1050);
}

// A packet that waited too long was to replace the samples that are queued: they move nothing either.
TEST_F(RequestsTest, APacketThatComesTooLateDiscardsTheChunkBefore) {
  for (const bool single : {true, false}) {
    ASSERT_EQ(ask(R"({"do":"switch","activate":["joint0"]})")["ok"], true);
    StreamChannel channel =
        handler_.open_channel(json::parse(R"({"do":"stream","controllet":"joint0","input":"joints"})"));
    const auto start = set_point("joint0");
    const double begin_s = ask(R"({"do":"state"})")["state"]["t_s"];
    ChunkPacket packet;
    packet.head = {.channel = 1, .sequence = 1, .client_time_ns = 0, .count = 7, .values = {}};
    packet.chunk.size = 7;
    packet.chunk.count = 20;
    for (std::size_t k = 0; k < packet.chunk.count; ++k) {
      packet.chunk.times_s[k] = begin_s + 0.05 * static_cast<double>(k + 1);
      std::copy(start.begin(), start.end(), packet.chunk.values[k].begin());
      packet.chunk.values[k][3] -= 1e-4 * static_cast<double>(k * k);
    }
    handler_.deliver(packet, channel, 0);
    ASSERT_EQ(channel.verdict, Verdict::accepted);
    fixture_.steps(300);
    ASSERT_EQ(owner(0), "joint0");
    const double before = set_point("joint0")[3];
    packet.head.sequence = 2;
    if (single)
      handler_.deliver(packet.head, channel, 1.0);
    else
      handler_.deliver(packet, channel, 1.0);
    EXPECT_EQ(channel.expired, 1u);
    fixture_.steps(300);
    EXPECT_EQ(owner(0), "arm0_hold");
    EXPECT_LT(std::abs(fixture_.loop.world.position(0)[3] - before), 5e-3);
  }
}

// The loop stands still between two cycles, and samples and a goal are sent meanwhile: the arms are held
// where they are, and what was queued moves nothing afterwards.
TEST_F(RequestsTest, WhatIsQueuedWhileTheLoopStallsMovesNothing) {
  ASSERT_EQ(ask(R"({"do":"switch","activate":["joint0"]})")["ok"], true);
  StreamChannel channel =
      handler_.open_channel(json::parse(R"({"do":"stream","controllet":"joint0","input":"joints"})"));
  const auto start = set_point("joint0");
  StreamPacket packet{.channel = 1, .sequence = 0, .client_time_ns = 0, .count = 7, .values = {}};
  std::copy(start.begin(), start.end(), packet.values.begin());
  for (int k = 0; k < 20; ++k) {
    ++packet.sequence;
    handler_.deliver(packet, channel);
    fixture_.steps(1);
  }
  ASSERT_EQ(owner(0), "joint0");
  for (int k = 0; k < 300; ++k) {  // during the stall
    ++packet.sequence;
    packet.values[3] = start[3] - 1e-3 * k;
    handler_.deliver(packet, channel);
  }
  EXPECT_EQ(channel.verdict, Verdict::accepted);
  fixture_.loop.world.start_s += 0.3;
  fixture_.steps(300);
  EXPECT_EQ(owner(0), "arm0_hold");
  EXPECT_NEAR(fixture_.loop.world.position(0)[3], start[3], 1e-4);
  // Nor do they when the controllet runs again.
  ASSERT_EQ(ask(R"({"do":"switch","activate":["joint0"]})")["ok"], true);
  fixture_.steps(300);
  EXPECT_NEAR(set_point("joint0")[3], start[3], 1e-4);
}

TEST_F(RequestsTest, AStreamRefusesInvalidSamples) {
  ASSERT_EQ(ask(R"({"do":"switch","activate":["joint0"]})")["ok"], true);
  StreamChannel channel =
      handler_.open_channel(json::parse(R"({"do":"stream","controllet":"joint0","input":"joints"})"));
  StreamPacket packet{.channel = 1, .sequence = 1, .client_time_ns = 0, .count = 6, .values = {}};
  handler_.deliver(packet, channel);
  EXPECT_EQ(channel.verdict, Verdict::wrong_size);
  packet = {.channel = 1, .sequence = 2, .client_time_ns = 0, .count = 7, .values = {}};
  packet.values[0] = std::nan("");
  handler_.deliver(packet, channel);
  EXPECT_EQ(channel.verdict, Verdict::not_finite);
  packet.sequence = 3;
  packet.values.fill(0);
  packet.values[0] = 100;
  handler_.deliver(packet, channel);
  EXPECT_EQ(channel.verdict, Verdict::out_of_bounds);
  EXPECT_EQ(channel.refused, 3u);
}

TEST_F(RequestsTest, GrippersTakeNamedActions) {
  const auto read = [](const char* text, bool vacuum = false) {
    const json request = json::parse(text);
    const JsonFields fields(request, "gripper");
    return std::get<GripperRequest>(
        read_backend_request(vacuum ? "vacuum" : "gripper", fields, {"do", "id"}));
  };
  EXPECT_TRUE(std::holds_alternative<GripperHoming>(read(R"({"action":"homing"})")));
  EXPECT_TRUE(std::holds_alternative<GripperStop>(read(R"({"action":"stop","arm":"arm0"})")));
  const auto move = std::get<GripperMove>(read(R"({"action":"move","width_m":0.03,"speed_m_per_s":0.2})"));
  EXPECT_EQ(move.width, 0.03);
  EXPECT_EQ(move.speed, 0.2);
  const auto grasp = std::get<GripperGrasp>(
      read(R"({"action":"grasp","width_m":0.02,"force_n":25,"tolerance_m":0.01,"tolerance_outer_m":0.03})"));
  EXPECT_EQ(grasp.width, 0.02);
  EXPECT_EQ(grasp.speed, GripperGrasp{}.speed);
  EXPECT_EQ(grasp.force, 25);
  EXPECT_EQ(grasp.tolerance_inner, 0.01);
  EXPECT_EQ(grasp.tolerance_outer, 0.03);
  const auto on = std::get<VacuumOn>(read(R"({"action":"on","vacuum_mbar":300,"timeout_s":2})", true));
  EXPECT_EQ(on.pressure_mbar, 300);
  EXPECT_EQ(on.timeout_s, 2);
  EXPECT_EQ(std::get<VacuumDrop>(read(R"({"action":"drop"})", true)).timeout_s, 1);

  expect_refused(R"({"do":"gripper","arm":"arm0","action":"open"})", "malformed", "no action 'open'");
  expect_refused(R"({"do":"gripper","arm":"arm0","action":"move"})", "malformed", "width_m");
  expect_refused(R"({"do":"gripper","arm":"arm0","action":"move","width_m":0.01,"force_n":1})", "malformed",
                 "force_n");
  expect_refused(R"({"do":"gripper","arm":"arm0","action":"grasp","width_m":0.01,"force_n":0})", "malformed",
                 "above 0");
  expect_refused(R"({"do":"gripper","arm":"arm9","action":"stop"})", "unknown_arm", "arm9");
  expect_refused(R"({"do":"vacuum","arm":"arm0","action":"on","timeout_s":-1})", "malformed", "timeout_s");

  // In the state only if there is one.
  EXPECT_FALSE(handler_.state()["arms"][0].contains("gripper"));
  CycleRecord record(2, 0, 0);
  record.cycle = 1;
  record.arms[1].has_gripper = record.arms[1].gripper_grasped = true;
  record.arms[1].gripper_width = 0.03;
  fixture_.latest.take(record);
  const json state = handler_.state();
  EXPECT_FALSE(state["arms"][0].contains("gripper"));
  EXPECT_EQ(state["arms"][1]["gripper"]["width_m"], 0.03);
  EXPECT_EQ(state["arms"][1]["gripper"]["grasped"], true);

  // A motion stops with a client that dies before its answer; a firmer grasp of what is held does not: it
  // would fall.
  const auto ends = [&](json request, const char* arm) {
    RequestHandler::Pending pending;
    request["arm"] = arm;
    (void)handler_.begin(request, pending);
    return pending.moving.has_value();
  };
  const json firmer = {{"do", "gripper"}, {"action", "grasp"}, {"width_m", 0.03}, {"force_n", 40}};
  EXPECT_FALSE(ends(firmer, "arm1"));
  EXPECT_FALSE(ends({{"do", "vacuum"}, {"action", "on"}, {"vacuum_mbar", 500}}, "arm1"));
  EXPECT_TRUE(ends({{"do", "gripper"}, {"action", "move"}, {"width_m", 0.05}}, "arm1"));
  EXPECT_TRUE(ends(firmer, "arm0"));
}

// Of its gripper requests, it keeps the widths to follow, and -1 for a hold.
class WidthsBackend final : public Backend {
 public:
  std::size_t arm_count() const override { return 2; }
  Capabilities capabilities(ArmIndex) const override { return {}; }
  ArmSet wait() override { return {}; }
  LoopTime now() const override { return {}; }
  void read(ArmSet, std::span<ArmState>) override {}
  void write(ArmSet, std::span<const ArmCommand>) override {}
  std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return refuse_request("no"); }
  std::future<RequestAnswer> request(ArmIndex, GripperRequest request) override {
    if (const auto* follow = std::get_if<GripperFollow>(&request))
      widths.push_back(follow->width.value_or(-1));
    stops += std::holds_alternative<GripperStop>(request);
    if (std::holds_alternative<GripperGrasp>(request)) return grasps.emplace_back().get_future();
    return answer_now({.success = true, .reason = {}});
  }
  std::vector<double> widths;
  std::vector<std::promise<RequestAnswer>> grasps;  // under way
  int stops = 0;
};

class FollowingTest : public RequestsTest {
 protected:
  FollowingTest()
      : handler_([this] {
          LiveInputContext run = fixture_.run();
          run.backend = &grippers_;
          return run;
        }()) {}

  // Why it is refused, with its verdict.
  std::string send(json request, const int& client) {
    RequestHandler::Pending pending;
    pending.client = &client;
    request["do"] = "gripper";
    request["arm"] = "arm0";
    try {
      if (const auto at_once = handler_.begin(request, pending)) return (*at_once)["verdict"];
      const auto answer = handler_.poll(pending);
      return answer && (*answer)["ok"] == true ? "" : answer->value("reason", "");
    } catch (const RequestRefused& refused) {
      return refused.code + ": " + refused.what();
    }
  }
  static json follow(double width) { return {{"action", "follow"}, {"width_m", width}, {"silence_s", 1}}; }
  static json old_width() {
    json old = follow(0.05);
    old["asked_ns"] = host_now().ns - 2'000'000'000;
    return old;
  }
  static json move(double width) { return {{"action", "move"}, {"width_m", width}}; }
  void shows(ArmMode mode, bool grasped = false) {
    CycleRecord record(2, 0, 0);
    record.cycle = 1;
    record.arms[0].has_gripper = true;
    record.arms[0].gripper_width = 0.05;
    record.arms[0].gripper_grasped = grasped;
    record.arms[0].mode = static_cast<std::uint8_t>(mode);
    fixture_.latest.take(record);
  }
  static void pause() {
    const HostTime begun = host_now();
    while (host_now() - begun < std::chrono::milliseconds(1050))
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }

  WidthsBackend grippers_;
  RequestHandler handler_;
  const int one_ = 1, other_ = 2, third_ = 3;
};

TEST_F(FollowingTest, OfOneClientUntilItIsGoneOrItsArmIsStopped) {
  EXPECT_EQ(send(follow(0.03), one_), "");
  EXPECT_EQ(send(follow(0.02), one_), "");
  EXPECT_THAT(send(follow(0.07), other_),
              HasSubstr("arm_refused: the gripper of arm 'arm0' follows widths of "
                        "another client"));
  EXPECT_THAT(send(move(0.07), other_), HasSubstr("another client"));
  EXPECT_EQ(grippers_.widths, (std::vector{0.03, 0.02}));
  // Its own next motion ends it; then the other's turn has come.
  EXPECT_EQ(send(move(0.01), one_), "");
  EXPECT_EQ(send(follow(0.07), other_), "");
  handler_.end_following(&one_);
  EXPECT_EQ(grippers_.widths.back(), 0.07);
  handler_.end_following(&other_);
  EXPECT_EQ(grippers_.widths.back(), -1);
  // So does anyone's stop of the gripper, and a stop of the arm.
  EXPECT_EQ(send(follow(0.03), one_), "");
  EXPECT_EQ(send({{"action", "stop"}}, other_), "");
  EXPECT_EQ(send(follow(0.04), other_), "");
  handler_.end_following();
  EXPECT_EQ(grippers_.widths.back(), 0.04);
  EXPECT_EQ(ask(R"({"do":"stop","arms":["arm0"]})")["ok"], true);
  handler_.end_following();
  EXPECT_EQ(grippers_.widths.back(), -1);
  EXPECT_THAT(send(follow(0.03), other_), HasSubstr("stopped"));
  EXPECT_EQ(grippers_.widths.back(), -1);
  EXPECT_EQ(ask(R"({"do":"resume"})")["ok"], true);
  // Neither old nor impossible widths.
  EXPECT_THAT(send(old_width(), third_), HasSubstr("s old"));
  EXPECT_THAT(send(follow(2), third_), HasSubstr("0 to 1 m"));
  EXPECT_EQ(grippers_.widths.back(), -1);
}

// A gone client is still known as the one that is followed, and a stop of the arm does not ask.
TEST_F(FollowingTest, EndsInAHoldAfterARefusedRequest) {
  EXPECT_EQ(send(follow(0.03), one_), "");
  EXPECT_THAT(send(old_width(), one_), HasSubstr("s old"));
  handler_.end_following(&one_);
  EXPECT_EQ(grippers_.widths, (std::vector{0.03, -1.0}));
  EXPECT_EQ(send(follow(0.02), one_), "");
  EXPECT_EQ(ask(R"({"do":"stop","arms":["arm0"]})")["ok"], true);
  EXPECT_THAT(send(follow(0.01), one_), HasSubstr("stopped"));
  handler_.end_following();
  handler_.end_following();
  EXPECT_EQ(grippers_.widths, (std::vector{0.03, -1.0, 0.02, -1.0}));
}

// Otherwise the next width of the same stream would undo a stop after 33 ms.
TEST_F(FollowingTest, AStreamThatWasEndedPausesFirst) {
  const auto ended = [&](const char* by) {
    EXPECT_THAT(send(follow(0.01), one_), HasSubstr("once it has paused for 1 s")) << by;
    EXPECT_THAT(send(old_width(), one_), HasSubstr("once it has paused")) << by;
    pause();
    EXPECT_EQ(send(follow(0.02), one_), "") << by;
  };
  shows(ArmMode::move);
  EXPECT_EQ(send(follow(0.03), one_), "");
  EXPECT_EQ(send({{"action", "stop"}}, one_), "");
  ended("its own stop");
  EXPECT_EQ(send({{"action", "follow"}}, other_), "");
  ended("another's hold");
  EXPECT_THAT(send(move(0.04), other_), HasSubstr("a move that opens it is accepted"));
  EXPECT_EQ(send(move(0.06), other_), "");
  ended("another's wider move");
  EXPECT_EQ(ask(R"({"do":"stop","arms":["arm0"]})")["ok"], true);
  handler_.end_following();
  EXPECT_THAT(send(follow(0.01), one_), HasSubstr("stopped"));
  EXPECT_EQ(ask(R"({"do":"resume"})")["ok"], true);
  shows(ArmMode::move);
  ended("a stop of the arm");
  // Its own hold and motions are its own will.
  EXPECT_EQ(send({{"action", "follow"}}, one_), "");
  EXPECT_EQ(send(follow(0.03), one_), "");
}

TEST(GripperMotion, EndsAsItBegan) {
  const auto end = [](const GripperRequest& request, bool grasped = false) {
    const auto found = ending_of(request, grasped);
    return found ? static_cast<int>(found->index()) : -1;
  };
  const int fingers = static_cast<int>(GripperRequest(GripperStop{}).index());
  const int pump = static_cast<int>(GripperRequest(VacuumStop{}).index());
  EXPECT_EQ(end(GripperHoming{}), fingers);
  EXPECT_EQ(end(GripperMove{}, true), fingers);
  EXPECT_EQ(end(GripperGrasp{}), fingers);
  EXPECT_EQ(end(GripperGrasp{}, true), -1);  // what is held would fall
  EXPECT_EQ(end(VacuumOn{}), pump);
  EXPECT_EQ(end(VacuumOn{}, true), -1);
  EXPECT_EQ(end(VacuumDrop{}, true), pump);
  EXPECT_EQ(end(GripperFollow{.width = 0.03}), static_cast<int>(GripperRequest(GripperFollow{}).index()));
  EXPECT_EQ(end(GripperFollow{}), -1);
  EXPECT_EQ(end(GripperStop{}), -1);
  EXPECT_EQ(end(VacuumStop{}), -1);
}

// Fingers that go on closing on what the arm has just hit would hold it; what they have grasped would fall.
TEST_F(FollowingTest, AReflexEndsAGraspThatHoldsNothingYet) {
  for (const bool grasped : {false, true}) {
    shows(ArmMode::move);
    RequestHandler::Pending pending;
    pending.client = &one_;
    (void)handler_.begin(
        {{"do", "gripper"}, {"arm", "arm0"}, {"action", "grasp"}, {"width_m", 0.03}, {"force_n", 40}},
        pending);
    EXPECT_FALSE(handler_.poll(pending));
    const int before = grippers_.stops;
    shows(ArmMode::reflex, grasped);
    EXPECT_FALSE(handler_.poll(pending));
    EXPECT_FALSE(handler_.poll(pending));
    EXPECT_EQ(grippers_.stops - before, grasped ? 0 : 1);
    EXPECT_THAT(send(move(0.01), one_), HasSubstr("is stopped by a reflex, and so is its gripper: recover"));
  }
}

// A person presses the arm's button.
TEST_F(FollowingTest, EndsWhenTheArmStopsItself) {
  for (const ArmMode mode : {ArmMode::user_stopped, ArmMode::reflex}) {
    shows(ArmMode::move);
    const int client = 0;
    EXPECT_EQ(send(follow(0.03), client), "");
    shows(mode);
    handler_.end_following();
    EXPECT_EQ(grippers_.widths.back(), -1);
    EXPECT_THAT(send(follow(0.01), client), HasSubstr("is " + std::string(to_string(mode))));
    shows(ArmMode::move);
    EXPECT_THAT(send(follow(0.01), client), HasSubstr("once it has paused"));
    handler_.end_following(&client);
  }
}

TEST_F(RequestsTest, StateNamesErrorsAndTheReasonOfAStop) {
  CycleRecord record(2, 0, 0);
  record.cycle = 1;
  record.arms[1].errors = std::uint64_t{1} << static_cast<unsigned>(ArmError::cartesian_reflex);
  fixture_.latest.take(record);
  fixture_.latest.take_stop_reason(1, "cartesian_reflex: force along z");
  const json arms = handler_.state()["arms"];
  EXPECT_EQ(arms[1]["errors"], record.arms[1].errors);
  EXPECT_EQ(arms[1]["error_names"], json::array({"cartesian_reflex"}));
  EXPECT_EQ(arms[1]["reason"], "cartesian_reflex: force along z");
  EXPECT_EQ(arms[0]["error_names"], json::array());
  EXPECT_FALSE(arms[0].contains("reason"));
  record.arms[1].errors = 0;
  fixture_.latest.take(record);
  EXPECT_FALSE(handler_.state()["arms"][1].contains("reason"));
}

TEST_F(RequestsTest, MessagesOfListsNameWhatWasFound) {
  // Both would let an arm press harder on a person.
  expect_refused(R"({"do":"set_collision_thresholds","arm":"arm0"})", "malformed", "unknown request");
  expect_refused(R"({"do":"set_load","arm":"arm0","mass_kg":0.5,"com_m":[0,1]})", "malformed",
                 "expected a list of 3 numbers, found a list of 2");
  expect_refused(R"({"do":"set_load","arm":"arm0","mass_kg":0.5,"com_m":[0,1,"x"]})", "malformed",
                 "found \"x\" in the list");
}

}  // namespace
}  // namespace multipanda::requests_test
