// Model files that are based on another one and describe an individual arm: written, read back, refused.
#include <filesystem>
#include <fstream>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "models/robot_description.hpp"
#include "models/write_robot.hpp"

namespace multipanda::identified_models_test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

fs::path scratch(const std::string& name) {
  const fs::path folder = fs::path(MULTIPANDA_BINARY_DIR) / "identified_models";
  fs::create_directories(folder);
  return folder / name;
}

struct Draw {
  explicit Draw(unsigned seed) : random(seed) {}
  double between(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  }
  JointVector joints(std::size_t n, double low, double high) {
    JointVector v = JointVector::Zero(static_cast<Eigen::Index>(n));
    for (double& value : v) value = between(low, high);
    return v;
  }
  std::mt19937 random;
};

// Everything that a file can specify for one arm, as random numbers.
RobotDescription random_robot(const RobotDescription& base, unsigned seed) {
  Draw draw(seed);
  RobotDescription robot = base;
  const std::size_t n = robot.joint_count();
  robot.name = "arm_of_seed";
  robot.title = "An arm: \"odd\" # title, " + std::to_string(seed);
  robot.origin["inertials"] = "Drawn: a 'note' with\ntwo lines";
  for (auto& link : robot.links) {
    const double factor = draw.between(0.3, 3);
    link.mass *= factor;
    link.inertia *= factor;
    for (double& c : link.com) c += draw.between(-0.1, 0.1);
  }
  for (auto& joint : robot.joints) {
    for (double& p : joint.position) p += draw.between(-1e-3, 1e-3);
    for (double& a : joint.rpy) a += draw.between(-1e-3, 1e-3);
  }
  for (double& p : robot.flange.position) p += draw.between(-5e-3, 5e-3);
  robot.friction = JointFriction{draw.joints(n, 0, 2), draw.joints(n, 1, 20), draw.joints(n, -0.1, 0.1)};
  FrictionLaw law;
  if (seed % 2 == 0) law.offset = draw.joints(n, -1, 1);
  if (seed % 3 != 0) law.viscous = draw.joints(n, 0, 3);
  if (seed % 5 != 0) law.stribeck = draw.joints(n, 0, 1);
  for (unsigned i = 0; i < seed % 4; ++i) {
    law.presliding.push_back({draw.between(1e-4, 0.1), draw.joints(n, 0, 1)});
  }
  if (seed % 2 == 1) law.sigmoid = robot.friction;
  robot.link_friction = law;
  robot.torque_sensor = TorqueSensor{draw.joints(n, 0.9, 1.1), draw.joints(n, -1, 1), draw.between(0, 0.1)};
  if (seed % 7 == 0) robot.torque_sensor->gain.resize(0);
  robot.actuation = Actuation{draw.between(30, 100), draw.between(0, 0.003)};
  robot.motor_inertia = draw.joints(n, 0, 0.5);
  robot.rotor_inertia = draw.joints(n, 0, 0.9);
  robot.base_tilt = {draw.between(-0.05, 0.05), draw.between(-0.05, 0.05)};
  robot.identified_range = IdentifiedRange{
      robot.limits.q_min * draw.between(0.1, 0.9), robot.limits.q_max * draw.between(0.1, 0.9),
      robot.limits.dq_max * draw.between(0.1, 0.9), seed % 3 == 0 ? JointVector() : draw.joints(n, 0, 0.2)};
  robot.q_home += draw.joints(n, -1e-3, 1e-3);
  return robot;
}

void expect_same(const JointVector& a, const JointVector& b) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(a, b);
}

void expect_same(const JointFriction& a, const JointFriction& b) {
  expect_same(a.p1, b.p1);
  expect_same(a.p2, b.p2);
  expect_same(a.p3, b.p3);
}

