// Laws with the gains of programs that run on real arms, on virtual arms as programs meet them by default:
// none loses an arm, at rest or in motion. Programs of our own, with the gains and laws of
//
//   libfranka 0.21 and pylibfranka 0.21     examples
//   panda-py 1.1.1, aiofranka 0.9           defaults
//   franka-rs 0.4, franky 2.0               defaults of target control and of trackers
#include <cmath>
#include <numbers>

#include "arm_interface/arm_error.hpp"
#include "backends/mujoco/testing/test_scenes.hpp"
#include "core/testing/series.hpp"
#include "fci/server/testing/test_program.hpp"
#include "fci/server/virtual_arms.hpp"
#include "scene/load.hpp"

namespace multipanda::fci::example_gains_test {
namespace {

using multipanda::test::arm_named;
using multipanda::test::pose;
using multipanda::test::scene_of;
using multipanda::test::terms_of;
using test::own_address;
using test::TestProgram;

using Seven = Eigen::Matrix<double, 7, 1>;

// tau = J^T A (Kx e - Dx V) + K (q_d - q) - D dq + N (k (q_start - q) - d dq) + c, A: Lambda or 1, N = 1 -
// J^T J^+^T
struct Law {
  const char* of;
  Seven K = Seven::Zero(), D = Seven::Zero();          // [N m/rad, N m s/rad]
  Vector6 Kx = Vector6::Zero(), Dx = Vector6::Zero();  // [N/m, N m/rad, ...]; with `inertia` [1/s^2, 1/s]
  bool inertia = false;                                // its mass matrix counts `motors`
  Seven motors = Seven::Zero();                        // [kg m^2]
  double posture = 0, posture_damping = 0;             // [N m/rad, N m s/rad]
  double low_pass_hz = 0;                              // of the torques
  bool coriolis = true;
};

Vector6 six(double linear, double angular) {
  return (Vector6() << linear, linear, linear, angular, angular, angular).finished();
}
Seven seven(double a, double b, double c, double d, double e, double f, double g) {
  return (Seven() << a, b, c, d, e, f, g).finished();
}

std::vector<Law> laws() {
  const auto critical = [](const auto& K) { return (2 * K.cwiseSqrt()).eval(); };
  const Seven example = seven(600, 600, 600, 600, 250, 150, 50), fifty = Seven::Constant(50),
              droid = seven(40, 30, 50, 25, 35, 25, 10), droid_damping = seven(4, 6, 5, 5, 3, 2, 1);
  const Seven example_damping = seven(50, 50, 50, 50, 30, 25, 15);
  return {
      {.of = "libfranka, joint_impedance_control", .K = example, .D = example_damping},
      {.of = "pylibfranka, joint_impedance_example; franky, JointImpedanceTracker",
       .K = fifty,
       .D = critical(fifty)},
      {.of = "libfranka, cartesian_impedance_control", .Kx = six(150, 10), .Dx = critical(six(150, 10))},
      {.of = "franky, CartesianImpedanceTracker", .Kx = six(500, 50), .Dx = critical(six(500, 50))},
      {.of = "panda-py, JointPosition", .K = example, .D = seven(50, 50, 50, 20, 20, 20, 10)},
      {.of = "panda-py, CartesianImpedance",
       .Kx = six(600, 30),
       .Dx = critical(six(600, 30)),
       .posture = 0.5,
       .posture_damping = 2 * std::sqrt(0.5)},
      {.of = "aiofranka, impedance", .K = Seven::Constant(80), .D = Seven::Constant(4), .coriolis = false},
      {.of = "aiofranka, osc",
       .Kx = six(100, 100),
       .Dx = six(4, 4),
       .inertia = true,
       .motors = seven(0.195, 0.195, 0.195, 0.195, 0.074, 0.074, 0.074),
       .posture = 1,
       .posture_damping = 1,
       .coriolis = false},
      {.of = "franka-rs, joint targets", .K = example, .D = example_damping, .low_pass_hz = 100},
      {.of = "franka-rs, Cartesian targets",
       .K = droid,
       .D = droid_damping,
       .Kx = six(750, 15),
       .Dx = (Vector6() << 50, 50, 90, 2, 2, 2).finished(),
       .low_pass_hz = 100},
      {.of = "franka-rs, DROID",
       .K = droid,
       .D = droid_damping,
       .Kx = six(750, 15),
       .Dx = six(37, 2),
       .low_pass_hz = 100},
  };
}

struct Place {
  const char* model = "fer";
  bool hand = true;
  PlantFidelity plant;
  std::optional<double> hidden = {};  // of the rotors; none: the default
  WorldPace pace = WorldPace::lockstep;
};

struct Motion {
  std::string lost;  // why the arm left its motion; empty: it followed to the end
  double error = 0;  // at the end [rad]
  double speed = 0;  // largest in the last 0.3 s [rad/s]
  double swing = 0;  // largest change of a joint's velocity within 1 ms in the last 0.3 s [rad/s]
};

class Follower {
 public:
  Follower(const Law& law, const SceneArm& arm) : law_(law), here_(terms_of(arm)), goal_(terms_of(arm)) {
    low_pass_ = law.low_pass_hz > 0 ? -std::expm1(-2e-3 * std::numbers::pi * law.low_pass_hz) : 1;
  }
  JointVector torque(const JointVector& q, const JointVector& dq, const JointVector& q_d) {
    if (q_start_.size() == 0) q_start_ = q, tau_ = 0 * q;
    here_.update(q, dq);
    JointVector tau = law_.K.cwiseProduct(q_d - q) - law_.D.cwiseProduct(dq);
    if (!law_.Kx.isZero()) {
      goal_.update(q_d, 0 * dq);
      const Jacobian& J = here_.J_V_WE();
      Vector6 F = law_.Kx.cwiseProduct(pose_error(goal_.X_WE(), here_.X_WE())) - law_.Dx.cwiseProduct(J * dq);
      if (law_.inertia) {
        Eigen::Matrix<double, 7, 7> M = here_.M();
        M.diagonal() += law_.motors;
        F = Matrix6(J * M.ldlt().solve(J.transpose())).ldlt().solve(F).eval();
      }
      tau += J.transpose() * F;
      const JointVector posture = law_.posture * (q_start_ - q) - law_.posture_damping * dq;
      tau += posture - J.transpose() * (J * J.transpose()).ldlt().solve(J * posture);
    }
    if (law_.coriolis) tau += here_.c();
    return tau_ += low_pass_ * (tau - tau_);
  }

