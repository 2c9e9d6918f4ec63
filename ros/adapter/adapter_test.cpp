// A run with its adapter and with clients, over shared memory. Covers what the tests of the
// parts cannot.
#include <algorithm>
#include <cstdlib>
#include <functional>
#include <geometry_msgs/msg/pose_stamped.hpp>
#include <geometry_msgs/msg/transform_stamped.hpp>
#include <multipanda_msgs/action/grasp.hpp>
#include <multipanda_msgs/action/move.hpp>
#include <multipanda_msgs/srv/list_arms.hpp>
#include <multipanda_msgs/srv/list_controllets.hpp>
#include <multipanda_msgs/srv/list_features.hpp>
#include <multipanda_msgs/srv/resume_arms.hpp>
#include <multipanda_msgs/srv/set_features.hpp>
#include <multipanda_msgs/srv/stop_arms.hpp>
#include <multipanda_msgs/srv/switch_controllets.hpp>
#include <multipanda_msgs/srv/vacuum_on.hpp>
#include <rcl_interfaces/msg/parameter_event.hpp>
#include <rcl_interfaces/msg/parameter_type.hpp>
#include <rcl_interfaces/srv/get_parameters.hpp>
#include <rcl_interfaces/srv/list_parameters.hpp>
#include <rcl_interfaces/srv/set_parameters.hpp>
#include <rcl_interfaces/srv/set_parameters_atomically.hpp>
#include <std_msgs/msg/float64.hpp>
#include <std_msgs/msg/float64_multi_array.hpp>
#include <std_srvs/srv/trigger.hpp>
#include <thread>
#include <unistd.h>
#include <visualization_msgs/msg/marker_array.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/plugin/load_plugin.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "ros/adapter/ros_adapter.hpp"
#include "ros/rcl/action_client.hpp"
#include "runtime/live_input/request_handler.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::ros::adapter_test {
namespace {

using namespace std::chrono_literals;
using namespace multipanda_msgs::srv;
using geometry_msgs::msg::PoseStamped;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using Type = rcl_interfaces::msg::ParameterType;

bool wait_for(const std::function<bool()>& condition, std::chrono::seconds deadline = 20s) {
  const auto until = std::chrono::steady_clock::now() + deadline;
  while (!condition()) {
    if (std::chrono::steady_clock::now() > until) return false;
    std::this_thread::sleep_for(500us);
  }
  return true;
}

// Counts what the loop's thread does between two calls: a whole cycle, including the adapter's part.
struct Counted {
  std::atomic<std::uint64_t> cycles{0}, heap{0}, locks{0};
  void count_cycle() {  // loop's thread
    if (!kLoopGuardWorks) return;
    const LoopGuardCounts counts = LoopGuard::disarm();
    const std::uint64_t before = cycles.fetch_add(1, std::memory_order_relaxed);
    if (before > 10) {  // the first cycles may allocate
      heap.fetch_add(counts.heap_calls, std::memory_order_relaxed);
      locks.fetch_add(counts.lock_calls, std::memory_order_relaxed);
    }
    LoopGuard::arm();
  }
};

// One run of two simulated arms for all tests.
class Run : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    setenv("ROS_DOMAIN_ID", std::to_string(1 + ::getpid() % 100).c_str(), 1);
    setenv("FASTDDS_BUILTIN_TRANSPORTS", "SHM", 1);
    setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT", 1);
    counted = new Counted;
    OpenedScene opened = open_scene("two_arms");
    opened.scene.timeline.clear();
    registry = new Registry(std::move(opened.registry));
    SessionOptions options;
    options.duration_s = 0;
    options.on_loop = [](const Tick&, const Backend&) { counted->count_cycle(); };
    options.make_adapter = [](const RunContext& run) {
      return std::make_unique<RosAdapter>(run, RosOptions{});
    };
    session = new Session(std::move(opened.scene), *registry, std::move(options));
    session->start();
    client = new ClientSide;
  }
  static void TearDownTestSuite() {
    delete client;
    session->stop();
    (void)session->finish();
    delete session;
    delete registry;
    delete counted;
  }
  struct ClientSide {
    Context context;
    Node node{context, "tester"};
    Executor executor;
    ClientSide() { executor.start(); }
    ~ClientSide() { executor.stop(); }
  };

  template <class S>
  typename S::Response call(const std::string& name, const typename S::Request& request) {
    Client<S> service(client->executor, client->node, "/multipanda/" + name);
    if (!service.wait_until_ready(20)) {
      ADD_FAILURE() << "no service " << name;
      return typename S::Response();
    }
    auto answer = service.call(request);
    if (answer.wait_for(20s) != std::future_status::ready) {
      ADD_FAILURE() << name << " did not answer";
      return typename S::Response();
    }
    return answer.get();
  }
  SwitchControllets::Response switch_to(std::vector<std::string> names,
                                        const std::string& by = "switch_controllets") {
    SwitchControllets::Request request;
    request.activate = std::move(names);
    return call<SwitchControllets>(by, request);
  }
  static rcl_interfaces::msg::Parameter number(const std::string& name, double value) {
    rcl_interfaces::msg::Parameter parameter;
    parameter.name = name;
    parameter.value.type = Type::PARAMETER_DOUBLE;
    parameter.value.double_value = value;
    return parameter;
  }

  static inline Counted* counted;
  static inline Registry* registry;
  static inline Session* session;
  static inline ClientSide* client;
};

