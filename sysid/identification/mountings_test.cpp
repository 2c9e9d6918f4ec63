// Logs of one arm on several bases in one fit. The torques come from MuJoCo's simulation, the parameters that
// are expected from the model that it simulates.
#include <functional>
#include <numbers>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sysid/identification/equations.hpp"
#include "sysid/identification/identify.hpp"
#include "sysid/identification/predict.hpp"
#include "sysid/identification/testing/simulated_log.hpp"

namespace multipanda::mountings_test {
namespace {

using namespace test;
using ::testing::AllOf;
using ::testing::HasSubstr;

const Vector3 kFloor(0, 0, 0), kWall(0, std::numbers::pi / 2, 0), kSlope(0.5, -0.7, 0.3);

MeasuredLog log_on(const Vector3& rpy, std::uint64_t seed, double seconds = 8) {
  const Pose X_WB{rotation_from_rpy(rpy), Vector3(0.4, -0.3, 0.9)};
  MeasuredLog log =
      record(scene_of({arm_named("a", X_WB, false)}), RichMotion(seed), {.duration_s = seconds});
  log.gravity_B = X_WB.rotation.transpose() * Vector3(0, 0, -9.81);
  return log;
}

// `fer` with other masses and centers.
RobotDescription wrong_prior() {
  RobotDescription robot = load_robot("fer");
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> any(-1, 1);
  for (std::size_t i = 1; i < robot.links.size(); ++i) {
    robot.links[i].mass *= 1 + 0.1 * any(random);
    robot.links[i].com += 0.015 * Vector3::NullaryExpr([&] { return any(random); });
  }
  robot.links[1].com.x() += 0.03;
  return robot;
}

std::string refusal(const std::function<void()>& call) {
  try {
    call();
  } catch (const LogRefused& refused) {
    return refused.what();
  }
  return "accepted";
}

TEST(Mountings, OneFitOfFloorAndWallFindsTheArm) {
  const RobotDescription truth = load_robot("fer"), prior = wrong_prior();
  const std::vector<MeasuredLog> both{log_on(kFloor, 1), log_on(kWall, 2)};
  const MeasuredLog slope = log_on(kSlope, 3);
  const IdentifyOptions options{.families = {"rigid"}, .choose = false};
  const Identification one = identify(std::span(both).first(1), prior, options);
  const Identification all = identify(both, prior, options);

  // Where gravity is along the first axis, no torque depends on link 1's center of mass.
  EXPECT_EQ(one.linear.base.rank(), 43);
  EXPECT_EQ(all.linear.base.rank(), 45);
  const auto unidentifiable = [](const Identification& id) { return id.linear.base.unidentifiable; };
  EXPECT_THAT(unidentifiable(one), ::testing::Contains("link1 mx"));
  EXPECT_THAT(unidentifiable(all), ::testing::Not(::testing::Contains("link1 mx")));

  const Eigen::VectorXd expected = all.linear.base.combination * thetas_of(truth);
  EXPECT_LT((all.linear.value - expected).norm() / expected.norm(), 0.01);
  const Eigen::VectorXd written = all.linear.base.combination * thetas_of(all.robot);
  EXPECT_LT((written - expected).norm() / expected.norm(), 0.05);

  // A base that no log had: only the fit of both predicts it.
  const double error = predict(slope, all.robot).rmse_mean;
  EXPECT_LT(error, 0.03);
  EXPECT_GT(predict(slope, one.robot).rmse_mean, 5 * error);
  EXPECT_TRUE(all.robot.base_tilt.isZero(0));
}

TEST(Mountings, AWallTakenForAFloorIsRefused) {
  std::vector<MeasuredLog> logs{log_on(kFloor, 1, 4), log_on(kWall, 2, 4)};
  logs[1].source = "wall.csv";
  logs[1].gravity_B.reset();
  const IdentifyOptions options{.families = {"rigid"}, .choose = false};
  EXPECT_THAT(refusal([&] { (void)identify(logs, load_robot("fer"), options); }),
              AllOf(HasSubstr("wall.csv"), HasSubstr("unexplained"), HasSubstr("--base")));
}

TEST(Mountings, UnlikeOnesAreRefusedWithWhatWasFound) {
  std::vector<MeasuredLog> logs(2);
  logs[0].source = "a.csv";
  logs[1].source = "b.csv";
  const auto said = [&](const Mounting& a, const Mounting& b) {
    return refusal([&] { refuse_unlike(logs, std::vector{a, b}, true); });
  };
  const Mounting unknown, floor{.base_told = true}, wall{.gravity_B = {9.81, 0, 0}, .base_told = true};
  EXPECT_EQ(said(unknown, unknown), "accepted");
  EXPECT_EQ(said(floor, unknown), "accepted");
  EXPECT_EQ(said(floor, wall), "accepted");
  EXPECT_THAT(said(wall, unknown), AllOf(HasSubstr("b.csv: its base is unknown"),
                                         HasSubstr("(1.00, 0.00, 0.00)"), HasSubstr("--base")));
  EXPECT_THAT(said(floor, {.hand = true, .base_told = true}),
              AllOf(HasSubstr("b.csv: with hand, but a.csv: without hand"), HasSubstr("--no-hand")));
  const RigidBody tool{0.4, {0, 0, 0.1}, 1e-3 * Matrix3::Identity()};
  EXPECT_THAT(said(floor, {.tool = tool}), AllOf(HasSubstr("a tool of 0.4000 kg"), HasSubstr("no tool")));
  EXPECT_TRUE(same_gravity({0, 0, -9.81}, {0.1, 0, -9.8}));
  EXPECT_FALSE(same_gravity({0, 0, -9.81}, {0.3, 0, -9.8}));
  EXPECT_FALSE(same_gravity({0, 0, -9.81}, {0, 0, 9.81}));
}

}  // namespace
}  // namespace multipanda::mountings_test
