#include "models/arm_source.hpp"

#include "models/to_urdf.hpp"

namespace multipanda {

ArmModelSource arm_model_source(const RobotDescription& robot, const Pose& X_WB, bool hand) {
  ArmModelSource source;
  source.name = robot.name;
  source.urdf = to_urdf(robot, {.hand = hand, .geometry = false});
  source.flange = "flange";
  source.X_WB = X_WB;
  source.limits.q_min = robot.limits.q_min;
  source.limits.q_max = robot.limits.q_max;
  source.limits.dq_max = robot.limits.dq_max;
  source.limits.ddq_max = robot.limits.ddq_max;
  source.limits.tau_max = robot.limits.tau_max;
  source.limits.tau_rate_max = robot.limits.tau_rate_max;
  source.q_home = robot.q_home;
  return source;
}

}  // namespace multipanda
