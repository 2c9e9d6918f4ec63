// A run with names and types of multipanda_ros2, driven by clients that know only these. Bases are turned.
#include "ros/adapter/compat/compat.hpp"

#include <algorithm>
#include <compat_test_msgs/msg/cartesian_impedance_goal.hpp>
#include <compat_test_msgs/msg/dual_cartesian_impedance_goal.hpp>
#include <compat_test_msgs/msg/franka_state.hpp>
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
#include <mutex>
#include <sensor_msgs/msg/joint_state.hpp>
#include <thread>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ros/adapter/compat/packages.hpp"
#include "ros/adapter/compat/state_fields.hpp"
#include "ros/adapter/compat/untyped.hpp"
#include "ros/adapter/ros_adapter.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::ros::compat_test {
namespace {

using namespace std::chrono_literals;
using namespace compat_test_msgs;
using testing::ElementsAre;
using testing::HasSubstr;

bool wait_for(const std::function<bool()>& condition, std::chrono::seconds deadline = 30s) {
  const auto until = std::chrono::steady_clock::now() + deadline;
  while (!condition()) {
    if (std::chrono::steady_clock::now() > until) return false;
    std::this_thread::sleep_for(500us);
  }
  return true;
}

constexpr const char* kScene =
    "arms:\n"
    "  - {name: left, base: {position_m: [0, 0.5, 0], rpy_rad: [0, 0, 0.6]},\n"
    "     collision: {torque_upper_nm: 30, wrench_upper: 40}}\n"
    "  - {name: right, base: {position_m: [0.1, -0.5, 0], rpy_rad: [0, 0, -1.2]}}\n"
    "controllets:\n"
    "  - {name: left_joint, type: joint_impedance, arms: left}\n"
    "  - {name: right_joint, type: joint_impedance, arms: right}\n"
    "  - {name: left_hand, type: cartesian_impedance, arms: left}\n"
    "  - {name: right_hand, type: cartesian_impedance, arms: right}\n"
    "  - {name: dual, type: dual_cartesian_impedance, arms: [left, right], parameters: {goals: separate}}\n"
    "active: [left_hand, right_hand]\n"
    "ros: {node: mc, compat: multipanda_ros2}\n";

class Compat : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    setenv("ROS_DOMAIN_ID", std::to_string(1 + ::getpid() % 100).c_str(), 1);
    setenv("FASTDDS_BUILTIN_TRANSPORTS", "SHM", 1);
    setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT", 1);
    registry = new Registry(Registry::with_builtins());
    SessionOptions options;
    options.duration_s = 0;
    options.make_adapter = [](const RunContext& run) {
      RosOptions ros;
      static_cast<RosSection&>(ros) = run.scene->ros;
      ros.compat_arm_messages = ros.compat_mode_messages = "compat_test_msgs";
      auto made = std::make_unique<RosAdapter>(run, ros);
      adapter = made.get();
      return made;
    };
    session = new Session(parse_scene(kScene, "test.yaml", *registry), *registry, std::move(options));
    session->start();
    client = new ClientSide;
  }
  static void TearDownTestSuite() {
    delete client;
    session->stop();
    (void)session->finish();
    delete session;
    delete registry;
  }
  struct ClientSide {
    Context context;
    Node node{context, "tester"};
    Executor executor;
    std::mutex mutex;
    std::array<msg::FrankaState, 2> states;
    std::array<std::size_t, 2> counts{};
    std::vector<std::unique_ptr<Subscription<msg::FrankaState>>> subscriptions;
    ClientSide() {
      for (std::size_t i = 0; i < 2; ++i) {
        subscriptions.push_back(std::make_unique<Subscription<msg::FrankaState>>(
            executor, node, std::string(i == 0 ? "/left" : "/right") + "_state_broadcaster/robot_state",
            Qos::reliable(), Doc{}, [this, i](const msg::FrankaState& state) {
              const std::lock_guard lock(mutex);
              states[i] = state;
              ++counts[i];
            }));
      }
      executor.start();
    }
    ~ClientSide() { executor.stop(); }
  };

  // A state that was sent after this call.
  msg::FrankaState state(std::size_t arm) {
    const auto count = [&] {
      const std::lock_guard lock(client->mutex);
      return client->counts[arm];
    };
    const std::size_t before = count();
    EXPECT_TRUE(wait_for([&] { return count() > before + 1; })) << "no states";
    const std::lock_guard lock(client->mutex);
    return client->states[arm];
  }
  template <class S>
  typename S::Response call(const std::string& name, const typename S::Request& request) {
    Client<S> service(client->executor, client->node, name);
    if (!service.wait_until_ready(30)) {
      ADD_FAILURE() << "no service " << name;
      return typename S::Response();
    }
    auto answer = service.call(request);
    if (answer.wait_for(30s) != std::future_status::ready) {
      ADD_FAILURE() << name << " did not answer";
      return typename S::Response();
    }
    return answer.get();
  }
  // A refused request is not answered: that alone tells a client of theirs.
  template <class S>
  void refuse(const std::string& name, const typename S::Request& request) {
    Client<S> service(client->executor, client->node, name);
    ASSERT_TRUE(service.wait_until_ready(30)) << name;
    const std::uint64_t were = adapter->run().counters->requests_refused.load();
    auto answer = service.call(request);
    EXPECT_TRUE(wait_for([&] { return adapter->run().counters->requests_refused.load() == were + 1; }))
        << name;
    EXPECT_EQ(answer.wait_for(1s), std::future_status::timeout) << name;
  }
  using Controllers = std::vector<std::pair<std::string, std::string>>;
  static srv::SetControllers::Request switch_to(const Controllers& controllers) {
    srv::SetControllers::Request request;
    for (const auto& [name, resource] : controllers) {
      request.controllers.emplace_back();
      request.controllers.back().name = name;
      request.controllers.back().resources = {resource};
    }
    return request;
  }
  void set(const Controllers& controllers) {
    (void)call<srv::SetControllers>("/mc/set_controllers", switch_to(controllers));
  }
  void refuse_set(const Controllers& controllers) {
    refuse<srv::SetControllers>("/mc/set_controllers", switch_to(controllers));
  }
  std::vector<std::string> active() {
    std::vector<std::string> names;
    const auto list = call<srv::GetControllers>("/mc/get_controllers", srv::GetControllers::Request());
    for (const auto& one : list.controllers) names.push_back(one.name + " on " + one.resources.at(0));
    return names;
  }
  static Diagnostic line(const std::string& name) {
    for (const auto& each : adapter->diagnostics()) {
      if (each.name == name) return each;
    }
    return {.name = name, .level = Diagnostic::Level::ok, .message = "no line", .values = {}};
  }
  static std::string trouble(const std::string& name) { return line(name).message; }
  static std::uint64_t accepted() { return adapter->run().counters->samples_accepted.load(); }
  static std::uint64_t refused() { return adapter->run().counters->samples_refused.load(); }
  static std::vector<double> parameter(const std::string& instance, const std::string& name) {
    const Instance& law = session->modes().instance(session->modes().find(instance));
    return law.parameter(law.find_parameter(name));
  }
  msg::FrankaState newest(std::size_t arm) {
    const std::lock_guard lock(client->mutex);
    return client->states[arm];
  }
  static std::string owner(ArmIndex arm) {
    return session->modes().instance(session->modes().owner(arm)).name();
  }
  // Streams until the condition holds. On a computer that stalls for the input's timeout the arm is held;
  // then the controllet is activated again, as a client would.
  template <class M>
  bool stream(Publisher<M>& publisher, const M& message, const std::string& name, const std::string& resource,
              const std::string& instance, const std::function<bool()>& reached) {
    const ArmIndex arm = session->modes().instance(session->modes().find(instance)).arm_list()[0];
    return wait_for([&] {
      if (owner(arm) != instance) set({{name, resource}});
      publisher.publish(message);
      std::this_thread::sleep_for(1ms);
      return reached();
    });
  }
  // A client that goes on streaming until the end of the returned thread, whatever happens.
  template <class M>
  static std::jthread keep_streaming(Publisher<M>& publisher, const M& message) {
    return std::jthread([&publisher, message](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        publisher.publish(message);
        std::this_thread::sleep_for(1ms);
      }
    });
  }
  template <class M>
  std::unique_ptr<Publisher<M>> sender(const std::string& topic) {
    auto made = std::make_unique<Publisher<M>>(client->node, topic, Qos::reliable(1), Doc{});
    EXPECT_TRUE(wait_for([&] { return made->subscribers() > 0; })) << topic;
    return made;
  }

  static inline Registry* registry;
  static inline Session* session;
  static inline RosAdapter* adapter;
  static inline ClientSide* client;
};