TEST_F(Run, SwitchesAndReportsTimesOrReasons) {
  ASSERT_TRUE(switch_to({"left_cartesian", "right_cartesian"}).accepted);
  const std::int64_t sent = host_now().ns;
  const auto both = switch_to({"dual"});
  const std::int64_t answered = host_now().ns;
  ASSERT_TRUE(both.accepted) << both.reason;
  EXPECT_EQ(both.verdict, "accepted");
  EXPECT_THAT(both.started, ElementsAre("dual"));
  EXPECT_THAT(both.stopped, testing::UnorderedElementsAre("left_cartesian", "right_cartesian"));
  EXPECT_THAT(both.arms, ElementsAre("left", "right"));
  EXPECT_GT(both.first_torque_ns, sent);
  EXPECT_LT(both.first_torque_ns, answered);
  EXPECT_GT(both.total_s, 0);
  EXPECT_LE(both.total_s, 1e-9 * static_cast<double>(both.first_torque_ns - sent));
  EXPECT_NEAR(both.total_s, both.waiting_s + both.computing_s, 1e-9);

  const auto twice = switch_to({"dual", "left_joint"});
  EXPECT_FALSE(twice.accepted);
  EXPECT_EQ(twice.verdict, "two_owners");
  EXPECT_THAT(twice.reason, HasSubstr("both own arm 'left'"));
  EXPECT_THAT(switch_to({"duel"}).reason, HasSubstr("did you mean 'dual'?"));
  EXPECT_TRUE(session->modes().active() & bit(session->modes().find("dual"))) << "nothing was changed";

  // The service of multipanda_ros2: exactly these controllets run afterwards.
  const auto exactly = switch_to({"left_joint"}, "set_controllers");
  ASSERT_TRUE(exactly.accepted) << exactly.reason;
  EXPECT_THAT(exactly.stopped, ElementsAre("dual"));
  EXPECT_THAT(exactly.started, testing::UnorderedElementsAre("left_joint", "right_hold"));
}

