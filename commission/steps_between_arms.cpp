#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>

#include <fmt/format.h>

#include "commission/limits.hpp"
#include "commission/rigid_fit.hpp"
#include "commission/scene_base.hpp"
#include "commission/tour.hpp"
#include "scene/load.hpp"

// Where the bases stand to each other: laws that couple arms squeeze by millimeters between them.
namespace multipanda::commission {
namespace {

Vector3 tip_of(ModelTerms& terms, const JointVector& q) {
  terms.update(q, JointVector::Zero(q.size()));
  return terms.X_WE().position;
}

// Waits until the arm, led by hand, rests at a place that `fits` (tip in the world).
bool wait_for_rest(Context& context, ArmIndex arm, const std::function<bool(const Vector3&)>& fits = {}) {
  ArmsRun& run = *context.run;
  const std::size_t n = run.joint_count(arm);
  ModelTerms terms = run.terms(arm);
  int still = 0;
  constexpr int kStill = 30;  // samples of 10 cycles
  (void)run.watch(kGuideWait_s, 10, [&](const Track& track) {
    const ArmSample& now = track.arms[arm].back();
    double fastest = 0;
    for (std::size_t j = 0; j < n; ++j) fastest = std::max(fastest, std::abs(now.dq[j]));
    const Eigen::Map<const Eigen::VectorXd> q(now.q.data(), static_cast<Eigen::Index>(n));
    still = fastest < kStillSpeed && (!fits || fits(tip_of(terms, q))) ? still + 1 : 0;
    return still >= kStill;
  });
  return still >= kStill;
}

// A joint may turn by so much while a point is read, 0.2 s [rad].
constexpr double kCreep_rad = 0.002;

// The end effector's origin in the arm's base, at rest; the arm is led by hand meanwhile.
Vector3 tip_in_base(Context& context, ArmIndex arm) {
  ArmsRun& run = *context.run;
  if (!wait_for_rest(context, arm))
    throw ArmLeft(
        fmt::format("arm '{}' did not rest on the point within {:g} s", context.arm(arm).name, kGuideWait_s));
  ModelTerms terms = run.terms(arm);
  const std::size_t n = run.joint_count(arm);
  const Track track = run.watch(0.2);
  const auto q_at = [&](const ArmSample& sample) {
    return JointVector(Eigen::Map<const Eigen::VectorXd>(sample.q.data(), static_cast<Eigen::Index>(n)));
  };
  const double crept = (q_at(track.arms[arm].back()) - q_at(track.arms[arm].front())).cwiseAbs().maxCoeff();
  if (crept > kCreep_rad)
    throw ArmLeft(
        fmt::format("arm '{}' was not still on the point: a joint turned by {:.4f} rad within 0.2 s",
                    context.arm(arm).name, crept));
  const JointVector q = track.mean(arm, &ArmSample::q, n);
  return context.arm(arm).X_WB.inverse() * tip_of(terms, q);
}

std::vector<Vector3> led_points(Context& context, ArmIndex arm, int count) {
  const std::string& name = context.arm(arm).name;
  std::vector<Vector3> points;
  context.person.ready(
      fmt::format("bases.{}", name),
      fmt::format("Take the hand of arm '{}'. After this key it can be led; the other arms stay in hold.",
                  name));
  context.run->lead(arm, Law::guide);
  for (int k = 1; k <= count; ++k) {
    context.person.ready(
        fmt::format("bases.{}.{}", name, k),
        fmt::format("Put the tip of arm '{}' on point {} of {}, hold it still; then this key.", name, k,
                    count));
    points.push_back(tip_in_base(context, arm));
    context.say(fmt::format("  point {}: [{:.4f}, {:.4f}, {:.4f}] m in its base", k, points.back().x(),
                            points.back().y(), points.back().z()));
  }
  context.person.ready(
      fmt::format("bases.{}.away", name),
      fmt::format("After this key, lead arm '{}' {:.0f} cm or more away from the points and keep "
                  "it still; then it is held there.",
                  name, 100 * kAway_m));
  const auto is_away = [&](const Vector3& tip) {
    const Vector3 tip_B = context.arm(arm).X_WB.inverse() * tip;
    return std::all_of(points.begin(), points.end(),
                       [&](const Vector3& point) { return (tip_B - point).norm() > kAway_m; });
  };
  if (!wait_for_rest(context, arm, is_away)) {
    throw ArmLeft(
        fmt::format("arm '{}' is in the way of the next arm: it was not led {:.0f} cm away from the points "
                    "within {:g} s",
                    name, 100 * kAway_m, kGuideWait_s));
  }
  context.run->lead(arm, Law::hold);
  context.say(fmt::format("  arm '{}' is held", name));
  return points;
}

Json row(const Vector3& v) { return {v.x(), v.y(), v.z()}; }

StepResult run_bases(Context& context) {
  StepResult result;
  const auto count = static_cast<int>(
      context.person.number("bases.points",
                            fmt::format("Mark points that all arms reach (dimples in a plate, not in a line, "
                                        "{:.0f} cm or more apart). How many? {} to {}",
                                        300 * kBaseWidth_m, kFewestPoints, kMostPoints),
                            kFewestPoints, kMostPoints));
  const auto first = led_points(context, 0, count);
  std::string text = context.setup.scene.text;
  for (ArmIndex i = 1; i < context.arm_count(); ++i) {
    const std::string& name = context.arm(i).name;
    const auto points = led_points(context, i, count);
    const RigidFit fit = fit_rigid(first, points);
    const Pose X_WB = context.arm(0).X_WB * fit.X_AB;
    const Vector6 moved = pose_error(X_WB, context.arm(i).X_WB);
    std::string each;
    for (const double residual : fit.residual_m)
      each += fmt::format("{}{:.1f}", each.empty() ? "" : ", ", 1e3 * residual);
    result.add({.arm = name,
                .quantity = "width of the points beside their line",
                .value = 1e3 * fit.width_m,
                .unit = "mm",
                .limit = 1e3 * kBaseWidth_m,
                .at_least = true,
                .found = "they lie nearly on a line: the rotation about it is unknown",
                .remedy = "choose points that span a triangle or a square"});
    result.add({.arm = name,
                .quantity = "residual of the points, rms",
                .value = 1e3 * fit.rms_m,
                .unit = "mm",
                .limit = 1e3 * kBaseResidual_m,
                .found = "of the points: " + each + " mm",
                .remedy = "repeat the worst point; check 'end_effector' of both arms: the tip must be the "
                          "point that touches"});
    result.readings.push_back({.arm = name,
                               .quantity = "uncertain rotation about the line of the points",
                               .value = 1e3 * fit.angle_rad,
                               .unit = "mrad",
                               .limit = kShown});
    result.add({.arm = name,
                .quantity = "base away from the scene's",
                .value = 1e3 * moved.head<3>().norm(),
                .unit = "mm",
                .limit = 1e3 * kBaseMoved_m,
                .found = "another scene, or points of different order",
                .remedy = "measure the bases with a tape and correct the scene, then repeat"});
    result.add(
        {.arm = name,
         .quantity = "base turned from the scene's",
         .value = 180 / M_PI * moved.tail<3>().norm(),
         .unit = "degrees",
         .limit = 180 / M_PI * kBaseTurned_rad,
         .found = "another scene, or points of different order",
         .remedy = "lead both arms to the points in the same order, or correct the scene, then repeat"});
    result.measured[name] = {{"residual_m", fit.residual_m},
                             {"position_m", row(X_WB.position)},
                             {"rpy_rad", row(rpy_of(X_WB.rotation))},
                             {"scene_position_m", row(context.arm(i).X_WB.position)},
                             {"scene_rpy_rad", row(rpy_of(context.arm(i).X_WB.rotation))}};
    if (result.verdict == Verdict::no_go) return result;
    text = with_base(
        text, name, X_WB,
        fmt::format("base of '{}' from {} common points, residual {:.2f} mm", name, count, 1e3 * fit.rms_m));
  }
  const auto file = context.setup.folder / "scene.yaml";
  std::ofstream(file) << text;
  try {
    (void)open_scene(file.string());
    result.notes.push_back("the measured bases are in " + file.string());
  } catch (const std::exception& error) {
    result.notes.push_back("the measured bases are in " + file.string() +
                           ", which can be used beside the files that it names: " + error.what());
  }
  return result;
}

}  // namespace

void add_steps_between_arms(std::vector<Step>& steps, const TourSetup& setup) {
  steps.push_back(
      {"bases", "Where the bases stand to each other",
       fmt::format("You lead the tip of each of the {} arms to the same points. Nothing moves by itself. "
                   "No-go: a residual above {:g} mm (rms), points within {:.0f} mm "
                   "of a line, or a base more than {:.0f} mm or {:.0f} degrees from the scene's.",
                   setup.scene.arms.size(), 1e3 * kBaseResidual_m, 1e3 * kBaseWidth_m, 1e3 * kBaseMoved_m,
                   180 / M_PI * kBaseTurned_rad),
       true, false, run_bases});
}

}  // namespace multipanda::commission
