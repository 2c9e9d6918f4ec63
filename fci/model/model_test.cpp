#include <algorithm>
#include <cstdlib>
#include <dlfcn.h>
#include <filesystem>
#include <fstream>
#include <random>
#include <regex>
#include <sstream>
#include <string_view>
#include <unistd.h>

#include <gmock/gmock.h>

#include "core/model/model_terms.hpp"
#include "fci/model/model_library.hpp"
#include "models/arm_source.hpp"

namespace multipanda::fci::model_test {
namespace {

using testing::HasSubstr;
using testing::Not;

const std::string kUr5e = MULTIPANDA_SOURCE_DIR "/tests/models/ur5e.yaml";

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double between(double low, double high) { return std::uniform_real_distribution(low, high)(engine_); }
  Vector3 vector(double size) { return {between(-size, size), between(-size, size), between(-size, size)}; }
  Pose pose() { return {exp_rotation(vector(3)), vector(0.5)}; }
  JointVector joints(double size) {
    JointVector q = joint_constant(7, 0);
    for (Eigen::Index i = 0; i < 7; ++i) q[i] = between(-size, size);
    return q;
  }
  // A random body in the flange.
  Load load() {
    Matrix3 half;
    for (int i = 0; i < 3; ++i) half.col(i) = vector(0.1);
    return {between(0.1, 3), vector(0.2), half * half.transpose() + 1e-3 * Matrix3::Identity()};
  }

