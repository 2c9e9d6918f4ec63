#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <fmt/format.h>

#include "config_file/text.hpp"
#include "sysid/excitation/excitation.hpp"

namespace multipanda {
namespace {

template <typename Values>
std::string list(const Values& values, Eigen::Index n) {
  std::string text;
  for (Eigen::Index i = 0; i < n; ++i) {
    text += (text.empty() ? "[" : ", ") + number_text(values[static_cast<std::size_t>(i)]);
  }
  return text + "]";
}

// From the base on; joints after the seventh have the last value. Joints 1 and 3 turn about nearly the same
// axis where joint 2 is near zero. Against each other they move little more than the link between them, so
// they are softer.
constexpr std::array<double, 7> kStiffness{100, 200, 100, 200, 40, 30, 10};  // [N m/rad]

}  // namespace

std::string excitation_gains(std::size_t joints) {
  std::vector<double> stiffness;
  for (std::size_t i = 0; i < joints; ++i) stiffness.push_back(kStiffness[std::min<std::size_t>(i, 6)]);
  return fmt::format("{{stiffness_nm_per_rad: {}, damping_ratio: 0.6}}",
                     list(stiffness, static_cast<Eigen::Index>(joints)));
}

std::string excitation_scene(const Excitation& excitation, const std::string& model, bool hand,
                             const std::string& note) {
  const ExcitationMotion& motion = excitation.motion;
  const auto n = motion.q_start.size();
  double fastest = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    fastest = std::max(fastest, motion.series.top_speed(static_cast<std::size_t>(i), 1));
  }
  std::string text = fmt::format(
      "# Excitation of {}, made by `multipanda excite`. Condition number of the base regressor: {:.2f}\n"
      "# ({} parameters; best of the random motions {:.1f}). {}\n"
      "# The space that it sweeps must be free.\n"
      "name: excitation\n"
      "description: Exciting motion for identification, within every limit of the arm\n"
      "duration_s: {}\n\n"
      "plant: {{fidelity: realistic}}\n\n"
      "arms:\n"
      "  - name: arm\n"
      "    model: {}\n"
      "    hand: {}\n"
      "    start_rad: {}\n\n"
      "contact_bounds: {{hand_speed_m_per_s: 3, spring_force_n: 1000, spring_moment_nm: 300}}  # nobody is "
      "near\n\n"
      "controllets:\n"
      "  - name: joints\n"
      "    type: joint_impedance\n"
      "    arms: arm\n"
      "    parameters: {}\n"
      "    inputs:\n"
      "      joints: {{max_speed_rad_per_s: {}}}\n\n"
      "active: joints\n\n"
      "timeline:\n"
      "  # To the start from any configuration; a real arm moves slowly.\n"
      "  - {{at_s: 0.1, reference: {{controllet: joints, input: joints, q_rad: {}, duration_s: 4}}}}\n"
      "  - at_s: {}\n"
      "    motion:\n"
      "      controllet: joints\n"
      "      input: joints\n"
      "      period_s: {}\n"
      "      cycles: {}\n"
      "      ramp_s: {}\n",
      model, excitation.condition, excitation.parameters, excitation.random_best, note,
      number_text(kExcitationBegins + motion.duration() + 1), model, hand ? "true" : "false",
      list(motion.q_start, n), excitation_gains(static_cast<std::size_t>(n)),
      number_text(std::ceil(10 * fastest) / 10), list(motion.q_start, n), number_text(kExcitationBegins),
      number_text(motion.series.period_s), number_text(motion.series.cycles),
      number_text(motion.series.ramp_s));
  text +=
      "      sine: " + list(motion.series.sine, n) + "\n      rise: " + list(motion.series.rise, n) + "\n";
  if (motion.series.harmonic_count > 0) text += "      overtones:\n";
  for (std::size_t k = 0; k < motion.series.harmonic_count; ++k) {
    text += "        - sine: " + list(motion.series.harmonics[k].sine, n) +
            "\n          rise: " + list(motion.series.harmonics[k].rise, n) + "\n";
  }
  return text;
}

}  // namespace multipanda
