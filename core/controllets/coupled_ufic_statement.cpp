#include "core/controllets/coupled_ufic_statement.hpp"

namespace multipanda::coupled_ufic {
namespace {

ParameterSpec number(std::string name, std::string unit, double initial, double min, double max,
                     std::string doc) {
  return {std::move(name), std::move(unit), 1, {initial}, min, max, std::move(doc)};
}

std::vector<ParameterSpec> parameters() {
  auto specs = cartesian_parameters();
  const auto add = [&](ParameterSpec spec) { specs.push_back(std::move(spec)); };
  add({"relative_translational_stiffness_n_per_m",
       "N/m",
       3,
       {400, 400, 400},
       0,
       5000,
       "Between the hands, along x, y, z; along the squeeze it only acts without a grasp."});
  add({"relative_rotational_stiffness_nm_per_rad",
       "N m/rad",
       3,
       {20, 20, 20},
       0,
       300,
       "Between the hands, about x, y, z."});
  add(number("force_proportional", "", 0.2, 0, 5, "P, on the error of the mean squeeze."));
  add(number("force_derivative_s", "s", 0, 0, 0.2, "D. With an observer in place of a sensor: 0."));
  add(number("force_integral_per_s", "1/s", 3, 0, 50, "I: takes joint friction and offsets out."));
  add(number("force_error_cutoff_hz", "Hz", 10, 1, 200, "Low-pass of the force error."));
  add(number("force_integral_limit_n", "N", 20, 0, 100, "The integral part stays below."));
  add(number("squeeze_damping_n_s_per_m", "N s/m", 30, 0, 300,
             "D_z on the rate of the hands' distance, on top of the impedance's damping."));
  add(number("contact_threshold_n", "N", 2, 0.5, 20,
             "Estimated push of a hand that counts as contact; lost below half of it."));
  add({"squeeze_direction",
       "",
       3,
       {0, 0, 0},
       -1,
       1,
       "n from the first hand to the second, axes of A, taken at the start; 0 0 0: the line between the "
       "hands."});
  add(number("approach_speed_m_per_s", "m/s", 0.01, 0.001, 0.1, "Of each hand, until both touch."));
  add(number("force_ramp_s", "s", 1, 0.2, 10, "From the touch to the whole squeeze."));
  add(number("release_distance_m", "m", 0.02, 0, 0.2, "That the hands open after a grasp."));
  add(number("object_mass_kg", "kg", 0, 0, 20, "Declared mass: fed forward with g and A_d once grasped."));
  add(number("vertical_integral_n_per_m_s", "N/(m s)", 0, 0, 20000,
             "Integral of the object's vertical error, once grasped."));
  add(number("vertical_integral_limit_n", "N", 20, 0, 100, "Its force stays below."));
  add({"valve_law",
       "",
       1,
       {0},
       0,
       1,
       "How gamma and alpha_f let the squeeze through; 'paper' as printed is not passive.",
       {"passive", "paper"}});
  add(number("d_max_m", "m", 0.02, 0.001, 1,
             "Width of gamma: the squeeze fades with the distance from where both touched last."));
  add(number("tank_start_j", "J", 100, 0, 1000, "Both tanks at the start, cut to their limits."));
  add(number("tank_min_j", "J", 0, 0, 1000, "E_min."));
  add(number("tank_max_j", "J", 100, 0, 1000, "E_max; what comes back above it is lost."));
  add(number("tank_closing_j", "J", 0.1, 0.01, 10, "Valves close over this range above E_min."));
  return specs;
}

std::vector<OutputSpec> outputs() {
  return {{"force_desired_n", 1, "F_d: squeeze of each hand."},
          {"force_estimated_n", 1, "Mean squeeze."},
          {"first_force_estimated_n", 1, "What the first hand presses, inwards."},
          {"second_force_estimated_n", 1, "The same of the second hand."},
          {"force_command_n", 1, "F_f'."},
          {"in_contact", 1, "1 while both hands touch."},
          {"phase", 1, "0 rest, 1 approach, 2 grasp, 3 lost."},
          {"gamma_f", 1, "gamma about the distance at the last contact."},
          {"alpha_f", 1, "Valve of the force tank."},
          {"alpha_i", 1, "Valve of the impedance tank: 0 leaves the springs, -1 takes them away."},
          {"force_tank_j", 1, "Energy of the force tank."},
          {"impedance_tank_j", 1, "Energy of the impedance tank."},
          {"stored_energy_j", 1, "Kinetic energy of both arms + springs + both tanks."},
          {"kinetic_energy_j", 1, "Its part in both arms."},
          {"power_task_spring_w", 1, "Into both arms, over the period just gone."},
          {"power_task_damping_w", 1, "The same, of -D V."},
          {"power_feedforward_w", 1, "The same, of D V_d, Lambda A_d, the weight and the integral."},
          {"power_nullspace_w", 1, "The same, of the null spaces."},
          {"power_coriolis_w", 1, "The same, of C dq."},
          {"power_force_w", 1, "The same, of F_f'."},
          {"power_force_damping_w", 1, "The same, of D_z."},
          {"power_set_point_w", 1, "Into the springs, by set-points, stiffness and valve."},
          {"power_other_w", 1, "Into both arms, by features and limits."},
          {"energy_made_up_j", 1, "Valve law 'paper': what its tanks gave without having it."},
          {"hand_distance_m", 1, "n^T (p_2 - p_1)."},
          {"hand_distance_set_m", 1, "Its set-point, of the spring that a grasp takes away."},
          {"vertical_force_n", 1, "Weight and integral, fed forward."},
          {"absolute_position_error_m", 3, "p_a,d - p_a, world axes."},
          {"absolute_orientation_error_rad", 3, "log(R_d R_a^T), world axes."},
          {"relative_position_error_m", 3, "p_r,d - p_r, world axes; across n only, once grasped."},
          {"relative_orientation_error_rad", 3, "-phi, world axes."}};
}

}  // namespace

Statement statement() {
  return {
      .type = "coupled_ufic",
      .doc =
          "Coupled UFIC: two hands squeeze an object with a force and move it as an impedance, kept "
          "passive by two energy tanks.",
      .arms = 2,
      .inputs = {{.name = "pose",
                  .quantity = Quantity::pose,
                  .arm = 0,
                  .doc = "X_WA set-point of the object's frame A, world; begins midway between the hands "
                         "with the world's axes."},
                 {.name = "squeeze",
                  .quantity = Quantity::scalar,
                  .doc = "Force of each hand on the object [N]. Above 1: the hands close, then squeeze; 0: "
                         "they let go.",
                  .max_speed = 50}},
      .parameters = parameters(),
      .outputs = outputs()};
}

Settings::Settings(const ParameterSet& p)
    : absolute(impedance_gains(p)),
      relative(absolute),
      null_space(null_space_gains(p)),
      force{p.number(kProportional), p.number(kDerivative), p.number(kIntegral), p.number(kErrorCutoff),
            p.number(kIntegralLimit)},
      grasp{.contact_threshold_n = p.number(kContactThreshold),
            .closing_speed = 2 * p.number(kApproachSpeed),
            .ramp_s = p.number(kRamp),
            .release_distance_m = p.number(kReleaseDistance)},
      tanks{p.number(kTankMin), p.number(kTankMax), p.number(kTankClosing)},
      valve_law(static_cast<ValveLaw>(p.choice(kValveLaw))),
      squeeze_damping(p.number(kSqueezeDamping)),
      reach(p.number(kReach)),
      object_mass(p.number(kObjectMass)),
      vertical_integral(p.number(kVerticalIntegral)),
      vertical_integral_limit(p.number(kVerticalIntegralLimit)) {
  relative.translational_stiffness = p.vector3(kRelativeTranslational);
  relative.rotational_stiffness = p.vector3(kRelativeRotational);
}

}  // namespace multipanda::coupled_ufic
