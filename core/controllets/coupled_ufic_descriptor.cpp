#include "core/controllets/coupled_ufic_descriptor.hpp"

#include "core/controllets/cooperative_frame.hpp"
#include "core/controllets/felt_wrench.hpp"

namespace multipanda::coupled_ufic {

ControlletDescriptor descriptor() {
  // The same as for one hand, with another initial value.
  auto of_force = [group = force_parameters()](ForceParameter which, double initial) mutable {
    group[which].initial = {initial};
    return group[which];
  };
  return {
      .type = "coupled_ufic",
      .doc =
          "Coupled UFIC: two hands squeeze an object with a force and move it as an impedance; two energy "
          "tanks keep it passive.",
      .arms = 2,
      .inputs = spec_table<kInputCount>(
          input_at<kPose>(shared_frame_input()),
          input_at<kSqueeze>({.name = "squeeze",
                              .quantity = Quantity::scalar,
                              .doc = "Force of each hand on the object [N]. Above 1, the hands close, then "
                                     "squeeze; at 0, they release.",
                              .max_speed = 50})),
      .parameters = spec_table<kParameterCount>(
          cartesian_parameters(),
          parameter_at<kRelativeTranslational>(relative_translational_stiffness_parameter()),
          parameter_at<kRelativeRotational>(relative_rotational_stiffness_parameter()),
          parameter_at<kProportional>(of_force(kForceProportional, 0.2)),
          parameter_at<kDerivative>(of_force(kForceDerivative, 0)),
          parameter_at<kIntegral>(of_force(kForceIntegral, 3)),
          parameter_at<kSqueezeCutoff>(of_force(kErrorCutoff, 10)),
          parameter_at<kSqueezeLimit>(of_force(kIntegralLimit, 20)),
          parameter_at<kSqueezeDamping>({.name = "squeeze_damping_n_s_per_m",
                                         .unit = "N s/m",
                                         .initial = {30},
                                         .max = 300,
                                         .doc = "D_z on the rate of the hands' distance, in addition to the "
                                                "damping of the impedance."}),
          parameter_at<kSqueezeThreshold>(of_force(kContactThreshold, 6)),
          parameter_at<kSqueezeDirection>({.name = "squeeze_direction",
                                           .size = 3,
                                           .initial = {0, 0, 0},
                                           .min = -1,
                                           .max = 1,
                                           .doc = "n from the first hand to the second, axes of A, read at "
                                                  "the start; 0 0 0 selects the line "
                                                  "between the hands."}),
          parameter_at<kApproachSpeed>({.name = "approach_speed_m_per_s",
                                        .unit = "m/s",
                                        .initial = {0.01},
                                        .min = 0.001,
                                        .max = 0.1,
                                        .doc = "Speed of each hand until both touch."}),
          parameter_at<kRamp>({.name = "force_ramp_s",
                               .unit = "s",
                               .initial = {1},
                               .min = 0.2,
                               .max = 10,
                               .doc = "Time from the touch to the full squeeze."}),
          parameter_at<kReleaseDistance>({.name = "release_distance_m",
                                          .unit = "m",
                                          .initial = {0.02},
                                          .max = 0.2,
                                          .doc = "Distance by which the hands open after a grasp."}),
          parameter_at<kObjectMass>(
              {.name = "object_mass_kg",
               .unit = "kg",
               .initial = {0},
               .max = 20,
               .doc = "Declared mass of the object; fed forward with g and A_d during a grasp."}),
          parameter_at<kVerticalIntegral>(
              {.name = "vertical_integral_n_per_m_s",
               .unit = "N/(m s)",
               .initial = {0},
               .max = 20000,
               .doc = "Integral gain on the vertical error of the object during a grasp."}),
          parameter_at<kVerticalIntegralLimit>({.name = "vertical_integral_limit_n",
                                                .unit = "N",
                                                .initial = {20},
                                                .max = 100,
                                                .doc = "Limit of the force of that integral."}),
          group_at<kTanks>(tank_parameters()), parameter_at<kFeedforward>(force_feedforward_parameter()),
          parameter_at<kMayPull>(force_may_pull_parameter()),
          parameter_at<kSqueezeMotionShare>(motion_share_parameter()),
          parameter_at<kRelativeTranslationalDamping>(relative_translational_damping_parameter()),
          parameter_at<kRelativeRotationalDamping>(relative_rotational_damping_parameter())),
      .outputs = spec_table<kOutputCount>(
          output_at<kDesired>("force_desired_n", "F_d: desired squeeze of each hand."),
          output_at<kEstimated>("force_estimated_n", "Mean estimated squeeze."),
          output_at<kFirstEstimated>("first_force_estimated_n",
                                     "Estimated force of the first hand, inwards."),
          output_at<kSecondEstimated>("second_force_estimated_n", "The same for the second hand."),
          output_at<kCommand>("force_command_n", "F_f'."),
          output_at<kInContact>("in_contact", "1 while both hands touch, otherwise 0."),
          output_at<kPhase>("phase", "0 rest, 1 approach, 2 grasp, 3 lost."),
          group_at<kTankOutputs>(tank_outputs()), output_at<kDistance>("hand_distance_m", "n^T (p_2 - p_1)."),
          output_at<kDistanceSet>("hand_distance_set_m",
                                  "Set-point of that distance; its spring is off during a grasp."),
          output_at<kVerticalForce>("vertical_force_n", "Force of weight and integral, fed forward."),
          output_at<kAbsoluteError, 3>("absolute_position_error_m", "p_a,d - p_a, world axes."),
          output_at<kAbsoluteError + 3, 3>("absolute_orientation_error_rad", "log(R_d R_a^T), world axes."),
          output_at<kRelativeError, 3>("relative_position_error_m",
                                       "p_r,d - p_r, world axes; only across n during a grasp."),
          output_at<kRelativeError + 3, 3>("relative_orientation_error_rad", "-phi, world axes."),
          output_at<kStiffnessShare>("stiffness_share", kStiffnessShareDoc),
          output_at<kTare, 2>("tare", FeltWrench::kTareDoc)),
      .presets = {coupled_paper_preset({{"force_proportional", {1}},
                                        {"force_derivative_s", {0.05}},
                                        {"force_integral_per_s", {0.25}},
                                        {"force_feedforward", {0}},
                                        {"force_may_pull", {1}},
                                        {"valve_law", {1}},
                                        {"d_max_m", {0.05}},
                                        {"squeeze_damping_n_s_per_m", {0}},
                                        {"object_mass_kg", {0}},
                                        {"vertical_integral_n_per_m_s", {0}}})}};
}

Settings::Settings(const ParameterSet& p, const ContactBounds& contact)
    : absolute(impedance_gains(p)),
      relative(absolute),
      null_space(null_space_gains(p, contact)),
      force{p.number(kProportional), p.number(kDerivative), p.number(kIntegral), p.number(kSqueezeCutoff),
            p.number(kSqueezeLimit), p.flag(kFeedforward),  p.flag(kMayPull)},
      grasp{.contact_threshold_n = p.number(kSqueezeThreshold),
            .closing_speed = 2 * p.number(kApproachSpeed),
            .ramp_s = p.number(kRamp),
            .release_distance_m = p.number(kReleaseDistance)},
      tanks(tank_settings(p, kTanks)),
      squeeze_damping(p.number(kSqueezeDamping)),
      object_mass(p.number(kObjectMass)),
      vertical_integral(p.number(kVerticalIntegral)),
      vertical_integral_limit(p.number(kVerticalIntegralLimit)),
      motion_share(p.number(kSqueezeMotionShare)) {
  relative.translational_stiffness = p.vector3(kRelativeTranslational);
  relative.rotational_stiffness = p.vector3(kRelativeRotational);
  relative.translational_damping = p.vector3(kRelativeTranslationalDamping);
  relative.rotational_damping = p.vector3(kRelativeRotationalDamping);
}

}  // namespace multipanda::coupled_ufic