TEST_F(Run, ListsControlletsFeaturesAndArms) {
  ASSERT_TRUE(switch_to({"dual"}).accepted);
  const auto list = call<ListControllets>("list_controllets", ListControllets::Request());
  EXPECT_EQ(list.controllets.size(), session->modes().instance_count());
  EXPECT_EQ(list, call<ListControllets>("get_controllers", ListControllets::Request()));
  const auto dual = std::find_if(list.controllets.begin(), list.controllets.end(),
                                 [](const auto& c) { return c.name == "dual"; });
  ASSERT_NE(dual, list.controllets.end());
  EXPECT_TRUE(dual->active);
  EXPECT_THAT(dual->arms, ElementsAre("left", "right"));
  ASSERT_FALSE(dual->inputs.empty());
  EXPECT_EQ(dual->inputs[0].topic, "/multipanda/dual/" + dual->inputs[0].name);
  EXPECT_THAT(dual->inputs[0].frames, ElementsAre("world", "left_link0", "right_link0"));
  EXPECT_THAT(dual->parameters, Contains("dual.offset_m"));
  const auto arms = call<ListArms>("list_arms", ListArms::Request());
  ASSERT_EQ(arms.arms.size(), 2u);
  EXPECT_EQ(arms.arms[1].name, "right");
  EXPECT_EQ(arms.arms[1].model, "fer");
  EXPECT_EQ(arms.arms[1].owner, "dual");
  EXPECT_EQ(arms.arms[1].joint_names[6], "right_joint7");
  EXPECT_TRUE(arms.arms[1].simulated);

  SetFeatures::Request features;
  features.instance = "dual";
  features.features = {"manipulability", "joint_limits"};
  features.on = {true, false};
  ASSERT_TRUE(call<SetFeatures>("set_features", features).accepted);
  ListFeatures::Request of_dual;
  of_dual.instance = "dual";
  for (const auto& feature : call<ListFeatures>("list_features", of_dual).features)
    EXPECT_EQ(feature.on, feature.name == "manipulability") << feature.name;
}

TEST_F(Run, FeaturesPublishOutputsOnlyWhileTheyAreOn) {
  ASSERT_TRUE(switch_to({"left_cartesian"}).accepted);
  std::atomic<int> of_law{0}, of_feature{0};
  const std::string left = "/multipanda/left_cartesian/";
  Subscription<std_msgs::msg::Float64MultiArray> law(client->executor, client->node,
                                                     left + "position_error_m", Qos::reliable(), {},
                                                     [&](const auto&) { ++of_law; });
  Subscription<std_msgs::msg::Float64> feature(client->executor, client->node,
                                               left + "joint_limits/largest_torque_nm", Qos::reliable(), {},
                                               [&](const auto&) { ++of_feature; });
  const auto set = [&](bool on) {
    SetFeatures::Request request;
    request.instance = "left_cartesian";
    request.features = {"joint_limits"};
    request.on = {on};
    return call<SetFeatures>("set_features", request).accepted;
  };
  const auto next = [&](std::atomic<int>& count, int more) {
    return wait_for([&, end = count + more] { return count >= end; });
  };
  for (int round = 0; round < 2; ++round) {
    ASSERT_TRUE(set(true));
    ASSERT_TRUE(next(of_feature, 20));
    ASSERT_TRUE(set(false));
    ASSERT_TRUE(next(of_law, 10));  // messages in flight have arrived
    const int before = of_feature;
    ASSERT_TRUE(next(of_law, 50));
    EXPECT_EQ(of_feature, before);
  }
}

TEST_F(Run, StopsUntilResumed) {
  ASSERT_TRUE(switch_to({"left_cartesian", "right_cartesian"}).accepted);
  StopArms::Request left;
  left.arms = {"left"};
  const auto stopped = call<StopArms>("stop", left);
  EXPECT_TRUE(stopped.accepted) << stopped.reason;
  EXPECT_THAT(stopped.stopped, ElementsAre("left"));
  EXPECT_EQ(session->modes().owner(0), session->modes().find("left_hold"));
  EXPECT_EQ(session->modes().owner(1), session->modes().find("right_cartesian"));
  const auto refused = switch_to({"left_cartesian"});
  EXPECT_EQ(refused.verdict, "arm_stopped");
  EXPECT_THAT(refused.reason, HasSubstr("resume first"));
  StopArms::Request nobody;
  nobody.arms = {"middle"};
  const auto all = call<StopArms>("stop", nobody);
  EXPECT_TRUE(all.accepted);
  EXPECT_THAT(all.stopped, ElementsAre("left", "right"));
  EXPECT_THAT(all.reason, HasSubstr("there is no arm 'middle'"));
  EXPECT_TRUE(call<ResumeArms>("resume", ResumeArms::Request()).accepted);
  EXPECT_TRUE(switch_to({"left_cartesian"}).accepted);
}

