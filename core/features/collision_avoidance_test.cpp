#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "core/features/bounded_drive.hpp"
#include "core/features/builtins.hpp"
#include "core/features/collision_pairs.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/smooth_reference.hpp"
#include "core/testing/test_arm.hpp"
#include "models/arm_source.hpp"

namespace multipanda::collision_avoidance_test {
namespace {

using namespace test;

constexpr double kRange = 0.05, kStiffness = 1000, kDamping = 150;  // the defaults

// Potential and force of one pair, written in d: V = k r^2 (ln(r/d) - 1 + d/r), F = k r (r/d - 1), and from d
// = r/5 on the parabola that touches V there.
double pair_potential(double d) {
  const double k = kStiffness, r = kRange, d0 = r / 5;
  if (d >= r) return 0;
  if (d >= d0) return k * r * r * (std::log(r / d) - 1 + d / r);
  const double V0 = k * r * r * (std::log(5.0) - 0.8), F0 = 4 * k * r, slope = 25 * k;
  return V0 + F0 * (d0 - d) + 0.5 * slope * (d0 - d) * (d0 - d);
}
double pair_force(double d) {
  const double d0 = kRange / 5;
  return d >= d0 ? kStiffness * kRange * (kRange / d - 1)
                 : 4 * kStiffness * kRange + 25 * kStiffness * (d0 - d);
}

std::shared_ptr<const ArmModel> franka(const std::string& robot, const Pose& X_WB, bool hand = true) {
  return std::make_shared<const ArmModel>(arm_model_source(load_robot(robot), X_WB, hand));
}

// Arms of different joint counts on turned bases, with shapes of every kind.
Models made_up(const Pose& X = {}) {
  Models models;
  const std::array bases{Pose{rotation_from_rpy({0.2, -0.4, 0.3}), {0, 0, 0.1}},
                         Pose{rotation_from_rpy({-0.3, 0.5, 2.4}), {0.4, 0.3, 0}}};
  for (std::uint32_t k = 0; k < 2; ++k) {
    const std::size_t joints = k == 0 ? 7 : 6;
    auto source = TestArm::make(joints, 1 + k).source(X * bases[k], "arm" + std::to_string(k));
    add_collision_shapes(source, joints, 5 + k);
    models.push_back(std::make_shared<const ArmModel>(std::move(source)));
  }
  return models;
}

std::vector<Obstacle> some_obstacles(const Pose& X = {}) {
  return {
      {"floor", ConvexShape::half_space(), X * Pose{rotation_from_rpy({0.1, 0.05, 0}), {0, 0, -0.1}}},
      {"box", ConvexShape::box({0.3, 0.2, 0.4}), X * Pose{rotation_from_rpy({0.3, 1, 2}), {0.3, -0.3, 0.3}}},
      {"can", ConvexShape::cylinder(0.1, 0.3), X * Pose{rotation_from_rpy({1, 0, 0}), {-0.3, 0.3, 0.5}}},
      {"ball", ConvexShape::sphere({0, 0, 0}, 0.1), X * Pose{Matrix3::Identity(), {0.1, 0.5, 0.5}}}};
}

// Deeper than the thinnest hulls around the shapes' cores the cores overlap: distances are then those of a
// polytope, accurate enough for repulsion, but not for differentiation.
constexpr double kCoresApart = -0.025;

// Error of a torque per newton of the largest force: the normal's remaining error on curved bodies (the
// cylinder), at a lever of a meter.
constexpr double kNormalError = 3e-4;

JointVector zero(std::size_t n) { return joint_constant(n, 0); }

double potential(ControlletRig& rig, const std::vector<JointVector>& q) {
  for (std::size_t i = 0; i < q.size(); ++i) rig.place(i, q[i], zero(static_cast<std::size_t>(q[i].size())));
  EXPECT_EQ(rig.update(), LawResult::ok);
  return rig.output("potential_j")[0];
}

// Every distance of the scene by brute force, with shapes placed one by one.
struct Counted {
  double smallest = 1e9, potential = 0;
  int active = 0;
};
Counted count_all(ControlletRig& rig, const Models& models, const std::vector<Obstacle>& obstacles) {
  Counted counted;
  const auto take = [&](const ConvexShape& a, const Pose& X_a, const ConvexShape& b, const Pose& X_b) {
    const double exact = closest_points(a, X_a, b, X_b).distance;
    counted.smallest = std::min(counted.smallest, exact);
    if (exact >= kRange + 3 * kEven) return;
    const double d = smooth_reference(a, X_a, b, X_b);
    if (d >= kRange) return;
    ++counted.active;
    counted.potential += pair_potential(d);
  };
  const auto pose = [&](std::size_t arm, const CollisionShape& part) {
    const Pose X_WJ =
        part.joint < 0 ? models[arm]->X_WB() : rig.terms(arm).X_WJ(static_cast<std::size_t>(part.joint));
    return X_WJ * part.X_JS;
  };
  for (std::size_t i = 0; i < models.size(); ++i) {
    const auto& parts = models[i]->collision_shapes();
    for (const auto& [a, b] : models[i]->self_pairs()) {
      take(parts[a].shape, pose(i, parts[a]), parts[b].shape, pose(i, parts[b]));
    }
    for (const auto& part : parts) {
      for (const auto& obstacle : obstacles) {
        if (part.scene) take(part.shape, pose(i, part), obstacle.shape, obstacle.X_WO);
      }
      for (std::size_t k = i + 1; k < models.size(); ++k) {
        for (const auto& other : models[k]->collision_shapes()) {
          if (part.joint < 0 && other.joint < 0) continue;
          take(part.shape, pose(i, part), other.shape, pose(k, other));
        }
      }
    }
  }
  return counted;
}

TEST(CollisionAvoidance, TorqueIsTheGradientOfThePotentialOfAllNearPairs) {
  Draw draw(61);
  const Models models = made_up();
  const auto obstacles = some_obstacles();
  ControlletRig rig(collision_avoidance_feature(), models, obstacles);
  ASSERT_EQ(rig.start(), LawResult::ok);
  int near = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const std::vector<JointVector> q{draw.joints(7, 1.5), draw.joints(6, 1.5)};
    const double V = potential(rig, q);
    const std::vector<JointVector> tau{rig.tau(0), rig.tau(1)};
    const Counted counted = count_all(rig, models, obstacles);
    EXPECT_EQ(rig.output("active_pairs")[0], counted.active);
    EXPECT_NEAR(V, counted.potential, 1e-6 * (1 + V));
    EXPECT_NEAR(rig.output("smallest_distance_m")[0], counted.smallest, 1e-8);
    if (counted.smallest < kCoresApart) continue;
    near += counted.active > 0;
    const double tolerance = 1e-4 + kNormalError * rig.output("largest_force_n")[0];
    constexpr double h = 1e-6;
    for (std::size_t arm = 0; arm < 2; ++arm) {
      for (Eigen::Index j = 0; j < q[arm].size(); ++j) {
        auto above = q, below = q;
        above[arm][j] += h;
        below[arm][j] -= h;
        const double slope = (potential(rig, above) - potential(rig, below)) / (2 * h);
        EXPECT_NEAR(tau[arm][j], -slope, tolerance) << trial << " " << arm << " " << j;
      }
    }
  }
  EXPECT_GT(near, 40);
}

TEST(CollisionAvoidance, SeesAllPairsOfTwoArmsWithHands) {
  Draw draw(62);
  const Models models{franka("fer", Pose{rotation_from_rpy({0, 0, 0.5}), {0, 0.26, 0}}),
                      franka("fr3", Pose{rotation_from_rpy({0, 0.2, -0.5}), {0, -0.26, 0}})};
  const std::vector<Obstacle> obstacles{some_obstacles()[0], some_obstacles()[1]};
  ControlletRig rig(collision_avoidance_feature(), models, obstacles);
  int near = 0;
  for (int trial = 0; trial < 500; ++trial) {
    std::vector<JointVector> q;
    for (const auto& model : models) {
      JointVector q_i = model->q_home();
      for (Eigen::Index j = 0; j < 7; ++j) {
        q_i[j] = draw.uniform(model->limits().q_min[j], model->limits().q_max[j]);
      }
      q.push_back(q_i);
    }
    const double V = potential(rig, q);
    const Counted counted = count_all(rig, models, obstacles);
    EXPECT_EQ(rig.output("active_pairs")[0], counted.active);
    EXPECT_NEAR(V, counted.potential, 1e-9 * (1 + V));
    EXPECT_NEAR(rig.output("smallest_distance_m")[0], counted.smallest, 1e-9);
    near += counted.active >= 3;
  }
  EXPECT_GT(near, 30);
}

// The pairs of each arm with itself that its robot description does not ignore: nothing to push at home.
TEST(CollisionAvoidance, NoTorqueInTheHomePose) {
  for (const std::string robot : {"fer", "fr3"}) {
    for (const bool hand : {true, false}) {
      const auto model = franka(robot, {}, hand);
      EXPECT_EQ(model->collision_shapes().size(), hand ? 12u : 10u);
      EXPECT_EQ(model->self_pairs().size(), hand ? 26u : 14u);
      ControlletRig rig(collision_avoidance_feature(), {model});
      rig.place(0, model->q_home(), zero(7));
      ASSERT_EQ(rig.update(), LawResult::ok);
      EXPECT_TRUE(rig.tau(0).isZero(0)) << robot;
      EXPECT_GT(rig.output("smallest_distance_m")[0], 0.1);
      EXPECT_LT(rig.output("smallest_distance_m")[0], 1);
    }
  }
}

TEST(CollisionAvoidance, TorqueDoesNotDependOnThePoseOfTheWorld) {
  Draw draw(63);
  int near = 0;
  for (int trial = 0; trial < 40; ++trial) {
    const Pose X = draw.pose(2);
    const Models here = made_up(), there = made_up(X);
    ControlletRig a(collision_avoidance_feature(), here, some_obstacles());
    ControlletRig b(collision_avoidance_feature(), there, some_obstacles(X));
    const std::vector<JointVector> q{draw.joints(7, 1.5), draw.joints(6, 1.5)},
        dq{draw.joints(7, 0.5), draw.joints(6, 0.5)};
    for (auto* rig : {&a, &b}) {
      for (std::size_t i = 0; i < 2; ++i) rig->place(i, q[i], dq[i]);
      ASSERT_EQ(rig->update(), LawResult::ok);
    }
    if (a.output("smallest_distance_m")[0] < kCoresApart) continue;
    near += a.output("active_pairs")[0] > 0;
    for (std::size_t i = 0; i < 2; ++i) {
      EXPECT_LT((a.tau(i) - b.tau(i)).norm(), 1e-6 + kNormalError * a.output("largest_force_n")[0]) << trial;
    }
  }
  EXPECT_GT(near, 3);
}

// To the bit as if the obstacles had been there from the start.
TEST(CollisionAvoidance, ObstaclesAreWhereTheyAreNow) {
  Draw draw(64);
  const Models models = made_up();
  const auto there = some_obstacles();
  const Pose elsewhere{rotation_from_rpy({0.4, 0.2, -1}), {0, 0, -30}};
  ControlletRig moved(collision_avoidance_feature(), models, some_obstacles(elsewhere));
  ControlletRig fixed(collision_avoidance_feature(), models, there);
  ControlletRig none(collision_avoidance_feature(), models, some_obstacles(elsewhere));
  int near = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const bool back = trial % 3 == 2;  // and away again
    const auto places = some_obstacles(back ? elsewhere : Pose{});
    for (std::size_t i = 0; i < places.size(); ++i) moved.place_obstacle(i, places[i].X_WO);
    const std::vector<JointVector> q{draw.joints(7, 1.5), draw.joints(6, 1.5)},
        dq{draw.joints(7, 0.5), draw.joints(6, 0.5)};
    for (auto* rig : {&moved, &fixed, &none}) {
      for (std::size_t i = 0; i < 2; ++i) rig->place(i, q[i], dq[i]);
      ASSERT_EQ(rig->update(), LawResult::ok);
    }
    near += fixed.output("potential_j") != none.output("potential_j");
    ControlletRig& same = back ? none : fixed;
    for (std::size_t i = 0; i < 2; ++i) EXPECT_EQ(moved.tau(i), same.tau(i)) << trial;
    EXPECT_EQ(moved.output("smallest_distance_m"), same.output("smallest_distance_m")) << trial;
  }
  EXPECT_GT(near, 10);
}

