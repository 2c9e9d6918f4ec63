// A law keeps nothing of an earlier run: one that ran and is started again gives, bit by bit, what a new one
// gives from there.
#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/moving_law.hpp"

namespace multipanda::restarted_laws_test {
namespace {

using namespace test;

struct Law {
  ControlletType type;
  std::size_t arms;  // observed ones included
  std::vector<std::string> inputs;
  std::vector<std::pair<std::string, std::vector<double>>> parameters;  // of the earlier run
};

std::vector<Law> laws() {
  return {
      {gravity_compensation_controllet(), 1, {}, {}},
      {hold_controllet(), 1, {}, {}},
      {joint_impedance_controllet(), 1, {"joints"}, {{"damping_design", {1}}}},
      {cartesian_impedance_controllet(), 1, {"pose"}, {{"nullspace_posture", {1}}}},
      {dual_cartesian_impedance_controllet(), 2, {"common_pose"}, {{"offset_m", {0.1, 0, 0.1}}}},
      {dual_cartesian_impedance_controllet(), 2, {"first_pose", "second_pose"}, {{"goals", {1}}}},
      {coupled_dual_cartesian_impedance_controllet(), 2, {"pose"}, {{"relative_offset_m", {0.1, 0, 0.1}}}},
      {joint_follower_controllet(), 2, {}, {{"joint_scale", {-1}}, {"alignment", {1}}}},
      {pose_follower_controllet(), 2, {}, {{"scale", {0.5}}, {"axes", {1}}}},
      {teleoperation_controllet(),
       2,
       {},
       {{"architecture", {1}}, {"channel_delay_s", {0.05}}, {"channel_loss", {0.3}}}},
      {force_controllet(), 1, {"wrench"}, {{"approach_speed_m_per_s", {0.1}}}},
      {hybrid_force_controllet(),
       1,
       {"pose", "wrench"},
       {{"force_z", {1}}, {"moment_x", {1}}, {"force_frame", {1}}, {"approach_speed_m_per_s", {0.1}}}},
      {ufic_controllet(), 1, {"pose", "wrench"}, {{"valve_law", {1}}, {"tank_min_j", {150}}}},
      {ufic_controllet(),
       1,
       {"pose", "wrench"},
       {{"force_z", {1}}, {"force_x", {1}}, {"moment_x", {1}}, {"force_frame", {1}}}},
      {coupled_ufic_controllet(), 2, {"pose", "squeeze"}, {{"valve_law", {1}}, {"tank_min_j", {150}}}}};
}

// Something between the hands, or below one, from 150 ms to 220 ms: it pushes back against them.
void touch(MovingLaw& law, int t) {
  Vector3 push(0.5, 1, -8);
  if (law.q.size() == 2) push = 8 * (law.X_WE(1).position - law.X_WE(0).position).normalized();
  for (std::size_t i = 0; i < law.q.size(); ++i) {
    ArmState& state = law.rig.state(i);
    state.has_wrench_estimate = true;
    state.F_K_W_est.vector.setZero();
    if (t >= 150 && t < 220) state.F_K_W_est.vector.head<3>() = i == 0 ? push : Vector3(-push);
  }
}

// Torques and outputs of 300 ms towards the same goals.
std::vector<double> begin(MovingLaw& law, const Law& described, std::uint32_t seed) {
  Draw draw(seed);
  for (std::size_t i = 0; i < law.q.size(); ++i) {
    law.q[i] = bent(7) + draw.joints(7, 0.1);
    law.dq[i] = draw.joints(7, 0.05);
    law.rig.place(i, law.q[i], law.dq[i]);
  }
  touch(law, 0);
  EXPECT_EQ(law.rig.start(), LawResult::ok);
  std::vector<double> all;
  for (int t = 0; t < 300; ++t) {
    if (t == 100) {
      for (const std::string& input : described.inputs) law.aim(input, draw);
    }
    touch(law, t);
    for (std::size_t i = 0; i < law.q.size(); ++i) {
      law.q[i] += 0.001 * law.dq[i];
      law.rig.place(i, law.q[i], law.dq[i]);
    }
    EXPECT_EQ(law.rig.tick(0.001), LawResult::ok);
    for (std::size_t i = 0; i < law.q.size(); ++i) {
      const JointVector tau = law.rig.tau(i);
      all.insert(all.end(), tau.begin(), tau.end());
    }
    const std::vector<double> outputs = law.rig.outputs();
    all.insert(all.end(), outputs.begin(), outputs.end());
  }
  return all;
}

TEST(RestartedLaws, GiveWhatNewOnesGive) {
  for (const Law& described : laws()) {
    for (const bool bounded : {false, true}) {
      const auto make = [&] {
        auto law = std::make_unique<MovingLaw>(described.type, described.arms, 71);
        if (bounded) law->rig.bound({});
        return law;
      };
      auto fresh = make(), used = make();
      begin(*used, described, 1);
      for (const auto& [name, values] : described.parameters) used->rig.approach(name, values);
      for (int t = 0; t < 150; ++t) ASSERT_EQ(used->rig.tick(0.001), LawResult::ok);
      for (std::size_t i = 0; i < described.arms; ++i) {
        used->rig.redefine(i, {exp_rotation(Vector3(0.2, 0.1, 0.3)), Vector3(0.03, 0.05, -0.02)});
      }
      for (int t = 0; t < 20; ++t) ASSERT_EQ(used->rig.tick(0.001), LawResult::ok);  // in the midst of it
      for (std::size_t i = 0; i < described.arms; ++i) {
        fresh->rig.frames(i, used->rig.state(i).frames);
      }
      for (std::size_t i = 0; i < fresh->rig.parameters().size(); ++i) {
        const std::string& name = described.type.descriptor.parameters[i].name;
        const bool kept = name == "goals";
        const auto values = (kept ? used : fresh)->rig.parameters().values(i);
        (kept ? fresh : used)->rig.set(name, {values.begin(), values.end()});
      }
      EXPECT_EQ(begin(*used, described, 2), begin(*fresh, described, 2)) << described.type.descriptor.type;
    }
  }
}

}  // namespace
}  // namespace multipanda::restarted_laws_test
