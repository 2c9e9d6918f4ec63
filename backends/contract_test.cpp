// One contract for every backend (core/cycle/backend.hpp): a loop that respects it cannot distinguish MuJoCo,
// Pinocchio and a replayed log.
#include <filesystem>
#include <functional>
#include <memory>
#include <random>

#include <gtest/gtest.h>

#include "backends/mujoco/mujoco_backend.hpp"
#include "backends/pinocchio/pinocchio_backend.hpp"
#include "backends/replay/replay_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "logs/recorder.hpp"
#include "scene/build.hpp"

namespace multipanda::contract_test {
namespace {

// Two different arms, bases off the origin and rotated, too far apart to touch.
Scene two_arms() {
  Scene scene;
  scene.name = "contract";
  scene.seed = 7;
  for (int i = 0; i < 2; ++i) {
    SceneArm arm;
    arm.name = i == 0 ? "left" : "right";
    arm.model = i == 0 ? "fer" : "fr3";
    arm.hand = i == 0;
    arm.X_WB = {rotation_from_rpy({0.1, -0.2, 0.7 * i}), Vector3(0.3, 1.0 - 2.0 * i, 0.4)};
    const auto model = build_arm_model(arm);
    arm.q_start = model->q_home();
    arm.safety = SafetyLimits::of(*model);
    scene.arms.push_back(arm);
  }
  return scene;
}

constexpr int kCycles = 300;

// The commands of one cycle: smooth torques that accelerate each joint alone by about 3 rad/s^2, whatever its
// inertia (joint 7 of an FR3 without a hand has 6e-5 kg m^2). They grow from zero within the arm's torque
// rate and are the same for every backend.
std::vector<ArmCommand> commands_at(const Scene& scene, int cycle) {
  static const std::vector<JointVector> amplitude = [&] {
    std::vector<JointVector> all;
    for (const auto& arm : scene.arms) {
      ModelTerms terms(build_arm_model(arm));
      all.push_back(3.0 * terms.M().diagonal());
    }
    return all;
  }();
  std::vector<ArmCommand> commands(scene.arms.size());
  for (std::size_t i = 0; i < commands.size(); ++i) {
    commands[i].tau_cmd = amplitude[i];
    for (Eigen::Index j = 0; j < amplitude[i].size(); ++j) {
      commands[i].tau_cmd[j] *= std::min(0.02 * cycle, 1.0) * std::sin(0.02 * cycle + static_cast<double>(j) +
                                                                       2.0 * static_cast<double>(i));
    }
  }
  return commands;
}

// The log of a run in which both arms are held.
std::filesystem::path recorded_run(const Scene& scene) {
  const auto log = std::filesystem::temp_directory_path() /
                   ("multipanda_contract_" + std::to_string(::getpid()) + ".mcap");
  const Registry registry = Registry::with_builtins();
  MujocoBackend backend(scene, {.pace = Pace::unpaced});
  ControlCycle cycle(build_cycle_config(scene, kCycles + 10), registry, backend);
  std::vector<RecordedArm> arms;
  for (const auto& arm : scene.arms) {
    const ArmConfig config = arm_config(arm);
    arms.push_back({build_arm_model(arm), config.frames, config.tool, config.load});
  }
  Recorder recorder(log, cycle.layout(), *cycle.record(), arms, {});
  backend.start();
  int n = 0;
  cycle.run([&] { return n++ < kCycles; });
  backend.finish();
  recorder.stop();
  return log;
}

struct Factory {
  const char* name;
  bool replay;
  std::unique_ptr<Backend> (*make)(const Scene&);
};

std::unique_ptr<Backend> make_replay(const Scene& scene) {
  static const std::filesystem::path log = recorded_run(two_arms());
  std::vector<ReplayBackend::Arm> arms;
  for (const auto& arm : scene.arms) {
    const ArmConfig config = arm_config(arm);
    arms.push_back({arm.name, config.frames, config.tool, config.load});
  }
  return std::make_unique<ReplayBackend>(log, arms);
}

const Factory kFactories[] = {
    {"mujoco", false,
     [](const Scene& s) -> std::unique_ptr<Backend> {
       return std::make_unique<MujocoBackend>(s, MujocoOptions{.pace = Pace::unpaced});
     }},
    {"pinocchio", false,
     [](const Scene& s) -> std::unique_ptr<Backend> { return std::make_unique<PinocchioBackend>(s); }},
    {"replay", true, make_replay}};

class Contract : public testing::TestWithParam<Factory> {
 protected:
  Scene scene_ = two_arms();
  std::unique_ptr<Backend> backend_ = GetParam().make(scene_);
  std::vector<ArmState> states_ = std::vector<ArmState>(2);

