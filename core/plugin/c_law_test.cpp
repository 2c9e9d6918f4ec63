#include "core/plugin/c_law.h"

#include <functional>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/plugin/law_trial.hpp"
#include "core/plugin/load_plugin.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// Laws behind the C interface: what they get, what happens when they fail, which ones are refused.
namespace multipanda::c_law_test {
namespace {

using namespace test;
using testing::HasSubstr;

std::string library(const std::string& name) { return std::string(C_LAWS_FOLDER "/") + name + ".so"; }

Registry with_c_laws(Registry registry = {}) {
  load_plugin(registry, library("c_laws"));
  return registry;
}

// Every member, in random states: the torque is what the law's formula says, written with Eigen.
TEST(CLaw, GetsTheStateTheModelAndTheSetPoints) {
  const Registry registry = with_c_laws();
  Draw draw(3);
  for (const std::size_t n : {3u, 6u, 7u, 9u}) {
    ControlletRig rig(*registry.controllet("c_mirror"), {TestArm::make(n).model(draw.pose(0.5))});
    const auto place = [&] {
      rig.state(0).tau_J = draw.joints(n, 10);
      rig.state(0).tau_ext_hat = draw.joints(n, 10);
      rig.state(0).has_wrench_estimate = true;
      rig.state(0).F_K_W_est.vector << draw.vector3(20), draw.vector3(5);
      const JointVector dq = draw.joints(n, 1);
      rig.place(0, draw.joints(n, 1), dq);
    };
    place();
    const double q_start = rig.state(0).q[0];
    rig.bound({.spring_force = 30});
    ASSERT_EQ(rig.start(), LawResult::ok);
    rig.set("stiffness_n_per_m", {420});
    JointVector d = draw.joints(n, 1).cwiseAbs();
    rig.set("damping_nms_per_rad", std::vector<double>(d.begin(), d.end()));
    rig.input("pose").set(pose_target(draw.pose(0.5)));
    for (int tick = 1; tick <= 20; ++tick) {
      place();
      Target height{.id = static_cast<std::uint64_t>(tick), .size = 1};
      height.values[0] = draw.uniform(-1, 1);
      rig.input("height").set(height);
      Target wrench{.id = static_cast<std::uint64_t>(tick), .size = 6};
      for (std::size_t k = 0; k < 6; ++k) wrench.values[k] = draw.uniform(-5, 5);
      rig.input("wrench").set(wrench);
      ASSERT_EQ(rig.tick(0.002), LawResult::ok);

      ModelTerms& terms = rig.terms(0);
      const Reference& pose = rig.input("pose");
      Vector6 force = rig.input("wrench").vector() + rig.state(0).F_K_W_est.vector;
      force.head<3>() += 420 * (pose.pose().position - terms.X_WE().position);
      const JointVector expected = terms.J_V_WE().transpose() * force + terms.M() * terms.dq() + terms.c() +
                                   2 * terms.g() + 3 * rig.state(0).tau_J + 5 * rig.state(0).tau_ext_hat +
                                   d.cwiseProduct(terms.dq());
      EXPECT_LT((rig.tau(0) - expected).norm(), 1e-9 * (1 + expected.norm())) << n;
      EXPECT_EQ(rig.output("ticks")[0], tick);
      EXPECT_EQ(rig.output("q_start_rad")[0], q_start);
      const Matrix3 R = terms.X_WE().rotation - 2 * pose.pose().rotation;
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j)
          EXPECT_NEAR(rig.output("R")[static_cast<std::size_t>(3 * i + j)], R(i, j), 1e-12);
      }
      const Vector6 V = terms.V_WE().vector - 2 * pose.twist().vector;
      EXPECT_GT(pose.twist().vector.norm(), 0);
      for (int k = 0; k < 6; ++k) EXPECT_NEAR(rig.output("V")[static_cast<std::size_t>(k)], V[k], 1e-12);
      const Reference& height_d = rig.input("height");
      EXPECT_NEAR(rig.output("rest")[0], height_d.scalar() + 2 * height_d.scalar_rate(), 1e-12);
      EXPECT_NEAR(rig.output("rest")[1], 0.002 + 30, 1e-12);
    }
    ASSERT_EQ(rig.start(), LawResult::ok);  // memory is zero again
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    EXPECT_EQ(rig.output("ticks")[0], 1);
  }
}

TEST(CLaw, DoesNotStartWithoutTheEstimatesThatItUses) {
  const Registry registry = with_c_laws();
  ControlletRig rig(*registry.controllet("c_mirror"), {TestArm::make().model()});
  EXPECT_EQ(rig.start(), LawResult::fault);
  rig.state(0).tau_J = rig.state(0).tau_ext_hat = joint_constant(7, 0);
  EXPECT_EQ(rig.start(), LawResult::fault);
  rig.state(0).has_wrench_estimate = true;
  EXPECT_EQ(rig.start(), LawResult::ok);
  EXPECT_EQ(rig.update(), LawResult::ok);
  rig.state(0).has_wrench_estimate = false;  // lost meanwhile
  EXPECT_EQ(rig.update(), LawResult::fault);
  rig.state(0).has_wrench_estimate = true;
  rig.place(0, joint_constant(7, 2.1), joint_constant(7, 0));  // its own refusal
  EXPECT_EQ(rig.start(), LawResult::fault);
}