// A stream moves the arm; its set-point and outputs are published. Invalid messages are refused, and the arm
// is then held.
TEST_F(Run, FollowsStreamsAndRefusesInvalidMessages) {
  ASSERT_TRUE(switch_to({"left_cartesian", "right_cartesian"}).accepted);
  std::atomic<double> z{0};
  std::string frame;
  Subscription<PoseStamped> reference(client->executor, client->node,
                                      "/multipanda/left_cartesian/pose/reference", Qos::sensor(), {},
                                      [&](const PoseStamped& message) {
                                        frame = message.header.frame_id;
                                        z = message.pose.position.z;
                                      });
  ASSERT_TRUE(wait_for([&] { return z > 0.1; }));
  EXPECT_EQ(frame, "world");
  Publisher<PoseStamped> goals(client->node, "/multipanda/left_cartesian/pose/goal", Qos::reliable(), {});
  ASSERT_TRUE(wait_for([&] { return goals.subscribers() > 0; }));
  const Pose X_WB = session->models()[0]->X_WB();
  PoseStamped goal;
  goal.header.frame_id = "left_link0";
  goal.pose.position.x = 0.45;
  goal.pose.position.z = 0.5;
  goal.pose.orientation.x = 1;
  goal.pose.orientation.w = 0;
  goals.publish(goal);
  const double z_goal = (X_WB * Vector3(0.45, 0, 0.5)).z();
  EXPECT_TRUE(wait_for([&] { return std::abs(z - z_goal) < 1e-6; }));

  Publisher<PoseStamped> stream(client->node, "/multipanda/left_cartesian/pose", Qos::sensor(), {});
  ASSERT_TRUE(wait_for([&] { return stream.subscribers() > 0; }));
  const InstanceIndex left = session->modes().find("left_cartesian");
  const auto streaming = [&] {
    const auto arms = call<ListArms>("list_arms", ListArms::Request());
    return arms.arms[0].owner == "left_cartesian";
  };
  for (int i = 0; i < 200; ++i) {
    goal.pose.position.z = 0.5 + 1e-4 * i;
    stream.publish(goal);
    std::this_thread::sleep_for(1ms);
  }
  EXPECT_TRUE(wait_for([&] { return z > z_goal + 0.005; }));
  EXPECT_TRUE(streaming());
  goal.pose.orientation.x = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(wait_for([&] {  // from now on only invalid messages, which count as silence
    stream.publish(goal);
    return session->modes().owner(0) != left;
  }));
  EXPECT_EQ(session->modes().owner(0), session->modes().find("left_hold"));
  EXPECT_EQ(session->modes().owner(1), session->modes().find("right_cartesian"));
}

TEST_F(Run, SetsParametersAllOrNone) {
  using namespace rcl_interfaces::srv;
  ListParameters::Request of_left;
  of_left.prefixes = {"left_joint"};
  of_left.depth = 1;
  const auto names = call<ListParameters>("list_parameters", of_left).result.names;
  ASSERT_THAT(names, Contains("left_joint.damping_ratio"));
  std::vector<std::string> changed;
  std::mutex mutex;
  Subscription<rcl_interfaces::msg::ParameterEvent> events(
      client->executor, client->node, "/parameter_events", Qos::reliable(1000), {}, [&](const auto& event) {
        const std::lock_guard lock(mutex);
        EXPECT_EQ(event.node, "/multipanda");
        for (const auto& parameter : event.changed_parameters) changed.push_back(parameter.name);
      });
  ASSERT_TRUE(wait_for([&] { return events.publishers() > 0; }));
  const auto value = [&] {
    GetParameters::Request get;
    get.names = {"left_joint.damping_ratio", "nobody.knows"};
    const auto values = call<GetParameters>("get_parameters", get).values;
    EXPECT_EQ(values.at(1).type, Type::PARAMETER_NOT_SET);
    return values.at(0).double_value;
  };
  const double before = value();
  SetParametersAtomically::Request all;
  all.parameters = {number("left_joint.damping_ratio", 0.77), number("left_joint.damping_ratoi", 1)};
  const auto refused = call<SetParametersAtomically>("set_parameters_atomically", all).result;
  EXPECT_FALSE(refused.successful);
  EXPECT_THAT(refused.reason, HasSubstr("did you mean 'damping_ratio'?"));
  EXPECT_EQ(value(), before);

  SetParameters::Request each;
  each.parameters = {number("left_joint.damping_ratio", -5), number("right_joint.damping_ratio", 0.6)};
  const auto results = call<SetParameters>("set_parameters", each).results;
  ASSERT_EQ(results.size(), 2u);
  EXPECT_FALSE(results[0].successful);
  EXPECT_THAT(results[0].reason, HasSubstr("must be"));
  EXPECT_TRUE(results[1].successful);

  all.parameters = {number("left_joint.damping_ratio", 0.77), number("right_joint.damping_ratio", 0.78)};
  EXPECT_TRUE(call<SetParametersAtomically>("set_parameters_atomically", all).result.successful);
  EXPECT_EQ(value(), 0.77);
  EXPECT_TRUE(wait_for([&] {
    const std::lock_guard lock(mutex);
    return changed.size() >= 3;
  }));
  EXPECT_THAT(changed, ElementsAre("right_joint.damping_ratio", "left_joint.damping_ratio",
                                   "right_joint.damping_ratio"));
}

