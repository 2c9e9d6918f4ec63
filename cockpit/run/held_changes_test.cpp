#include <cmath>
#include <regex>
#include <thread>

#include <gtest/gtest.h>

#include "cockpit/run/run_source.hpp"
#include "cockpit/run/state_view.hpp"
#include "core/controllets/goal_parameters.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

// What of a run needs a hold, and how it ends with the hold: a simulated run without a network, and the test
// in the place of the clients.
namespace multipanda::cockpit::held_changes_test {

namespace {

using nlohmann::json;

// Names of parameters carry their unit, so they say in another way what is a gain: something per something, a
// frequency, a time, an energy.
TEST(GoalParameters, AreAllThatAreNoGains) {
  const std::regex gain("damping_ratio|.*_per_(?!s$).*|.*_(hz|s|j)"), speed(".*_(m|rad)_per_s");
  const Registry registry = Registry::with_builtins();
  std::vector<ControlletDescriptor> all;
  for (const auto& type : registry.controllets()) all.push_back(type.descriptor);
  for (const auto& type : registry.features()) all.push_back(type.descriptor);
  std::size_t goals = 0, gains = 0;
  for (const auto& descriptor : all) {
    for (const ParameterSpec& spec : descriptor.parameters) {
      EXPECT_NE(acts_as_goal(spec), std::regex_match(spec.name, gain) && !std::regex_match(spec.name, speed))
          << descriptor.type << " " << spec.name;
      ++(acts_as_goal(spec) ? goals : gains);
    }
  }
  EXPECT_GT(goals, 20u);
  EXPECT_GT(gains, 20u);
  EXPECT_TRUE(acts_as_goal({.name = "of_a_new_law"}));
}

class HeldChanges : public testing::Test {
 protected:
  void run(const std::string& scene) {
    opened_ = open_scene(scene);
    opened_.scene.timeline.clear();
    SessionOptions options{.paced = true, .duration_s = 0};
    options.share_records = true;
    session_ = std::make_unique<Session>(opened_.scene, opened_.registry, std::move(options));
    session_->start();
    source_ = std::make_unique<RunSource>(*session_);
    until([this] { return state()["arms"].size() == 2; });
  }
  void TearDown() override {
    source_.reset();
    session_->stop();
    session_->finish();
  }

  json state() {
    source_->update(host_now());
    return source_->slow_state();
  }
  double hand(std::size_t arm) { return state()["arms"][arm]["position_m"][1].get<double>(); }  // y [m]
  double width() { return state()["arms"][0]["gripper"]["width_m"].get<double>(); }
  std::string owner(std::size_t arm = 0) { return state()["arms"][arm]["controllet"].get<std::string>(); }
  template <typename Condition>
  void until(Condition condition) {
    while (!condition()) std::this_thread::yield();
  }
  void pass(double time) {  // of the loop [s]
    const double end = state()["t_s"].get<double>() + time;
    until([&] { return state()["t_s"].get<double>() >= end; });
  }
  json ask(const json& request) {
    EXPECT_TRUE(source_->moves(request)) << request;
    auto reply = source_->ask(request, host_now());
    if (auto* at_once = std::get_if<Reply>(&reply)) return at_once->answer;
    for (;; std::this_thread::yield()) {
      if (const auto done = std::get<Later>(reply)()) return done->answer;
    }
  }
  void activate(const std::string& name) {
    const json answer = ask({{"do", "switch"}, {"activate", name}});
    ASSERT_EQ(answer["ok"], true) << answer;
  }

