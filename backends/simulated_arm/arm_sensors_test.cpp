// What a virtual arm measures, beside what real arms sent: within a factor of 2. Measurements of real arms
// are read where they lie next to the project (../shared/data); without them the tests skip.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <numeric>
#include <sstream>

#include <gtest/gtest.h>

#include "arm_interface/arm_settings.hpp"
#include "backends/mujoco/plant.hpp"
#include "backends/mujoco/testing/test_scenes.hpp"
#include "backends/simulated_arm/from_scene.hpp"
#include "backends/simulated_arm/testing/arm_rig.hpp"
#include "core/testing/test_arm.hpp"
#include "scene/build.hpp"

namespace multipanda::arm_sensors_test {
namespace {

using namespace test;
constexpr double dt = 0.001;

struct Data {
  explicit Data(const std::string& name) {
    path = std::filesystem::path(MULTIPANDA_SOURCE_DIR) / "../shared/data" / name;
    std::ifstream file(path);
    std::string line, cell;
    std::vector<std::string> names;
    std::getline(file, line);
    for (std::istringstream text(line); std::getline(text, cell, ',');) names.push_back(cell);
    while (std::getline(file, line)) {
      std::istringstream text(line);
      for (std::size_t i = 0; std::getline(text, cell, ','); ++i)
        columns[names.at(i)].push_back(std::stod(cell));
      ++rows;
    }
  }
  const std::vector<double>& at(const std::string& name) const { return columns.at(name); }
  JointVector joints(const std::string& name, std::size_t row) const {
    JointVector v(7);
    for (int i = 0; i < 7; ++i) v[i] = at(name + std::to_string(i + 1))[row];
    return v;
  }
  // Linear between the rows.
  JointVector joints_at(const std::string& name, double t) const {
    const auto& times = at("t");
    const auto after = std::clamp<std::ptrdiff_t>(
        std::upper_bound(times.begin(), times.end(), t) - times.begin(), 1, std::ptrdiff_t(rows) - 1);
    const auto k = static_cast<std::size_t>(after);
    const double share = std::clamp((t - times[k - 1]) / (times[k] - times[k - 1]), 0.0, 1.0);
    return joints(name, k - 1) + share * (joints(name, k) - joints(name, k - 1));
  }
  void measure(double t, ArmState& state) const {
    state.q = joints_at("q", t);
    state.dq = joints_at("dq", t);
    state.tau_J = joints_at("tau", t);
    state.t_robot = RobotTime::from_seconds(t);
  }
  double begin() const { return at("t").front(); }
  double duration() const { return at("t").back() - begin(); }
  std::filesystem::path path;
  std::map<std::string, std::vector<double>> columns;
  std::size_t rows = 0;
};

#define SKIP_WITHOUT(data) \
  if ((data).rows == 0) GTEST_SKIP() << "no data in " << (data).path

void expect_within_a_factor_of_2(double ours, double real, const std::string& what) {
  EXPECT_GT(ours, real / 2) << what;
  EXPECT_LT(ours, real * 2) << what;
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + std::ptrdiff_t(values.size() / 2), values.end());
  return values[values.size() / 2];
}

double rms(const std::vector<double>& values) {
  return std::sqrt(std::inner_product(values.begin(), values.end(), values.begin(), 0.0) /
                   static_cast<double>(values.size()));
}

SimulatedArmConfig config_of(const std::string& model, std::uint32_t seed, const Pose& X_WB = {}) {
  SceneArm arm = arm_named("a", X_WB);
  arm.model = model;
  Scene scene = scene_of({arm}, PlantFidelity::realistic());
  scene.seed = seed;
  return simulated_arm_config(scene, 0, true);
}

// A gap that docs/like_a_real_arm.md states: only on Pandas an estimate has the errors of an own model.
TEST(ArmSensors, OnlyPandasEstimateByAModelThatIsNotTheirPlants) {
  EXPECT_NE(config_of("fer", 1).estimating_model, nullptr);
  for (const char* robot : {"fr3", "fr3v2"})
    EXPECT_EQ(config_of(robot, 1).estimating_model, nullptr) << robot;
}

TEST(ArmSensors, MotorsAreAheadOfTheirLinksAsOfARealArm) {
  const Data data("panda_state_give.csv");
  SKIP_WITHOUT(data);
  const JointVector K = (JointVector(7) << 14250, 14250, 14250, 14250, 9000, 9000, 9000).finished();
  ArmRig rig(config_of("fer", 1));
  std::array<std::vector<double>, 7> real, ours;
  for (std::size_t k = 0; k < data.rows; ++k) {
    rig.step();
    const JointVector left =
        data.joints("theta_", k) - data.joints("q_", k) - data.joints("tau_J_", k).cwiseQuotient(K);
    const JointVector left_here = rig.face().theta - rig.state().q - rig.state().tau_J.cwiseQuotient(K);
    for (std::size_t i = 0; i < 7; ++i) {
      real[i].push_back(left[Eigen::Index(i)]);
      ours[i].push_back(left_here[Eigen::Index(i)]);
    }
  }
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_LT(rms(real[i]), 1.5e-6) << "the law holds on the real arm";
    expect_within_a_factor_of_2(rms(ours[i]), rms(real[i]), "joint " + std::to_string(i + 1));
  }
  EXPECT_NEAR(rig.face().dtheta.norm(), 0, 0.02);
}