// A dump of all parameters can be loaded again, whatever their number.
TEST_F(Run, AcceptsADumpOfAllParameters) {
  using namespace rcl_interfaces::srv;
  GetParameters::Request get;
  get.names = call<ListParameters>("list_parameters", ListParameters::Request()).result.names;
  ASSERT_GT(get.names.size(), 64u);
  const auto values = call<GetParameters>("get_parameters", get).values;
  SetParameters::Request set;
  for (std::size_t i = 0; i < values.size(); ++i) {
    set.parameters.emplace_back();
    set.parameters.back().name = get.names[i];
    set.parameters.back().value = values[i];
  }
  const auto results = call<SetParameters>("set_parameters", set).results;
  ASSERT_EQ(results.size(), values.size());
  for (std::size_t i = 0; i < results.size(); ++i)
    EXPECT_TRUE(results[i].successful) << get.names[i] << ": " << results[i].reason;
}

// After all the calls above, the loop's thread has neither allocated nor locked.
TEST_F(Run, NeitherAllocatesNorLocksInTheLoop) {
  // With a viewer, the loop also reads the places of objects.
  std::atomic<int> drawn{0};
  const Subscription<visualization_msgs::msg::MarkerArray> viewer(
      client->executor, client->node, "/multipanda/markers", Qos::reliable(), Doc{},
      [&](const visualization_msgs::msg::MarkerArray&) { ++drawn; });
  ASSERT_TRUE(wait_for([&] { return drawn > 3; }));
  if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  const std::uint64_t first = counted->cycles;
  ASSERT_TRUE(wait_for([&] { return counted->cycles > first + 1000; }));
  EXPECT_EQ(counted->heap.load(), 0u);
  EXPECT_EQ(counted->locks.load(), 0u);
}

// The socket's clients and those of ROS command the same grippers.
class ARunWithGrippers : public testing::Test {
 protected:
  ARunWithGrippers() {
    OpenedScene opened = open_scene("grippers");
    opened.scene.timeline.clear();
    std::erase_if(opened.scene.objects, [](const SceneObject& object) { return object.name == "part"; });
    registry_ = std::make_unique<Registry>(std::move(opened.registry));
    SessionOptions options;
    options.duration_s = 0;
    options.share_records = true;
    options.make_adapter = [](const RunContext& run) {
      return std::make_unique<RosAdapter>(run, RosOptions{});
    };
    run_ = std::make_unique<Session>(std::move(opened.scene), *registry_, std::move(options));
    run_->start();
    executor_.start();
  }
  ~ARunWithGrippers() override {
    executor_.stop();
    run_->stop();
    (void)run_->finish();
  }

  using Grasp = multipanda_msgs::action::Grasp;
  using Move = multipanda_msgs::action::Move;

  static Move::Goal to_width(double width) {
    Move::Goal goal;
    goal.width = width;
    goal.speed = 0.1;
    return goal;
  }
  static Move::Goal opened() { return to_width(0.07); }
  static Move::Goal closed() { return to_width(0.02); }
  template <class A>
  static typename A::Result outcome(ActionClient<A>& client, const typename A::Goal& goal) {
    const Uuid id = random_uuid();
    EXPECT_EQ(client.send(id, goal).wait_for(20s), std::future_status::ready);
    auto result = client.result(id);
    if (result.wait_for(20s) == std::future_status::ready) return result.get().result;
    ADD_FAILURE() << "a goal did not end";
    return typename A::Result();
  }
  std::uint64_t cycle_now() {
    LatestState::Snapshot now;
    run_->live_input().latest->copy(now);
    return now.cycle;
  }

