// A stiffness that rises while its spring is stretched throws nobody: what the arm does while stiffnesses
// jump between nothing and their greatest, with undeclared loads, on both plants.
#include <gtest/gtest.h>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/modes/registry.hpp"
#include "core/testing/series.hpp"
#include "scene/build.hpp"

namespace multipanda::raised_stiffness_test {
namespace {

struct BenchSetup {
  std::string type, model = "fr3";
  PlantFidelity plant = PlantFidelity::ideal();
  bool hand = true;
  Vector3 base_rpy = Vector3::Zero();
  double load = 0, load_across = 0;  // undeclared, beside the flange [kg], [m]
  double tool = 0;                   // length of a pointer [m]
  JointVector q_start = joint_constant(7, 0);

  std::string name() const {
    return type + ", " + plant.name + ", delay " + std::to_string(plant.command_delay_s) + ", " + model +
           (hand ? "" : " without hand") + ", base " + std::to_string(base_rpy.x());
  }
};

JointVector ready() {
  JointVector q(7);
  q << 0, -M_PI / 4, 0, -3 * M_PI / 4, 0, M_PI / 2, M_PI / 4;
  return q;
}

// One law on its arms, cycle by cycle, and how fast its hands have been.
class Bench {
 public:
  explicit Bench(const BenchSetup& setup)
      : scene_(scene_of(setup)),
        backend_(scene_, {.pace = Pace::unpaced}),
        cycle_(build_cycle_config(scene_), registry(), backend_),
        law_(instance()) {
    for (const SceneArm& arm : scene_.arms) {
      const ArmConfig config = arm_config(arm);
      terms_.emplace_back(build_arm_model(arm)).set_config(config.frames, config.tool, config.load);
    }
    backend_.start();
    steps(1);
    forget();
  }

  void steps(int n) {
    for (int k = 0; k < n; ++k) {
      cycle_.step(backend_.wait());
      for (std::size_t i = 0; i < terms_.size(); ++i) {
        backend_.world().joints(i, q_, dq_);
        terms_[i].update(q_, dq_);
        fastest = std::max(fastest, terms_[i].V_WE().linear().norm());
        turning = std::max(turning, terms_[i].V_WE().angular().norm());
        for (const Vector3& p : terms_[i].points_from_hand())
          farthest =
              std::max(farthest, (terms_[i].V_WE().linear() + terms_[i].V_WE().angular().cross(p)).norm());
      }
      if (terms_.size() < 2) continue;
      const Vector3 p = X(1).position - X(0).position;
      const Vector3 v = terms_[1].V_WE().linear() - terms_[0].V_WE().linear();
      closing = std::max(closing, -p.normalized().dot(v));
    }
  }
  void forget() { fastest = turning = closing = farthest = 0; }
  void stop() { cycle_.modes().stop(ArmSet::all(terms_.size())); }

  // Each stiffness whose name has this: this share of its greatest.
  void stiffness(const std::string& part, double share) {
    for (std::size_t i = 0; i < law_.parameter_count(); ++i) {
      const ParameterSpec& spec = law_.parameter_spec(i);
      if (spec.unit.rfind("N", 0) != 0 || spec.name.find("stiffness") == spec.name.npos ||
          spec.name.find(part) == spec.name.npos) {
        continue;
      }
      law_.set_parameter(i, std::vector<double>(law_.parameter_size(i), share * spec.max), true);
    }
  }
  void set(const std::string& name, std::vector<double> values) {
    for (std::size_t i = 0; i < law_.parameter_count(); ++i) {
      if (law_.parameter_spec(i).name == name) return law_.set_parameter(i, values, true);
    }
    FAIL() << name;
  }

  // The next goal, away from the one before by this.
  void go(const Vector3& p, const Vector3& r = Vector3::Zero()) {
    for (Reference& input : law_.inputs()) {
      if (input.spec().quantity == Quantity::joints) {
        Target target;
        target.size = 7;
        for (std::size_t i = 0; i < 7; ++i)
          target.values[i] = input.joints()[static_cast<Eigen::Index>(i)] +
                             (p.norm() > 0 ? p.x() / p.norm() : 0) * (i % 2 == 0 ? 0.25 : -0.25);
        input.post(target);
      } else if (input.spec().quantity == Quantity::pose) {
        const Pose goal{exp_rotation(r) * input.pose().rotation, input.pose().position + p};
        input.post(pose_target(goal, 0));
      }
    }
  }