TEST(CLaw, NeitherAllocatesNorLocks) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  const Registry registry = with_c_laws();
  ControlletRig rig(*registry.controllet("c_mirror"), {TestArm::make().model()});
  rig.state(0).tau_J = rig.state(0).tau_ext_hat = joint_constant(7, 0);
  rig.state(0).has_wrench_estimate = true;
  LoopGuard::arm();
  const LawResult started = rig.start(), ticked = rig.tick(0.001);
  const LoopGuardCounts counts = LoopGuard::disarm();
  EXPECT_EQ(started, LawResult::ok);
  EXPECT_EQ(ticked, LawResult::ok);
  EXPECT_EQ(counts.heap_calls, 0u);
  EXPECT_EQ(counts.lock_calls, 0u);
}

// In the cycle of its fault the arm is held, and the other arm's torques are those of a run without it.
TEST(CLaw, AFaultTakesTheArmInTheSameCycleAndLeavesTheOther) {
  for (const double fault : {1.0, 2.0, 3.0}) {
    const std::vector<InstanceConfig> laws = {{.name = "s0", .type = "spring", .arms = {0}},
                                              {.name = "bad", .type = "c_faulty", .arms = {1}}};
    TestLoop loop(2, laws, with_c_laws(test_registry())), quiet(2, laws, with_c_laws(test_registry()));
    for (TestLoop* l : {&loop, &quiet}) {
      l->modes().activate_at_start(l->set({"s0", "bad"}));
      l->world.set_velocity(1, joint_constant(7, 0.1));
      l->steps(50);
      ASSERT_EQ(l->modes().owner(1), l->find("bad"));
    }
    // A parameter approaches its value within 0.2 s; the fault acts when it is there.
    Request request{.kind = Request::Kind::set_parameter, .instance = loop.find("bad"), .size = 1};
    request.values[0] = fault;
    ASSERT_TRUE(loop.ask(request).accepted());
    quiet.step();
    for (int k = 0; k < 300; ++k) {
      const bool owned = loop.modes().owner(1) == loop.find("bad");
      loop.step();
      quiet.step();
      ASSERT_EQ(loop.world.torque(0), quiet.world.torque(0)) << k;
      ASSERT_TRUE(loop.world.torque(1).allFinite());
      if (owned && loop.modes().owner(1) != loop.find("bad")) {
        EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold"));
        EXPECT_EQ(loop.cycle.safety().counted(1, Intervention::controllet_fault), 1u);
      }
    }
    EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold")) << fault;
    EXPECT_EQ(loop.cycle.safety().counted(1, Intervention::controllet_fault), 1u);
    EXPECT_EQ(loop.modes().owner(0), loop.find("s0"));
  }
}

TEST(CLaw, ATrialFindsFaultsAndRepeats) {
  const Registry registry = with_c_laws();
  const std::vector<std::shared_ptr<const ArmModel>> models{TestArm::make().model()};
  LawTrialOptions options{.states = 300, .seed = 5, .most_us = 1e9};
  const LawTrial fine = try_law(*registry.controllet("c_faulty"), models, options);
  EXPECT_EQ(fine.states, 300u);
  EXPECT_EQ(fine.faults, 0u);  // between the values of its parameter that are faults
  EXPECT_GT(fine.median_us, 0);
  EXPECT_GE(fine.p999_us, fine.median_us);

  ControlletType bad = *registry.controllet("c_faulty");
  bad.descriptor.parameters[0].min = 3;
  bad.descriptor.parameters[0].initial = {3};
  std::size_t seen = 0;
  const LawTrial found = try_law(bad, models, options, [&](const LawTrialState& state) {
    seen += state.result == LawResult::fault ? 1 : 0;
    EXPECT_TRUE((state.context.arms[0].q().array() >= models[0]->limits().q_min.array()).all());
    EXPECT_TRUE((state.context.arms[0].q().array() <= models[0]->limits().q_max.array()).all());
  });
  EXPECT_EQ(found.faults, 300u);
  EXPECT_EQ(found.first_fault, 0u);
  EXPECT_EQ(seen, 300u);

  std::vector<double> first, again;
  for (auto* values : {&first, &again}) {
    try_law(*registry.controllet("c_faulty"), models, options,
            [&](const LawTrialState& state) { values->push_back(state.context.arms[0].tau->sum()); });
  }
  EXPECT_EQ(first, again);
}

// --- Refusals ---

int32_t nothing(const multipanda_c_tick* /*tick*/) { return 0; }