geometry_msgs::msg::Pose pose_of(const std::array<double, 16>& values) {
  const Eigen::Map<const Eigen::Matrix4d> X(values.data());
  const Eigen::Quaterniond q(Matrix3(X.topLeftCorner<3, 3>()));
  geometry_msgs::msg::Pose pose;
  pose.position.x = X(0, 3), pose.position.y = X(1, 3), pose.position.z = X(2, 3);
  pose.orientation.w = q.w(), pose.orientation.x = q.x();
  pose.orientation.y = q.y(), pose.orientation.z = q.z();
  return pose;
}

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
  EXPECT_THAT(trouble(kLine), HasSubstr("are one controllet here, 'left_joint'"));
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

// The operator who asks for a controllet, or for one without goals, finds the arm standing still, although
// the client of another name goes on streaming to it. Both names are one controllet here.
TEST_F(Compat, AnArmStandsStillWhenAnotherNameIsAskedFor) {
  const auto velocities = sender<msg::VelocityGoal>("/right/panda_joint_velocity_controller/desired_pose");
  const auto positions = sender<msg::JointGoal>("/right/panda_joint_impedance_controller/desired_pose");
  msg::VelocityGoal turn;
  turn.qd = {0, 0, 0, 0, 0, 0, 0.1};
  for (const std::string asked :
       {"panda_joint_impedance_controller", "comless_panda_joint_impedance_controller"}) {
    set({{"panda_joint_impedance_controller", "left"}, {"panda_joint_velocity_controller", "right"}});
    const double before = state(1).q[6];
    ASSERT_TRUE(stream(*velocities, turn, "panda_joint_velocity_controller", "right", "right_joint",
                       [&] { return std::abs(newest(1).q[6] - before) > 0.03; }));
    const std::jthread goes_on = keep_streaming(*velocities, turn);
    set({{asked, "right"}});
    const double q = state(1).q[6];
    EXPECT_EQ(owner(1), "right_joint");
    EXPECT_THAT(active(), testing::Contains(asked + " on right"));
    const std::uint64_t were = refused();
    double most = 0;
    EXPECT_TRUE(wait_for([&] {
      most = std::max(most, std::abs(newest(1).q[6] - q));
      return refused() >= were + 400;
    }));
    EXPECT_LT(most, 0.01) << "0.04 rad at the speed of the stream";
    EXPECT_EQ(owner(1), "right_joint");
    turn.qd[6] *= -1;
  }
  set({{"panda_joint_impedance_controller", "right"}});
  const std::uint64_t taken = accepted();
  msg::JointGoal here;
  here.q = state(1).q;
  EXPECT_TRUE(stream(*positions, here, "panda_joint_impedance_controller", "right", "right_joint",
                     [&] { return accepted() > taken; }));
}

