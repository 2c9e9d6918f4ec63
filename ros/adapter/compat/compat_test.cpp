// A run with names and types of multipanda_ros2, driven by clients that know only these. Bases are turned.
#include <compat_test_msgs/msg/cartesian_impedance_goal.hpp>
#include <compat_test_msgs/msg/joint_goal.hpp>
#include <compat_test_msgs/msg/velocity_goal.hpp>
#include <compat_test_msgs/srv/error_recovery.hpp>
#include <compat_test_msgs/srv/get_controllers.hpp>
#include <compat_test_msgs/srv/get_robot_states.hpp>
#include <compat_test_msgs/srv/set_cartesian_impedance.hpp>
#include <compat_test_msgs/srv/set_controllers.hpp>
#include <compat_test_msgs/srv/set_full_collision_behavior.hpp>
#include <compat_test_msgs/srv/set_joint_impedance.hpp>
#include <compat_test_msgs/srv/set_load.hpp>
#include <compat_test_msgs/srv/set_tcp_frame.hpp>
#include <cstdlib>
#include <sensor_msgs/msg/joint_state.hpp>
#include <unistd.h>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/compat/controllet_names.hpp"
#include "ros/adapter/compat/state_fields.hpp"
#include "ros/adapter/compat/testing/compat_fixture.hpp"
#include "ros/adapter/compat/untyped.hpp"