// The distance at which a pair has that force.
double distance_of(double force) {
  double near = -1, far = kRange;
  for (int round = 0; round < 80; ++round)
    (pair_force(0.5 * (near + far)) > force ? near : far) = 0.5 * (near + far);
  return far;
}

// The damping dissipates energy of both arms together, is zero while the gap opens, and linear in the speed.
// It is bounded by the mass that both arms' points have along the normal.
TEST(CollisionAvoidance, AnObstacleThatOnlyTurnsOrOnlyMovesIsSeen) {
  const Obstacle box = some_obstacles()[1];
  const Models arm{made_up()[0]};
  for (const bool turns : {false, true}) {
    Obstacle there = box;
    if (turns)
      there.X_WO.rotation = rotation_from_rpy({0.8, 0.3, 0}) * there.X_WO.rotation;
    else
      there.X_WO.position += Vector3(-0.1, 0.1, 0);
    ControlletRig moved(collision_avoidance_feature(), arm, {box}),
        fresh(collision_avoidance_feature(), arm, {there});
    ControlletRig left(collision_avoidance_feature(), arm, {box});
    for (ControlletRig* rig : {&moved, &fresh, &left}) {
      ASSERT_EQ(rig->start(), LawResult::ok);
      ASSERT_EQ(rig->tick(0.001), LawResult::ok);
    }
    moved.place_obstacle(0, there.X_WO);
    Draw draw(37);
    double difference = 0;
    for (int trial = 0; trial < 40; ++trial) {
      const JointVector q = draw.joints(7, 1.5);
      for (ControlletRig* rig : {&moved, &fresh, &left}) {
        rig->place(0, q, joint_constant(7, 0));
        ASSERT_EQ(rig->tick(0.001), LawResult::ok);
      }
      EXPECT_EQ(moved.output("smallest_distance_m"), fresh.output("smallest_distance_m"));
      EXPECT_EQ(moved.tau(0), fresh.tau(0));
      difference += std::abs(moved.output("smallest_distance_m")[0] - left.output("smallest_distance_m")[0]);
    }
    EXPECT_GT(difference, 1e-3);
  }
}

