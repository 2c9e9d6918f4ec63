#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>

#include <fmt/format.h>

#include "commission/fits.hpp"
#include "commission/limits.hpp"
#include "commission/tour.hpp"
#include "scene/load.hpp"
#include "scene/rewrite.hpp"

// Relative poses of the bases: errors of millimeters become forces between coupled arms.
namespace multipanda::commission {
namespace {

Vector3 tip_of(ModelTerms& terms, const JointVector& q) {
  terms.update(q, JointVector::Zero(q.size()));
  return terms.X_WE().position;
}

// Waits until the guided arm rests at a place that `fits` (tip in the world).
bool wait_for_rest(Context& context, ArmIndex arm, const std::function<bool(const Vector3&)>& fits = {}) {
  ArmsRun& run = *context.run;
  ModelTerms terms = run.terms(arm);
  int still = 0;
  constexpr int kStill = 30;  // samples of 10 cycles
  (void)run.watch(kGuideWait_s, 10, [&](const Track& track) {
    const ArmSample& now = track.arms[arm].back();
    const bool rests = run.fastest_joint(arm, now) < kStillSpeed;
    still = rests && (!fits || fits(tip_of(terms, run.q(arm, now)))) ? still + 1 : 0;
    return still >= kStill;
  });
  return still >= kStill;
}

// Largest motion of a joint while a point is read, 0.2 s [rad].
constexpr double kCreep_rad = 0.002;

// The end effector's origin in the arm's base, at rest; the arm is guided by hand.
Vector3 tip_in_base(Context& context, ArmIndex arm) {
  ArmsRun& run = *context.run;
  if (!wait_for_rest(context, arm))
    throw ArmLeft(
        fmt::format("arm '{}' did not rest on the point within {:g} s", context.arm(arm).name, kGuideWait_s));
  ModelTerms terms = run.terms(arm);
  const Track track = run.watch(0.2);
  const auto& [first, last] = std::pair(track.arms[arm].front(), track.arms[arm].back());
  const double crept = (run.q(arm, last) - run.q(arm, first)).cwiseAbs().maxCoeff();
  if (crept > kCreep_rad)
    throw ArmLeft(
        fmt::format("arm '{}' was not still on the point: a joint turned by {:.4f} rad within 0.2 s",
                    context.arm(arm).name, crept));
  const JointVector q = track.mean(arm, &ArmSample::q, run.joint_count(arm));
  return context.arm(arm).X_WB.inverse() * tip_of(terms, q);
}

std::vector<Vector3> led_points(Context& context, ArmIndex arm, int count) {
  const std::string& name = context.arm(arm).name;
  std::vector<Vector3> points;
  context.person.ready(
      fmt::format("bases.{}", name),
      fmt::format("Take the hand of arm '{}'. After this key you can guide it; the other arms stay in hold.",
                  name));
  context.run->lead(arm, Law::guide);
  for (int k = 1; k <= count; ++k) {
    context.person.ready(
        fmt::format("bases.{}.{}", name, k),
        fmt::format("Put the tip of arm '{}' on point {} of {}, hold it still; then press the key.", name, k,
                    count));
    points.push_back(tip_in_base(context, arm));
    context.say(fmt::format("  point {}: [{:.4f}, {:.4f}, {:.4f}] m in its base", k, points.back().x(),
                            points.back().y(), points.back().z()));
  }
  context.person.ready(fmt::format("bases.{}.away", name),
                       fmt::format("After this key, guide arm '{}' at least {:.0f} cm away from the points "
                                   "and keep it still; it is then held there.",
                                   name, 100 * kAway_m));
  const auto is_away = [&](const Vector3& tip) {
    const Vector3 tip_B = context.arm(arm).X_WB.inverse() * tip;
    return std::all_of(points.begin(), points.end(),
                       [&](const Vector3& point) { return (tip_B - point).norm() > kAway_m; });
  };
  if (!wait_for_rest(context, arm, is_away)) {
    throw ArmLeft(
        fmt::format("arm '{}' is in the way of the next arm: it was not guided {:.0f} cm away from the "
                    "points within {:g} s",
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
    result.at_least(name, "width of the points across their line", 1e3 * fit.width_m, "mm",
                    1e3 * kBaseWidth_m, "choose points that span a triangle or a square",
                    "they lie nearly on a line: the rotation about it is unknown");
    result.at_most(name, "residual of the points, rms", 1e3 * fit.rms_m, "mm", 1e3 * kBaseResidual_m,
                   "repeat the worst point; check 'end_effector' of both arms: it must be the tip that "
                   "touches the point",
                   "of the points: " + each + " mm");
    result.show(name, "uncertain rotation about the line of the points", 1e3 * fit.angle_rad, "mrad");
    result.at_most(name, "distance of the base from the scene's", 1e3 * moved.head<3>().norm(), "mm",
                   1e3 * kBaseMoved_m, "measure the bases with a tape and correct the scene, then repeat",
                   "another scene, or points of different order");
    result.at_most(name, "rotation of the base from the scene's", 180 / M_PI * moved.tail<3>().norm(),
                   "degrees", 180 / M_PI * kBaseTurned_rad,
                   "guide both arms to the points in the same order, or correct the scene, then repeat",
                   "another scene, or points of different order");
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
                           ", which refers to files next to it: " + error.what());
  }
  return result;
}

}  // namespace

void add_steps_between_arms(std::vector<Step>& steps, const TourSetup& setup) {
  steps.push_back(
      {"bases", "Relative poses of the bases",
       fmt::format("You guide the tip of each of the {} arms to the same points. Nothing moves by itself. "
                   "No-go: a residual above {:g} mm (rms), points within {:.0f} mm "
                   "of a line, or a base more than {:.0f} mm or {:.0f} degrees from the scene's.",
                   setup.scene.arms.size(), 1e3 * kBaseResidual_m, 1e3 * kBaseWidth_m, 1e3 * kBaseMoved_m,
                   180 / M_PI * kBaseTurned_rad),
       true, false, run_bases});
}

}  // namespace multipanda::commission