namespace multipanda::ros::compat_test {
namespace {

TEST_F(Compat, SwitchesByTheirNamesAndLogsRefusals) {
  set({{"panda_cartesian_impedance_controller", "left"}, {"panda_cartesian_impedance_controller", "right"}});
  set({{"comless_panda_joint_impedance_controller", "left"}});
  EXPECT_THAT(active(), testing::UnorderedElementsAre("comless_panda_joint_impedance_controller on left",
                                                      "panda_cartesian_impedance_controller on right"));
  set({{"dual_cartesian_impedance_controller", "left&right"}});
  EXPECT_THAT(active(), ElementsAre("dual_cartesian_impedance_controller on left&right"));
  EXPECT_EQ(trouble("compat ~/set_controllers"), "");

  // Their answer has no field for a refusal: there is none, nothing changes, and diagnostics say why.
  const char* const kLine = "compat ~/set_controllers";
  refuse_set({{"panda_joint_impedance_controller", "left"}, {"no_such_controller", "right"}});
  EXPECT_THAT(active(), ElementsAre("dual_cartesian_impedance_controller on left&right"));
  EXPECT_THAT(trouble(kLine), HasSubstr("no controllet 'no_such_controller'"));
  EXPECT_EQ(line(kLine).level, Diagnostic::Level::error);
  refuse_set(
      {{"dual_cartesian_impedance_controller", "left&right"}, {"panda_joint_impedance_controller", "left"}});
  EXPECT_THAT(trouble(kLine), HasSubstr("own arm 'left'"));
  refuse_set({{"panda_joint_impedance_controller", "left"}, {"panda_joint_velocity_controller", "left"}});
  EXPECT_THAT(trouble(kLine), HasSubstr("are both the controllet 'left_joint' here"));
  refuse_set({});
  EXPECT_THAT(trouble(kLine), HasSubstr("names no controllet"));
  // What two hands carry would fall.
  refuse_set({{"panda_joint_impedance_controller", "left"}});
  EXPECT_THAT(trouble(kLine), HasSubstr("'dual' also controls right"));
  EXPECT_THAT(active(), ElementsAre("dual_cartesian_impedance_controller on left&right"));
  set({{"panda_joint_impedance_controller", "left"}, {"right_hold", "right"}});
  EXPECT_THAT(active(), ElementsAre("panda_joint_impedance_controller on left"));
  EXPECT_EQ(owner(1), "right_hold");
  EXPECT_EQ(line(kLine).level, Diagnostic::Level::ok);
}

TEST_F(Compat, ParametersAreSetAllOrNone) {
  srv::SetCartesianImpedance::Request request;
  for (std::size_t i = 0; i < 6; ++i) request.stiffness[7 * i] = i < 3 ? 350 : 15;
  request.damping_ratio.fill(0.7);
  request.nullspace_stiffness = 12;
  const std::string service = "/left/panda_cartesian_impedance_controller/parameters";
  (void)call<srv::SetCartesianImpedance>(service, request);
  EXPECT_THAT(parameter("left_hand", "translational_stiffness_n_per_m"), ElementsAre(350, 350, 350));
  EXPECT_THAT(parameter("left_hand", "rotational_stiffness_nm_per_rad"), ElementsAre(15, 15, 15));
  EXPECT_THAT(parameter("left_hand", "damping_ratio"), ElementsAre(0.7));
  EXPECT_THAT(parameter("left_hand", "nullspace_stiffness_nm_per_rad"), ElementsAre(12));
  const std::string name = "compat left/panda_cartesian_impedance_controller/parameters";
  EXPECT_EQ(line(name).level, Diagnostic::Level::ok);
  for (std::size_t i = 0; i < 3; ++i) request.stiffness[7 * i] = 200;
  request.nullspace_stiffness = 1e4;  // beyond our bound
  refuse<srv::SetCartesianImpedance>(service, request);
  EXPECT_THAT(trouble(name), HasSubstr("nullspace_stiffness"));
  EXPECT_EQ(line(name).level, Diagnostic::Level::error);
  request.nullspace_stiffness = 12;
  request.damping_ratio[2] = 1;
  refuse<srv::SetCartesianImpedance>(service, request);
  EXPECT_THAT(trouble(name), HasSubstr("six equal numbers"));
  // Soft along one axis, for a hand, in a base that is turned: the arm stays stiff, so no client may take it
  // for soft.
  request.damping_ratio[2] = 0.7;
  request.stiffness[0] = 50;
  refuse<srv::SetCartesianImpedance>(service, request);
  EXPECT_THAT(trouble(name), HasSubstr("diagonal in the axes of the world"));
  request.stiffness[0] = 200;
  Request design{
      .kind = Request::Kind::set_parameter, .instance = session->modes().find("left_hand"), .size = 1};
  design.index =
      static_cast<std::uint16_t>(session->modes().instance(design.instance).find_parameter("damping_design"));
  design.values[0] = 1;  // given, without a ratio
  ASSERT_TRUE(session->modes().ask(design).accepted());
  refuse<srv::SetCartesianImpedance>(service, request);
  EXPECT_THAT(trouble(name), HasSubstr("damping_design of 'left_hand' is 'given': set it to 'coupled'"));
  design.values[0] = 0;
  ASSERT_TRUE(session->modes().ask(design).accepted());
  EXPECT_THAT(parameter("left_hand", "translational_stiffness_n_per_m"), ElementsAre(350, 350, 350));

  srv::SetJointImpedance::Request scale;
  scale.stiffness_scale = 0.5;
  (void)call<srv::SetJointImpedance>("/right/panda_joint_impedance_controller/parameters", scale);
  EXPECT_THAT(parameter("right_joint", "stiffness_nm_per_rad"), ElementsAre(300, 300, 300, 300, 125, 75, 25));
  scale.stiffness_scale = -1;
  refuse<srv::SetJointImpedance>("/right/panda_joint_impedance_controller/parameters", scale);
  EXPECT_THAT(parameter("right_joint", "stiffness_nm_per_rad"), ElementsAre(300, 300, 300, 300, 125, 75, 25));
}

// Each of their controllets has parameters of its own: nobody makes an arm stiff that another one has
// softened for a hand, and a switch gives each its own back.
TEST_F(Compat, EachNameHasItsOwnParameters) {
  const auto names = {"panda_joint_impedance_controller", "panda_joint_velocity_controller",
                      "comless_panda_joint_impedance_controller"};
  const auto service = [](const std::string& name) { return "/right/" + name + "/parameters"; };
  const auto stiffness = [] { return parameter("right_joint", "stiffness_nm_per_rad")[0]; };
  srv::SetJointImpedance::Request soft, stiff;
  soft.stiffness_scale = 0.1;
  stiff.stiffness_scale = 1;
  set({{"panda_joint_impedance_controller", "right"}});
  (void)call<srv::SetJointImpedance>(service("panda_joint_impedance_controller"), soft);
  EXPECT_DOUBLE_EQ(stiffness(), 60);
  for (const std::string name : names) {
    if (name == "panda_joint_impedance_controller") continue;
    refuse<srv::SetJointImpedance>(service(name), stiff);
    EXPECT_THAT(trouble("compat right/" + name + "/parameters"), HasSubstr("'right_joint' is active as"));
    EXPECT_DOUBLE_EQ(stiffness(), 60);
  }
  set({{"panda_joint_velocity_controller", "right"}});
  const Instance& law = session->modes().instance(session->modes().find("right_joint"));
  const auto of_the_scene = law.parameter_spec(law.find_parameter("stiffness_nm_per_rad")).initial;
  EXPECT_DOUBLE_EQ(stiffness(), of_the_scene[0]) << "it has none of its own";
  (void)call<srv::SetJointImpedance>(service("panda_joint_velocity_controller"), stiff);
  EXPECT_DOUBLE_EQ(stiffness(), 600);
  set({{"panda_joint_impedance_controller", "right"}});
  EXPECT_DOUBLE_EQ(stiffness(), 60);
  set({{"panda_joint_velocity_controller", "right"}});
  EXPECT_DOUBLE_EQ(stiffness(), 600);
  // What was refused after its parameters were set leaves nothing of them behind.
  set({{"panda_joint_impedance_controller", "right"}});
  reluctant = true;
  refuse_set({{"panda_joint_velocity_controller", "right"}});
  EXPECT_EQ(owner(1), "right_hold");
  reluctant = false;
  set({{"panda_joint_impedance_controller", "right"}});
  EXPECT_DOUBLE_EQ(stiffness(), 60);
  // Set meanwhile by their own name, while another law has the arm, or by ours, which nothing undoes.
  set({{"panda_cartesian_impedance_controller", "right"}});
  (void)call<srv::SetJointImpedance>(service("panda_joint_impedance_controller"), soft);
  EXPECT_DOUBLE_EQ(stiffness(), 60);
  Request ours{
      .kind = Request::Kind::set_parameter, .instance = session->modes().find("right_joint"), .size = 7};
  ours.index = static_cast<std::uint16_t>(
      session->modes().instance(ours.instance).find_parameter("stiffness_nm_per_rad"));
  std::fill_n(ours.values.begin(), 7, 30);
  ASSERT_TRUE(session->modes().ask(ours).accepted());
  set({{"panda_joint_velocity_controller", "right"}});
  EXPECT_DOUBLE_EQ(stiffness(), 30);
}

// Two clients ask for one controllet at once: one is answered, and the stiffness is that of its name.
TEST_F(Compat, OneOfTwoRequestsAtOnceIsAnswered) {
  const auto stiffness = [] { return parameter("right_joint", "stiffness_nm_per_rad")[0]; };
  const std::map<std::string, double> scales = {{"panda_joint_impedance_controller", 0.1},
                                                {"panda_joint_velocity_controller", 1}};
  for (const auto& [name, scale] : scales) {
    set({{name, "right"}});
    srv::SetJointImpedance::Request request;
    request.stiffness_scale = scale;
    (void)call<srv::SetJointImpedance>("/right/" + name + "/parameters", request);
  }
  Client<srv::SetControllers> service(client->executor, client->node, "/mc/set_controllers");
  ASSERT_TRUE(service.wait_until_ready(30));
  for (int k = 0; k < 20; ++k) {
    std::vector<std::future<srv::SetControllers::Response>> answers;
    for (const auto& [name, scale] : scales) answers.push_back(service.call(switch_to({{name, "right"}})));
    EXPECT_TRUE(wait_for([&] {
      return std::ranges::any_of(
          answers, [](auto& answer) { return answer.wait_for(0s) == std::future_status::ready; });
    }));
    const auto now = active();
    for (const auto& [name, scale] : scales) {
      if (std::ranges::find(now, name + " on right") == now.end()) continue;
      EXPECT_DOUBLE_EQ(stiffness(), 600 * scale) << name;
    }
  }
}

// What starts again has ended before: if it cannot start, its arms are held, and the refusal says so.
TEST_F(Compat, WhatCannotStartAgainIsHeld) {
  set({{"panda_joint_impedance_controller", "left"}, {"panda_joint_impedance_controller", "right"}});
  const Controllers both{{"panda_joint_impedance_controller", "left"},
                         {"panda_joint_impedance_controller", "right"}};
  reluctant = true;
  refuse_set(both);
  EXPECT_THAT(trouble("compat ~/set_controllers"), HasSubstr("its active controllets have ended"));
  EXPECT_EQ(owner(0), "left_hold");
  EXPECT_EQ(owner(1), "right_hold");
  reluctant = false;
  set(both);
  // A stopped arm is known before anything ends.
  session->modes().stop(ArmSet::of(1));
  ASSERT_TRUE(wait_for([] { return owner(1) == "right_hold"; }));
  refuse_set(both);
  EXPECT_THAT(trouble("compat ~/set_controllers"), HasSubstr("stopped: right"));
  EXPECT_EQ(owner(0), "left_joint");
  ASSERT_TRUE(session->modes().ask({.kind = Request::Kind::resume, .arms = ArmSet::of(1)}).accepted());
}

TEST_F(Compat, ArmsTakeTheirRequestsWithOurRefusals) {
  srv::SetLoad::Request load;
  load.mass = 0.4;
  load.center_of_mass = {0, 0.01, 0.05};
  load.load_inertia = {1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3};
  const auto set = call<srv::SetLoad>("/left_param_service_server/set_load", load);
  EXPECT_TRUE(set.success) << set.error;
  ASSERT_TRUE(wait_for([&] { return state(0).m_load == 0.4; }));
  load.mass = -1;
  EXPECT_FALSE(call<srv::SetLoad>("/left_param_service_server/set_load", load).success);
  load.mass = 0;  // it holds nothing: with 0.4 kg declared it would rise a little at every start
  load.center_of_mass = {};
  load.load_inertia = {};
  EXPECT_TRUE(call<srv::SetLoad>("/left_param_service_server/set_load", load).success);

  // Thresholds above those of the scene are refused, as by our own service.
  srv::SetFullCollisionBehavior::Request thresholds;
  for (auto* torques :
       {&thresholds.upper_torque_thresholds_nominal, &thresholds.upper_torque_thresholds_acceleration})
    torques->fill(20);
  for (auto* forces :
       {&thresholds.upper_force_thresholds_nominal, &thresholds.upper_force_thresholds_acceleration})
    forces->fill(20);
  const std::string service = "/left_param_service_server/set_full_collision_behavior";
  const auto lower = call<srv::SetFullCollisionBehavior>(service, thresholds);
  EXPECT_TRUE(lower.success) << lower.error;
  thresholds.upper_torque_thresholds_acceleration[2] = 35;
  const auto above = call<srv::SetFullCollisionBehavior>(service, thresholds);
  EXPECT_FALSE(above.success);
  EXPECT_THAT(above.error, HasSubstr("35 exceeds 30"));

  srv::SetTCPFrame::Request frame;
  const double c = std::cos(0.4), s = std::sin(0.4);
  frame.transformation = {c, s, 0, 0, -s, c, 0, 0, 0, 0, 1, 0, 0.01, 0, 0.05, 1};
  const auto framed = call<srv::SetTCPFrame>("/right_param_service_server/set_tcp_frame", frame);
  EXPECT_TRUE(framed.success) << framed.error;
  ASSERT_TRUE(wait_for([&] { return std::abs(state(1).ne_t_ee[14] - 0.05) < 1e-9; }));
  EXPECT_NEAR(state(1).ne_t_ee[1], s, 1e-9);
  frame.transformation[0] = 2;
  EXPECT_THAT(call<srv::SetTCPFrame>("/right_param_service_server/set_tcp_frame", frame).error,
              HasSubstr("no rotation"));
  (void)call<srv::ErrorRecovery>("/right_error_recovery_service_server/error_recovery",
                                 srv::ErrorRecovery::Request());
}

TEST_F(Compat, StatesAreGivenOnRequest) {
  const auto both =
      call<srv::GetRobotStates>("/left_and_right/get_robot_states", srv::GetRobotStates::Request());
  ASSERT_EQ(both.states.size(), 2u);
  EXPECT_EQ(both.states[0].header.frame_id, "left_link0");
  EXPECT_EQ(both.states[1].header.frame_id, "right_link0");
  const auto right = call<srv::GetRobotStates>("/right/get_robot_states", srv::GetRobotStates::Request());
  ASSERT_EQ(right.states.size(), 1u);
  EXPECT_NEAR(right.states[0].q[3], state(1).q[3], 0.2);
}

TEST(CompatWithoutMessages, IsRefusedAtTheStart) {
  const Registry registry = Registry::with_builtins();
  SessionOptions options;
  options.make_adapter = [](const RunContext& run) {
    RosOptions ros;
    ros.compat = RosSection::Compat::franka_ros2;
    ros.compat_arm_messages = "msgs_that_nobody_has";
    return std::make_unique<RosAdapter>(run, ros);
  };
  try {
    const Session session(parse_scene("arms:\n  - name: left\n", "test.yaml", registry), registry,
                          std::move(options));
    FAIL() << "not refused";
  } catch (const std::exception& error) {
    EXPECT_THAT(error.what(), HasSubstr("'msgs_that_nobody_has' was not found when multipanda was built"));
  }
}

// With the real packages, where this build has found them: clients use their types by introspection, too.
TEST(CompatWithTheirMessages, DriveAnArm) {
  const CompatPackages theirs;
  std::optional<MessageType> state, goal;
  try {
    state = MessageType::find(theirs.arms, "FrankaState");
    goal = MessageType::find(theirs.modes, "CartesianImpedanceGoal");
  } catch (const std::invalid_argument& error) {
    GTEST_SKIP() << error.what();
  }
  const Registry registry = Registry::with_builtins();
  SessionOptions options;
  options.duration_s = 0;
  options.make_adapter = [](const RunContext& run) {
    RosOptions ros;
    static_cast<RosSection&>(ros) = run.scene->ros;
    return std::make_unique<RosAdapter>(run, ros);
  };
  Session session(parse_scene("arms:\n  - {name: left, base: {rpy_rad: [0, 0, 1]}}\n"
                              "controllets: [{name: hand, type: cartesian_impedance, arms: left}]\n"
                              "active: [hand]\nros: {compat: multipanda_ros2}\n",
                              "test.yaml", registry),
                  registry, std::move(options));
  session.start();
  {
    Context context;
    Node node(context, "tester");
    Executor executor;
    std::mutex mutex;
    std::vector<double> X_OE, values;
    const Numbers o_t_ee(*state, {"o_t_ee"}, 16);
    const UntypedSubscription states(executor, node, "/franka_robot_state_broadcaster/robot_state", *state,
                                     Qos::reliable(), Doc{}, [&](const void* message, double) {
                                       const std::lock_guard lock(mutex);
                                       X_OE = o_t_ee.read(message);
                                     });
    executor.start();
    const auto newest = [&] {
      const std::lock_guard lock(mutex);
      return X_OE;
    };
    UntypedPublisher goals(node, "/left/panda_cartesian_impedance_controller/desired_pose", *goal,
                           Qos::reliable(1), Doc{});
    ASSERT_TRUE(wait_for([&] { return !newest().empty() && goals.subscribers() > 0; }));
    const Pose X = read_transform(newest(), "o_t_ee");
    const Quaternion q = X.quaternion();
    const auto message = goal->make();
    Numbers(*goal,
            {"pose.position.x", "pose.position.y", "pose.position.z", "pose.orientation.w",
             "pose.orientation.x", "pose.orientation.y", "pose.orientation.z"},
            7)
        .write(message.get(),
               std::array{X.position.x() - 0.02, X.position.y(), X.position.z(), q.w(), q.x(), q.y(), q.z()});
    const double x = X.position.x();
    EXPECT_TRUE(wait_for([&] {
      goals.publish(message.get());
      std::this_thread::sleep_for(1ms);
      return newest()[12] < x - 0.015;
    }));
    executor.stop();
  }
  session.stop();
  (void)session.finish();
}

}  // namespace
}  // namespace multipanda::ros::compat_test