TEST(CollisionAvoidance, ASingleShapeIsCheckedAgainstASingleObstacle) {
  auto source = TestArm::make(7).source();
  source.collision_shapes = {{"tip", 6, ConvexShape::sphere({0, 0, 0}, 0.05), {}}};
  const Vector3 ball(0.2, -0.1, 0.3);
  ControlletRig rig(collision_avoidance_feature(), {std::make_shared<const ArmModel>(std::move(source))},
                    {{"ball", ConvexShape::sphere({0, 0, 0}, 0.1), Pose{Matrix3::Identity(), ball}}});
  ASSERT_EQ(rig.start(), LawResult::ok);
  Draw draw(38);
  for (int trial = 0; trial < 10; ++trial) {
    rig.place(0, draw.joints(7, 1.5), joint_constant(7, 0));
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    EXPECT_NEAR(rig.output("smallest_distance_m")[0], (rig.terms(0).X_WJ(6).position - ball).norm() - 0.15,
                1e-9);
  }
}

// What an own arm can move is checked against all else once, and nothing that no own arm can move.
TEST(CollisionPairs, AreThoseThatAnOwnArmCanMove) {
  const Models arms = made_up();
  const std::vector<Obstacle> obstacles = some_obstacles();
  for (const std::vector<ArmIndex>& own : {std::vector<ArmIndex>{0}, {1}, {0, 1}}) {
    const auto is_own = [&](ArmIndex arm) { return std::find(own.begin(), own.end(), arm) != own.end(); };
    std::size_t self = 0, with_obstacles = 0, between_arms = 0;
    for (const ArmIndex arm : own) {
      self += arms[arm]->self_pairs().size();
      for (const auto& shape : arms[arm]->collision_shapes())
        with_obstacles += shape.joint >= 0 && shape.scene ? obstacles.size() : 0;
    }
    for (const auto& a : arms[0]->collision_shapes()) {
      for (const auto& b : arms[1]->collision_shapes())
        between_arms += (is_own(0) && a.joint >= 0) || (is_own(1) && b.joint >= 0);
    }
    const CollisionPairs pairs(FeatureContext{arms, own, obstacles, {}});
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const auto &a = pairs.body(pairs.pair(i).a), &b = pairs.body(pairs.pair(i).b);
      --(a.arm == b.arm ? self : b.arm == CollisionPairs::kNoArm ? with_obstacles : between_arms);
    }
    EXPECT_EQ(self, 0u);
    EXPECT_EQ(with_obstacles, 0u);
    EXPECT_EQ(between_arms, 0u);
  }
}

// Each arm is kept from the base by its own model. The other arm's copy counts only where it is another body.
TEST(CollisionPairs, ArmsOfOneRobotHaveOneBase) {
  const std::vector<Vector3> corners{{0, 0, 0}, {0.2, 0, 0}, {0, 0.3, 0}, {0, 0, -0.4}};
  const std::vector<ConvexShape> bases{ConvexShape::capsule({0, 0, -0.2}, {0, 0, 0.1}, 0.1),
                                       ConvexShape::hull(corners)};
  for (const ConvexShape& base : bases) {
    for (const double apart : {0.0, 0.01}) {
      Models models;
      for (std::uint32_t k = 0; k < 2; ++k) {
        const Pose X_WB{rotation_from_rpy({0.2, -0.4, 0.3}), {k * apart, 0, 0.1}};
        auto source = TestArm::make(7, 1 + k).source(X_WB, "arm" + std::to_string(k));
        source.collision_shapes = {{"link0", -1, base, {}, false},
                                   {"link6", 5, ConvexShape::sphere({0, 0, 0.1 + k}, 0.05), {}}};
        source.self_pairs = {{0, 1}};
        models.push_back(std::make_shared<const ArmModel>(std::move(source)));
      }
      for (const std::vector<ArmIndex>& own : {std::vector<ArmIndex>{0, 1}, {0}}) {
        const CollisionPairs pairs(
            FeatureContext{.arms = models, .own = own, .obstacles = {}, .friction_compensated = {}});
        // Each own arm with its base, and the arms with each other; a second base meets each arm once more.
        EXPECT_EQ(pairs.size(), own.size() + 1 + (apart > 0 ? own.size() : 0));
      }
    }
  }
}