// The rms change from value to value in the quietest second at 90 Hz: nobody touches the arm.
double quietest_change(const std::vector<double>& values) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t from = 0; from + 91 <= values.size(); from += 30) {
    std::vector<double> changes;
    for (std::size_t k = from; k < from + 90; ++k) changes.push_back(values[k + 1] - values[k]);
    least = std::min(least, rms(changes));
  }
  return least;
}

TEST(ArmSensors, TorquesHaveNoiseAndGridOfRealArms) {
  const Data touched("panda_touch_d5.csv"), moved("fr3_circle_2.csv");
  SKIP_WITHOUT(touched);
  SKIP_WITHOUT(moved);
  ArmRig rig(config_of("fer", 2));
  for (int i = 0; i < 7; ++i) {
    const std::string name = "tau" + std::to_string(i + 1);
    std::vector<double> ours;
    for (int k = 0; k < 300; ++k) {
      rig.steps(11);  // 90 Hz
      ours.push_back(rig.state().tau_J[i]);
    }
    expect_within_a_factor_of_2(quietest_change(ours), quietest_change(touched.at(name)), name);
    const double grid = i < 4 ? ArmSensors::kTorqueGrid : ArmSensors::kFineGrid;
    std::vector<double> values = moved.at(name);
    std::sort(values.begin(), values.end());
    double least = 1;
    for (std::size_t k = 1; k < values.size(); ++k) {
      if (values[k] - values[k - 1] > 1e-4) least = std::min(least, values[k] - values[k - 1]);
    }
    const double cells = rig.state().tau_J[i] / grid;
    EXPECT_NEAR(cells, std::round(cells), 1e-9);
    EXPECT_NEAR(least, grid, 1e-3) << "of the real arm, in a file of three decimals";
  }
}

// Cycles per turn of the strongest ripple in a joint's torque, less its mean over 51 rows.
int ripple(const Data& data, int joint) {
  const std::string number = std::to_string(joint);
  const auto &q = data.at("q" + number), &dq = data.at("dq" + number), &tau = data.at("tau" + number);
  int strongest = 0;
  double most = 0;
  for (int cycles = 100; cycles < 350; ++cycles) {
    double cosine = 0, sine = 0, sum = std::accumulate(tau.begin(), tau.begin() + 50, 0.0);
    for (std::size_t k = 25; k + 25 < tau.size(); ++k) {
      sum += tau[k + 25];
      const double rest = tau[k] - sum / 51;
      sum -= tau[k - 25];
      if (std::abs(dq[k]) < 0.15) continue;
      cosine += rest * std::cos(cycles * q[k]);
      sine += rest * std::sin(cycles * q[k]);
    }
    if (const double power = std::hypot(cosine, sine); power > most) most = power, strongest = cycles;
  }
  return strongest;
}