void expect_same(const RobotDescription& a, const RobotDescription& b) {
  EXPECT_EQ(a.name, b.name);
  EXPECT_EQ(a.title, b.title);
  EXPECT_EQ(a.origin, b.origin);
  ASSERT_EQ(a.links.size(), b.links.size());
  for (std::size_t i = 0; i < a.links.size(); ++i) {
    EXPECT_EQ(a.links[i].mass, b.links[i].mass);
    EXPECT_EQ(a.links[i].com, b.links[i].com);
    EXPECT_EQ(a.links[i].inertia, b.links[i].inertia);
  }
  for (std::size_t j = 0; j < a.joint_count(); ++j) {
    EXPECT_EQ(a.joints[j].position, b.joints[j].position);
    EXPECT_EQ(a.joints[j].rpy, b.joints[j].rpy);
  }
  EXPECT_EQ(a.flange.position, b.flange.position);
  EXPECT_EQ(a.flange.rpy, b.flange.rpy);
  expect_same(a.friction.value(), b.friction.value());
  const FrictionLaw &x = a.link_friction.value(), &y = b.link_friction.value();
  expect_same(x.offset, y.offset);
  expect_same(x.viscous, y.viscous);
  expect_same(x.stribeck, y.stribeck);
  ASSERT_EQ(x.presliding.size(), y.presliding.size());
  for (std::size_t i = 0; i < x.presliding.size(); ++i) {
    EXPECT_EQ(x.presliding[i].distance, y.presliding[i].distance);
    expect_same(x.presliding[i].amplitude, y.presliding[i].amplitude);
  }
  ASSERT_EQ(x.sigmoid.has_value(), y.sigmoid.has_value());
  if (x.sigmoid) expect_same(*x.sigmoid, *y.sigmoid);
  expect_same(a.torque_sensor.value().gain, b.torque_sensor.value().gain);
  expect_same(a.torque_sensor->offset, b.torque_sensor->offset);
  EXPECT_EQ(a.torque_sensor->noise, b.torque_sensor->noise);
  EXPECT_EQ(a.actuation.value().torque_bandwidth_hz, b.actuation.value().torque_bandwidth_hz);
  EXPECT_EQ(a.actuation->command_delay, b.actuation->command_delay);
  expect_same(a.motor_inertia, b.motor_inertia);
  expect_same(a.rotor_inertia, b.rotor_inertia);
  EXPECT_EQ(a.base_tilt, b.base_tilt);
  EXPECT_EQ(a.identified_range->q_min, b.identified_range->q_min);
  EXPECT_EQ(a.identified_range->q_max, b.identified_range->q_max);
  EXPECT_EQ(a.identified_range->dq_max, b.identified_range->dq_max);
  expect_same(a.identified_range->rmse, b.identified_range->rmse);
  expect_same(a.q_home, b.q_home);
}

TEST(WrittenRobots, ReadBackEqualToTheBit) {
  for (const std::string base : {"fer", "fr3", MULTIPANDA_SOURCE_DIR "/tests/models/ur5e.yaml"}) {
    const RobotDescription nominal = load_robot(base);
    for (unsigned seed = 0; seed < 12; ++seed) {
      const RobotDescription robot = random_robot(nominal, seed);
      const fs::path file = scratch("round.yaml");
      write_robot(robot, nominal, file);
      expect_same(load_robot(file.string()), robot);
      if (HasFailure()) FAIL() << base << " " << seed;
    }
  }
}