// Each of these differs from the first of its kind somewhere: another body, which both arms keep from.
TEST(CollisionPairs, BasesThatDifferAnywhereAreTwoBodies) {
  const auto hull = [](int moved) {
    std::vector<Vector3> corners{{0, 0, 0}, {0.2, 0, 0}, {0, 0.3, 0}, {0, 0, -0.4}};
    if (moved >= 0) corners[static_cast<std::size_t>(moved)].z() += 0.01;
    return ConvexShape::hull(corners);
  };
  const std::vector<std::vector<ConvexShape>> kinds{
      {hull(-1), hull(0), hull(1), hull(2), hull(3)},
      {ConvexShape::capsule({0, 0, 0}, {0, 0, 0.1}, 0.1),
       ConvexShape::capsule({0, 0, 0.01}, {0, 0, 0.1}, 0.1),
       ConvexShape::capsule({0, 0, 0}, {0, 0, 0.11}, 0.1),
       ConvexShape::capsule({0, 0, 0}, {0, 0, 0.1}, 0.11)},
      {ConvexShape::sphere({0, 0, 0}, 0.1), ConvexShape::sphere({0, 0.01, 0}, 0.1)},
      {ConvexShape::box({0.1, 0.2, 0.3}), ConvexShape::box({0.1, 0.21, 0.3})}};
  for (const auto& kind : kinds) {
    for (std::size_t other = 0; other < kind.size(); ++other) {
      Models models;
      for (const std::size_t k : {std::size_t{0}, other}) {
        auto source = TestArm::make(7).source({}, "arm" + std::to_string(models.size()));
        source.collision_shapes = {{"link0", -1, kind[k], {}, false},
                                   {"link6", 5, ConvexShape::sphere({0, 0, 0.1}, 0.05), {}}};
        source.self_pairs = {{0, 1}};
        models.push_back(std::make_shared<const ArmModel>(std::move(source)));
      }
      const std::vector<ArmIndex> own{0, 1};
      const CollisionPairs pairs(FeatureContext{models, own, {}, {}});
      EXPECT_EQ(pairs.size(), other == 0 ? 3u : 5u) << other;
    }
  }
}

// The first link has the same numbers in its frame as the base of the other arm has in the world.
TEST(CollisionPairs, AFirstLinkIsNoBase) {
  Models models;
  for (const int joint : {0, -1}) {
    auto source = TestArm::make(7).source({}, "arm" + std::to_string(models.size()));
    source.collision_shapes = {{"link", joint, ConvexShape::sphere({0, 0, 0}, 0.1), {}, false}};
    models.push_back(std::make_shared<const ArmModel>(std::move(source)));
  }
  for (const ArmIndex first : {ArmIndex{0}, ArmIndex{1}}) {
    if (first == 1) std::swap(models[0], models[1]);
    const std::vector<ArmIndex> own{first};
    EXPECT_EQ(CollisionPairs(FeatureContext{models, own, {}, {}}).size(), 1u);
  }
}

// A hull around a base is wider than the body: an arm that reaches into it is not thrown out. Other shapes
// push it out gently enough.
TEST(CollisionAvoidance, IsNotSwitchedOnWithinAHullOfABase) {
  const std::vector<Vector3> corners{
      {-1.6, -1.6, -1}, {1.6, -1.6, -1}, {-1.6, 1.6, -1}, {1.6, 1.6, -1}, {0, 0, 1.3}};
  for (const bool hull : {true, false}) {
    for (const bool of_another : {false, true}) {
      Models models;
      for (std::uint32_t k = 0; k < 2; ++k) {
        auto source =
            TestArm::make(7, 1 + k).source({rotation_from_rpy({0.2, -0.4, 0.3}), {6.0 * k, 0, 0.1}});
        source.collision_shapes = {{"link0.1",
                                    -1,
                                    hull ? ConvexShape::hull(corners) : ConvexShape::sphere({0, 0, 0}, 0.9),
                                    {},
                                    false},
                                   {"link6", 5, ConvexShape::sphere({0, 0, 0}, 0.05), {}}};
        if (k == 0) source.self_pairs = {{0, 1}};
        models.push_back(std::make_shared<const ArmModel>(std::move(source)));
      }
      // An arm that reaches into its own base, or one that stands in that of another.
      if (of_another) {
        auto source = TestArm::make(7, 2).source(models[0]->X_WB());
        source.collision_shapes = {{"link6", 5, ConvexShape::sphere({0, 0, 0}, 0.05), {}}};
        models[1] = std::make_shared<const ArmModel>(std::move(source));
      }
      ControlletRig rig(collision_avoidance_feature(), models, {},
                        of_another ? std::vector<ArmIndex>{1} : std::vector<ArmIndex>{0});
      const std::size_t arm = of_another ? 1 : 0;
      Draw draw(17);
      int inside = 0;
      for (int trial = 0; trial < 200; ++trial) {
        for (std::size_t i = 0; i < 2; ++i) rig.place(i, draw.joints(7, 1.5), zero(7));
        const Vector3 p = models[0]->X_WB().inverse() * rig.terms(arm).X_WJ(5).position;
        // Planes of the pyramid: z = -1, and four through the tip, 2.3 high and 1.6 wide.
        const double side = std::max(std::abs(p.x()), std::abs(p.y()));
        const double distance =
            std::max(-1 - p.z(), (2.3 * side - 1.6 * (1.3 - p.z())) / std::hypot(2.3, 1.6));
        if (distance > -0.01 && distance < 0.06) continue;  // beside an edge it is farther than from a plane
        const bool refused = hull && distance < 0;
        inside += distance < 0;
        EXPECT_EQ(rig.start(), refused ? LawResult::fault : LawResult::ok) << distance;
      }
      EXPECT_GT(inside, 5);
      EXPECT_LT(inside, 195);
    }
  }
}

