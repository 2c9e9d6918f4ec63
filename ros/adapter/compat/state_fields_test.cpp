// Messages about arms in the types of other systems: compared with the record, with our own state and with
// each other. The bases are turned and off the origin.
#include "ros/adapter/compat/state_fields.hpp"

#include <cmath>
#include <compat_test_msgs/msg/franka_robot_state.hpp>
#include <compat_test_msgs/msg/franka_state.hpp>
#include <compat_test_msgs/srv/set_load.hpp>
#include <random>
#include <set>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "arm_interface/arm_error.hpp"
#include "ros/adapter/compat/arm_services.hpp"
#include "ros/adapter/state/testing/state_fixture.hpp"

namespace multipanda::ros::state_fields_test {
namespace {

using namespace compat_test_msgs;
using test::StateFixture;
using testing::Contains;
using testing::ElementsAreArray;
using testing::HasSubstr;

constexpr const char* kPackage = "compat_test_msgs";
constexpr double kTiny = 1e-12;

const std::string kArms =
    "arms:\n"
    "  - name: left\n"
    "    base: {position_m: [0.1, 0.5, 0.2], rpy_rad: [0.4, -0.3, 1.1]}\n"
    "    stiffness_frame: {position_m: [0.02, 0.01, 0.05], rpy_rad: [0.3, 0.2, -0.5]}\n"
    "  - name: right\n"
    "    base: {position_m: [-0.2, -0.7, 0.1], rpy_rad: [-0.6, 0.2, -2.0]}\n";

Eigen::Matrix4d matrix(const std::array<double, 16>& values) {
  return Eigen::Map<const Eigen::Matrix4d>(values.data());
}

Eigen::Matrix4d matrix(const geometry_msgs::msg::PoseStamped& stamped) {
  const auto& [p, q] = std::tie(stamped.pose.position, stamped.pose.orientation);
  Eigen::Isometry3d X(Eigen::Quaterniond(q.w, q.x, q.y, q.z));
  X.pretranslate(Eigen::Vector3d(p.x, p.y, p.z));
  return X.matrix();
}

Eigen::Matrix4d matrix(const Pose& X) {
  Eigen::Isometry3d out(X.rotation);
  out.pretranslate(X.position);
  return out.matrix();
}

Vector6 vector(const geometry_msgs::msg::Wrench& w) {
  Vector6 out;
  out << w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z;
  return out;
}

// One record of random content about one arm, in both messages.
class Both {
 public:
  explicit Both(StateFixture& fixture, unsigned seed, bool reports) : models_(fixture.run_context()) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<> number(-1, 1);
    record_ = CycleRecord(2, 0, 0);
    ArmSample& sample = record_.arms[0];
    for (JointArray* values : {&sample.q, &sample.dq, &sample.tau_J, &sample.tau_J_d, &sample.tau_ext,
                               &sample.q_d, &sample.dq_d, &sample.theta}) {
      for (double& value : *values) value = number(random);
    }
    for (double& value : sample.F_K_W_est) value = number(random);
    sample.has_report = sample.has_tau_ext = sample.has_wrench_estimate = reports;
    sample.X_BE_d = {1, 2, 3, 0, 1, 0, -1, 0, 0, 0, 0, 1};  // turned by 90 degrees about z
    sample.X_BE_c = sample.X_BE_d;
    sample.elbow = {0.3, -1};
    sample.joint_contact = 0b1000001, sample.joint_collision = 0b0000100;
    sample.cartesian_contact = 0b100010, sample.cartesian_collision = 0b000001;
    sample.errors = error_bit(ArmError::joint_reflex);
    sample.last_motion_errors = error_bit(ArmError::communication_constraints_violation);
    sample.mode = 4;
    sample.t_robot_ns = 2500000000;
    sample.command_success_rate = 0.75;
    models_.take(record_);
    ArmModels::Arm arm = models_.arms()[0];
    arm.load.mass = 1.5;
    arm.load.p_FC << 0.1, 0.2, 0.3;
    arm.load.inertia_C << 1, 4, 5, 4, 2, 6, 5, 6, 3;
    const Pose X_FN = arm.frames.X_FE;
    arm.frames.X_FE = X_FN * Pose::from({0, 0.1, 0.2}, {0.8, 0.6, 0, 0});
    const ArmReport report{sample, arm, models_.terms(0), X_FN, 7000000123};
    StateWriter first(MessageType::find(kPackage, "FrankaState"), arm, franka_state_rules(7));
    StateWriter second(MessageType::find(kPackage, "FrankaRobotState"), arm, franka_robot_state_rules(7));
    first.prepare(&state);
    first.fill(report, &state);
    second.prepare(&robot_state);
    second.fill(report, &robot_state);
    unknown = first.unknown();
    unknown_2 = second.unknown();
    X_WE = matrix(models_.terms(0).X_WE());
    X_WB = matrix(models_.terms(0).model().X_WB());
    X_FE = matrix(arm.frames.X_FE);
  }
  const ArmSample& sample() const { return record_.arms[0]; }

