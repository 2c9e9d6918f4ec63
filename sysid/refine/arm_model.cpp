#include <algorithm>
#include <limits>

#include <fmt/format.h>

#include "models/write_robot.hpp"
#include "sysid/identification/actuation.hpp"
#include "sysid/identification/identify.hpp"
#include "sysid/refine/refine.hpp"

namespace multipanda {
namespace {

using Json = nlohmann::ordered_json;

Json list(const Eigen::VectorXd& values) {
  Json json = Json::array();
  for (const double value : values) json.push_back(value);
  return json;
}

// A gain this small from further coefficients may be noise. In the next simulation it would reappear as
// offsets that the masses compensate. Candidates are ordered, simplest first.
constexpr double kAsGood = 1.15;     // times the best RMSE in cross-validation; or
constexpr double kNoiseShare = 0.1;  // plus this fraction of the torque sensor's noise

std::string simplest_as_good(const Identification& found, double noise) {
  double best = std::numeric_limits<double>::infinity();
  for (const auto& score : found.scores) best = score.eligible ? std::min(best, score.mean) : best;
  for (const auto& score : found.scores) {
    if (score.eligible && score.mean <= std::max(kAsGood * best, best + kNoiseShare * noise))
      return score.name;
  }
  return found.family;
}

}  // namespace

RefinedArm identify_arm(const SceneArm& arm, const RobotDescription& prior, std::span<const MeasuredLog> logs,
                        const ArmModelOptions& options) {
  IdentifyOptions identify_options{.hand = arm.hand && prior.hand.has_value()};
  if (arm.tool.mass > 0) {
    identify_options.tool = RigidBody{arm.tool.mass, arm.tool.p_FC, arm.tool.inertia_C};
  }
  identify_options.gravity_B = arm.X_WB.rotation.transpose() * Vector3(0, 0, -9.81);
  if (!options.family.empty()) {
    identify_options.families = {options.family};
    identify_options.choose = false;
  }
  // Without sensor gains: they are hard to separate from masses, and a wrong gain appears fully in the
  // control error.
  for (const auto& name : family_names()) {
    const bool needs_table = name.starts_with("table") && !prior.friction;
    if (options.family.empty() && !needs_table && name.find("gains") == std::string::npos) {
      identify_options.families.push_back(name);
    }
  }
  identify_options.threads = static_cast<unsigned>(options.threads);
  const ActuationFit actuation = fit_actuation(logs, prior);
  Identification found = identify(logs, prior, identify_options);
  if (const std::string simpler = simplest_as_good(found, actuation.noise);
      options.family.empty() && simpler != found.family) {
    identify_options.families = {simpler};
    identify_options.choose = false;
    found = identify(logs, prior, identify_options);
  }
  RobotDescription robot = found.robot;
  apply(actuation, robot);
  // The excitation shows every motor that acts; without a word, the prior's rotors would act in simulations.
  if (robot.motor_inertia.size() == 0) robot.motor_inertia = joint_constant(robot.joint_count(), 0);
  write_robot(robot, prior, options.file);

  RefinedArm result{.arm = arm.name, .model = options.file, .found = {}, .warnings = found.warnings};
  result.warnings.insert(result.warnings.end(), actuation.warnings.begin(), actuation.warnings.end());
  result.found = {{"family", found.family},
                  {"seconds_used", found.seconds_used},
                  {"rmse_train", list(found.rmse_train)},
                  {"rmse_heldout", list(found.rmse_heldout)},
                  {"rmse_all", list(found.rmse_all)},
                  {"rmse_mean", found.rmse_all.size() > 0 ? found.rmse_all.mean() : 0},
                  {"consistent", found.consistent},
                  {"dissipative", found.dissipative},
                  {"delay_s", actuation.actuation.command_delay},
                  {"delay_half95_s", actuation.delay_half95},
                  {"bandwidth_hz", actuation.actuation.torque_bandwidth_hz},
                  {"bandwidth_half95_hz", actuation.bandwidth_half95},
                  {"friction_scale", list(actuation.friction_scale)},
                  {"motor_inertia_kg_m2", list(actuation.motor_inertia)},
                  {"torque_noise_nm", actuation.noise}};
  return result;
}

std::string in_words(const RefinedArm& arm) {
  const Json& found = arm.found;
  std::string text = fmt::format(
      "fits its torque with an RMSE of {:.3f} N m ({}), delay {:.2f} ms, torque bandwidth {:.1f} Hz, noise "
      "{:.3f} N m",
      found["rmse_mean"].get<double>(), found["family"].get<std::string>(),
      1e3 * found["delay_s"].get<double>(), found["bandwidth_hz"].get<double>(),
      found["torque_noise_nm"].get<double>());
  const Json& scales = found["friction_scale"];
  if (!scales.empty()) {
    double mean = 0;
    for (const auto& scale : scales) mean += scale.get<double>() / static_cast<double>(scales.size());
    text += fmt::format(", friction {:.2f} of the table", mean);
  }
  return text;
}

}  // namespace multipanda