// Close to a hull the push would begin with four times k r and more. The refusal names the pair.
TEST(CollisionAvoidance, IsNotSwitchedOnCloseToAHullOfABase) {
  const Pose X_WB{rotation_from_rpy({0.2, -0.4, 0.3}), {0.3, 0.2, 0.1}};
  ModelTerms terms(TestArm::make(7).model(X_WB));
  terms.update(bent(7), zero(7));
  const Vector3 p = X_WB.inverse() * terms.X_WJ(5).position;
  for (const double range : {0.05, 0.1}) {
    for (const double share : {0.19, 0.21}) {
      const double radius = 0.05, gap = share * range;
      std::vector<Vector3> corners;  // a box whose face is that far from the sphere
      for (const double x : {p.x() + radius + gap, p.x() + 1}) {
        for (const double y : {-0.5, 0.5}) {
          for (const double z : {-0.5, 0.5}) corners.push_back({x, p.y() + y, p.z() + z});
        }
      }
      auto source = TestArm::make(7).source(X_WB, "left");
      source.collision_shapes = {{"link0.3", -1, ConvexShape::hull(corners), {}, false},
                                 {"link6", 5, ConvexShape::sphere({0, 0, 0}, radius), {}}};
      source.self_pairs = {{0, 1}};
      ControlletRig rig(collision_avoidance_feature(), {std::make_shared<const ArmModel>(std::move(source))});
      rig.set("range_m", {range});
      rig.place(0, bent(7), zero(7));
      EXPECT_EQ(rig.start_condition().find("link0.3"), std::string::npos);
      EXPECT_EQ(rig.start(), share < 0.2 ? LawResult::fault : LawResult::ok);
      const std::string pair = "link0.3 of arm 'left' and link6 of arm 'left' were too near";
      EXPECT_EQ(rig.start_condition().starts_with(pair), share < 0.2) << rig.start_condition();
      EXPECT_NE(rig.start_condition().find("a fifth of range_m"), std::string::npos);
      rig.set("range_m", {0.005});  // no longer too near, so no pair is named
      EXPECT_EQ(rig.start(), LawResult::ok);
      EXPECT_EQ(rig.start_condition().find("link0.3"), std::string::npos);
    }
  }
}

TEST(CollisionAvoidance, DampsApproachOnly) {
  Draw draw(64);
  const Models models = made_up();
  ControlletRig rig(collision_avoidance_feature(), models, some_obstacles());
  int closing = 0, opening = 0, light = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const std::vector<JointVector> q{draw.joints(7, 1.5), draw.joints(6, 1.5)},
        dq{draw.joints(7, 0.5), draw.joints(6, 0.5)};
    const double damping = trial % 2 == 0 ? kDamping : 1000;
    rig.set("damping_n_s_per_m", {damping});
    std::vector<JointVector> still, moving, faster;
    potential(rig, q);
    if (rig.output("active_pairs")[0] != 1) continue;
    for (std::size_t i = 0; i < 2; ++i) still.push_back(rig.tau(i));
    const auto run = [&](double speed, std::vector<JointVector>& tau) {
      for (std::size_t i = 0; i < 2; ++i) rig.place(i, q[i], speed * dq[i]);
      EXPECT_EQ(rig.update(), LawResult::ok);
      for (std::size_t i = 0; i < 2; ++i) tau.push_back(rig.tau(i) - still[i]);
    };
    run(1, moving);
    run(2, faster);
    // The potential's rate shows whether the gap closes.
    const double rate = -(still[0].dot(dq[0]) + still[1].dot(dq[1]));
    const double power = moving[0].dot(dq[0]) + moving[1].dot(dq[1]);
    if (rate > 1e-9) {
      ++closing;
      EXPECT_LT(power, 0);
      // F_D = D min(1 - d/r, 1) v_n with v_n = rate / F_K, along the same closest points.
      potential(rig, q);
      const double F = rig.output("largest_force_n")[0], d = distance_of(F);
      double mobility = 0;
      for (std::size_t i = 0; i < 2; ++i) {
        const JointVector along = still[i] / F;
        mobility += along.dot(JointVector(inverse(rig.terms(i).M()) * along));
      }
      const double D = std::min(damping, 100 / mobility);
      light += D < damping;
      const double v_n = rate / F, F_D = D * std::min(1 - d / kRange, 1.0) * v_n;
      for (std::size_t i = 0; i < 2; ++i) {
        EXPECT_LT((moving[i] - F_D / F * still[i]).norm(), 1e-7 * (1 + still[i].norm()));
        EXPECT_LT((faster[i] - 2 * moving[i]).norm(), 1e-9 * (1 + moving[i].norm()));
      }
    } else {
      ++opening;
      EXPECT_EQ(power, 0);
    }
  }
  EXPECT_GT(closing, 10);
  EXPECT_GT(opening, 10);
  EXPECT_GT(light, 3);
}