  const Pose& X(std::size_t i) { return terms_[i].X_WE(); }
  Reference& input() { return law_.inputs()[0]; }
  bool owns() { return cycle_.modes().owner(0) == cycle_.modes().find("law"); }

  std::string positions() {
    ArmSample sample;
    std::string text;
    for (std::size_t i = 0; i < terms_.size(); ++i) {
      cycle_.take_sample(i, sample);
      for (int j = 0; j < 7; ++j) text += " " + std::to_string(sample.q[j]);
      text += "; ";
    }
    return text;
  }

  double fastest = 0, turning = 0, closing = 0;  // [m/s], [rad/s], [m/s] of two hands
  double farthest = 0;                           // of flange or tool [m/s]

 private:
  static const Registry& registry() {
    static const Registry builtins = Registry::with_builtins();
    return builtins;
  }
  static Scene scene_of(const BenchSetup& setup) {
    Scene scene;
    scene.plant = setup.plant;
    const std::size_t arms = registry().controllet(setup.type)->descriptor.arms;
    InstanceConfig law{.name = "law", .type = setup.type, .arms = {}, .contact = {}};
    for (std::size_t i = 0; i < arms; ++i) {
      SceneArm arm;
      arm.name = i == 0 ? "left" : "right";
      arm.model = setup.model;
      arm.hand = setup.hand;
      arm.X_WB.rotation = rotation_from_rpy(setup.base_rpy);
      if (arms == 2) arm.X_WB.position.y() = i == 0 ? 0.3 : -0.3;
      arm.q_start = ready() + setup.q_start;
      if (setup.tool > 0)
        arm.tool_shapes = {{.size = Vector3::Constant(0.02),
                            .X_FS = {Matrix3::Identity(), Vector3(0, 0, setup.tool)},
                            .place = {}}};
      arm.load_present.mass = setup.load;
      arm.load_present.p_FC = Vector3(setup.load_across, 0, 0.05);
      arm.load_present.inertia_C = 1e-3 * setup.load * Matrix3::Identity();
      arm.safety = SafetyLimits::of(*build_arm_model(arm));
      scene.arms.push_back(arm);
      law.arms.push_back(i);
    }
    if (setup.type != "hold") {  // every arm has one
      scene.controllets = {law};
      scene.active = {"law"};
    }
    return scene;
  }
  Instance& instance() {
    MultimodeController& modes = cycle_.modes();
    modes.activate_at_start(start_set(scene_, modes));
    return modes.instance(modes.find(scene_.controllets.empty() ? "left_hold" : "law"));
  }