  std::unique_ptr<Registry> registry_;
  std::unique_ptr<Session> run_;
  Context context_;
  Node node_{context_, "tester"};
  Executor executor_;
};

TEST_F(ARunWithGrippers, EndsSuctionWithAStopOfItsArm) {
  constexpr ArmIndex kRight = 1;
  using Suction = multipanda_msgs::srv::VacuumOn;
  Client<Suction> on(executor_, node_, "/right/vacuum/on");
  ASSERT_TRUE(on.wait_until_ready(20));
  Suction::Request request;
  request.vacuum_mbar = 400;
  request.timeout = 60;  // there is nothing to hold
  auto answer = on.call(request);
  ASSERT_TRUE(wait_for([&] { return run_->live_input().latest->sample(kRight).gripper_moving != 0; }))
      << (answer.wait_for(0s) == std::future_status::ready ? answer.get().error : "no answer");
  run_->modes().stop(ArmSet::of(kRight));
  ASSERT_EQ(answer.wait_for(20s), std::future_status::ready);
  const auto ended = answer.get();
  EXPECT_FALSE(ended.success);
  EXPECT_THAT(ended.error, HasSubstr("ended by a stop"));
  auto refused = on.call(request);
  ASSERT_EQ(refused.wait_for(20s), std::future_status::ready);
  EXPECT_THAT(refused.get().error, HasSubstr("is stopped, and so is its gripper"));
}

TEST_F(ARunWithGrippers, HoldsWhatAStoppedArmHasGraspedWhateverIsRefused) {
  const auto left = [&] { return run_->live_input().latest->sample(0); };
  ActionClient<Grasp> grasp(executor_, node_, "/left_gripper/grasp");
  ActionClient<Move> move(executor_, node_, "/left_gripper/move");
  ASSERT_TRUE(grasp.wait_until_ready(20) && move.wait_until_ready(20));
  Grasp::Goal goal;
  goal.width = 0.04;
  goal.speed = 0.1;
  goal.force = 30;
  goal.epsilon.inner = goal.epsilon.outer = 0.005;
  EXPECT_TRUE(outcome(grasp, goal).success);
  ASSERT_TRUE(wait_for([&] { return left().gripper_grasped != 0; }));
  run_->modes().stop(ArmSet::of(0));
  ASSERT_TRUE(wait_for([&] { return run_->modes().stopped().contains(0); }));
  EXPECT_THAT(outcome(move, opened()).error, HasSubstr("is stopped, and so is its gripper"));
  const std::uint64_t cycle = cycle_now();
  ASSERT_TRUE(wait_for([&] { return cycle_now() > cycle + 500; }));
  EXPECT_TRUE(left().gripper_grasped);
}

TEST_F(ARunWithGrippers, KnowsWhoseWidthsAreFollowed) {
  ActionClient<Move> move(executor_, node_, "/left_gripper/move");
  Client<std_srvs::srv::Trigger> stop(executor_, node_, "/left_gripper/stop");
  ASSERT_TRUE(move.wait_until_ready(20) && stop.wait_until_ready(20));
  RequestHandler handler(run_->live_input());
  std::atomic<bool> ends = false, follows = false, paused = false;
  std::thread stream([&] {
    for (; !ends; std::this_thread::sleep_for(10ms)) try {
        RequestHandler::Pending pending;
        pending.client = &handler;
        (void)handler.begin(
            {{"do", "gripper"}, {"arm", "left"}, {"action", "follow"}, {"width_m", 0.06}, {"silence_s", 1}},
            pending);
        follows = true;
      } catch (const RequestRefused& refused) {
        paused = std::string(refused.what()).find("once it has paused") != std::string::npos;
      }
  });
  // A move that opens the fingers farther would be accepted.
  EXPECT_TRUE(wait_for([&] { return follows && run_->live_input().latest->sample(0).gripper_width > 0.04; }));
  EXPECT_THAT(outcome(move, closed()).error, HasSubstr("follows widths of another client"));
  EXPECT_FALSE(paused);
  EXPECT_EQ(stop.call(std_srvs::srv::Trigger::Request()).wait_for(20s), std::future_status::ready);
  EXPECT_TRUE(wait_for([&] { return paused.load(); }));
  ends = true;
  stream.join();
}