// As to an obstacle in the same place.
TEST(CollisionAvoidance, AnArmBrakesTowardsItsOwnBase) {
  const Pose X_WB{rotation_from_rpy({0.2, -0.4, 0.3}), {0.3, 0.2, 0.1}};
  const ConvexShape ball = ConvexShape::sphere({0, 0, 0.3}, 0.3);
  auto with_base = TestArm::make(7).source(X_WB);
  with_base.collision_shapes = {{"link6", 5, ConvexShape::sphere({0, 0, 0}, 0.05), {}}};
  auto bare = with_base;
  with_base.collision_shapes.insert(with_base.collision_shapes.begin(), {"link0", -1, ball, {}, false});
  with_base.self_pairs = {{0, 1}};
  ControlletRig own(collision_avoidance_feature(), {std::make_shared<const ArmModel>(std::move(with_base))}),
      other(collision_avoidance_feature(), {std::make_shared<const ArmModel>(std::move(bare))},
            {{"ball", ball, X_WB}});
  Draw draw(71);
  int near = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const JointVector q = draw.joints(7, 1.5), dq = draw.joints(7, 0.5);
    for (ControlletRig* rig : {&own, &other}) {
      rig->set("range_m", {0.3});
      rig->place(0, q, dq);
      ASSERT_EQ(rig->update(), LawResult::ok);
    }
    EXPECT_LT((own.tau(0) - other.tau(0)).norm(), 1e-9 * (1 + other.tau(0).norm()));
    near += other.output("active_pairs")[0] > 0;
  }
  EXPECT_GT(near, 10);
}

// An arm of another owner is checked, but not pushed; the own arm gets the same torque as with one owner.
TEST(CollisionAvoidance, ChecksArmsOfOtherOwners) {
  Draw draw(65);
  const Models models = made_up();
  ControlletRig both(collision_avoidance_feature(), models);
  ControlletRig first(collision_avoidance_feature(), models, {}, {0});
  ControlletRig second(collision_avoidance_feature(), models, {}, {1});
  int near = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const std::vector<JointVector> q{draw.joints(7, 1.5), draw.joints(6, 1.5)},
        dq{draw.joints(7, 0.5), draw.joints(6, 0.5)};
    for (auto* rig : {&both, &first, &second}) {
      for (std::size_t i = 0; i < 2; ++i) rig->place(i, q[i], dq[i]);
      ASSERT_EQ(rig->update(), LawResult::ok);
    }
    EXPECT_TRUE(first.tau(1).isZero(0));
    EXPECT_TRUE(second.tau(0).isZero(0));
    EXPECT_LT((first.tau(0) - both.tau(0)).norm(), 1e-9 * (1 + both.tau(0).norm()));
    EXPECT_LT((second.tau(1) - both.tau(1)).norm(), 1e-9 * (1 + both.tau(1).norm()));
    near += both.tau(0).norm() > 0 && both.tau(1).norm() > 0;
  }
  EXPECT_GT(near, 20);
}

TEST(CollisionAvoidance, AnArmWithoutShapesHasNoPairs) {
  ControlletRig rig(collision_avoidance_feature(), {TestArm::make().model()}, some_obstacles());
  ASSERT_EQ(rig.update(), LawResult::ok);
  EXPECT_TRUE(rig.tau(0).isZero(0));
  EXPECT_EQ(rig.output("smallest_distance_m")[0], 10);
}

// A NaN state must not look like "nothing is near".
TEST(CollisionAvoidance, NaNInAStateIsAFault) {
  const Models models = made_up();
  ControlletRig rig(collision_avoidance_feature(), models, some_obstacles());
  JointVector q = zero(7);
  q[2] = NAN;
  rig.place(0, q, zero(7));
  rig.place(1, zero(6), zero(6));
  EXPECT_TRUE(rig.update() == LawResult::fault || !rig.tau(0).allFinite());
}

// The other arm's owner loses it; this one keeps its distance from where that arm was last.
TEST(CollisionAvoidance, NaNOfAnotherOwnersArmStaysThere) {
  Draw draw(66);
  const Models models = made_up();
  ControlletRig rig(collision_avoidance_feature(), models, some_obstacles(), {0});
  ControlletRig healthy(collision_avoidance_feature(), models, some_obstacles(), {0});
  // Too little for its bound, which counts an unknown arm as immovable.
  for (auto* r : {&rig, &healthy}) r->set("damping_n_s_per_m", {5});
  int near = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const JointVector q = draw.joints(7, 1.5), dq = draw.joints(7, 0.5);
    const JointVector other = draw.joints(6, 1.5);
    for (auto* r : {&rig, &healthy}) {
      r->place(0, q, dq);
      r->place(1, other, zero(6));
      ASSERT_EQ(r->update(), LawResult::ok);
    }
    const auto expect_as_healthy = [&] {
      ASSERT_EQ(rig.update(), LawResult::ok);
      EXPECT_EQ(rig.tau(0), healthy.tau(0));
      EXPECT_EQ(rig.output("smallest_distance_m"), healthy.output("smallest_distance_m"));
      EXPECT_EQ(rig.output("active_pairs"), healthy.output("active_pairs"));
    };
    JointVector broken = other;
    broken[trial % 6] = NAN;
    rig.place(1, broken, zero(6));
    expect_as_healthy();
    JointVector rates = zero(6);
    rates[trial % 6] = NAN;
    rig.place(1, other, rates);
    expect_as_healthy();
    rig.place(1, broken, rates);
    expect_as_healthy();
    near += healthy.tau(0).norm() > 0;
  }
  EXPECT_GT(near, 40);
}

// An arm that never had a place is nowhere.
TEST(CollisionAvoidance, AnArmWithoutAnyStateIsLeftOut) {
  Draw draw(67);
  const Models models = made_up();
  ControlletRig alone(collision_avoidance_feature(), {models[0]}, some_obstacles());
  ControlletRig rig(collision_avoidance_feature(), models, some_obstacles(), {0});
  rig.place(1, zero(6) * NAN, zero(6));
  int near = 0;
  for (int trial = 0; trial < 100; ++trial) {
    const JointVector q = draw.joints(7, 1.5), dq = draw.joints(7, 0.5);
    for (auto* r : {&rig, &alone}) {
      r->place(0, q, dq);
      ASSERT_EQ(r->update(), LawResult::ok);
    }
    ASSERT_TRUE(rig.tau(0).allFinite());
    // The other arm's base stands still and is known.
    if (rig.output("active_pairs") != alone.output("active_pairs")) continue;
    EXPECT_LT((rig.tau(0) - alone.tau(0)).norm(), 1e-12);
    near += rig.tau(0).norm() > 0;
  }
  EXPECT_GT(near, 20);
}