 private:
  std::mt19937 engine_;
};

// A model library as a program uses it: written to a file, loaded, every symbol found.
class Library {
 public:
  explicit Library(const RobotDescription& robot, LibraryModel model = LibraryModel::scene) {
    const auto bytes = model_library(robot, model);
    std::string name = std::string(MULTIPANDA_BINARY_DIR) + "/model_XXXXXX";
    const int file = mkstemp(name.data());
    std::ofstream(name, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    close(file);
    handle_ = dlopen(name.c_str(), RTLD_LAZY | RTLD_GLOBAL);  // as libfranka loads it
    EXPECT_NE(handle_, nullptr) << dlerror();
    std::filesystem::remove(name);
  }
  ~Library() {
    if (handle_) dlclose(handle_);
  }

  void* symbol(const std::string& name) const { return handle_ ? dlsym(handle_, name.c_str()) : nullptr; }
  template <class... Arguments>
  void call(const std::string& name, Arguments... arguments) const {
    void* const function = symbol(name);
    ASSERT_NE(function, nullptr) << name;
    reinterpret_cast<void (*)(Arguments...)>(function)(arguments...);
  }

  Eigen::Matrix4d pose(int frame, const double* q, const Eigen::Matrix4d& F_T_EE) const {
    Eigen::Matrix4d out = Eigen::Matrix4d::Constant(NAN);
    const std::string name = "O_T_J" + std::to_string(frame);
    frame == 9 ? call<const double*, const double*, double*>(name, q, F_T_EE.data(), out.data())
               : call<const double*, double*>(name, q, out.data());
    return out;
  }
  Eigen::Matrix<double, 6, 7> jacobian(const std::string& which, int frame, const double* q,
                                       const Eigen::Matrix4d& F_T_EE) const {
    Eigen::Matrix<double, 6, 7> out = Eigen::Matrix<double, 6, 7>::Constant(NAN);
    const std::string name = which + std::to_string(frame);
    if (frame == 1) call<double*>(name, out.data());
    if (frame == 9) call<const double*, const double*, double*>(name, q, F_T_EE.data(), out.data());
    if (frame > 1 && frame < 9) call<const double*, double*>(name, q, out.data());
    return out;
  }

 private:
  void* handle_ = nullptr;
};

Eigen::Matrix4d homogeneous(const Pose& X) {
  Eigen::Matrix4d T = Eigen::Matrix4d::Identity();
  T.topLeftCorner<3, 3>() = X.rotation;
  T.topRightCorner<3, 1>() = X.position;
  return T;
}

std::vector<std::string> seven_joints() {
  std::vector<std::string> names;
  for (const std::string& name : available_robots())
    if (load_robot(name).joint_count() == 7) names.push_back(name);
  return names;
}

class EveryRobot : public testing::TestWithParam<std::string> {
 protected:
  const RobotDescription robot = load_robot(GetParam());
};
INSTANTIATE_TEST_SUITE_P(Model, EveryRobot, testing::ValuesIn(seven_joints()),
                         [](const auto& name) { return name.param; });

#ifndef __x86_64__
#define SKIP_WITHOUT_LIBRARY() GTEST_SKIP() << "the model library is made for x86-64 only"
#else
#define SKIP_WITHOUT_LIBRARY() static_assert(true)
#endif

TEST_P(EveryRobot, LibraryAgreesWithTheControllersModel) {
  SKIP_WITHOUT_LIBRARY();
  const Library library(robot);
  Random random(31);
  for (int trial = 0; trial < 100; ++trial) {
    const Pose X_WB = random.pose();
    ModelTerms terms(std::make_shared<ArmModel>(arm_model_source(robot, X_WB, false)));
    const ArmFrames frames{random.pose(), {}};
    const Load load = random.load();
    const JointVector q = random.joints(2.8), dq = random.joints(2);
    terms.set_config(frames, {}, load);
    terms.update(q, dq);

    const Eigen::Matrix4d F_T_EE = homogeneous(frames.X_FE);
    const Pose X_BE = X_WB.inverse() * terms.X_WE();
    EXPECT_LT((library.pose(9, q.data(), F_T_EE) - homogeneous(X_BE)).norm(), 1e-12);
    EXPECT_LT((library.pose(8, q.data(), F_T_EE) - homogeneous(X_WB.inverse() * terms.X_WF())).norm(), 1e-12);
    for (int joint = 1; joint <= 7; ++joint) {
      const Pose X_BJ = X_WB.inverse() * terms.X_WJ(static_cast<std::size_t>(joint - 1));
      EXPECT_LT((library.pose(joint, q.data(), F_T_EE) - homogeneous(X_BJ)).norm(), 1e-12) << joint;
    }
    const Matrix3 R_BW = X_WB.rotation.transpose();
    Eigen::Matrix<double, 6, 7> J_B = terms.J_V_WE();
    J_B.topRows<3>() = R_BW * J_B.topRows<3>();
    J_B.bottomRows<3>() = R_BW * J_B.bottomRows<3>();
    EXPECT_LT((library.jacobian("O_J_J", 9, q.data(), F_T_EE) - J_B).norm(), 1e-12);

    Eigen::Matrix<double, 7, 7> M;
    Eigen::Matrix<double, 7, 1> c, g;
    const Vector3 g_earth = R_BW * Vector3(0, 0, -9.81);
    library.call<const double*, const double*, double, const double*, double*>(
        "M_NE", q.data(), load.inertia_C.data(), load.mass, load.p_FC.data(), M.data());
    library.call<const double*, const double*, const double*, double, const double*, double*>(
        "c_NE", q.data(), dq.data(), load.inertia_C.data(), load.mass, load.p_FC.data(), c.data());
    library.call<const double*, const double*, double, const double*, double*>(
        "g_NE", q.data(), g_earth.data(), load.mass, load.p_FC.data(), g.data());
    EXPECT_LT((M - terms.M()).norm(), 1e-9);
    EXPECT_LT((c - terms.c()).norm(), 1e-9);
    EXPECT_LT((g - terms.g()).norm(), 1e-9);
    EXPECT_GT(c.norm(), 1e-3);
  }
}

// Jacobians of all frames against differences of their poses, which the test above has checked.
TEST_P(EveryRobot, LibrarysJacobiansAreItsPosesDerivatives) {
  SKIP_WITHOUT_LIBRARY();
  const Library library(robot);
  Random random(32);
  for (int trial = 0; trial < 10; ++trial) {
    const Eigen::Matrix4d F_T_EE = homogeneous(random.pose());
    const JointVector q = random.joints(2.8);
    for (int frame = 1; frame <= 9; ++frame) {
      const Eigen::Matrix4d T = library.pose(frame, q.data(), F_T_EE);
      Eigen::Matrix<double, 6, 7> J, J_body;
      for (Eigen::Index i = 0; i < 7; ++i) {
        constexpr double kStep = 1e-5;
        JointVector more = q, less = q;
        more[i] += kStep;
        less[i] -= kStep;
        const Eigen::Matrix4d dT =
            (library.pose(frame, more.data(), F_T_EE) - library.pose(frame, less.data(), F_T_EE)) /
            (2 * kStep);
        const Matrix3 W = dT.topLeftCorner<3, 3>() * T.topLeftCorner<3, 3>().transpose();
        J.col(i) << dT.topRightCorner<3, 1>(), W(2, 1), W(0, 2), W(1, 0);
      }
      const Matrix3 R_EB = T.topLeftCorner<3, 3>().transpose();
      J_body.topRows<3>() = R_EB * J.topRows<3>();
      J_body.bottomRows<3>() = R_EB * J.bottomRows<3>();
      EXPECT_LT((library.jacobian("O_J_J", frame, q.data(), F_T_EE) - J).norm(), 1e-8) << frame;
      EXPECT_LT((library.jacobian("Ji_J_J", frame, q.data(), F_T_EE) - J_body).norm(), 1e-8) << frame;
    }
  }
}

// Outputs of a real Panda's library: where they lie next to the project, in ../shared/data.
TEST(Model, APandasOwnLibraryGivesTheOutputsOfARealOne) {
  SKIP_WITHOUT_LIBRARY();
  std::ifstream file(std::filesystem::path(MULTIPANDA_SOURCE_DIR) / "../shared/data/panda_model_give.csv");
  if (!file) GTEST_SKIP() << "no outputs of a real Panda's library at ../shared/data";
  const Library library(load_robot("fer"), LibraryModel::own), scene(load_robot("fer"));
  const double mass[] = {0, 1.23};
  const Vector3 com(-0.0018699187, 0.0081300813, 0.03), down(0, 0, -9.81);
  const Matrix3 none = Matrix3::Zero(), loads = Vector3(0.0031, 0.0046, 0.0049).asDiagonal();
  using P = const double*;
  std::string line;
  std::getline(file, line);  // names
  int rows = 0;
  double scenes_gravity = 0;
  for (; std::getline(file, line); ++rows) {
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream numbers(line);
    int sample = 0, load = 0;
    Eigen::Matrix<double, 7, 1> q, dq, g, c, found;
    Eigen::Matrix<double, 7, 7> M, found_M;
    numbers >> sample >> load;
    for (auto* v : {&q, &dq, &g, &c})
      for (double& x : *v) numbers >> x;
    for (double& x : M.reshaped()) numbers >> x;
    ASSERT_TRUE(numbers) << line;
    const double kg = mass[load];
    const Matrix3& inertia = load == 0 ? none : loads;
    library.call<P, P, double, P, double*>("g_NE", q.data(), down.data(), kg, com.data(), found.data());
    EXPECT_LT((found - g).lpNorm<Eigen::Infinity>(), 1e-7) << "gravity of sample " << sample;
    library.call<P, P, P, double, P, double*>("c_NE", q.data(), dq.data(), inertia.data(), kg, com.data(),
                                              found.data());
    EXPECT_LT((found - c).lpNorm<Eigen::Infinity>(), 1e-7) << "Coriolis of sample " << sample;
    library.call<P, P, double, P, double*>("M_NE", q.data(), inertia.data(), kg, com.data(), found_M.data());
    EXPECT_LT((found_M - M).lpNorm<Eigen::Infinity>(), 1e-8) << "mass of sample " << sample;
    scene.call<P, P, double, P, double*>("g_NE", q.data(), down.data(), kg, com.data(), found.data());
    scenes_gravity = std::max(scenes_gravity, (found - g).lpNorm<Eigen::Infinity>());
  }
  EXPECT_EQ(rows, 40);
  EXPECT_GT(scenes_gravity, 0.1);  // the published parameters are other ones
  EXPECT_LT(scenes_gravity, 0.2);
}

TEST(Model, LibraryHasNoDependencies) {
  SKIP_WITHOUT_LIBRARY();
  const auto bytes = model_library(load_robot("fer"), LibraryModel::own);
  EXPECT_LT(bytes.size(), 100000u);
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  EXPECT_EQ(text.find("libstdc++"), std::string_view::npos);
  EXPECT_EQ(text.find("libgcc"), std::string_view::npos);
  EXPECT_EQ(text.find("libasan"), std::string_view::npos);
  // Two arms' models in one program are independent.
  const Library fer(load_robot("fer")), fr3(load_robot("fr3"));
  const double zero[9] = {};
  Eigen::Matrix<double, 7, 7> a, b;
  using M = const double*;
  fer.call<M, M, double, M, double*>("M_NE", zero, zero, 0., zero, a.data());
  fr3.call<M, M, double, M, double*>("M_NE", zero, zero, 0., zero, b.data());
  EXPECT_GT((a - b).norm(), 0.01);
}

// The flange's load and the text together equal the controllers' model with its hand.
TEST_P(EveryRobot, TextAndEndEffectorAgreeWithTheControllersModel) {
  if (!robot.hand) GTEST_SKIP() << "no hand";
  Random random(33);
  const Load tool = random.load();
  const RigidBody ee = end_effector(robot, true, tool);
  ArmModelSource source;
  source.name = "as downloaded";
  source.urdf = model_urdf(robot);
  source.flange = "link8";
  ModelTerms downloaded(std::make_shared<ArmModel>(source));
  ModelTerms ours(std::make_shared<ArmModel>(arm_model_source(robot, {}, true)));
  const ArmFrames frames{random.pose(), {}};
  downloaded.set_config(frames, {ee.mass, ee.com, ee.inertia}, {});
  ours.set_config(frames, tool, {});
  for (int trial = 0; trial < 20; ++trial) {
    const JointVector q = random.joints(2.8), dq = random.joints(2);
    downloaded.update(q, dq);
    ours.update(q, dq);
    EXPECT_LT((downloaded.J_V_WE() - ours.J_V_WE()).norm(), 1e-12);
    EXPECT_LT((downloaded.M() - ours.M()).norm(), 1e-9);
    EXPECT_LT((downloaded.c() - ours.c()).norm(), 1e-9);
    EXPECT_LT((downloaded.g() - ours.g()).norm(), 1e-9);
  }
}

TEST(Model, EndEffectorWithoutHand) {
  const RobotDescription robot = load_robot("fr3");
  EXPECT_EQ(end_effector(robot, false, {}).mass, 0);
  EXPECT_EQ(end_effector(robot, false, Load{2, {}, {}}).mass, 2);
  EXPECT_GT(end_effector(robot, true, {}).mass, 0.5);
  RobotDescription bare = robot;
  bare.hand.reset();
  EXPECT_THROW(end_effector(bare, true, {}), std::invalid_argument);
}

// Reads the text as libfranka does and evaluates its formula.
double highest_velocity(const std::string& urdf, int joint, double q) {
  const std::string text = urdf.substr(urdf.find("\"joint" + std::to_string(joint) + "\""),
                                       urdf.find("\"joint" + std::to_string(joint + 1)));
  const auto value = [&](const std::string& name) {
    std::smatch match;
    EXPECT_TRUE(std::regex_search(text, match, std::regex(name + "=\"([^\"]+)\""))) << name;
    return std::stod(match[1]);
  };
  return std::min(
      value("velocity"),
      std::max(0., -value("velocity_offset") +
                       std::sqrt(std::max(0., 2 * value("deceleration_limit") * (value("upper") - q)))));
}

TEST(Model, TextLimitsVelocities) {
  const std::string fr3 = model_urdf(load_robot("fr3"));
  EXPECT_EQ(highest_velocity(fr3, 1, 0), 2.62);
  EXPECT_NEAR(highest_velocity(fr3, 1, 2.8), std::sqrt(2 * 6 * (2.9007 - 2.8)) - 0.6599, 1e-12);
  EXPECT_EQ(highest_velocity(fr3, 6, 4.6), 0);
  const std::string fer = model_urdf(load_robot("fer"));
  const RobotDescription robot = load_robot("fer");
  for (int joint = 1; joint <= 7; ++joint)
    for (const double share : {0., 0.5, 0.999, 1.})
      EXPECT_EQ(highest_velocity(fer, joint, share * robot.limits.q_max[joint - 1]),
                robot.limits.dq_max[joint - 1]);
}

TEST(Model, TextHasTheNamesThatLibfrankaRequires) {
  RobotDescription robot = load_robot("fr3");
  const std::string urdf = model_urdf(robot);
  EXPECT_THAT(urdf, HasSubstr("<robot name=\"fr3\""));
  EXPECT_THAT(urdf, HasSubstr("<link name=\"link8\""));
  EXPECT_THAT(urdf, Not(HasSubstr("finger")));
  EXPECT_THAT(urdf, Not(HasSubstr("hand")));
  robot.name = "tmr_of_mine";
  EXPECT_THAT(model_urdf(robot), HasSubstr("<robot name=\"arm_tmr_of_mine\""));
}

TEST(Model, RefusesArmsWithMoreThanSevenJoints) {
  const RobotDescription six = load_robot(kUr5e);
  EXPECT_THROW(model_urdf(six), std::invalid_argument);
  EXPECT_THROW(model_library(six, LibraryModel::own), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::fci::model_test