std::string content(const fs::path& file) {
  std::ifstream stream(file);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

TEST(WrittenRobots, HaveOnlyTheDifferences) {
  const RobotDescription nominal = load_robot("fer");
  RobotDescription robot = nominal;
  robot.motor_inertia = JointVector::Constant(7, 0.1);
  const fs::path file = scratch("little.yaml");
  write_robot(robot, nominal, file);
  const std::string text = content(file);
  EXPECT_THAT(text, HasSubstr("base: \"fer\""));
  EXPECT_THAT(text, HasSubstr("motor_inertia_kg_m2: [0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1]"));
  for (const char* section :
       {"inertials", "identified_range", "joints:", "friction", "flange", "origin", "torque_sensor"}) {
    EXPECT_THAT(text, testing::Not(HasSubstr(section)));
  }
}

TEST(WrittenRobots, MayBeBasedOnEachOtherAndRemoveSections) {
  const RobotDescription nominal = load_robot("fer");
  const fs::path first = scratch("first.yaml"), second = scratch("second.yaml");
  write_robot(random_robot(nominal, 4), nominal, first);
  const RobotDescription base = load_robot(first.string());
  RobotDescription robot = base;
  robot.link_friction.reset();
  robot.torque_sensor.reset();
  robot.actuation.reset();
  robot.friction.reset();
  robot.motor_inertia.resize(0);
  write_robot(robot, base, second);
  EXPECT_THAT(content(second), HasSubstr("base: \"first.yaml\""));
  const RobotDescription read = load_robot(second.string());
  EXPECT_FALSE(read.link_friction || read.torque_sensor || read.actuation || read.friction);
  EXPECT_EQ(read.motor_inertia.size(), 0);
  EXPECT_EQ(read.base_tilt, base.base_tilt);
}

// A file may have the name of the robot that it is based on.
TEST(WrittenRobots, MayHaveTheNameOfTheirBase) {
  const RobotDescription nominal = load_robot("fer");
  RobotDescription robot = nominal;
  robot.base_tilt = {0.01, 0.02};
  const fs::path file = scratch("own/fer.yaml");
  write_robot(robot, nominal, file);
  write_robot(robot, nominal, file);  // now there is one of this name
  EXPECT_EQ(load_robot(file.string()).base_tilt, robot.base_tilt);
}

TEST(WrittenRobots, RefuseWhatAFileCannotExpress) {
  const RobotDescription nominal = load_robot("fer");
  RobotDescription robot = nominal;
  robot.hand->body.mass += 0.1;
  EXPECT_THROW(write_robot(robot, nominal, scratch("no.yaml")), std::invalid_argument);
  robot = nominal;
  robot.links[3].inertia(0, 0) *= 10;  // no body has this
  EXPECT_THROW(write_robot(robot, nominal, scratch("no.yaml")), std::invalid_argument);
  RobotDescription nowhere = nominal;
  nowhere.file.clear();
  EXPECT_THROW(write_robot(nominal, nowhere, scratch("no.yaml")), std::invalid_argument);
  EXPECT_FALSE(fs::exists(scratch("no.yaml")));
}

// An imported arm (from a URDF) may differ from its URDF in a file that is based on the one which imports it.
TEST(WrittenRobots, MayBeBasedOnImportedArms) {
  const RobotDescription nominal = load_robot(MULTIPANDA_SOURCE_DIR "/tests/models/ur5.yaml");
  RobotDescription robot = nominal;
  robot.links[2].mass *= 1.5;
  robot.links[2].inertia *= 1.5;
  const fs::path file = scratch("imported.yaml");
  write_robot(robot, nominal, file);
  const RobotDescription read = load_robot(file.string());
  EXPECT_EQ(read.links[2].mass, robot.links[2].mass);
  EXPECT_EQ(read.links[3].mass, nominal.links[3].mass);
}

// The exports of a file that identification wrote: masses in both, motors as armature; friction only on
// request, because the plant simulates it itself.
TEST(WrittenRobots, AreExported) {
  const RobotDescription nominal = load_robot("fer");
  RobotDescription robot = nominal;
  robot.links[3].mass = 3.0625;
  robot.motor_inertia = JointVector::Constant(7, 0.40625);
  FrictionLaw law;
  law.viscous = JointVector::Constant(7, 1.1875);
  law.stribeck = JointVector::Constant(7, 0.25);
  law.presliding = {{0.01, JointVector::Constant(7, 0.125)}};
  robot.link_friction = law;
  write_robot(robot, nominal, scratch("exported.yaml"));
  const RobotDescription read = load_robot(scratch("exported.yaml").string());
  EXPECT_THAT(to_urdf(read, {.hand = true}), HasSubstr("<mass value=\"3.0625\"/>"));
  // Without its own, an arm has the rotors of its model, as far as no torque loop hides them.
  EXPECT_THAT(to_mjcf(nominal), HasSubstr("armature=\"0\""));
  EXPECT_THAT(to_mjcf(nominal, {.rotor_hidden = 0.75}), HasSubstr("armature=\"0.151430364\""));
  const std::string plant = to_mjcf(read), whole = to_mjcf(read, {.friction = true});
  EXPECT_THAT(plant, AllOf(HasSubstr("mass=\"3.0625\""),
                           HasSubstr("armature=\"0.40625\" damping=\"0\" frictionloss=\"0\"")));
  EXPECT_THAT(whole, HasSubstr("armature=\"0.40625\" damping=\"1.1875\" frictionloss=\"0.375\""));
}

std::string refusal(const std::string& sections) {
  const fs::path file = scratch("refused.yaml");
  std::ofstream(file) << "name: wrong\ntitle: Wrong\nbase: fer\n" << sections;
  try {
    (void)load_robot(file.string());
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

TEST(IdentifiedSections, AreRefusedWithFileAndLine) {
  const std::string seven = "[1, 1, 1, 1, 1, 1, 1]", negative = "[1, 1, 1, -0.1, 1, 1, 1]";
  const auto at = [](int line) { return HasSubstr("refused.yaml:" + std::to_string(line) + ":"); };
  EXPECT_EQ(refusal("link_friction: {offset_nm: " + negative + ", viscous_nm_s_per_rad: " + seven + "}\n"),
            "accepted");
  EXPECT_THAT(refusal("link_friction:\n  viscous_nm_s_per_rad: " + negative + "\n"),
              AllOf(at(5), HasSubstr("at least 0"), HasSubstr("-0.1")));
  EXPECT_THAT(refusal("link_friction:\n  stribeck_nm: [1, 2]\n"), AllOf(at(5), HasSubstr("7 numbers")));
  EXPECT_THAT(
      refusal("link_friction:\n  presliding:\n    - {distance_rad: 0, amplitude_nm: " + seven + "}\n"),
      AllOf(at(6), HasSubstr("above 0")));
  EXPECT_THAT(
      refusal("link_friction:\n  presliding:\n    - {distance_rad: 1, amplitude_nm: " + negative + "}\n"),
      AllOf(at(6), HasSubstr("at least 0")));
  EXPECT_THAT(refusal("link_friction: {viscosity: " + seven + "}\n"), AllOf(at(4), HasSubstr("viscous")));
  EXPECT_THAT(refusal("torque_sensor: {gain: " + negative + "}\n"), AllOf(at(4), HasSubstr("above 0")));
  EXPECT_THAT(refusal("torque_sensor: {noise_nm: -1}\n"), AllOf(at(4), HasSubstr("at least 0")));
  EXPECT_THAT(refusal("actuation: {command_delay_s: 1.5}\n"), AllOf(at(4), HasSubstr("milliseconds")));
  EXPECT_THAT(refusal("actuation: {torque_bandwidth_hz: -5}\n"), AllOf(at(4), HasSubstr("at least 0")));
  EXPECT_THAT(refusal("motor_inertia_kg_m2: " + negative + "\n"), AllOf(at(4), HasSubstr("at least 0")));
  EXPECT_THAT(refusal("base_tilt_rad: [0.1]\n"), AllOf(at(4), HasSubstr("2 numbers")));
  EXPECT_THAT(refusal("base_tilt_rad: [0.1, 45]\n"), AllOf(at(4), HasSubstr("degrees")));
  EXPECT_THAT(refusal("joint_friction: {p1_nm: " + negative + ", p2_s_per_rad: " + seven +
                      ", p3_rad_per_s: " + seven + "}\n"),
              AllOf(at(4), HasSubstr("at least 0")));
}

TEST(IdentifiedSections, UnknownBaseNamesTheNearest) {
  const fs::path file = scratch("lost.yaml");
  std::ofstream(file) << "name: lost\ntitle: Lost\nbase: ferr\n";
  try {
    (void)load_robot(file.string());
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("lost.yaml:3:"), HasSubstr("did you mean 'fer'?")));
  }
}

}  // namespace
}  // namespace multipanda::identified_models_test