TEST(CollisionAvoidance, AFirstLinkWithoutAnyStateIsLeftOut) {
  Models models;
  for (const int joint : {5, 0}) {
    auto source = TestArm::make(7).source();
    source.collision_shapes = {{"link", joint, ConvexShape::sphere({0, 0, 0}, 0.05), {}}};
    models.push_back(std::make_shared<const ArmModel>(std::move(source)));
  }
  ControlletRig rig(collision_avoidance_feature(), models, {}, {0});
  rig.place(1, zero(7) * NAN, zero(7));
  rig.place(0, bent(7), zero(7));
  ASSERT_EQ(rig.update(), LawResult::ok);
  EXPECT_EQ(rig.output("smallest_distance_m")[0], 10);
  rig.place(1, bent(7), zero(7));
  ASSERT_EQ(rig.update(), LawResult::ok);
  EXPECT_LT(rig.output("smallest_distance_m")[0], 10);
}

// Of its own arms, in either place.
TEST(CollisionAvoidance, NaNOfAnOwnArmIsAFault) {
  const Models models = made_up();
  for (const std::size_t arm : {0, 1}) {
    for (const bool velocity : {false, true}) {
      ControlletRig rig(collision_avoidance_feature(), models, some_obstacles());
      ASSERT_EQ(rig.update(), LawResult::ok);
      JointVector q = zero(arm == 0 ? 7 : 6), dq = q;
      (velocity ? dq : q)[2] = NAN;
      rig.place(arm, q, dq);
      EXPECT_EQ(rig.update(), LawResult::fault);
    }
  }
}

TEST(CollisionAvoidance, ShowsNothingButTheDistanceWhereNothingIsNear) {
  Draw draw(33);
  ControlletRig rig(collision_avoidance_feature(), made_up(), some_obstacles());
  rig.set("range_m", {0.005});
  ASSERT_EQ(rig.start(), LawResult::ok);
  int apart = 0;
  for (int trial = 0; trial < 200; ++trial) {
    for (std::size_t arm = 0; arm < 2; ++arm) {
      const std::size_t n = arm == 0 ? 7 : 6;
      rig.place(arm, bent(n) + draw.joints(n, 1), JointVector(draw.joints(n, 1)));
    }
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    if (rig.output("smallest_distance_m")[0] < 0.01) continue;
    ++apart;
    std::vector<double> others = rig.outputs();
    EXPECT_EQ(std::count(others.begin(), others.end(), 0.0), 3);
    EXPECT_EQ(rig.tau(0).norm() + rig.tau(1).norm(), 0);
  }
  EXPECT_GE(apart, 5);
}

// Within bounds for contact: the hand is drawn with them at most, with nothing where the push itself would
// have it at hand_speed, and as without bounds where it approaches.
TEST(CollisionAvoidance, PushesNoHandHarderOrFasterThanItsBounds) {
  Draw draw(68);
  const auto model = franka("fer", {});
  ModelTerms terms(model);
  int pushed = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const JointVector q = model->q_home() + draw.joints(7, 0.1);
    terms.update(q, zero(7));
    const double below = terms.X_WE().position.z() - 0.0166 - draw.uniform(-0.01, 0.05);
    const std::vector<Obstacle> table{
        {"table", ConvexShape::half_space(), Pose{Matrix3::Identity(), {0, 0, below}}}};
    ControlletRig free(collision_avoidance_feature(), {model}, table),
        rig(collision_avoidance_feature(), {model}, table);
    const ContactBounds contact;
    rig.bound(contact);
    const auto run = [&](ControlletRig& feature, const JointVector& dq) {
      feature.place(0, q, dq);
      EXPECT_EQ(feature.start(), LawResult::ok);
      for (int k = 0; k < 101; ++k) EXPECT_EQ(feature.tick(0.001), LawResult::ok);  // it has come in
      return feature.tau(0);
    };
    const JointVector at_rest = run(rig, zero(7)), unbounded = run(free, zero(7));
    if (unbounded.isZero(0)) continue;
    const Eigen::MatrixXd J = rig.terms(0).J_V_WE(), M_inv = inverse(rig.terms(0).M());
    const Eigen::VectorXd pull = inverse(J * M_inv * J.transpose()) * (J * (M_inv * at_rest));
    EXPECT_LT(pull.head<3>().norm(), 1.001 * contact.spring_force);
    EXPECT_LT(pull.tail<3>().norm(), 1.001 * contact.spring_moment);
    pushed += 1;
    // Joints at s M^-1 tau move as the push would have them after s seconds.
    const JointVector away = M_inv * at_rest;
    const double hand = (J.topRows<3>() * away).norm(),
                 s = std::min(0.9 * contact.hand_speed / hand, 1 / away.norm());
    for (const double share : {0.25, 0.5, 0.75}) {
      const double gone = share * s * std::min(1 / s, 200.0);
      const double fast = std::clamp((share * s * hand / contact.hand_speed - 0.6) / 0.3, 0.0, 1.0);
      const double left = (1 - gone) * (1 - fast * gone);
      EXPECT_LT((run(rig, JointVector(away * (share * s))) - left * at_rest).norm(), 1e-9) << share;
    }
    EXPECT_LT(run(rig, JointVector(away * (4 * std::max(s, 1 / 200.0)))).norm(), 1e-9);
    const JointVector closing = away * (-0.1 / hand);
    EXPECT_LT((run(rig, closing) - at_rest - (run(free, closing) - unbounded)).norm(), 1e-9);
  }
  EXPECT_GT(pushed, 20);
}