  Scene scene_;
  MujocoBackend backend_;
  ControlCycle cycle_;
  Instance& law_;
  std::vector<ModelTerms> terms_;
  JointVector q_ = joint_constant(7, 0), dq_ = q_;
};

PlantFidelity plant_of(int i) {
  PlantFidelity plant = i == 0 ? PlantFidelity::ideal() : PlantFidelity::realistic();
  if (i == 2) plant.command_delay_s = 0.003;
  return plant;
}

constexpr double kHandSpeed = 0.25;
constexpr double kOvershoot = 1.02;  // goals of joints alone reach 0.2545 m/s

// A goal leads an arm there and back, while all its stiffnesses fall to nothing and rise to their greatest.
TEST(RaisedStiffness, SwitchedInMotionThrowsNoHand) {
  test::Series series;
  for (const std::string type :
       {"cartesian_impedance", "joint_impedance", "ufic", "hybrid_force", "dual_cartesian_impedance",
        "coupled_dual_cartesian_impedance", "coupled_ufic"}) {
    for (int plant = 0; plant < 3; ++plant) {
      for (const int every : {150, 300, 700}) {
        for (int variant = 0; variant < 6; ++variant) {
          if (!series.takes(every == 300 && plant < 2)) continue;
          BenchSetup setup{.type = type, .model = variant % 2 == 0 ? "fr3" : "fer", .plant = plant_of(plant)};
          setup.hand = variant % 3 != 0;
          const bool two = type.find("dual") != type.npos || type == "coupled_ufic";  // stay side by side
          if (variant > 2) setup.base_rpy = Vector3(two ? 0 : 0.5 * M_PI * (variant - 4), 0.3, 0);
          // Two arms stay away from the axes of their shoulders, where a limp arm meets the speed of joint 1.
          const double away = two ? 0.02 : 0.06;
          for (Eigen::Index i = 0; i < 7; ++i) setup.q_start[i] = away * variant * (i % 2 == 0 ? 1 : -1);
          Bench bench(setup);
          const Vector3 first = bench.X(0).position;
          double moved = 0;
          for (int k = 0; k < 8000; k += 50) {
            if (k % every == 0) bench.stiffness("", k / every % 2);
            if (k % 2000 == 200) bench.go((k / 2000 % 2 == 0 ? 1 : -1) * Vector3(0.15, 0.2, -0.15));
            bench.steps(50);
            moved = std::max(moved, (bench.X(0).position - first).norm());
          }
          const std::string name = setup.name() + ", every " + std::to_string(every) + " ms";
          std::printf("%s: hand %.3f m/s, %.2f m\n", name.c_str(), bench.fastest, moved);
          series.record("hand_m_per_s", bench.fastest);
          EXPECT_TRUE(bench.owns()) << name << ", " << bench.positions();
          EXPECT_LT(bench.fastest, (type == "joint_impedance" ? kOvershoot : 1) * kHandSpeed) << name;
          EXPECT_GT(moved, 0.03) << name;
        }
      }
    }
  }
}

// A circle is streamed with 0.25 m/s. With each sample the whole speed came back: 0.27 m/s.
TEST(RaisedStiffness, SwitchedInAStreamThrowsNoHand) {
  for (const std::string type : {"cartesian_impedance", "ufic"}) {
    for (int plant = 0; plant < 2; ++plant) {
      Bench bench({.type = type, .plant = plant_of(plant)});
      const Pose start = bench.X(0);
      for (int k = 0; k < 8000; k += 50) {
        const double angle = kHandSpeed / 0.08 * 1e-3 * (k < 1000 ? k * k / 2000.0 : k - 500.0);
        const Vector3 p = 0.08 * Vector3(std::sin(angle), 1 - std::cos(angle), 0);
        Target sample = pose_target({start.rotation, start.position + p}, 0);
        sample.delivery = Delivery::stream;
        ASSERT_EQ(bench.input().post(sample), Verdict::accepted);
        if (k == 2100) bench.forget();
        if (k >= 2100 && k % 700 == 0) bench.stiffness("", k / 700 % 2 == 0 ? 0.3 : 0);
        bench.steps(50);
      }
      std::printf("%s, %s: %.3f m/s, flange %.3f m/s\n", type.c_str(), plant_of(plant).name.c_str(),
                  bench.fastest, bench.farthest);
      EXPECT_TRUE(bench.owns()) << type << plant;
      EXPECT_LT(bench.farthest, 1.05 * kHandSpeed) << type << plant;  // what streams may exceed it by
    }
  }
}

// What was fed forward for an acceleration, of the rule or of a return, threw the end at 0.61 m/s.
TEST(RaisedStiffness, BetweenTwoHandsAnAccelerationThrowsNoTool) {
  for (const auto& [tool, every] : {std::pair{0.8, 700}, {0.0, 2000}, {0.8, 1500}}) {
    Bench bench({.type = "coupled_dual_cartesian_impedance", .tool = tool});
    bench.steps(300);
    for (int k = 0; k < 12000; k += 10) {
      if (k % every == 0) bench.stiffness("", k / every % 2 == 0 ? 0 : 0.3);
      const double way = k / 2000 % 2 == 0 ? 1 : -1;
      if (k % 2000 == 200) bench.go(way * Vector3(0.1, 0.2, -0.1), way * Vector3(0, 0.3, 0.3));
      bench.steps(10);
    }
    std::printf("tool %.1f m, every %d ms: %.3f m/s\n", tool, every, bench.farthest);
    EXPECT_TRUE(bench.owns()) << tool << every;
    EXPECT_LT(bench.farthest, kHandSpeed) << tool << every;
  }
}

// The set-point has gone on while the springs were off, or turned by 1 rad; then they come at once.
TEST(RaisedStiffness, ARiseFromNothingBringsTheHandBackSlowly) {
  for (const std::string type : {"cartesian_impedance", "joint_impedance", "ufic"}) {
    for (const std::string part : {"", "translational", "rotational"}) {
      if (type == "joint_impedance" && part != "") continue;
      for (int plant = 0; plant < 2; ++plant) {
        Bench bench({.type = type, .plant = plant_of(plant)});
        bench.stiffness(part, 0);
        bench.steps(300);
        const bool turns = part != "translational", slides = part != "rotational";
        bench.go(slides ? Vector3(0.1, 0.15, -0.1) : Vector3(0, 0, 0),
                 turns ? Vector3(0, 0, 1) : Vector3(0, 0, 0));
        bench.steps(4000);
        bench.forget();
        bench.stiffness(part, part == "rotational" ? 20.0 / 300 : 0.2);
        bench.steps(6000);
        const std::string name = type + ", " + part + ", " + plant_of(plant).name;
        std::printf("%s: %.3f m/s, %.3f rad/s\n", name.c_str(), bench.fastest, bench.turning);
        EXPECT_LT(bench.fastest, kHandSpeed) << name;
        EXPECT_LT(bench.turning, 0.75) << name;
        if (bench.input().spec().quantity == Quantity::pose) {
          const Vector6 error = pose_error(bench.input().pose(), bench.X(0));
          EXPECT_LT(error.head<3>().norm(), plant == 0 ? 0.002 : 0.02) << name;
          EXPECT_LT(error.tail<3>().norm(), plant == 0 ? 0.01 : 0.12) << name;
        }
      }
    }
  }
}

// Its end is 0.7 m from the end effector: 0.35 m/s at 0.5 rad/s.
TEST(RaisedStiffness, TheEndOfALongToolComesBackAsSlowly) {
  for (const std::string type : {"cartesian_impedance", "joint_impedance", "ufic", "dual_cartesian_impedance",
                                 "coupled_dual_cartesian_impedance"}) {
    for (int plant = 0; plant < 2; ++plant) {
      Bench bench({.type = type, .plant = plant_of(plant), .tool = 0.8});
      const std::string part = type == "joint_impedance" ? "" : "rotational";
      bench.stiffness(part, 0);
      bench.steps(300);
      bench.go(part.empty() ? Vector3(0.1, 0, 0) : Vector3(0, 0, 0), Vector3(0, 0.8, 0));
      bench.steps(4000);
      bench.forget();
      bench.stiffness(part, 20.0 / 300);
      bench.steps(6000);
      const std::string name = type + ", " + plant_of(plant).name;
      std::printf("%s: hand %.3f m/s, tool %.3f m/s, %.3f rad/s\n", name.c_str(), bench.fastest,
                  bench.farthest, bench.turning);
      EXPECT_LT(bench.farthest, kHandSpeed) << name;
      EXPECT_GT(bench.farthest, 0.1) << name;
      EXPECT_TRUE(bench.owns()) << name;
    }
  }
}

// What a load of 1 kg beside the flange does to a hand and its goals does not depend on how its stiffness
// came: it rises to where it would be, and goals arrive.
TEST(RaisedStiffness, AnUndeclaredLoadRisesAndGoalsArrive) {
  for (const std::string type : {"cartesian_impedance", "joint_impedance", "ufic"}) {
    for (int plant = 0; plant < 2; ++plant) {
      for (const double load : {1.0, 2.0}) {
        const auto ends = [&](bool rises) {
          Bench bench({.type = type, .plant = plant_of(plant), .load = load, .load_across = 0.08});
          bench.stiffness("", rises ? 0.05 : 0.4);
          bench.steps(3000);
          bench.forget();
          bench.stiffness("", 0.4);
          bench.steps(6000);
          const Pose at_rest = bench.X(0);
          EXPECT_LT(bench.fastest, kHandSpeed) << type;
          bench.go(Vector3(0.05, 0.1, 0.05), Vector3(0, 0, 0.2));
          bench.steps(4000);
          EXPECT_TRUE(bench.owns()) << type;
          return std::pair(at_rest, bench.X(0));
        };
        const auto raised = ends(true), always = ends(false);
        const Vector6 rest = pose_error(always.first, raised.first);
        const Vector6 arrival = pose_error(always.second, raised.second);
        std::printf("%s, %s, %.0f kg: %.2f mm %.2f mrad at rest, %.2f mm %.2f mrad at the goal\n",
                    type.c_str(), plant_of(plant).name.c_str(), load, 1e3 * rest.head<3>().norm(),
                    1e3 * rest.tail<3>().norm(), 1e3 * arrival.head<3>().norm(),
                    1e3 * arrival.tail<3>().norm());
        // Friction holds a joint within its own torque over the stiffness, on either side.
        EXPECT_LT(rest.head<3>().norm(), plant == 0 ? 5e-4 : 0.01) << type;
        EXPECT_LT(arrival.head<3>().norm(), plant == 0 ? 5e-4 : 0.01) << type;
        EXPECT_LT(rest.tail<3>().norm(), plant == 0 ? 5e-3 : 0.05) << type;
        EXPECT_LT(arrival.tail<3>().norm(), plant == 0 ? 5e-3 : 0.05) << type;
      }
    }
  }
}

// The axes of a stiffness that lie along the set-point's orientation do not turn with what a raised one sees.
TEST(RaisedStiffness, DoesNotTurnTheAxesOfAnother) {
  for (const std::string type :
       {"cartesian_impedance", "dual_cartesian_impedance", "coupled_dual_cartesian_impedance", "ufic"}) {
    for (int plant = 0; plant < 2; ++plant) {
      Bench bench({.type = type, .plant = plant_of(plant)});
      bench.set("stiffness_axes", {1});
      bench.set("translational_stiffness_n_per_m", {3000, 0, 0});
      bench.set("rotational_stiffness_nm_per_rad", {0, 0, 0});
      bench.steps(300);
      bench.go(Vector3(0, 0.2, 0), Vector3(0, 0, 0.5));
      bench.steps(3000);
      bench.forget();
      bench.set("rotational_stiffness_nm_per_rad", {20, 20, 20});
      bench.steps(1500);
      const std::string name = type + ", " + plant_of(plant).name;
      std::printf("%s: %.3f m/s, %.3f rad/s\n", name.c_str(), bench.fastest, bench.turning);
      EXPECT_TRUE(bench.owns()) << name;
      EXPECT_LT(bench.fastest, 0.2) << name;
      EXPECT_LT(bench.turning, 0.75) << name;
    }
  }
}

// An axis of a force takes the set-point to the hand, and with it what a raised stiffness left of the way.
TEST(RaisedStiffness, LeavesNothingAlongAnAxisOfAForce) {
  for (int plant = 0; plant < 2; ++plant) {
    for (const int on : {250, 600, 1000}) {
      Bench bench({.type = "hybrid_force", .plant = plant_of(plant)});
      bench.set("translational_stiffness_n_per_m", {2000, 2000, 0});
      bench.steps(300);
      bench.go(Vector3(0, 0, -0.22));
      bench.steps(3000);
      bench.forget();
      const double z = bench.X(0).position.z();
      bench.set("translational_stiffness_n_per_m", {2000, 2000, 2000});
      bench.steps(300);
      bench.set("force_z", {1});
      bench.steps(on);
      const double released = bench.X(0).position.z();
      bench.set("force_z", {0});
      bench.steps(2000);
      const std::string name = plant_of(plant).name + ", " + std::to_string(on) + " ms";
      std::printf("%s: %.3f m/s, %.4f m, %.4f m\n", name.c_str(), bench.fastest, released - z,
                  bench.X(0).position.z() - z);
      EXPECT_TRUE(bench.owns()) << name;
      EXPECT_LT(bench.fastest, 0.2) << name;
      EXPECT_LT(bench.X(0).position.z(), released + 0.01) << name;  // not away from its goal
    }
  }
}

// A hold that was soft sags under 1 kg; it lifts the arm slowly when it becomes stiff, as far as one that was
// stiff from the start.
TEST(RaisedStiffness, AHoldLiftsSlowly) {
  for (int plant = 0; plant < 2; ++plant) {
    const auto height = [&](bool rises) {
      Bench bench({.type = "hold", .plant = plant_of(plant), .load = 1, .load_across = 0.08});
      bench.set("stiffness_nm_per_rad", std::vector<double>(7, rises ? 20 : 1000));
      bench.steps(3000);
      bench.forget();
      bench.set("stiffness_nm_per_rad", std::vector<double>(7, 1000));
      bench.steps(9000);
      std::printf("hold, %s: %.3f m/s\n", plant_of(plant).name.c_str(), bench.fastest);
      EXPECT_LT(bench.fastest, 0.12) << plant;  // 0.1 rad/s on a lever of at most 0.9 m, and what lags
      return bench.X(0).position.z();
    };
    EXPECT_NEAR(height(true), height(false), plant == 0 ? 1e-3 : 5e-3);
  }
}

// A stop on the way up: what carries the load goes on carrying it. The arm was behind its set-point by what
// damping takes, 2 zeta v / omega = 2 * 0.05 / 12 m, and comes to rest there.
TEST(RaisedStiffness, AStoppedHoldKeepsItsLoad) {
  Bench bench({.type = "hold", .load = 1, .load_across = 0.08});
  bench.set("stiffness_nm_per_rad", std::vector<double>(7, 20));
  bench.steps(3000);
  bench.set("stiffness_nm_per_rad", std::vector<double>(7, 300));
  bench.steps(1000);
  const double z = bench.X(0).position.z();
  bench.stop();
  bench.steps(2000);
  const double rest = bench.X(0).position.z();
  bench.steps(2000);
  std::printf("stopped: %.4f m higher, then %.5f m\n", rest - z, bench.X(0).position.z() - rest);
  EXPECT_GT(rest, z - 0.001);
  EXPECT_LT(rest, z + 0.01);
  EXPECT_NEAR(bench.X(0).position.z(), rest, 1e-4);
}

// An undeclared load does not sink without end while the stiffness of its hold goes up and down.
TEST(RaisedStiffness, UpAndDownAHoldDoesNotSinkWithoutEnd) {
  Bench bench({.type = "hold", .plant = plant_of(1), .load = 1, .load_across = 0.08});
  const double z = bench.X(0).position.z();
  const auto swing = [&](int times) {
    for (int k = 0; k < times; ++k) {
      bench.stiffness("", k % 2 == 0 ? 0.01 : 0.1);
      bench.steps(200);
    }
    return z - bench.X(0).position.z();
  };
  const double early = swing(20), late = swing(40);
  std::printf("hold: %.4f m, then %.4f m lower, %.3f m/s\n", early, late, bench.fastest);
  EXPECT_LT(late, early + 0.01);
  EXPECT_LT(bench.fastest, 0.25);
}

// The offset of 0.14 m that is asked for while nothing holds the hands together comes later, and moves them
// relative to each other with ReturningOffset::kShare of a hand's speed; each does half of that.
TEST(RaisedStiffness, BetweenTwoHandsClosesThemSlowly) {
  for (int plant = 0; plant < 3; ++plant) {
    Bench bench({.type = "coupled_dual_cartesian_impedance", .plant = plant_of(plant)});
    bench.set("damping_of", {1});  // the velocity of the offset does not lead the hands
    bench.stiffness("relative", 0);
    bench.steps(300);
    bench.set("relative_offset_m", {0.1, 0.1, 0});
    bench.steps(3000);
    const double before = (bench.X(1).position - bench.X(0).position).norm();
    bench.forget();
    bench.stiffness("relative", 1);
    bench.steps(4000);
    const double after = (bench.X(1).position - bench.X(0).position).norm();
    std::printf("%s: closing at %.3f m/s from %.3f to %.3f m\n", plant_of(plant).name.c_str(), bench.closing,
                before, after);
    EXPECT_LT(bench.closing, 0.12);
    EXPECT_LT(bench.fastest, 0.1);
    EXPECT_LT(after, before - 0.08);
  }
}

}  // namespace
}  // namespace multipanda::raised_stiffness_test