// As theirs, a controllet that is asked for again starts again, where the arm is.
TEST_F(Compat, AskingAgainStartsAgain) {
  set({{"panda_joint_impedance_controller", "left"}, {"panda_joint_impedance_controller", "right"}});
  Publisher<sensor_msgs::msg::JointState> goals(client->node, "/mc/left_joint/joints/goal", Qos::reliable(1),
                                                Doc{});
  ASSERT_TRUE(wait_for([&] { return goals.subscribers() > 0; }));
  const auto before = state(0).q;
  sensor_msgs::msg::JointState far;
  far.position.assign(before.begin(), before.end());
  far.position[6] += before[6] > 0.5 ? -1.0 : 1.0;
  goals.publish(far);
  ASSERT_TRUE(wait_for([&] { return std::abs(newest(0).q[6] - before[6]) > 0.1; }));
  set({{"panda_joint_impedance_controller", "left"}});
  const double q = state(0).q[6];
  ASSERT_GT(std::abs(q - far.position[6]), 0.2) << "the goal came too early to tell";
  double most = 0;
  for (int k = 0; k < 600; ++k) {
    std::this_thread::sleep_for(1ms);
    most = std::max(most, std::abs(newest(0).q[6] - q));
  }
  EXPECT_LT(most, 0.05) << "it would go on at up to 0.5 rad/s";
  EXPECT_EQ(owner(0), "left_joint");
}

// Their guard against jumps, and against a stream that went on while its arm stood still.
TEST_F(Compat, FarGoalsMoveNothing) {
  const std::string name = "panda_cartesian_impedance_controller";
  set({{name, "left"}, {name, "right"}});
  const auto goals = sender<msg::CartesianImpedanceGoal>("/left/" + name + "/desired_pose");
  ASSERT_TRUE(wait_for([&] {
    const auto dq = state(0).dq;
    return std::all_of(dq.begin(), dq.end(), [](double v) { return std::abs(v) < 5e-3; });
  }));
  const auto before = state(0).o_t_ee;
  const auto moved = [&] {
    const auto now = state(0).o_t_ee;
    return std::hypot(now[12] - before[12], now[13] - before[13], now[14] - before[14]);
  };
  const auto far = [&](auto change) {
    msg::CartesianImpedanceGoal goal;
    goal.pose = pose_of(before);
    change(goal);
    return goal;
  };
  for (const auto& goal : {msg::CartesianImpedanceGoal(), far([](auto& g) { g.pose.position.z += 0.11; })}) {
    const std::uint64_t were = refused();
    const std::jthread goes_on = keep_streaming(*goals, goal);
    set({{name, "left"}});
    ASSERT_TRUE(wait_for([&] { return refused() >= were + 100; }));
    set({{name, "left"}});
    ASSERT_TRUE(wait_for([&] { return refused() >= were + 300; }));
    EXPECT_LT(moved(), 1e-3);
    EXPECT_EQ(owner(0), "left_hand");
  }
}

