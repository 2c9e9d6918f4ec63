// Hidden plants: inside their ranges, physical, independent of each other, and the same in every scene.
#include "scene/hidden_plant.hpp"

#include <filesystem>
#include <fstream>
#include <set>

#include <Eigen/Eigenvalues>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::hidden_plant_test {
namespace {

namespace fs = std::filesystem;

// Smallest eigenvalue of the pseudo-inertia about the link's origin: some distribution of positive mass.
double smallest_pseudo_inertia(const RigidBody& body) {
  const Matrix3 second = 0.5 * body.inertia.trace() * Matrix3::Identity() - body.inertia +
                         body.mass * body.com * body.com.transpose();
  Eigen::Matrix4d P;
  P << second, body.mass * body.com, body.mass * body.com.transpose(), body.mass;
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d>(P, Eigen::EigenvaluesOnly).eigenvalues().minCoeff();
}

struct Range {
  double low = 1e9, high = -1e9;
  void add(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
};

// Over many seeds each draw stays within its range and fills it.
TEST(HiddenPlants, FillTheirRanges) {
  const RobotDescription nominal = load_robot("fer");
  Range mass, com, payload, friction, delay, bandwidth, shift, turn;
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    const RobotDescription robot = draw_hidden_plant(nominal, seed, seed % 3);
    for (std::size_t i = 0; i < robot.links.size(); ++i)
      EXPECT_GT(smallest_pseudo_inertia(robot.links[i]), 0);
    EXPECT_EQ(robot.links[0].mass, nominal.links[0].mass);
    for (std::size_t i = 1; i < 7; ++i) {
      const double factor = robot.links[i].mass / nominal.links[i].mass;
      mass.add(factor);
      EXPECT_LT((robot.links[i].inertia - factor * nominal.links[i].inertia).norm(), 1e-12);
      for (int k = 0; k < 3; ++k) com.add(robot.links[i].com[k] - nominal.links[i].com[k]);
    }
    payload.add(robot.links[7].mass - nominal.links[7].mass);
    for (int j = 0; j < 7; ++j) friction.add(robot.friction->p1[j] / nominal.friction->p1[j]);
    EXPECT_EQ(robot.friction->p2, nominal.friction->p2);
    delay.add(robot.actuation->command_delay);
    bandwidth.add(robot.actuation->torque_bandwidth_hz);
    EXPECT_EQ(robot.torque_sensor->noise, 0.05);
    const Pose error = nominal.flange.pose().inverse() * robot.flange.pose();
    for (int k = 0; k < 3; ++k) shift.add(error.position[k]);
    turn.add(Eigen::AngleAxisd(error.rotation).angle());
  }
  const auto fills = [](const Range& range, double low, double high) {
    const double slack = 0.02 * (high - low);
    return range.low >= low - 1e-9 && range.high <= high + 1e-9 && range.low < low + slack &&
           range.high > high - slack;
  };
  EXPECT_TRUE(fills(mass, 0.9, 1.1));
  EXPECT_TRUE(fills(com, -0.010, 0.010));
  const double own = 0.1 * nominal.links[7].mass;
  EXPECT_GT(payload.low, -own);
  EXPECT_LT(payload.high, 1 + own);
  EXPECT_GT(payload.high - payload.low, 0.9);
  EXPECT_TRUE(fills(friction, 0.5, 1.5));
  EXPECT_TRUE(fills(delay, 0, 0.003));
  EXPECT_TRUE(fills(bandwidth, 30, 100));
  EXPECT_TRUE(fills(shift, -0.005, 0.005));
  EXPECT_TRUE(fills(turn, 0, 2 * M_PI / 180));
}

// Rotors always, transmissions where the scene has them; neither changes what the seed drew before them.
TEST(HiddenPlants, DrawRotorsAndTransmissionsAfterTheRest) {
  const RobotDescription nominal = load_robot("fer");
  const PlantFidelity means{.transmission_stiffness_nm_per_rad = 1e4, .gear_ripple_nm = 0.2};
  Range rotor, stiffness, ripple, phase;
  std::set<double> stiffnesses;
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    const RobotDescription robot = draw_hidden_plant(nominal, seed, seed % 3, means),
                           without = draw_hidden_plant(nominal, seed, seed % 3);
    EXPECT_EQ(robot.flange.rpy, without.flange.rpy);
    EXPECT_EQ(robot.rotor_inertia, without.rotor_inertia);
    EXPECT_EQ(without.transmission->stiffness.size(), 0);
    EXPECT_EQ(without.transmission->ripple.size(), 0);
    const Transmission& t = *robot.transmission;
    for (int j = 0; j < 7; ++j) {
      rotor.add(robot.rotor_inertia[j] / nominal.rotor_inertia[j]);
      stiffness.add(t.stiffness[j]);
      stiffnesses.insert(t.stiffness[j]);
      ripple.add(t.ripple[j]);
      phase.add(t.ripple_phase[j]);
      EXPECT_EQ(t.ripple_cycles[j], j < 4 ? 240 : 160);
    }
  }
  const auto fills = [](const Range& range, double low, double high) {
    const double slack = 0.02 * (high - low);
    return range.low >= low && range.high <= high && range.low < low + slack && range.high > high - slack;
  };
  EXPECT_TRUE(fills(rotor, 0.7, 1.3));
  EXPECT_TRUE(fills(stiffness, 5e3, 1.5e4));
  EXPECT_EQ(stiffnesses.size(), 7 * 300u);  // every joint of every arm differs
  EXPECT_TRUE(fills(ripple, 0.1, 0.3));
  EXPECT_TRUE(fills(phase, 0, 2 * M_PI));
}

