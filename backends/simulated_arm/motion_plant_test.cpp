// Desired motion on the simulated arm in MuJoCo, through its interface alone, as a program would see it.
#include <functional>

#include <gtest/gtest.h>

#include "backends/mujoco/plant.hpp"
#include "backends/mujoco/testing/test_scenes.hpp"

namespace multipanda::motion_plant_test {
namespace {

constexpr double dt = 0.001;

struct World {
  explicit World(const char* robot, bool realistic)
      : plant([&] {
          SceneArm placed = test::arm_named("arm", test::pose(0.3, -0.2, 0.4, 0.3, -0.2, 0.5));
          placed.model = robot;
          return test::scene_of({placed}, realistic ? PlantFidelity::realistic() : PlantFidelity::ideal());
        }()),
        arm(plant.arm(0)) {
    for (int k = 0; k < 50; ++k) plant.advance();
  }
  // command(t, state at the start); errors of tracking from what is published.
  void run(ArmController controller, MotionGenerator generator, double duration,
           const std::function<void(double, const InterfaceState&, InterfaceCommand&)>& fill) {
    ASSERT_EQ(arm.start_motion({.controller = controller, .generator = generator}), MotionStart::started);
    plant.advance();
    const InterfaceState start = arm.interface();
    const std::uint64_t ended = arm.motions_ended();
    for (int k = 0; arm.motions_ended() == ended; ++k) {
      InterfaceCommand command;
      fill(k * dt, start, command);
      command.motion_finished = k * dt >= duration;
      arm.take_command(command);
      plant.advance();
      ASSERT_EQ(arm.errors(), 0u) << k << ": " << describe(arm.reflex_detail());
      const InterfaceState& i = arm.interface();
      const Vector6 e = pose_error(i.X_BE_d, i.X_BE);
      joint = std::max(joint, (i.q_d - arm.state().q).lpNorm<Eigen::Infinity>());
      position = std::max(position, e.head<3>().norm());
      rotation = std::max(rotation, e.tail<3>().norm());
    }
    EXPECT_EQ(arm.motion_end(), MotionEnd::finished);
    for (int k = 0; k < 300; ++k) plant.advance();
    EXPECT_EQ(arm.mode(), ArmMode::idle);
    EXPECT_LT(arm.state().dq.lpNorm<Eigen::Infinity>(), 0.01);
  }
  MujocoPlant plant;
  SimulatedArm& arm;
  double joint = 0, position = 0, rotation = 0;
};

struct Setup {
  const char* robot;
  bool realistic;
};
class MotionInMujoco : public testing::TestWithParam<Setup> {};

TEST_P(MotionInMujoco, OrdinaryMotionsAreFollowed) {
  for (const ArmController controller :
       {ArmController::joint_impedance, ArmController::cartesian_impedance}) {
    World world(GetParam().robot, GetParam().realistic);
    world.run(controller, MotionGenerator::joint_position, 2.5,
              [](double t, const InterfaceState& start, InterfaceCommand& c) {
                c.q_c = start.q_d;
                for (const Eigen::Index i : {3, 4, 6})
                  c.q_c[i] += M_PI / 16 * (1 - std::cos(2 * M_PI / 2.5 * t));
              });
    world.run(controller, MotionGenerator::cartesian_pose, 4,
              [](double t, const InterfaceState& start, InterfaceCommand& c) {
                const double angle = M_PI / 8 * (1 - std::cos(M_PI / 2 * t));
                Eigen::Map<Eigen::Matrix4d> T(c.O_T_EE_c.data());
                T.setIdentity();
                T.topLeftCorner<3, 3>() = start.X_BE_c.rotation;
                T.topRightCorner<3, 1>() =
                    start.X_BE_c.position + Vector3(0.3 * std::sin(angle), 0, 0.3 * (std::cos(angle) - 1));
              });
    world.run(controller, MotionGenerator::cartesian_velocity, 2,
              [](double t, const InterfaceState& start, InterfaceCommand& c) {
                c.O_dP_EE_c << 0, 0.05 * std::sin(M_PI * t) * (1 - std::cos(M_PI * t)), 0, 0, 0, 0;
                c.has_elbow = true;
                c.elbow_c = {start.elbow_c[0] + 0.1 * (1 - std::cos(M_PI * t)), start.elbow_c[1]};
              });
    // In the null space the Cartesian controller pulls more softly.
    EXPECT_LT(world.joint, controller == ArmController::joint_impedance ? 1.2e-3 : 5e-3);
    EXPECT_LT(world.position, 8e-4);
    EXPECT_LT(world.rotation, 2e-3);
  }
}

INSTANTIATE_TEST_SUITE_P(Arms, MotionInMujoco,
                         testing::Values(Setup{"fr3", false}, Setup{"fr3", true}, Setup{"fer", false},
                                         Setup{"fer", true}),
                         [](const auto& p) {
                           return std::string(p.param.robot) + (p.param.realistic ? "_realistic" : "_ideal");
                         });

}  // namespace
}  // namespace multipanda::motion_plant_test