  msg::FrankaState state;
  msg::FrankaRobotState robot_state;
  std::vector<std::string> unknown, unknown_2;
  Eigen::Matrix4d X_WE, X_WB, X_FE;

 private:
  ArmModels models_;
  CycleRecord record_;
};

std::vector<double> first7(const JointArray& values) { return {values.begin(), values.begin() + 7}; }

TEST(StateFields, HoldWhatTheArmReports) {
  StateFixture fixture(kArms);
  for (const unsigned seed : {1u, 2u, 3u}) {
    const Both both(fixture, seed, true);
    const msg::FrankaState& state = both.state;
    const msg::FrankaRobotState& other = both.robot_state;
    EXPECT_THAT(state.q, ElementsAreArray(first7(both.sample().q)));
    EXPECT_THAT(other.measured_joint_state.position, ElementsAreArray(state.q));
    EXPECT_THAT(state.dq, ElementsAreArray(first7(both.sample().dq)));
    EXPECT_THAT(other.measured_joint_state.velocity, ElementsAreArray(state.dq));
    EXPECT_THAT(state.tau_j, ElementsAreArray(first7(both.sample().tau_J)));
    EXPECT_THAT(other.measured_joint_state.effort, ElementsAreArray(state.tau_j));
    EXPECT_THAT(state.tau_j_d, ElementsAreArray(first7(both.sample().tau_J_d)));
    EXPECT_THAT(other.desired_joint_state.effort, ElementsAreArray(state.tau_j_d));
    EXPECT_THAT(state.q_d, ElementsAreArray(first7(both.sample().q_d)));
    EXPECT_THAT(other.desired_joint_state.position, ElementsAreArray(state.q_d));
    EXPECT_THAT(state.dq_d, ElementsAreArray(first7(both.sample().dq_d)));
    EXPECT_THAT(other.desired_joint_state.velocity, ElementsAreArray(state.dq_d));
    EXPECT_THAT(state.theta, ElementsAreArray(first7(both.sample().theta)));
    EXPECT_THAT(other.measured_joint_motor_state.position, ElementsAreArray(state.theta));
    EXPECT_THAT(state.tau_ext_hat_filtered, ElementsAreArray(first7(both.sample().tau_ext)));
    EXPECT_THAT(other.tau_ext_hat_filtered.effort, ElementsAreArray(state.tau_ext_hat_filtered));
    EXPECT_THAT(other.measured_joint_state.name, Contains("left_joint7"));

    // Poses are in the base; column by column; the nominal end effector and the tool make up the flange's.
    EXPECT_LT((both.X_WB * matrix(state.o_t_ee) - both.X_WE).norm(), kTiny);
    EXPECT_LT((matrix(other.o_t_ee) - matrix(state.o_t_ee)).norm(), kTiny);
    EXPECT_LT((matrix(state.f_t_ee) - both.X_FE).norm(), kTiny);
    EXPECT_LT((matrix(state.f_t_ne) * matrix(state.ne_t_ee) - both.X_FE).norm(), kTiny);
    EXPECT_NEAR(state.ne_t_ee[13], 0.1, kTiny);
    EXPECT_LT((matrix(other.f_t_ee) - both.X_FE).norm(), kTiny);
    EXPECT_LT((matrix(other.ee_t_k) - matrix(state.ee_t_k)).norm(), kTiny);
    EXPECT_NEAR(state.ee_t_k[14], 0.05, kTiny);
    EXPECT_THAT(state.o_t_ee_d, ElementsAreArray({0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1}));
    EXPECT_LT((matrix(other.o_t_ee_c) - matrix(state.o_t_ee_c)).norm(), kTiny);

    // Turned into world axes, the one is about the base's origin and the other about K, as in our record.
    const Eigen::Map<const Vector6> F(both.sample().F_K_W_est.data());
    const Eigen::Map<const Vector6> F_O(state.o_f_ext_hat_k.data()), F_K(state.k_f_ext_hat_k.data());
    const Matrix3 R_WB = both.X_WB.topLeftCorner<3, 3>();
    const Eigen::Matrix4d X_WK = both.X_WE * matrix(state.ee_t_k);
    const Matrix3 R_WK = X_WK.topLeftCorner<3, 3>();
    const Vector3 p_BK_W = (X_WK - both.X_WB).topRightCorner<3, 1>();
    EXPECT_LT((R_WB * F_O.head<3>() - F.head<3>()).norm(), kTiny);
    EXPECT_LT((R_WB * F_O.tail<3>() - F.tail<3>() - p_BK_W.cross(F.head<3>())).norm(), kTiny);
    EXPECT_LT((R_WK * F_K.head<3>() - F.head<3>()).norm(), kTiny);
    EXPECT_LT((R_WK * F_K.tail<3>() - F.tail<3>()).norm(), kTiny);
    EXPECT_LT((vector(other.o_f_ext_hat_k.wrench) - F_O).norm(), kTiny);
    EXPECT_LT((vector(other.k_f_ext_hat_k.wrench) - F_K).norm(), kTiny);
  }
}

TEST(StateFields, FlagsConfigurationTimesAndNames) {
  StateFixture fixture(kArms);
  const Both both(fixture, 5, true);
  const msg::FrankaState& state = both.state;
  const msg::FrankaRobotState& other = both.robot_state;
  EXPECT_THAT(state.joint_contact, ElementsAreArray({1, 0, 0, 0, 0, 0, 1}));
  EXPECT_THAT(state.joint_collision, ElementsAreArray({0, 0, 1, 0, 0, 0, 0}));
  EXPECT_THAT(other.collision_indicators.is_joint_collision, ElementsAreArray(state.joint_collision));
  EXPECT_THAT(state.cartesian_contact, ElementsAreArray({0, 1, 0, 0, 0, 1}));
  EXPECT_EQ(other.collision_indicators.is_cartesian_angular_contact.z, 1);
  EXPECT_EQ(other.collision_indicators.is_cartesian_angular_contact.x, 0);
  EXPECT_THAT(state.cartesian_collision, ElementsAreArray({1, 0, 0, 0, 0, 0}));
  EXPECT_EQ(other.collision_indicators.is_cartesian_linear_collision.x, 1);
  for (const auto* errors : {&state.current_errors, &other.current_errors}) {
    EXPECT_TRUE(errors->joint_reflex);
    EXPECT_FALSE(errors->communication_constraints_violation);
  }
  EXPECT_TRUE(state.last_motion_errors.communication_constraints_violation);
  EXPECT_FALSE(state.last_motion_errors.joint_reflex);
  EXPECT_EQ(state.robot_mode, 4);
  EXPECT_EQ(state.time, 2.5);
  EXPECT_EQ(other.control_command_success_rate, 0.75);
  EXPECT_EQ(state.m_load, 1.5);
  EXPECT_THAT(state.f_x_cload, ElementsAreArray({0.1, 0.2, 0.3}));
  EXPECT_THAT(state.i_load, ElementsAreArray({1, 4, 5, 4, 2, 6, 5, 6, 3}));
  EXPECT_EQ(other.inertia_load.inertia.iyz, 6);
  EXPECT_EQ(other.inertia_load.inertia.com.y, 0.2);
  EXPECT_EQ(state.header.stamp.sec, 7);
  EXPECT_EQ(other.o_t_ee.header.stamp.nanosec, 123u);
  EXPECT_EQ(state.header.frame_id, "left_link0");
  EXPECT_EQ(other.k_f_ext_hat_k.header.frame_id, "left_k");
  EXPECT_THAT(both.unknown,
              testing::UnorderedElementsAre("ddq_d", "current_errors.an_error_of_another_version",
                                            "last_motion_errors.an_error_of_another_version"));
  EXPECT_THAT(both.unknown_2, Contains("ddq_d"));
  EXPECT_THAT(both.unknown_2, testing::Not(Contains("measured_joint_state.name")));
}

// Fields of messages are in lower case; all flags have one of their own.
TEST(StateFields, ErrorsHaveTheNamesOfFields) {
  std::set<std::string> names;
  for (std::size_t i = 0; i < kArmErrorCount; ++i) {
    const std::string name = error_field(static_cast<ArmError>(i));
    EXPECT_EQ(name.find_first_not_of("abcdefghijklmnopqrstuvwxyz_2"), std::string::npos) << name;
    names.insert(name);
  }
  EXPECT_EQ(names.size(), kArmErrorCount);
  EXPECT_EQ(names.count("tau_j_range_violation"), 1u);
  EXPECT_EQ(names.count("cartesian_position_motion_generator_invalid_frame"), 1u);
  EXPECT_EQ(names.count("joint_p2p_insufficient_torque_for_planning"), 1u);
}

// Zeros would look like a joint at its middle and an end effector in the base.
TEST(StateFields, WhatTheArmDoesNotReportIsNotANumber) {
  StateFixture fixture(kArms);
  const Both both(fixture, 6, false);
  EXPECT_TRUE(std::isnan(both.state.q_d[3]));
  EXPECT_TRUE(std::isnan(both.state.o_t_ee_d[0]));
  EXPECT_TRUE(std::isnan(both.state.tau_ext_hat_filtered[6]));
  EXPECT_TRUE(std::isnan(both.state.o_f_ext_hat_k[2]));
  EXPECT_TRUE(std::isnan(both.robot_state.o_t_ee_c.pose.orientation.w));
  EXPECT_TRUE(std::isfinite(both.state.q[3]));
  EXPECT_TRUE(std::isfinite(both.state.o_t_ee[12]));
}

TEST(StateFields, ATypeThatDoesNotFitIsRefused) {
  StateFixture fixture(kArms);
  const ArmModels models(fixture.run_context());
  const auto writer = [&](const char* type, std::size_t joints) {
    StateWriter(MessageType::find(kPackage, type), models.arms()[0], franka_state_rules(joints));
  };
  EXPECT_THROW(writer("FrankaState", 6), std::invalid_argument);       // 7 numbers for 6 joints
  EXPECT_THROW(writer("TooShortState", 7), std::invalid_argument);     // no o_t_ee
  EXPECT_THROW(writer("FrankaRobotState", 7), std::invalid_argument);  // another system's
  EXPECT_NO_THROW(writer("VariantState", 7));
}

TEST(Transform, GoesThereAndBackAndRefusesOthers) {
  const Pose X = Pose::from({1, -2, 3}, {0.5, 0.5, -0.5, 0.5});
  std::array<double, 16> values{};
  write_transform(X, values);
  EXPECT_LT((matrix(read_transform(values, "X")) - matrix(X)).norm(), kTiny);
  const auto refused = [&](std::size_t at, double value) {
    auto bad = values;
    bad[at] = value;
    EXPECT_THROW(read_transform(bad, "X"), std::invalid_argument) << at << " " << value;
  };
  refused(0, 0.3);   // no rotation
  refused(12, NAN);  // not finite
  refused(15, 0);    // another last row
  refused(3, 1);     // row by row
  for (std::size_t i = 0; i < 3; ++i) values[i] = -values[i];
  refused(14, 1);  // a mirror
}

// The state of each arm in franka_ros2's type and under its names, and a service of it.
TEST(FrankaRos2, PublishesItsTypeUnderItsNames) {
  StateFixture fixture(kArms);
  const CompatPackages packages{RosSection::Compat::franka_ros2, kPackage, kPackage};
  AdapterParts parts;
  parts.push_back(std::make_unique<CompatState>(fixture.run_context(), packages));
  parts.push_back(std::make_unique<CompatArmServices>(fixture.run_context(), packages, ArmIndex{1}));
  fixture.executor().start();
  Node tester(fixture.context(), "tester");
  test::Received<msg::FrankaRobotState> states(fixture, tester,
                                               "/right/franka_robot_state_broadcaster/robot_state");
  ASSERT_TRUE(test::wait_for([&] { return states.subscription.publishers() > 0; }));
  ASSERT_TRUE(test::wait_for([&] {
    fixture.run(20, parts);
    return states.count() > 3;
  }));
  EXPECT_EQ(states.messages[0].header.frame_id, "right_link0");
  EXPECT_EQ(states.messages[0].measured_joint_state.name[0], "right_joint1");

  Client<srv::SetLoad> set_load(fixture.executor(), tester, "/right/service_server/set_load");
  ASSERT_TRUE(set_load.wait_until_ready(20));
  srv::SetLoad::Request request;
  request.mass = 0.5;
  request.center_of_mass = {0, 0, 0.05};
  request.load_inertia = {1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3};
  auto answer = set_load.call(request);
  ASSERT_TRUE(test::wait_for([&] {
    fixture.run(5, parts);
    return answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  }));
  const auto set = answer.get();
  EXPECT_TRUE(set.success) << set.error;
  const auto before = states.count();
  ASSERT_TRUE(test::wait_for([&] {
    fixture.run(20, parts);
    return states.count() > before + 2;
  }));
  EXPECT_EQ(states.messages.back().inertia_load.inertia.m, 0.5);
  fixture.executor().stop();
}

}  // namespace
}  // namespace multipanda::ros::state_fields_test
