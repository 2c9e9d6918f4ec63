#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <fmt/format.h>

#include "common/text.hpp"
#include "sysid/excitation/excitation.hpp"

namespace multipanda {
namespace {

std::string list(const double* values, Eigen::Index n) { return list_text({values, values + n}); }

// By joint, from the base; joints after the seventh have the last value. Joints 1 and 3 turn about nearly the
// same axis when joint 2 is near zero; moved against each other they carry little more than the link between
// them, so they are softer.
constexpr std::array<double, 7> kStiffness{100, 200, 100, 200, 40, 30, 10};  // [N m/rad]

}  // namespace

std::string excitation_gains(std::size_t joints) {
  std::vector<double> stiffness;
  for (std::size_t i = 0; i < joints; ++i) stiffness.push_back(kStiffness[std::min<std::size_t>(i, 6)]);
  return fmt::format("{{stiffness_nm_per_rad: {}, damping_ratio: 0.6}}", list_text(stiffness));
}

std::string reference_event(double at_s, const std::string& controllet, const JointVector& q) {
  return fmt::format(
      "  - {{at_s: {}, reference: {{controllet: {}, input: joints, q_rad: {}, duration_s: {}}}}}\n",
      number_text(at_s), controllet, list(q.data(), q.size()), number_text(kExcitationApproach));
}

std::string motion_event(double at_s, const std::string& controllet, const ExcitationMotion& motion) {
  const Harmonic& series = motion.series;
  const auto n = motion.q_start.size();
  std::string text = fmt::format(
      "  - at_s: {}\n"
      "    motion:\n"
      "      controllet: {}\n"
      "      input: joints\n"
      "      period_s: {}\n"
      "      cycles: {}\n"
      "      ramp_s: {}\n"
      "      sine: {}\n"
      "      rise: {}\n",
      number_text(at_s), controllet, number_text(series.period_s), number_text(series.cycles),
      number_text(series.ramp_s), list(series.sine.data(), n), list(series.rise.data(), n));
  if (series.harmonic_count > 0) text += "      overtones:\n";
  for (std::size_t k = 0; k < series.harmonic_count; ++k) {
    const HarmonicPart& part = series.harmonics[k];
    text += fmt::format("        - sine: {}\n          rise: {}\n", list(part.sine.data(), n),
                        list(part.rise.data(), n));
  }
  return text;
}

std::string excitation_scene(const Excitation& excitation, const RobotDescription& robot,
                             const std::string& model, bool hand, const std::string& note) {
  const bool rotors = acting_motor_inertia(robot, 0).size() > 0;
  const ExcitationMotion& motion = excitation.motion;
  const auto n = motion.q_start.size();
  double fastest = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    fastest = std::max(fastest, motion.series.top_speed(static_cast<std::size_t>(i), 1));
  }
  return fmt::format(
      "# Excitation of {}, made by `multipanda excite`. Condition number of the base regressor: {:.2f}\n"
      "# ({} parameters; best of the random motions {:.1f}). {}\n"
      "# The swept space must be free.\n"
      "name: excitation\n"
      "description: Exciting motion for identification, within every limit of the arm\n"
      "duration_s: {}\n\n"
      "plant: {{fidelity: realistic{}}}\n\n"
      "arms:\n"
      "  - name: arm\n"
      "    model: {}\n"
      "    hand: {}\n"
      "    start_rad: {}\n{}\n"
      "contact_bounds: {{hand_speed_m_per_s: 3, spring_force_n: 1000, spring_moment_nm: 300}}  # no person "
      "in reach\n\n"
      "controllets:\n"
      "  - name: joints\n"
      "    type: joint_impedance\n"
      "    arms: arm\n"
      "    parameters: {}\n"
      "    inputs:\n"
      "      joints: {{max_speed_rad_per_s: {}}}\n\n"
      "active: joints\n\n"
      "timeline:\n"
      "  # To the start from any configuration; a real arm moves slowly.\n{}{}",
      model, excitation.condition, excitation.parameters, excitation.random_best, note,
      number_text(kExcitationBegins + motion.duration() + 1), rotors ? ", rotor_inertia_hidden: 0" : "",
      model, hand ? "true" : "false", list(motion.q_start.data(), n),
      rotors ? "    known_rotor_inertia: model\n" : "", excitation_gains(static_cast<std::size_t>(n)),
      number_text(std::ceil(10 * fastest) / 10), reference_event(0.1, "joints", motion.q_start),
      motion_event(kExcitationBegins, "joints", motion));
}

}  // namespace multipanda