// Why the Panda has the rotors that are known of an FR3, whose other joints turn too little in this file.
TEST(ArmSensors, APandaHasTheGearsOfAnFr3) {
  const Data panda("panda_excitation.csv"), fr3("fr3_circle_2.csv");
  SKIP_WITHOUT(panda);
  for (int joint = 1; joint <= 7; ++joint)
    EXPECT_NEAR(ripple(panda, joint), joint <= 4 ? 240 : 160, 4) << joint;
  for (const int joint : {1, 2, 4, 7}) EXPECT_NEAR(ripple(fr3, joint), joint <= 4 ? 240 : 160, 4) << joint;
}

// The lag d of a velocity behind the slope of the position, dq = v - d a, with slopes over 20 ms.
double lag_of(const std::vector<double>& t, const std::vector<double>& q, const std::vector<double>& dq) {
  constexpr std::size_t kHalf = 10;
  double product = 0, square = 0;
  const auto slope = [&](std::size_t k) {
    return (q[k + kHalf] - q[k - kHalf]) / (t[k + kHalf] - t[k - kHalf]);
  };
  for (std::size_t k = 2 * kHalf; k + 2 * kHalf < q.size(); ++k) {
    const double a = (slope(k + kHalf) - slope(k - kHalf)) / (t[k + kHalf] - t[k - kHalf]);
    product += a * (slope(k) - dq[k]);
    square += a * a;
  }
  return product / square;
}

TEST(ArmSensors, VelocitiesAreAsLateAsThoseOfARealArm) {
  const Data data("fr3_circle_2.csv");
  SKIP_WITHOUT(data);
  for (const int joint : {1, 2, 4, 6}) {  // those that move much
    const auto name = std::to_string(joint);
    const double real = lag_of(data.at("t"), data.at("q" + name), data.at("dq" + name));
    ArmSensors sensors(7, 3, false);
    std::vector<double> t, q, dq;
    ArmState state;
    state.q = state.dq = state.tau_J = joint_constant(7, 0);
    for (int k = 0; k < 8000; ++k) {
      t.push_back(k * dt);
      state.q.setConstant(0.5 * std::sin(2 * k * dt));
      state.dq.setConstant(std::cos(2 * k * dt));
      sensors.show(state, dt);
      q.push_back(state.q[joint - 1]);
      dq.push_back(state.dq[joint - 1]);
    }
    expect_within_a_factor_of_2(lag_of(t, q, dq), real, "joint " + name);
  }
}

// Fed with what a real arm measured while a person touched it, the estimate is that of the arm itself.
TEST(ArmSensors, TheEstimateIsTheOneOfARealArm) {
  for (const char* name : {"panda_touch_a4.csv", "panda_touch_b9.csv", "panda_touch_d5.csv"}) {
    const Data data(name);
    SKIP_WITHOUT(data);
    SCOPED_TRACE(name);
    const SimulatedArmConfig config = config_of("fer", 4);
    ModelTerms terms(config.model);
    terms.set_config(config.frames, {}, {});
    ContactMonitor monitor(7, true, config.hand_excess), quick(7);
    const SetCollisionThresholds thresholds = thresholds_of(7, 80, 80, 200, 200);
    ArmState state;
    std::vector<JointVector> real, ours, other;
    for (int k = 0; k * dt < data.duration(); ++k) {
      const double t = k * dt;
      data.measure(t, state);
      terms.update(state.q, state.dq);
      monitor.update(terms, state, {}, dt, thresholds);
      quick.update(terms, state, {}, dt, thresholds);
      if (t < 0.5) continue;  // from no estimate
      real.push_back(data.joints_at("tau_ext", t));
      ours.push_back(monitor.tau_ext_hat());
      other.push_back(quick.tau_ext_hat());
    }
    for (int i = 0; i < 7; ++i) {
      const auto changes = [&](const std::vector<JointVector>& a, const std::vector<JointVector>* b) {
        std::vector<double> x;
        for (std::size_t k = 0; k < a.size(); ++k) x.push_back(a[k][i] - (b ? (*b)[k][i] : 0));
        const double mean = std::accumulate(x.begin(), x.end(), 0.0) / double(x.size());
        for (double& v : x) v -= mean;
        return rms(x);
      };
      const double size = changes(real, nullptr);
      if (size < 0.1) continue;  // not touched
      EXPECT_LT(changes(ours, &real), 0.35 * size) << "joint " << i + 1;
      EXPECT_LT(changes(ours, &real), 0.6 * changes(other, &real)) << "than 30 Hz, joint " << i + 1;
    }
  }
}