 private:
  const Law& law_;
  ModelTerms here_, goal_;
  double low_pass_;
  JointVector q_start_, tau_;
};

// The arm rests for `seconds`, is led to and fro for as long, and rests again for 2 s.
Motion lead(const Law& law, const Place& place, double seconds) {
  SceneArm arm = arm_named("arm", pose(0.2, -0.3, 0.1, 0, 0, 0.8));
  arm.model = place.model;
  arm.hand = place.hand;
  VirtualArmOptions options;
  options.places.push_back({.address = own_address(0),
                            .port = 0,
                            .gripper_port = 0,
                            .vacuum_port = 0,
                            .versions = VersionRange{}});
  options.pace = place.pace;
  options.idle_stands_still = place.pace == WorldPace::lockstep;
  Scene scene = scene_of({arm}, place.plant);
  scene.plant.rotor_hidden = place.hidden;
  scene.arms[0].rotor_hidden = place.hidden.value_or(1);
  let_rotors_act(scene);
  VirtualArms arms(std::move(scene), options);
  arms.start();
  TestProgram program(arms.place(0));
  Follower follower(law, arm);
  const bool waits = place.pace == WorldPace::lockstep;
  RobotState state = waits ? program.start_torques() : program.begin_torques();
  const auto vector = [](const std::array<double, 7>& v) {
    return JointVector(Eigen::Map<const Seven>(v.data()));
  };
  const JointVector start = vector(state.q);
  const Seven amplitude = seven(0.2, 0.2, -0.2, 0.2, 0.3, -0.3, 0.4), times = seven(1, 2, 1, 1, 2, 1, 2);
  constexpr double kSwing = 8;  // seconds to and fro
  const double swings = std::ceil(seconds / kSwing);
  const double moves = swings * kSwing, end = seconds + moves + 2,
               began = static_cast<double>(state.message_id) / 1e3;
  Motion result;
  JointVector before = vector(state.dq);
  for (bool last = false; !last;) {
    const double t = static_cast<double>(state.message_id) / 1e3 - began;
    last = t + 1e-3 >= end;
    if (state.robot_mode != static_cast<std::uint8_t>(RobotMode::move)) {
      for (std::size_t i = 0; i < kErrorCount; ++i) {
        if (state.reflex_reason[i] != 0)
          result.lost += std::string(to_string(static_cast<ArmError>(i))) + " ";
      }
      result.lost += "after " + std::to_string(t) + " s";
      return result;
    }
    JointVector q_d = start;
    if (t > seconds && t < seconds + moves)
      q_d += amplitude.cwiseProduct(
          Seven((2 * std::numbers::pi / kSwing * (t - seconds) * times).array().sin().square()));
    const JointVector q = vector(state.q), dq = vector(state.dq), tau = follower.torque(q, dq, q_d);
    RobotCommand command = program.torques(state, last);
    Eigen::Map<Seven>(command.tau_J_d.data()) = tau;
    result.error = (q_d - q).cwiseAbs().maxCoeff();
    if (t > end - 0.3) {
      result.speed = std::max(result.speed, dq.cwiseAbs().maxCoeff());
      result.swing = std::max(result.swing, (dq - before).cwiseAbs().maxCoeff());
    }
    before = dq;
    program.command(command);
    if (!last) state = waits ? program.read() : program.read_newest_or(program.read());
  }
  return result;
}

TEST(ExampleGains, LoseNoArmAtRestOrInMotion) {
  multipanda::test::Series series;
  const double seconds = multipanda::test::full_series() ? 60 : 2;
  int n = 0;
  for (const Law& law : laws()) {
    for (int i = 0; i < 13; ++i) {
      const bool real_time = i == 12;  // of the long series only
      if (!series.takes(!real_time && n++ % 9 == 0)) continue;
      const Place place{.model = std::to_array({"fer", "fr3", "fr3v2"})[static_cast<std::size_t>(i % 3)],
                        .hand = i / 3 % 2 == 0,
                        .plant = i / 6 == 0 ? PlantFidelity::ideal() : PlantFidelity::realistic(),
                        .pace = real_time ? WorldPace::realtime : WorldPace::lockstep};
      SCOPED_TRACE(std::string(law.of) + ", " + place.model + (place.hand ? ", " : " without hand, ") +
                   place.plant.name + (real_time ? ", in real time" : ""));
      Motion motion = lead(law, place, seconds);
      // The machine stood still: a real arm stops, too.
      for (int k = 0; k < 3 && motion.lost.starts_with("communication_constraints"); ++k)
        motion = lead(law, place, seconds);
      EXPECT_EQ(motion.lost, "");
      // What nothing damps on an ideal plant goes on: the self-motion, and rotors that a law does not know.
      if (place.plant.joint_friction) EXPECT_LT(motion.speed, 0.05);
    }
  }
}

// With less of the rotors: FR3's wrist alone is too light for 15 N m s/rad at 1 kHz, a bare Panda's with a
// tenth of its rotor is behind real motors.
TEST(ExampleGains, AreTooMuchForAWristWithoutItsRotor) {
  EXPECT_NE(lead(laws()[0], {.model = "fr3", .plant = {}, .hidden = 1}, 2).lost, "");
  EXPECT_NE(lead(laws()[0], {.hand = false, .plant = PlantFidelity::realistic(), .hidden = 0.9}, 2).lost, "");
}

TEST(Rotors, ActUnlessTheSceneSaysHowMuchOfThemIsHidden) {
  const Registry registry = Registry::with_builtins();
  const auto hidden = [&](const char* plant) {
    Scene scene = parse_scene(std::string("arms:\n  - name: arm\n") + plant, "rotors.yaml", registry);
    let_rotors_act(scene);
    return scene.arms[0].rotor_hidden;
  };
  EXPECT_EQ(hidden(""), 0);
  EXPECT_EQ(hidden("plant: {rotor_inertia_hidden: 1}\n"), 1);
  EXPECT_EQ(hidden("plant: {rotor_inertia_hidden: 0.25}\n"), 0.25);
}

}  // namespace
}  // namespace multipanda::fci::example_gains_test