  OpenedScene opened_;
  std::unique_ptr<Session> session_;
  std::unique_ptr<RunSource> source_;
};

json parameter(const char* controllet, const char* name, const json& value) {
  return {{"do", "parameter"}, {"controllet", controllet}, {"name", name}, {"value", value}};
}

TEST_F(HeldChanges, AreNeededForWhatMayMoveAnArm) {
  run("two_arms");
  const std::vector<double> q(7, 0);
  const json pose = {{"do", "reference"},
                     {"controllet", "left_cartesian"},
                     {"input", "pose"},
                     {"position_m", {0.4, 0.3, 0.5}},
                     {"quaternion_wxyz", {0, 1, 0, 0}}};
  for (const json& request :
       {pose, json{{"do", "switch"}, {"activate", "dual"}}, parameter("dual", "offset_m", {0, 0.3, 0}),
        parameter("dual", "goals", "separate"), parameter("left_cartesian", "nullspace_posture", "given"),
        parameter("left_cartesian", "nullspace_posture_rad", q),
        parameter("left_cartesian", "translational_stiffness_n_per_m", 4000),
        parameter("left_cartesian", "joint_limits.range_rad", 0.2),
        json{{"do", "feature"}, {"controllet", "dual"}, {"name", "joint_limits"}, {"on", false}},
        json{{"do", "set_load"}, {"arm", "left"}, {"mass_kg", 0.5}},
        json{{"do", "gripper"}, {"arm", "left"}, {"action", "homing"}},
        json{{"do", "vacuum"}, {"arm", "left"}, {"action", "on"}},
        json{{"do", "vacuum"}, {"arm", "left"}, {"action", "drop"}},
        json{{"do", "gripper"}, {"arm", "left"}, {"action", "move"}, {"width_m", 0.02}},
        json{{"do", "gripper"}, {"arm", "left"}, {"action", "grasp"}, {"width_m", 0.02}}})
    EXPECT_TRUE(source_->moves(request)) << request;
  for (const json& request :
       {json{{"do", "switch"}, {"deactivate", "left_cartesian"}},
        json{{"do", "switch"}, {"activate", "left_hold"}},
        parameter("left_cartesian", "translational_stiffness_n_per_m", 1),
        parameter("left_cartesian", "damping_ratio", 0.7),
        json{{"do", "gripper"}, {"arm", "left"}, {"action", "stop"}},
        json{{"do", "vacuum"}, {"arm", "left"}, {"action", "stop"}}, json{{"do", "recover"}, {"arm", "left"}},
        json{{"do", "stop"}}, json{{"do", "resume"}}, json{{"do", "state"}}, json{{"do", "reset"}}})
    EXPECT_FALSE(source_->moves(request)) << request;
  EXPECT_THROW((void)source_->moves(parameter("dual", "ofset_m", 0)), RequestRefused);
}

// The offset leads each hand 15 cm further; 2 cm on its way it is let go, and held.
TEST_F(HeldChanges, AHandThatAParameterLeadsStopsWhenItIsLetGo) {
  run("two_arms");
  activate("dual");
  pass(2);  // to the offset of the scene
  EXPECT_EQ(source_->come_to_rest(false), "");
  pass(0.1);
  EXPECT_EQ(owner(), "dual");
  const double from[] = {hand(0), hand(1)};
  ASSERT_EQ(ask(parameter("dual", "offset_m", {0, 0.3, 0}))["ok"], true);
  until([&] { return std::abs(hand(0) - from[0]) > 0.02; });
  EXPECT_NE(source_->come_to_rest(false).find("dual has ended"), std::string::npos);
  until([&] { return owner() == "left_hold"; });
  pass(2);
  EXPECT_EQ(owner(1), "right_hold");
  for (const std::size_t arm : {0u, 1u}) EXPECT_LT(std::abs(hand(arm) - from[arm]), 0.06);
}

TEST_F(HeldChanges, EndInHoldWhenTheyAreLetGoBeforeTheArmHasStoodStill) {
  run("two_arms");
  activate("left_joint");
  EXPECT_NE(source_->come_to_rest(false), "");
  until([&] { return owner() == "left_hold"; });
  ASSERT_EQ(ask({{"do", "set_load"}, {"arm", "right"}, {"mass_kg", 0.1}})["ok"], true);
  EXPECT_NE(source_->come_to_rest(false), "");
  until([&] { return owner(1) == "right_hold"; });
  activate("left_guide");  // a person moves it
  EXPECT_EQ(source_->come_to_rest(false), "");
  pass(0.1);
  EXPECT_EQ(owner(), "left_guide");
}

TEST_F(HeldChanges, EndInHoldWhenNobodyIsHeardOf) {
  run("two_arms");
  activate("left_guide");
  ASSERT_EQ(ask({{"do", "feature"},
                 {"controllet", "right_cartesian"},
                 {"name", "joint_limits"},
                 {"on", false}})["ok"],
            true);
  pass(1);
  EXPECT_EQ(source_->come_to_rest(true), "");
  until([&] { return owner() == "left_hold" && owner(1) == "right_hold"; });
}

TEST_F(HeldChanges, AGripperStopsWhenItIsLetGo) {
  run("grippers");
  const double from = width();
  auto reply = source_->ask(
      {{"do", "gripper"}, {"arm", "left"}, {"action", "move"}, {"width_m", 0.0}, {"speed_m_per_s", 0.02}},
      host_now());
  until([&] { return width() < from - 0.01; });
  (void)source_->come_to_rest(false);
  json answer;
  until([&] {
    const auto done = std::get<Later>(reply)();
    if (done) answer = done->answer;
    return done.has_value();
  });
  EXPECT_EQ(answer["ok"], false) << answer;
  pass(0.5);
  const double stopped = width();
  pass(0.5);
  EXPECT_NEAR(width(), stopped, 1e-4);
  EXPECT_GT(stopped, 0.02);
}

// Whose page is gone before the loop has taken it.
TEST_F(HeldChanges, ASwitchToHoldCountsWithoutItsPage) {
  run("two_arms");
  activate("left_joint");
  (void)source_->ask({{"do", "switch"}, {"deactivate", "left_joint"}}, host_now());  // no longer asked for
  until([&] { return owner() == "left_hold"; });
}

TEST_F(HeldChanges, SuctionStopsWhenItIsLetGo) {
  run("grippers");
  activate("right_pose");
  pass(1);
  (void)source_->come_to_rest(false);
  auto reply =
      source_->ask({{"do", "vacuum"}, {"arm", "right"}, {"action", "on"}, {"timeout_s", 60}}, host_now());
  pass(0.1);
  ASSERT_FALSE(std::get<Later>(reply)().has_value());
  EXPECT_EQ(source_->come_to_rest(false), "");
  const double let_go = state()["t_s"].get<double>();
  json answer;
  until([&] {
    const auto done = std::get<Later>(reply)();
    if (done) answer = done->answer;
    return done.has_value();
  });
  EXPECT_LT(state()["t_s"].get<double>() - let_go, 20) << answer;
  EXPECT_EQ(answer["ok"], false) << answer;
  EXPECT_EQ(owner(1), "right_pose") << "it does not move the arm";
}

// The stop finds no place among other requests, here of somebody who floods the gripper with them.
TEST_F(HeldChanges, AGripperThatRefusesToStopIsShown) {
  run("grippers");
  const json move = {
      {"do", "gripper"}, {"arm", "left"}, {"action", "move"}, {"width_m", 0.0}, {"speed_m_per_s", 0.001}};
  std::string cause;
  while (cause.empty()) {
    auto reply = source_->ask(move, host_now());
    std::vector<std::future<RequestAnswer>> flood;
    for (int k = 0; k < 1000; ++k) flood.push_back(session_->backend().request(0, GripperStop{}));
    cause = source_->come_to_rest(false);
  }
  EXPECT_NE(cause.find("the gripper of left may still move"), std::string::npos) << cause;
  const auto shown = [this] { return state()["arms"][0].value("reason", ""); };
  EXPECT_NE(shown().find("may still move"), std::string::npos) << shown();
  (void)source_->ask(move, host_now());
  EXPECT_EQ(shown().find("may still move"), std::string::npos) << "a new motion";
}

}  // namespace

namespace {

std::vector<double> rest(Quantity quantity, const std::vector<double>& before, const std::vector<double>& now,
                         double dt = 1e-3) {
  return MovedInputs::resting_place(quantity, before, now, dt);
}

std::vector<double> pose(double x, double yaw) {
  return {x, 0, 0.4, std::cos(yaw / 2), 0, 0, std::sin(yaw / 2)};
}

double yaw_of(const std::vector<double>& pose) { return 2 * std::atan2(pose[6], pose[3]); }

TEST(RestingPlace, IsThePlaceOfWhatRests) {
  EXPECT_EQ(rest(Quantity::joints, {1, 2}, {1, 2}), (std::vector<double>{1, 2}));
  EXPECT_EQ(rest(Quantity::pose, pose(0.5, 0), pose(0.5, 0)), pose(0.5, 0));
  EXPECT_EQ(rest(Quantity::scalar, {1}, {2}), std::vector<double>{2});
  EXPECT_EQ(rest(Quantity::joints, {1}, {2}, 0), std::vector<double>{2});  // nothing is known of its speed
}

TEST(RestingPlace, OfForcesAndSpeedsIsZero) {
  EXPECT_EQ(rest(Quantity::wrench, {1, 2, 3, 4, 5, 6}, {1, 2, 3, 4, 5, 6}), std::vector<double>(6, 0));
  EXPECT_EQ(rest(Quantity::twist, {1, 2, 3, 4, 5, 6}, {1, 2, 3, 4, 5, 6}), std::vector<double>(6, 0));
}

// Constant braking from v takes v^2 / 2a; within 0.1 s at least, half of v times that.
TEST(RestingPlace, IsAheadByTheBrakingDistance) {
  EXPECT_NEAR(rest(Quantity::pose, pose(0.5 - 0.0001, 0), pose(0.5, 0))[0], 0.5 + 0.1 * 0.05, 1e-9);
  EXPECT_NEAR(rest(Quantity::pose, pose(0.5 + 0.001, 0), pose(0.5, 0))[0], 0.5 - 1.0 / 8, 1e-9);
  EXPECT_NEAR(rest(Quantity::joints, {0.998}, {1})[0], 1 + 4.0 / 10, 1e-9);
  EXPECT_NEAR(yaw_of(rest(Quantity::pose, pose(0.5, 0.3 - 0.0005), pose(0.5, 0.3))), 0.3 + 0.5 * 0.05, 1e-6);
  EXPECT_NEAR(yaw_of(rest(Quantity::pose, pose(0.5, 0.3 + 0.002), pose(0.5, 0.3))), 0.3 - 4.0 / 16, 1e-6);
}

}  // namespace

}  // namespace multipanda::cockpit::held_changes_test