// A library of the scene brings a codec, so that input takes its own message type. After the end of the run
// nothing of it remains in the graph.
TEST(ARunWithACodec, TakesItsMessagesAndCleansUp) {
  using geometry_msgs::msg::TransformStamped;
  Context context;
  Node node(context, "watcher");
  const auto present = [&] {
    const auto others = node.other_nodes();
    return std::find(others.begin(), others.end(), "/multipanda") != others.end();
  };
  {
    OpenedScene opened = open_scene("one_arm");
    opened.scene.timeline.clear();
    opened.scene.controllets = {{.name = "cartesian", .type = "cartesian_impedance", .arms = {0}}};
    opened.scene.active = {"cartesian"};
    opened.scene.plugins = {OWN_MESSAGE};
    load_plugin(opened.registry, OWN_MESSAGE);
    SessionOptions options;
    options.duration_s = 0;
    RosAdapter* adapter = nullptr;
    options.make_adapter = [&](const RunContext& run) {
      auto made = std::make_unique<RosAdapter>(run, RosOptions{});
      adapter = made.get();
      return made;
    };
    Session run(std::move(opened.scene), opened.registry, std::move(options));
    run.start();
    ASSERT_TRUE(wait_for(present));
    Publisher<TransformStamped> goals(node, "/multipanda/cartesian/pose/goal", Qos::reliable(), {});
    ASSERT_TRUE(wait_for([&] { return goals.subscribers() > 0; }));
    const auto line = [&] {
      const auto lines = adapter->diagnostics();
      return *std::find_if(lines.begin(), lines.end(),
                           [](const auto& l) { return l.name == "cartesian/pose"; });
    };
    TransformStamped goal;
    goal.child_frame_id = "base";
    // Until one arrives: a publisher may know of a subscription before that knows of it.
    const auto warned_of = [&](auto& publisher, const auto& message) {
      return wait_for([&] {
        if (line().level != Diagnostic::Level::warn) publisher.publish(message);
        return line().level == Diagnostic::Level::warn;
      });
    };
    ASSERT_TRUE(warned_of(goals, goal));
    EXPECT_THAT(line().message, HasSubstr("the transform's child frame is 'base', expected 'goal'"));
    goal.child_frame_id = "goal";
    goal.header.frame_id = "arm_link0";
    goal.transform.translation.x = 0.5;
    goal.transform.translation.z = 0.5;
    goal.transform.rotation.x = 1;
    goal.transform.rotation.w = 0;
    goals.publish(goal);
    ASSERT_TRUE(wait_for([&] { return line().level == Diagnostic::Level::ok; }));

    // A second type for the same law, beside the first: the newest message of either counts.
    const auto received = [&] { return std::stoi(line().values.at(0).second); };
    int count = received();
    EXPECT_GE(count, 2);
    Publisher<geometry_msgs::msg::Pose> plain(node, "/multipanda/cartesian/pose/plain/goal", Qos::reliable(),
                                              {});
    ASSERT_TRUE(wait_for([&] { return plain.subscribers() > 0; }));
    geometry_msgs::msg::Pose pose;
    pose.orientation.w = 0.5;
    ASSERT_TRUE(warned_of(plain, pose));
    EXPECT_THAT(line().message, HasSubstr("unit quaternion"));
    EXPECT_GT(received(), count);
    count = received();
    pose.position.x = 0.45;
    pose.position.z = 0.5;
    pose.orientation.x = 1;
    pose.orientation.w = 0;
    plain.publish(pose);
    ASSERT_TRUE(wait_for([&] { return line().level == Diagnostic::Level::ok; }));
    EXPECT_GT(received(), count);
    count = received();
    goals.publish(goal);
    EXPECT_TRUE(wait_for([&] { return received() > count; }));
    EXPECT_EQ(line().level, Diagnostic::Level::ok);
    run.stop();
    (void)run.finish();
  }
  EXPECT_TRUE(wait_for([&] { return !present(); }));
}

}  // namespace
}  // namespace multipanda::ros::adapter_test