struct Given {
  std::vector<double> initial = {1};
  multipanda_c_parameter parameter{"k", "N/m", "K.", 1, 1, nullptr, 0, 2};
  multipanda_c_input input{"pose", "P.", MULTIPANDA_POSE, 0};
  multipanda_c_output output{"e_m", "E.", 1};
  multipanda_c_law law{"mine", "Mine.", 1, 0, 1, 1, 1, 0, nullptr, nullptr, nullptr, nullptr, nothing};
  multipanda_c_laws laws{MULTIPANDA_C_LAW_VERSION,
                         sizeof(multipanda_c_law),
                         sizeof(multipanda_c_parameter),
                         sizeof(multipanda_c_input),
                         sizeof(multipanda_c_output),
                         sizeof(multipanda_c_arm),
                         sizeof(multipanda_c_set_point),
                         sizeof(multipanda_c_tick),
                         1,
                         0,
                         nullptr};
};

std::string refusal(const std::function<void(Given&)>& change) {
  Given given;
  given.parameter.initial = given.initial.data();
  given.law.inputs = &given.input;
  given.law.parameters = &given.parameter;
  given.law.outputs = &given.output;
  given.laws.laws = &given.law;
  change(given);
  try {
    c_law_controllets(given.laws);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "accepted";
}

TEST(CLaw, WhatDoesNotFitIsRefusedWithTheReason) {
  const double kInfinity = std::numeric_limits<double>::infinity();
  EXPECT_EQ(refusal([](Given&) {}), "accepted");
  const std::vector<std::pair<std::function<void(Given&)>, std::string>> cases = {
      {[](Given& g) { g.laws.version = 2; }, "version 2 of the C interface, this program has version 1"},
      {[](Given& g) { g.laws.size_of_tick -= 8; }, "multipanda_c_tick has"},
      {[](Given& g) { g.laws.size_of_arm += 8; }, "multipanda_c_arm has"},
      {[](Given& g) { g.laws.law_count = 0; }, "it has 0 laws"},
      {[](Given& g) { g.laws.laws = nullptr; }, "expected 1 to"},
      {[](Given& g) { g.law.type = "my law"; }, "called 'my law'"},
      {[](Given& g) { g.law.type = nullptr; }, "the name of it is missing"},
      {[](Given& g) { g.law.doc = nullptr; }, "its doc is missing"},
      {[](Given& g) { g.law.arms = 17; }, "it owns 17 arms"},
      {[](Given& g) { g.law.arms = 0; }, "it owns 0 arms"},
      {[](Given& g) { g.law.update = nullptr; }, "'update' is missing"},
      {[](Given& g) { g.law.uses = 4096; }, "does not have"},
      {[](Given& g) { g.law.memory_size = 1u << 30u; }, "at most 65536"},
      {[](Given& g) { g.law.parameter_count = 1000; }, "1000 parameters"},
      {[](Given& g) { g.law.inputs = nullptr; }, "list of its inputs is missing"},
      {[](Given& g) { g.input.quantity = 5; }, "unknown quantity 5"},
      {[](Given& g) { g.input.arm = 1; }, "arm number 1 of 1"},
      {[](Given& g) { g.input.name = "a.b"; }, "called 'a.b'"},
      {[](Given& g) { g.parameter.name = ""; }, "called ''"},
      {[](Given& g) { g.parameter.size = 17; }, "17 numbers"},
      {[](Given& g) { g.parameter.initial_count = 2; }, "2 initial values; expected 1 or 1"},
      {[](Given& g) { g.parameter.size = MULTIPANDA_PER_JOINT, g.parameter.initial_count = 7; },
       "expected 1 or 16"},
      {[](Given& g) { g.parameter.initial = nullptr; }, "initial values"},
      {[](Given& g) { g.initial[0] = 3; }, "out of its bounds"},
      {[](Given& g) { g.initial[0] = std::numeric_limits<double>::quiet_NaN(); }, "out of its bounds"},
      {[&](Given& g) { g.parameter.max = kInfinity; }, "finite bounds"},
      {[](Given& g) { g.parameter.min = 3; }, "finite bounds"},
      {[](Given& g) { g.output.size = 0; }, "its outputs need"},
      {[](Given& g) { g.output.size = 257; }, "its outputs need"},
      {[](Given& g) { g.output.doc = nullptr; }, "doc of output 'e_m'"},
  };
  for (const auto& [change, reason] : cases) EXPECT_THAT(refusal(change), HasSubstr(reason));
}

TEST(CLaw, LibrariesAreLoadedWholeOrNotAtAll) {
  Registry registry = with_c_laws(Registry::with_builtins());
  ASSERT_NE(registry.controllet("c_mirror"), nullptr);
  ASSERT_NE(registry.controllet("c_faulty"), nullptr);
  EXPECT_THROW(load_plugin(registry, library("c_laws")), std::invalid_argument);  // the names are taken

  Registry other = Registry::with_builtins();
  const std::size_t before = other.controllets().size();
  try {
    load_plugin(other, library("c_laws_of_other_version"));
    ADD_FAILURE() << "accepted";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("c_laws_of_other_version.so: its laws have version 99"));
  }
  EXPECT_EQ(other.controllets().size(), before);
}

}  // namespace
}  // namespace multipanda::c_law_test
