#include "core/controllets/teleoperation_descriptor.hpp"

#include "core/controllets/teleoperation_channel.hpp"

namespace multipanda::teleoperation {

ControlletDescriptor descriptor() {
  CartesianParameters cartesian = cartesian_parameters();
  // The spring between both hands is stiff enough to follow within 2 mm.
  cartesian[kTranslationalStiffness].initial = {1500, 1500, 1500};
  cartesian[kRotationalStiffness].initial = {40, 40, 40};
  return {
      .type = "teleoperation",
      .doc =
          "A person guides the first arm, the second follows, and its contact forces are reflected; energy "
          "tanks keep it passive for any delay and packet loss.",
      .arms = 2,
      .parameters = spec_table<kParameterCount>(
          cartesian,
          parameter_at<kArchitecture>(choice_parameter(
              "architecture", {"position_position", "position_force"},
              "What the leader feels: a spring to the follower's hand, or the follower's estimated force.")),
          parameter_at<kClutch>(clutch_parameter()), parameter_at<kAxes>(leading_axes_parameter()),
          parameter_at<kScale>(leading_scale_parameter()),
          parameter_at<kForceScale>(
              {.name = "force_scale",
               .initial = {1},
               .max = 3,
               .doc = "Force on the leader's hand per force on the follower's. Below `scale`, the follower "
                      "needs more energy than the leader supplies."}),
          parameter_at<kCutoff>({.name = "force_cutoff_hz",
                                 .unit = "Hz",
                                 .initial = {3},
                                 .min = 0.5,
                                 .max = 10,
                                 .doc = "position_force: up to here the leader feels the estimated force, "
                                        "above it the spring."}),
          parameter_at<kLeaderDamping>({.name = "leader_damping_n_s_per_m",
                                        .unit = "N s/m",
                                        .initial = {5},
                                        .max = 60,
                                        .doc = "Damping of the leader's hand."}),
          parameter_at<kLeaderJointDamping>(
              {.name = "leader_joint_damping_nms_per_rad",
               .unit = "N m s/rad",
               .initial = {0.1},
               .max = 0.25,
               .doc = "Damping of the leader's joints, as in gravity_compensation."}),
          parameter_at<kTankStart>({.name = "tank_start_j",
                                    .unit = "J",
                                    .initial = {5},
                                    .max = 50,
                                    .doc = "Initial energy of each tank."}),
          parameter_at<kTankMax>(
              {.name = "tank_max_j",
               .unit = "J",
               .initial = {10},
               .min = 0.5,
               .max = 50,
               .doc = "Largest energy of a tank, from the next start on; what is returned above it "
                      "is lost."}),
          parameter_at<kTankClosing>({.name = "tank_closing_j",
                                      .unit = "J",
                                      .initial = {0.1},
                                      .min = 0.01,
                                      .max = 5,
                                      .doc = "Range above zero over which the valve of a tank closes."}),
          parameter_at<kRefillBelow>(
              {.name = "refill_below_j",
               .unit = "J",
               .initial = {1},
               .max = 10,
               .doc = "Below this energy of its tank, the leader's motion is damped more, which fills it."}),
          parameter_at<kRefillDamping>({.name = "refill_damping_n_s_per_m",
                                        .unit = "N s/m",
                                        .initial = {30},
                                        .max = 60,
                                        .doc = "Additional damping with an empty tank."}),
          parameter_at<kDelay>({.name = "channel_delay_s",
                                .unit = "s",
                                .initial = {0},
                                .max = TeleoperationChannel::kLongestDelay,
                                .doc = "Simulated delay in each direction."}),
          parameter_at<kLoss>({.name = "channel_loss",
                               .initial = {0},
                               .max = 0.95,
                               .doc = "Simulated probability that a packet never arrives."})),
      .outputs = spec_table<kOutputCount>(
          output_at<kEngaged>("engaged", "Share of the coupling that acts: 1 while the clutch is closed."),
          output_at<kLeaderTank>("leader_tank_j", "Energy of the leader's tank."),
          output_at<kFollowerTank>("follower_tank_j", "Energy of the follower's tank."),
          output_at<kUnderWay>("channel_energy_j", "Energy in transit in the channel."),
          output_at<kStored>("stored_energy_j", "Kinetic energy of both arms, tanks and channel."),
          output_at<kLost>("channel_lost_j", "Energy lost with packets so far."),
          output_at<kLeaderValve>("leader_valve", "Valve of the leader's tank, 0 to 1."),
          output_at<kFollowerValve>("follower_valve", "Valve of the follower's tank, 0 to 1."),
          output_at<kAge>("packet_age_s", "Age of the newest packet of the leader at the follower."),
          output_at<kLeaderForce, 3>("leader_force_n", "Force of the law on the leader's hand, world axes."),
          output_at<kLeaderForce + 3, 3>("leader_moment_nm", "Its moment."),
          output_at<kFollowerForce, 3>("follower_force_n",
                                       "Force of the law on the follower's hand, world axes."),
          output_at<kFollowerForce + 3, 3>("follower_moment_nm", "Its moment."),
          output_at<kError, 3>("position_error_m", "From the follower's hand to the leader's present goal."),
          output_at<kError + 3, 3>("orientation_error_rad", "The same, log(R_d R^T)."),
          output_at<kSlipped>("slipped",
                              "1: the follower was left behind, or nobody held the leader, so the "
                              "clutch opened; set `clutch` to false and to true again."),
          output_at<kStiffnessShare>("stiffness_share", kStiffnessShareDoc))};
}

}  // namespace multipanda::teleoperation
