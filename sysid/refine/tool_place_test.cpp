#include "sysid/refine/tool_place.hpp"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "experiments/experiment.hpp"
#include "experiments/task_runs.hpp"
#include "scene/build.hpp"

namespace multipanda::tool_place_test {
namespace {

constexpr double kSqueeze = 20;  // [N], along y of the world, the assumed positions of both E

// Two hands hold a box, the first at its left (+y, pressing towards -y). Computed by hand, with E of each
// aligned with the world:
//   moment about the assumed E:  d x F + k (turn across the line of force)     (pads that turn with a spring)
//   place along y: the squeeze is kept, so the hands are assumed closer together by the additional length of
//   the tools, each by half of it along x and z the hands hold their places; the box responds only with a
//   shear force between them, of a spring c against the difference of the shifts
struct Grasp {
  double k = 2.5, c = 300, bend = 0;  // [N m/rad], [N/m]; bend: of the spring, 1 + bend turn (not linear)

  std::vector<MeasuredLog> logs(const ToolPlaces& places) const {
    std::vector<MeasuredLog> list(2);
    const Vector3 apart = places[0].shift - places[1].shift;
    for (std::size_t i = 0; i < 2; ++i) {
      const double side = i == 0 ? 1 : -1;
      MeasuredLog& log = list[i];
      log.arm = i == 0 ? "left" : "right";
      log.t = Eigen::VectorXd::LinSpaced(2001, 0, 2);
      const Vector3 swing(0.3, 0.2, 0.1);  // some motion for the alignment
      const Eigen::VectorXd phase = (std::numbers::pi * log.t.array()).sin();
      log.q = phase * Eigen::RowVectorXd::Constant(7, 0.1);
      log.dq = (std::numbers::pi * log.t.array()).cos().matrix() *
               Eigen::RowVectorXd::Constant(7, 0.1 * std::numbers::pi);
      log.tau = log.q;
      const Vector3 F(-side * c * apart.x(), -side * kSqueeze, -side * c * apart.z());
      const Vector3& turn = places[i].turn;
      const Vector3 across(turn.x() * (1 + bend * turn.x()), 0, turn.z());
      Vector6 wrench;
      wrench << F, places[i].shift.cross(F) + k * across;
      log.F_EE = Eigen::VectorXd::Ones(log.t.size()) * wrench.transpose();
      const Vector3 x(0, side * 0.1 - apart.y() / 2 * side, 0.3);
      log.x_EE = phase * swing.transpose();
      log.x_EE.rowwise() += x.transpose();
    }
    return list;
  }
};

AlignOptions as_stamped() {
  AlignOptions options;
  options.lag_s = 0;
  return options;
}

PlaceFit fit(const Grasp& grasp, const ToolPlaces& truth) {
  const auto real = grasp.logs(truth);
  const auto found = fit_places(
      real,
      [&](const std::vector<ToolPlaces>& candidates) {
        std::vector<std::vector<MeasuredLog>> all;
        for (const auto& places : candidates) all.push_back(grasp.logs(places));
        return all;
      },
      as_stamped());
  return found.value();
}

// Moments determine shifts across the force and turns together (M_z = side 20 N d_x + k turn_z), the shear
// between the hands the difference of the shifts, and the distance of the hands only the difference along the
// force. All identifiable components are explained; the others are zero or shared equally.
TEST(ToolPlace, ExplainsTheForcesOfTwoHandsAndSplitsTheUnidentifiable) {
  const Grasp grasp;
  const ToolPlaces truth{{.shift = {0.001, 0.004, -0.002}, .turn = {0.02, 0.03, -0.01}},
                         {.shift = {-0.003, -0.001, 0.0015}, .turn = {-0.015, -0.02, 0.01}}};
  const PlaceFit found = fit(grasp, truth);
  EXPECT_GT(found.before, 100);
  // The remaining cost is that of the places alone: at most that of the true ones.
  double price = 0;
  for (const auto& place : truth)
    price += place.shift.squaredNorm() / 1e-4 + place.turn.squaredNorm() / 1.2185e-3;
  EXPECT_LT(found.after, price);
  const ToolPlace &left = found.places[0], &right = found.places[1];
  EXPECT_NEAR(left.turn.y(), 0, 1e-6);  // about the line of force
  EXPECT_NEAR(right.turn.y(), 0, 1e-6);
  EXPECT_NEAR(left.shift.y() - right.shift.y(), 0.005, 5e-5);  // the difference, as drawn
  EXPECT_NEAR(left.shift.y() + right.shift.y(), 0, 1e-4);      // the sum is unidentifiable: equal shares
  EXPECT_NEAR(left.shift.x() - right.shift.x(), 0.004, 1e-4);  // by the shear
  for (std::size_t i = 0; i < 2; ++i) {
    const double side = i == 0 ? 1 : -1;
    const auto moment = [&](const ToolPlace& p) {  // z, by hand
      return side * (-kSqueeze * p.shift.x() + 300 * 0.004 * p.shift.y()) + 2.5 * p.turn.z();
    };
    EXPECT_NEAR(moment(found.places[i]), moment(truth[i]), 0.003) << i;
  }
}

// Pads as stiffening springs: one step with the slopes at zero misses, the next ones do not.
TEST(ToolPlace, StepsAgainWhereTheAnswerIsNotLinear) {
  const Grasp grasp{.k = 5, .bend = 12};
  const PlaceFit found = fit(grasp, {{.turn = {0.03, 0, 0}}, {.turn = {-0.03, 0, 0}}});
  EXPECT_LT(found.after, 0.03 * found.before);
  EXPECT_GT(found.runs, 14u);
}

TEST(ToolPlace, HasNoResultWithoutForces) {
  auto real = Grasp{}.logs(ToolPlaces(2));
  for (auto& log : real) log.F_EE.resize(0, 6);
  const auto same = [&](const std::vector<ToolPlaces>& candidates) {
    return std::vector<std::vector<MeasuredLog>>(candidates.size(), real);
  };
  EXPECT_FALSE(fit_places(real, same, as_stamped()));
  EXPECT_FALSE(fit_places(
      real, [](const auto&) { return std::vector<std::vector<MeasuredLog>>{}; }, as_stamped()));
}

// E moves to the given place, and the load on the joints stays the same.
TEST(ToolPlace, MovesTheFlangeAndLeavesTheMass) {
  const Experiment experiment = load_experiment("task-5");
  const TaskRun run{&experiment.variants.front(), "ideal", 1};
  const std::string text = task_scene_text(experiment, run);
  const Registry registry = build_registry(scene_plugins(text, experiment.scene));
  const SceneArm arm = parse_scene(text, experiment.scene, registry).arms.at(0);
  const RobotDescription robot = load_robot("fer");
  const ToolPlace place{.shift = {0.001, -0.002, 0.003}, .turn = {0.01, 0.02, -0.03}};
  const RobotDescription moved_robot = with_tool_place(robot, arm, place);

  const Pose X_FE = arm_config(arm).frames.X_FE;
  const Pose X_EE = (robot.flange.pose() * X_FE).inverse() * (moved_robot.flange.pose() * X_FE);
  EXPECT_LT((X_EE.position - place.shift).norm(), 1e-12);
  const Eigen::AngleAxisd turn(X_EE.rotation);
  EXPECT_LT((turn.angle() * turn.axis() - place.turn).norm(), 1e-9);

  const RigidBody tool{arm.tool.mass, arm.tool.p_FC, arm.tool.inertia_C};
  const RigidBody before = merged(robot.links.back(), moved(tool, robot.flange.pose()));
  const RigidBody after = merged(moved_robot.links.back(), moved(tool, moved_robot.flange.pose()));
  EXPECT_NEAR(after.mass, before.mass, 1e-12);
  EXPECT_LT((after.com - before.com).norm(), 1e-9);

  const RobotDescription same = with_tool_place(robot, arm, {});
  EXPECT_LT((same.flange.position - robot.flange.position).norm(), 1e-12);
  EXPECT_EQ(same.flange.rpy, robot.flange.rpy);
}

}  // namespace
}  // namespace multipanda::tool_place_test
