// The outputs of the laws with energy tanks: powers against the work of the torques, energies against a book
// that is kept here.
#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/moving_law.hpp"

namespace multipanda::force_law_outputs_test {
namespace {

using namespace test;

struct Law {
  ControlletType type;
  std::size_t arms;
  const char* force;  // its input
};

std::vector<Law> laws() {
  return {{ufic_controllet(), 1, "wrench"}, {coupled_ufic_controllet(), 2, "squeeze"}};
}

struct Course {
  Course(const Law& described, std::uint32_t seed)
      : law(described.type, described.arms, seed), force(described.force) {
    law.place();
    touch(0);
  }

  Vector3 along() const {  // what a hand is pushed back with
    if (law.q.size() == 1) return {0, 0, -1};
    return (law.X_WE(1).position - law.X_WE(0).position).normalized();
  }

  void touch(int t) {
    for (std::size_t i = 0; i < law.q.size(); ++i) {
      ArmState& state = law.rig.state(i);
      state.has_wrench_estimate = true;
      state.F_K_W_est.vector.setZero();
      state.F_K_W_est.vector.head<3>() = (t > 150 ? 20 + 0.01 * t : 0) * (i == 0 ? 1.0 : -1.0) * along();
      state.F_K_W_est.vector[1] += 0.5;
    }
  }

  // A law under way, its arms moved along by the test.
  void tick(int t) {
    if (t == 100) {
      law.aim("pose", law.draw);
      law.aim(force, law.draw);
    }
    tau.clear();
    dq.clear();
    for (std::size_t i = 0; i < law.q.size(); ++i) {
      tau.push_back(law.rig.tau(i));
      JointVector step = 0.001 * std::sin(0.01 * t + static_cast<double>(i)) * law.dq[i];
      law.rig.state(i).tau_J_d = tau[i] + others * joint_constant(7, 1);
      law.q[i] += step;
      dq.push_back(step);
      law.rig.place(i, law.q[i], law.dq[i]);
    }
    touch(t);
    ASSERT_EQ(law.rig.tick(0.001), LawResult::ok);
  }

  double number(const char* name) const { return law.rig.output(name)[0]; }
  double kinetic() const {
    double sum = 0;
    for (std::size_t i = 0; i < law.q.size(); ++i)
      sum += 0.5 * law.dq[i].dot(JointVector(law.plain[i].mass(law.q[i]) * law.dq[i]));
    return sum;
  }
  double shown_work() const {  // of the parts of the law, in the last tick
    double sum = 0;
    for (const char* part :
         {"task_spring", "task_damping", "feedforward", "nullspace", "coriolis", "force", "force_damping"})
      sum += 0.001 * number(("power_" + std::string(part) + "_w").c_str());
    return sum;
  }

  MovingLaw law;
  std::string force;
  double others = 0.2;  // torque of features on every joint [N m]
  std::vector<JointVector> tau, dq;
};

TEST(ForceLawOutputs, PowersAddUpToTheWorkOfTheTorques) {
  for (const Law& described : laws()) {
    Course run(described, 51);
    ASSERT_EQ(run.law.rig.start(), LawResult::ok);
    run.tick(0);
    double largest = 0;
    for (int t = 1; t < 500; ++t) {
      run.tick(t);
      double work = 0, others = 0;
      for (std::size_t i = 0; i < run.tau.size(); ++i) {
        work += run.tau[i].dot(run.dq[i]);
        others += run.others * run.dq[i].sum();
      }
      EXPECT_NEAR(run.shown_work(), work, 1e-9);
      EXPECT_NEAR(0.001 * run.number("power_other_w"), others, 1e-9);
      largest = std::max(largest, std::abs(work));
    }
    EXPECT_GT(largest, 1e-4);
  }
}

// Spring and tanks together give what goes into the arms, apart from what an empty tank made up.
TEST(ForceLawOutputs, StoredEnergyIsABook) {
  double created_at_all = 0;
  for (const Law& described : laws()) {
    for (const bool empty : {false, true}) {
      Course run(described, 52);
      run.law.rig.set("valve_law", {empty ? 1.0 : 0.0});
      run.law.rig.set("tank_start_j", {empty ? 0.0 : 50.0});
      ASSERT_EQ(run.law.rig.start(), LawResult::ok);
      run.tick(0);
      const auto stored = [&] { return run.number("stored_energy_j") - run.kinetic(); };
      double before = stored(), created = run.number("energy_injected_j");
      for (int t = 1; t < 500; ++t) {
        run.tick(t);
        const double given = run.shown_work() + 0.001 * run.number("power_other_w");
        const double injected = run.number("energy_injected_j") - created;
        EXPECT_NEAR(stored() - before, injected - given, 1e-8) << described.type.descriptor.type << t;
        before = stored();
        created = run.number("energy_injected_j");
        const double tanks = run.number("force_tank_j") + run.number("impedance_tank_j");
        EXPECT_GE(before - tanks, -1e-9);  // the spring's
      }
      if (!empty) {
        EXPECT_EQ(created, 0) << described.type.descriptor.type;
      }
      created_at_all += created;
    }
  }
  EXPECT_GT(created_at_all, 0);
}

TEST(ForceLawOutputs, ForcesAreThoseAlongThePressingDirection) {
  for (const Law& described : laws()) {
    Course run(described, 53);
    run.law.rig.set("contact_motion_share", {0});
    ASSERT_EQ(run.law.rig.start(), LawResult::ok);
    run.tick(0);
    const Vector3 n = run.along();
    for (int t = 1; t < 140; ++t) run.tick(t);  // before contact turns the direction
    for (std::size_t i = 0; i < run.law.q.size(); ++i) run.law.dq[i].setZero();
    for (int t = 140; t < 180; ++t) {
      run.tick(t);
      double mean = 0;
      for (std::size_t i = 0; i < run.law.q.size(); ++i) {
        const Vector3 F = run.law.rig.state(i).F_K_W_est.force();
        const double along = (i == 0 ? 1 : -1) * n.dot(F);
        if (described.arms == 2) {
          EXPECT_NEAR(run.number(i == 0 ? "first_force_estimated_n" : "second_force_estimated_n"), along,
                      0.3);
        }
        mean += along / static_cast<double>(described.arms);
      }
      EXPECT_NEAR(run.number("force_estimated_n"), mean, 0.3);
      if (t > 178) {
        EXPECT_EQ(run.number("in_contact"), 1);
      }
    }
    if (described.arms == 2) {
      EXPECT_NEAR(run.number("kinetic_energy_j"), run.kinetic(), 1e-9);
      EXPECT_NEAR(run.number("hand_distance_m"),
                  n.dot(Vector3(run.law.X_WE(1).position - run.law.X_WE(0).position)), 0.02);
    }
  }
}

}  // namespace
}  // namespace multipanda::force_law_outputs_test