TEST(ArmSensors, AtRestTheEstimateIsTheTorqueLessTheDeclaredWeightAndBiased) {
  const Data data("panda_state_give.csv"), touched("panda_touch_d5.csv");
  SKIP_WITHOUT(data);
  SKIP_WITHOUT(touched);
  std::vector<double> real_force, force, real_bias, bias;
  for (std::size_t k = 0; k < data.rows; ++k) {
    real_force.push_back(std::hypot(data.at("O_F_ext_hat_K_1")[k], data.at("O_F_ext_hat_K_2")[k],
                                    data.at("O_F_ext_hat_K_3")[k]));
  }
  for (int i = 1; i <= 7; ++i) real_bias.push_back(median(touched.at("tau_ext" + std::to_string(i))));
  for (std::uint32_t seed = 1; seed <= 12; ++seed) {
    SimulatedArmConfig config = config_of("fer", seed, Draw(seed).pose(1));
    config.load = {.mass = 0.6, .p_FC = {0.02, 0, 0.08}, .inertia_C = 1e-3 * Matrix3::Identity()};
    ArmRig rig(config);
    rig.steps(800);
    JointVector tau = rig.zero(), estimate = rig.zero();
    for (int k = 0; k < 1000; ++k) {
      rig.step();
      tau += rig.state().tau_J / 1000;
      estimate += rig.face().tau_ext_hat / 1000;
    }
    // As a program computes it: the arm's own model without hand, hand and load as the state declares them.
    RobotDescription robot = load_robot("fer");
    std::copy(robot.own_model.begin(), robot.own_model.end(), robot.links.begin() + 1);
    ModelTerms declared(
        std::make_shared<const ArmModel>(arm_model_source(robot, config.model->X_WB(), false)));
    declared.set_config(config.frames, manufacturers_hand_as_declared(), config.load);
    declared.update(rig.q, rig.dq);
    EXPECT_LT((estimate - (tau - declared.g())).cwiseAbs().maxCoeff(), 0.01) << "seed " << seed;
    force.push_back(rig.face().F_K_K.force().norm());
    for (const double b : estimate) bias.push_back(b);
  }
  expect_within_a_factor_of_2(rms(bias), rms(real_bias), "joints");
  expect_within_a_factor_of_2(median(force), median(real_force), "hand");
}

// Forces that nothing exerts, while an arm moves.
struct FreeMotion {
  std::vector<double> force;  // [N]
  std::vector<Vector3> p;     // of the hand, each millisecond [m]
  // The forces while the hand accelerates by `least` to `most` [m/s^2], over 40 ms.
  double rms_at(double least, double most) const {
    std::vector<double> taken;
    for (std::size_t k = 20; k + 20 < p.size(); ++k) {
      const double a = (p[k + 20] - 2 * p[k] + p[k - 20]).norm() / (0.02 * 0.02);
      if (a >= least && a < most) taken.push_back(force[k]);
    }
    EXPECT_GT(taken.size(), 300u) << "from " << least;
    return rms(taken);
  }
};

SceneArm arm_on(const Data& data, const std::string& model, bool hand) {
  SceneArm arm = arm_named("a", {}, hand);
  arm.model = model;
  arm.q_start = data.joints_at("q", data.begin());
  arm.rotor_hidden = 1;  // so that M ddq leads it
  return arm;
}