TEST_F(Compat, AStreamedPoseIsFollowedInTheBaseAndHeldAfterwards) {
  set({{"panda_cartesian_impedance_controller", "left"}, {"panda_cartesian_impedance_controller", "right"}});
  const auto goals =
      sender<msg::CartesianImpedanceGoal>("/left/panda_cartesian_impedance_controller/desired_pose");
  const auto before = state(0);
  msg::CartesianImpedanceGoal goal;
  goal.pose = pose_of(before.o_t_ee);
  goal.pose.position.x += 0.03;
  goal.pose.position.y -= 0.02;
  ASSERT_TRUE(stream(*goals, goal, "panda_cartesian_impedance_controller", "left", "left_hand", [&] {
    const auto now = newest(0).o_t_ee;
    return std::hypot(now[12] - goal.pose.position.x, now[13] - goal.pose.position.y) < 3e-3;
  }));
  ASSERT_TRUE(wait_for([] { return owner(0) == "left_hold"; })) << "when it is silent";
  EXPECT_EQ(owner(1), "right_hand");
  goal.pose.orientation.w = 5;
  ASSERT_TRUE(stream(*goals, goal, "panda_cartesian_impedance_controller", "left", "left_hand",
                     [] { return trouble("left_hand/pose").find("unit quaternion") != std::string::npos; }));
}

TEST_F(Compat, TwoPosesAreFollowedTogetherOrNotAtAll) {
  set({{"dual_cartesian_impedance_controller", "left&right"}});
  const auto goals = sender<msg::DualCartesianImpedanceGoal>(
      "/left_and_right/dual_cartesian_impedance_controller/desired_pose");
  msg::DualCartesianImpedanceGoal goal;
  goal.l_pose = pose_of(state(0).o_t_ee);
  goal.r_pose = pose_of(state(1).o_t_ee);
  goal.l_pose.position.z += 0.02;
  goal.r_pose.position.z += 0.03;
  goal.r_pose.position.y = NAN;
  const std::uint64_t taken = accepted(), were = refused();
  goals->publish(goal);
  ASSERT_TRUE(wait_for([&] { return refused() == were + 2; })) << "both arms' inputs refuse it";
  EXPECT_EQ(accepted(), taken);
  EXPECT_THAT(trouble("dual/first_pose"), HasSubstr("dual/second_pose: a number is not finite"));
  goal.r_pose.position.y = pose_of(state(1).o_t_ee).position.y;
  ASSERT_TRUE(stream(*goals, goal, "dual_cartesian_impedance_controller", "left&right", "dual", [&] {
    return std::abs(newest(0).o_t_ee[14] - goal.l_pose.position.z) < 3e-3 &&
           std::abs(newest(1).o_t_ee[14] - goal.r_pose.position.z) < 3e-3;
  }));
}

TEST_F(Compat, JointsFollowPositionsAndVelocities) {
  set({{"panda_joint_impedance_controller", "left"}, {"panda_joint_impedance_controller", "right"}});
  const auto positions = sender<msg::JointGoal>("/left/panda_joint_impedance_controller/desired_pose");
  msg::JointGoal goal;
  goal.q = state(0).q;
  goal.q[6] += 0.08;
  ASSERT_TRUE(stream(*positions, goal, "panda_joint_impedance_controller", "left", "left_joint",
                     [&] { return std::abs(newest(0).q[6] - goal.q[6]) < 0.01; }));
  const auto velocities = sender<msg::VelocityGoal>("/right/panda_joint_velocity_controller/desired_pose");
  set({{"panda_joint_velocity_controller", "right"}});
  const double q7 = state(1).q[6];
  msg::VelocityGoal turn;
  turn.qd = {0, 0, 0, 0, 0, 0, -0.2};
  ASSERT_TRUE(stream(*velocities, turn, "panda_joint_velocity_controller", "right", "right_joint",
                     [&] { return newest(1).q[6] < q7 - 0.05; }));
  ASSERT_TRUE(wait_for([] { return owner(1) == "right_hold"; })) << "when it is silent";
  EXPECT_GT(newest(1).q[6], q7 - 0.2) << "it does not run on";
  turn.qd[2] = 9;
  ASSERT_TRUE(stream(*velocities, turn, "panda_joint_velocity_controller", "right", "right_joint", [] {
    return trouble("right_joint/joints").find("joint 3: 9 rad/s") != std::string::npos;
  }));
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
  EXPECT_THAT(above.error, HasSubstr("35 is above 30"));

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