// An arm that comes fast drives the other one away with no more than that. What comes fast itself is braked
// as without bounds.
TEST(CollisionAvoidance, AnArmThatComesThrowsNoOther) {
  const Models models{franka("fer", {}), franka("fer", {rotation_from_rpy({0, 0, M_PI}), {0.69, 0.02, 0}})};
  ControlletRig free(collision_avoidance_feature(), models, {}, {0}),
      rig(collision_avoidance_feature(), models, {}, {0});
  const ContactBounds contact;
  rig.bound(contact);
  const auto run = [&](ControlletRig& feature, double own, double other) {
    for (const std::size_t arm : {0u, 1u}) {
      ModelTerms& terms = feature.terms(arm);
      terms.update(models[arm]->q_home(), zero(7));
      const double speed = arm == 0 ? own : -other;  // along x
      const JointVector dq = terms.task().J_bar.leftCols<1>() * speed;
      feature.place(arm, models[arm]->q_home(), dq);
    }
    EXPECT_EQ(feature.start(), LawResult::ok);
    for (int k = 0; k < 101; ++k) EXPECT_EQ(feature.tick(0.001), LawResult::ok);  // it has come in
    return JointVector(feature.tau(0));
  };
  const auto pull = [&](const JointVector& tau) {
    return Vector6(rig.terms(0).task().J_bar.transpose() * tau).head<3>().norm();
  };
  EXPECT_GT(pull(run(free, 0, 2)), 2 * contact.spring_force);
  EXPECT_GT(pull(run(rig, 0, 2)), 0.9 * contact.spring_force);
  EXPECT_LT(pull(run(rig, 0, 2)), 1.001 * contact.spring_force);
  const JointVector braked = run(rig, 2, 0) - run(rig, 0, 0), whole = run(free, 2, 0) - run(free, 0, 0);
  EXPECT_GT(pull(whole), contact.spring_force);
  EXPECT_LT((braked - whole).norm(), 1e-9);
}

// Pushes of two features against a hand, and a law's against those.
TEST(BoundedDrive, OfFeaturesTogetherKeepsToTheBounds) {
  Draw draw(69);
  const auto model = franka("fer", {});
  ModelTerms terms(model);
  ArmState state;
  JointVector tau, law;
  const OwnedArm arm{&state, &terms, &tau};
  std::array scene{OwnedArm{&state, &terms, &law}};
  ControlContext context;
  context.dt = 0.2;  // each comes in at once
  context.scene_arms = scene;
  context.contact = {};
  const double most = context.contact.spring_force;
  for (int trial = 0; trial < 50; ++trial) {
    state.q = model->q_home() + draw.joints(7, 0.1);
    state.dq = zero(7);
    terms.update(state.q, state.dq);
    const Eigen::MatrixXd J = terms.J_V_WE();
    const Vector3 along = Vector3(draw.uniform(-1, 1), draw.uniform(-1, 1), draw.uniform(-1, 1)).normalized();
    const Vector3 across = along.unitOrthogonal();
    const auto force = [&](const Vector3& f) -> JointVector { return J.topRows<3>().transpose() * f; };
    const auto drawn = [&](const JointVector& torque) -> Vector3 {
      const Eigen::MatrixXd M_inv = inverse(terms.M());
      return (inverse(J * M_inv * J.transpose()) * (J * (M_inv * torque))).head<3>();
    };
    const auto both = [&](const Vector3& first, const Vector3& second, const Vector3& of_law) {
      law = force(of_law);
      tau = zero(7);
      tau += BoundedDrive().limit(context, arm, force(first));
      tau += BoundedDrive().limit(context, arm, force(second));
      return drawn(tau);
    };
    const Vector3 none = Vector3::Zero(), push = 2 * most * along;
    const double one = both(push, none, none).norm();  // less where the arm is light
    EXPECT_GT(one, 0.3 * most);
    EXPECT_LT(one, 1.001 * most);
    EXPECT_LT(both(push, push, none).norm(), 1.001 * most);
    EXPECT_LT(both(push, -push, none).norm(), 1.001 * most);
    EXPECT_LT((both(push, push, -most * along) - most * along).norm(), 1.001 * most);
    const Vector3 other = both(none, 2 * most * across, none);  // takes nothing from it
    EXPECT_LT((both(push, 2 * most * across, none) - both(push, none, none) - other).norm(), 1e-6);
  }
}

// By a tenth of the bound in 10 ms, along the force or about the moment that is nearer to its bound, and
// again after a cycle without a push.
TEST(BoundedDrive, ComesInWithinATenthOfASecond) {
  Draw draw(70);
  const auto model = franka("fer", {});
  ModelTerms terms(model);
  ArmState state;
  state.q = model->q_home();
  state.dq = zero(7);
  terms.update(state.q, state.dq);
  JointVector tau = zero(7);
  const OwnedArm arm{&state, &terms, &tau};
  ControlContext context;
  context.contact = {};
  const Eigen::MatrixXd J = terms.J_V_WE(), M_inv = inverse(terms.M());
  int light = 0;
  for (int trial = 0; trial < 30; ++trial) {
    Vector6 push = Vector6::Zero();
    for (double& each : push) each = draw.uniform(-60, 60);
    push.tail<3>() *= draw.coin() ? 0.02 : 0.5;
    const JointVector torque = J.transpose() * push;
    context.dt = 0.2;
    const JointVector whole = BoundedDrive().limit(context, arm, torque);
    // J^T push pulls with `push`; alone it reaches 0.9 of 0.25 m/s or 1 rad/s at this rate.
    const Eigen::VectorXd ddq = M_inv * torque;
    const double rate = std::max((J.topRows<3>() * ddq).norm() / 0.225, ddq.norm());
    const double force = push.head<3>().norm() / 60, moment = push.tail<3>().norm() / 15;
    const double part = std::min({1.0, 200 / rate, 1 / force, 1 / moment}),
                 of_bounds = part * std::max(force, moment);
    EXPECT_LT((whole - part * torque).norm(), 1e-9 * torque.norm());
    light += part < 1 / std::max({1.0, force, moment});
    BoundedDrive drive;
    for (const int start : {1, 2}) {
      for (int k = 1; k <= 110; ++k) {
        context.dt = 0.001 * start;
        const JointVector now = drive.limit(context, arm, torque);
        const double share = std::min(1.0, 0.01 * start * k / of_bounds);
        ASSERT_LT((now - share * whole).norm(), 1e-9 * (1 + whole.norm())) << trial << " " << k;
      }
      EXPECT_EQ(drive.limit(context, arm, zero(7)).norm(), 0);
    }
  }
  EXPECT_GT(light, 3);
  EXPECT_LT(light, 27);
}

}  // namespace
}  // namespace multipanda::collision_avoidance_test