bool same(const RobotDescription& a, const RobotDescription& b) {
  for (std::size_t i = 0; i < a.links.size(); ++i) {
    if (a.links[i].mass != b.links[i].mass || a.links[i].com != b.links[i].com) return false;
  }
  return a.friction->p1 == b.friction->p1 && a.flange.position == b.flange.position &&
         a.actuation->command_delay == b.actuation->command_delay;
}

TEST(HiddenPlants, DependOnArmAndSeedOnly) {
  const Registry registry = Registry::with_builtins();
  Scene one = load_scene("one_arm", registry), two = load_scene("two_arms", registry);
  const std::string text = two.text;
  hide(one, 7);
  hide(two, 7);
  EXPECT_TRUE(same(*one.arms[0].plant_robot, *two.arms[0].plant_robot));
  EXPECT_FALSE(same(*two.arms[0].plant_robot, *two.arms[1].plant_robot));
  Scene again = load_scene("two_arms", registry);
  hide(again, 8);
  EXPECT_FALSE(same(*two.arms[0].plant_robot, *again.arms[0].plant_robot));
  // The controllers' models and the scene's text do not contain it.
  EXPECT_EQ(two.text, text);
  EXPECT_EQ(robot_of(two.arms[0]).links[3].mass, load_robot(two.arms[0].model).links[3].mass);
  EXPECT_EQ(two.plant.name, "realistic");
  // Its noise is not that of a simulation of the same scene.
  EXPECT_NE(two.seed, load_scene("two_arms", registry).seed);
}

// Identification must not be able to draw plants: only virtual arms, studies, learning and tests do.
TEST(HiddenPlants, AreNotIncludedByIdentification) {
  const std::set<std::string> allowed{"scene/hidden_plant.cpp", "cli/virtual_arm.cpp",
                                      "experiments/study/scene_run.cpp",
                                      "python_bindings/controlled_world.cpp"};
  const fs::path root = MULTIPANDA_SOURCE_DIR;
  int found = 0;
  for (const char* folder :
       {"arm_interface", "backends", "cli", "common", "core", "doctor", "experiments", "fci", "logs",
        "models", "motion_generators", "python_bindings", "report", "ros", "runtime", "scene", "sysid"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      const std::string name = entry.path().lexically_relative(root).generic_string();
      if (!name.ends_with(".cpp") && !name.ends_with(".hpp")) continue;
      std::ifstream stream(entry.path());
      const std::string source{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
      if (source.find("scene/hidden_plant.hpp\"") == std::string::npos) continue;
      ++found;
      EXPECT_TRUE(allowed.contains(name) || name.ends_with("_test.cpp")) << name;
    }
  }
  EXPECT_GE(found, 2);
}

}  // namespace
}  // namespace multipanda::hidden_plant_test