  bool next() {
    const ArmSet due = backend_->wait();
    if (due.empty()) return false;
    backend_->read(due, states_);
    return true;
  }
  void write(int cycle) { backend_->write(ArmSet::all(2), commands_at(scene_, cycle)); }
};

TEST_P(Contract, StatesAreCompleteAndTimeAdvancesByTheArmsPeriod) {
  ASSERT_EQ(backend_->arm_count(), 2u);
  backend_->start();
  std::uint64_t sequence[2] = {};
  LoopTime before{};
  for (int k = 0; k < 50; ++k) {
    ASSERT_TRUE(next());
    for (ArmIndex i = 0; i < 2; ++i) {
      const ArmState& s = states_[i];
      ASSERT_EQ(s.q.size(), 7);
      ASSERT_EQ(s.dq.size(), 7);
      ASSERT_EQ(s.tau_J.size(), 7);
      ASSERT_EQ(s.tau_J_d.size(), 7);
      EXPECT_TRUE(s.q.allFinite() && s.dq.allFinite() && s.tau_J.allFinite());
      EXPECT_TRUE(s.mode == ArmMode::idle || s.mode == ArmMode::move);
      EXPECT_GT(s.sequence, 0u);
      if (k > 0) {
        EXPECT_EQ(s.sequence, sequence[i] + 1);
      }
      sequence[i] = s.sequence;
    }
    if (k > 0) {
      EXPECT_EQ((backend_->now() - before).count(), 1'000'000);
    }
    before = backend_->now();
    write(k);
  }
  backend_->finish();
}

TEST_P(Contract, ReadTouchesOnlyTheArmsDue) {
  backend_->start();
  ASSERT_TRUE(next());
  states_[0].sequence = states_[1].sequence = 12345;
  backend_->read(ArmSet::of(1), states_);
  EXPECT_EQ(states_[0].sequence, 12345u);
  EXPECT_NE(states_[1].sequence, 12345u);
  backend_->finish();
}

TEST_P(Contract, AnArmReportsItsCommandedTorqueAndCompensatesGravity) {
  if (GetParam().replay) GTEST_SKIP() << "a recording does not react";
  backend_->start();
  JointVector q_0[2];
  for (int k = 0; k < 200; ++k) {
    ASSERT_TRUE(next());
    for (ArmIndex i = 0; i < 2; ++i) {
      if (k == 0) q_0[i] = states_[i].q;
      EXPECT_LT((states_[i].q - q_0[i]).norm(), 1e-6) << "zero torque: gravity is the arm's own business";
    }
    backend_->write(ArmSet::all(2), std::vector<ArmCommand>{{joint_constant(7, 0)}, {joint_constant(7, 0)}});
  }
  ASSERT_TRUE(next());
  write(3);
  ASSERT_TRUE(next());
  for (ArmIndex i = 0; i < 2; ++i) EXPECT_EQ(states_[i].tau_J_d, commands_at(scene_, 3)[i].tau_cmd);
  backend_->finish();
}

TEST_P(Contract, TheSameCommandsGiveTheSameStates) {
  const auto other = GetParam().make(scene_);
  std::vector<ArmState> others(2);
  backend_->start();
  other->start();
  for (int k = 0; k < 200; ++k) {
    ASSERT_TRUE(next());
    other->read(other->wait(), others);
    for (ArmIndex i = 0; i < 2; ++i) {
      ASSERT_EQ(states_[i].q, others[i].q);
      ASSERT_EQ(states_[i].dq, others[i].dq);
      ASSERT_EQ(states_[i].tau_J, others[i].tau_J);
    }
    write(k);
    other->write(ArmSet::all(2), commands_at(scene_, k));
  }
  backend_->finish();
  other->finish();
}

TEST_P(Contract, AnInvalidCommandNeverReachesTheMotors) {
  if (GetParam().replay) GTEST_SKIP() << "a recording does not react";
  backend_->start();
  for (int k = 0; k < 100; ++k) {
    ASSERT_TRUE(next());
    ASSERT_TRUE(states_[0].q.allFinite() && states_[1].q.allFinite());
    auto commands = commands_at(scene_, k);
    if (k == 20) commands[0].tau_cmd[3] = std::nan("");
    backend_->write(ArmSet::all(2), commands);
  }
  EXPECT_NE(states_[0].mode, ArmMode::move);
  EXPECT_NE(states_[0].errors, 0u);
  EXPECT_EQ(states_[1].errors, 0u);
  EXPECT_EQ(states_[1].mode, ArmMode::move) << "the other arm goes on";
  EXPECT_LT(states_[0].dq.norm(), 0.05) << "the arm brakes by itself";
  backend_->finish();
}

TEST_P(Contract, RequestsAreAnsweredWithReasons) {
  backend_->start();
  auto unknown_arm = backend_->request(7, RecoverFromError{});
  auto nonsense = backend_->request(0, SetLoad{{.mass = -1}});
  auto heavy = backend_->request(0, SetLoad{{.mass = 50}});  // above the rated payload
  auto load = backend_->request(0, SetLoad{{.mass = 0.5, .p_FC = {0, 0, 0.1}}});
  auto never_taken = backend_->request(1, RecoverFromError{});
  for (int k = 0; k < 3; ++k) {
    ASSERT_TRUE(next());
    write(k);
  }
  backend_->finish();
  for (auto* answer : {&unknown_arm, &nonsense, &heavy, &never_taken}) {
    const RequestAnswer a = answer->get();
    EXPECT_FALSE(a.success);
    EXPECT_GT(a.reason.size(), 10u);
  }
  const RequestAnswer a = load.get();
  EXPECT_EQ(a.success, !GetParam().replay) << a.reason;
  if (!GetParam().replay) {
    EXPECT_EQ(states_[0].load.mass, 0.5);
  }
}

INSTANTIATE_TEST_SUITE_P(Backends, Contract, testing::ValuesIn(kFactories),
                         [](const auto& backend) { return std::string(backend.param.name); });

TEST(Replay, EndsWithTheRecordingAndGivesBackItsCommands) {
  Scene scene = two_arms();
  const auto backend = make_replay(scene);
  auto& replay = dynamic_cast<ReplayBackend&>(*backend);
  EXPECT_EQ(replay.cycle_count(), static_cast<std::size_t>(kCycles));
  const Registry registry = Registry::with_builtins();
  ControlCycle cycle(build_cycle_config(scene), registry, replay);
  replay.start();
  cycle.run([] { return true; });
  EXPECT_EQ(replay.compared(), 2u * kCycles);
  EXPECT_EQ(replay.largest_difference(), 0.0) << "the same controllers, the same states: the same bits";
  EXPECT_TRUE(replay.wait().empty());
}

// Two different integrators (semi-implicit Euler, Runge-Kutta) on two engines: their difference is the
// integration error, which halves with the step. So the equations are the same.
TEST(CrossCheck, MujocoApproachesPinocchioAtFirstOrder) {
  const auto final_state = [](auto&& backend, const Scene& scene) {
    std::vector<ArmState> states(2);
    backend.start();
    for (int k = 0; k <= kCycles; ++k) {
      backend.read(backend.wait(), states);
      backend.write(ArmSet::all(2), commands_at(scene, k));
    }
    backend.finish();
    Eigen::VectorXd x(28);
    x << states[0].q, states[0].dq, states[1].q, states[1].dq;
    return x;
  };
  Scene scene = two_arms();
  const Eigen::VectorXd start = (Eigen::VectorXd(28) << scene.arms[0].q_start, Eigen::VectorXd::Zero(7),
                                 scene.arms[1].q_start, Eigen::VectorXd::Zero(7))
                                    .finished();
  double error[2];
  for (int i = 0; i < 2; ++i) {
    scene.substeps = i == 0 ? 4 : 16;
    // The motors' torque is constant over a physics step, so both take the same steps.
    const Eigen::VectorXd reference = final_state(PinocchioBackend(scene), scene);
    ASSERT_GT((reference - start).norm(), 0.1) << "the arms must move for this to mean anything";
    error[i] = (final_state(MujocoBackend(scene, {.pace = Pace::unpaced}), scene) - reference).norm();
  }
  EXPECT_LT(error[0], 1e-2);  // of 28 positions and velocities together, after 0.3 s
  EXPECT_NEAR(error[0] / error[1], 4.0, 0.6) << error[0] << " " << error[1];
}

}  // namespace
}  // namespace multipanda::contract_test