// What the estimate of a real arm, which is that of the test above, shows of what that arm measured.
FreeMotion real_motion(const Data& data, const std::string& model, bool hand) {
  const SimulatedArmConfig config =
      simulated_arm_config(scene_of({arm_on(data, model, hand)}, PlantFidelity::realistic()), 0, true);
  ModelTerms terms(config.estimating_model ? config.estimating_model : config.model);
  terms.set_config(config.frames, {}, {});
  ContactMonitor monitor(7, true, config.hand_excess);
  FreeMotion motion;
  ArmState state;
  for (int k = 0; k * dt < data.duration(); ++k) {
    data.measure(data.begin() + k * dt, state);
    terms.update(state.q, state.dq);
    monitor.update(terms, state, {}, dt, thresholds_of(7, 80, 80, 200, 200));
    if (k < 500) continue;  // from no estimate
    motion.force.push_back(monitor.F_K_K().force().norm());
    motion.p.push_back(terms.X_WE().position);
  }
  return motion;
}

// The same of a virtual arm that is led along it.
FreeMotion our_motion(const Data& data, const std::string& model, bool hand) {
  const SceneArm arm = arm_on(data, model, hand);
  MujocoPlant plant(scene_of({arm}, PlantFidelity::realistic()), {.real_sensors = true});
  plant.arm(0).watch(false);
  ModelTerms here = terms_of(arm);
  const auto q_d = [&](double t) {  // over 40 ms, so that it has derivatives
    JointVector sum = joint_constant(7, 0);
    for (int k = -20; k <= 20; k += 5) sum += data.joints_at("q", std::max(data.begin(), t + k * dt)) / 9;
    return sum;
  };
  FreeMotion motion;
  for (int k = 0; (k + 50) * dt < data.duration(); ++k) {
    const double t = data.begin() + k * dt, h = 0.01;
    const JointVector now = q_d(t), dq_d = (q_d(t + h) - q_d(t - h)) / (2 * h),
                      ddq_d = (q_d(t + h) - 2 * now + q_d(t - h)) / (h * h);
    const ArmState& seen = plant.arm(0).state();
    here.update(seen.q, seen.dq);
    const JointVector a = ddq_d + 40 * (dq_d - seen.dq) + 400 * (now - seen.q);
    plant.arm(0).take_command(JointVector(here.M() * a + here.c()));
    plant.advance();
    if (k < 500) continue;
    motion.force.push_back(plant.arm(0).interface().F_K_K.force().norm());
    here.update(seen.q, seen.dq);
    motion.p.push_back(here.X_WE().position);
  }
  return motion;
}

// A Research 3 on a circle at up to 1 rad/s, and a Panda on an exciting motion at up to 1.3 m/s and 3.2
// m/s^2: neither shows larger forces while it accelerates.
TEST(ArmSensors, FreeMotionShowsForcesAsOfRealArms) {
  const Data circle("fr3_circle_2.csv"), exciting("panda_excitation_second_period.csv");
  SKIP_WITHOUT(circle);
  SKIP_WITHOUT(exciting);
  const FreeMotion fr3 = real_motion(circle, "fr3", true), our_fr3 = our_motion(circle, "fr3", true);
  EXPECT_NEAR(rms(fr3.force), 3.4, 0.7);
  expect_within_a_factor_of_2(rms(our_fr3.force), rms(fr3.force), "fr3");
  const FreeMotion fer = real_motion(exciting, "fer", false), our_fer = our_motion(exciting, "fer", false);
  EXPECT_NEAR(rms(fer.force), 4.0, 0.8);
  expect_within_a_factor_of_2(rms(our_fer.force), rms(fer.force), "fer");
  for (const auto& [least, most] : {std::pair(1.0, 2.0), std::pair(2.0, 4.0)}) {
    expect_within_a_factor_of_2(our_fer.rms_at(least, most), fer.rms_at(least, most),
                                "fer from " + std::to_string(least));
  }
  for (const auto& [least, most] : {std::pair(0.0, 0.5), std::pair(0.5, 2.0)}) {
    expect_within_a_factor_of_2(our_fr3.rms_at(least, most), fr3.rms_at(least, most),
                                "fr3 from " + std::to_string(least));
  }
}

}  // namespace
}  // namespace multipanda::arm_sensors_test
