#include "fci/client/from_scene.hpp"

#include "arm_interface/arm_settings.hpp"
#include "arm_interface/declared_hand.hpp"
#include "fci/client/end_effector.hpp"
#include "scene/build.hpp"

namespace multipanda::fci {

FciArmConfig fci_arm_config(const SceneArm& arm, const std::string& address) {
  FciArmConfig config;
  config.name = arm.name;
  config.address = address;
  config.model = build_arm_model(arm);
  const RobotDescription robot = robot_of(arm);
  if (arm.hand && robot.hand) {
    const RigidBody hand = moved(rigid_hand(*robot.hand), robot.hand->mount.pose());
    config.hand = {hand.mass, hand.com, hand.inertia};
    config.hand_declared = declared_hand(config.hand);
  }
  const ArmConfig requested = arm_config(arm);
  config.frames = requested.frames;
  config.tool = requested.tool;
  config.load = requested.load;
  config.joint_stiffness = arm.joint_stiffness;
  config.cartesian_stiffness = arm.cartesian_stiffness;
  config.thresholds = arm.collision;
  if (!config.thresholds && !(arm.fci && arm.fci->keep_collision_thresholds)) {
    config.thresholds = careful_thresholds(*config.model);
  }
  if (arm.vacuum || (arm.fci && arm.fci->vacuum)) {
    config.end_effector = [name = arm.name, address] { return vacuum_link(name, address); };
  } else if (arm.hand && (!arm.fci || arm.fci->gripper)) {
    config.end_effector = [name = arm.name, address] { return gripper_link(name, address); };
  }
  if (arm.fci) {
    config.version = arm.fci->version;
    config.low_pass_hz = arm.fci->low_pass_hz;
    config.recover_at_start = arm.fci->recover_at_start;
    if (!arm.fci->check_model) config.model_check = ModelCheck::off;
  }
  return config;
}

}  // namespace multipanda::fci
