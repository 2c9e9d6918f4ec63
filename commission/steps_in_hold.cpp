#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "arm_interface/arm_error.hpp"
#include "commission/fits.hpp"
#include "commission/limits.hpp"
#include "commission/tour.hpp"

// Torque control begins: hold, hand guiding, payload. The arms yield, and only the person moves them.
namespace multipanda::commission {
namespace {

Vector3 flange_of(ModelTerms& terms, const JointVector& q) {
  terms.update(q, JointVector::Zero(q.size()));
  return terms.X_WF().position;
}

// Both checks at once, so that a drifting arm is detected early.
StepResult run_hold(Context& context) {
  StepResult result;
  constexpr double kWatched_s = 2;
  context.run = std::make_unique<ArmsRun>(commission_scene(context.setup.scene), context.registry,
                                          BackendOptions{.kind = BackendKind::fci}, context.setup.paced,
                                          context.stopped);
  ArmsRun& run = *context.run;
  run.start();
  const Track track = run.watch(kWatched_s, 1, [&](const Track& seen) {
    for (ArmIndex i = 0; i < context.arm_count(); ++i) {
      const JointVector way = run.q(i, seen.arms[i].back()) - run.q(i, seen.arms[i].front());
      if (way.lpNorm<Eigen::Infinity>() > kHoldDrift_rad) return true;
    }
    return false;
  });
  for (ArmIndex i = 0; i < context.arm_count(); ++i) {
    ModelTerms terms = run.terms(i);
    const JointVector q0 = run.q(i, track.arms[i].front());
    const Vector3 p0 = flange_of(terms, q0);
    double away = 0, turned = 0;
    for (std::size_t k = 0; k < track.t.size(); ++k) {
      const JointVector q = run.q(i, track.arms[i][k]);
      turned = std::max(turned, (q - q0).lpNorm<Eigen::Infinity>());
      away = std::max(away, (flange_of(terms, q) - p0).norm());
    }
    const std::string remedy = "end here; the compensated weight is wrong: repeat the step on gravity";
    result.at_most(context.arm(i).name, "flange moved in hold", 1e3 * away, "mm", 1e3 * kHoldDrift_m, remedy);
    result.at_most(context.arm(i).name, "joint moved in hold", turned, "rad", kHoldDrift_rad, remedy);
  }
  return result;
}

// Waits for a mode of the arm; the others must stay in hold. A lasting reflex, or one with an error before
// the mode was reported, counts as `stopped_itself`: the person would press the button in that case.
bool wait_for_mode(Context& context, ArmIndex arm, ArmMode mode, bool is, bool* stopped_itself = nullptr) {
  bool seen = false, erred = false;
  int in_reflex = 0;
  constexpr int kLasts = 50;  // samples of 10 cycles; a button may show as a reflex for a moment
  (void)context.run->watch(kButtonWait_s, 10, [&](const Track& track) {
    const auto now = static_cast<ArmMode>(track.arms[arm].back().mode);
    seen = (now == mode) == is;
    in_reflex = now == ArmMode::reflex ? in_reflex + 1 : 0;
    erred = erred || (now == ArmMode::reflex && track.arms[arm].back().errors != 0);
    return seen || (stopped_itself != nullptr && in_reflex >= kLasts);
  });
  if (stopped_itself == nullptr) return seen;
  *stopped_itself = erred || (!seen && in_reflex >= kLasts);
  return seen && !erred;
}

// Before any motion: the person's user stop must stop the intended arm.
StepResult run_button(Context& context) {
  ArmsRun& run = *context.run;
  return each_arm(context, [&](ArmIndex i, const std::string& name, StepResult& result) {
    context.person.ready(
        "button." + name,
        fmt::format(
            "After this key, press the user stop of arm '{}' within {:g} s. The arm stays where it is.", name,
            kButtonWait_s));
    const ArmSample before = run.newest(i);
    run.excuse(i);
    context.say("  now press the user stop of arm '" + name + "'");
    bool stopped_itself = false;
    if (!wait_for_mode(context, i, ArmMode::user_stopped, true, &stopped_itself)) {
      if (stopped_itself) {
        result.fail(fmt::format("arm '{}' stopped itself: {}", name, error_names(run.newest(i).errors)),
                    "the mode 'user stopped' of this arm, and no error",
                    "see docs/errors.md for the cause; free the arm, then resume the tour");
        return;
      }
      result.fail(
          fmt::format("the user stop of arm '{}' was not detected within {:g} s", name, kButtonWait_s),
          "the mode 'user stopped' of this arm",
          "check that the button belongs to this arm; do not continue without a working user stop");
      return;
    }
    context.say("  detected; now release it");
    if (!wait_for_mode(context, i, ArmMode::user_stopped, false)) {
      result.fail(
          fmt::format("the user stop of arm '{}' was not released within {:g} s", name, kButtonWait_s),
          "the button released", "release it, then resume the tour");
      return;
    }
    const std::string errors = error_names(run.newest(i).errors);
    if (!errors.empty())
      result.notes.push_back(fmt::format("arm '{}' reported with its user stop: {}", name, errors));
    context.person.ready(
        "button." + name + ".recover",
        fmt::format("After this key arm '{}' holds its present position again{}. Stand clear.", name,
                    errors.empty() ? "" : ", and its errors are cleared: " + errors));
    if (const std::string now = error_names(run.newest(i).errors); now != errors) {
      result.fail(fmt::format("arm '{}' stopped itself before the key was pressed: {}", name, now),
                  "only errors that the question named", "free the arm, then resume the tour");
      return;
    }
    const RequestAnswer answer = run.request(i, RecoverFromError{});
    if (!answer.success) {
      result.fail(fmt::format("arm '{}' did not recover: {}", name, answer.reason), "hold again",
                  "remove the cause, then resume the tour");
      return;
    }
    if (!wait_for_mode(context, i, ArmMode::move, true)) {
      result.fail(fmt::format("arm '{}' did not begin to hold within {:g} s", name, kButtonWait_s),
                  "hold again", "remove the cause, then resume the tour");
      return;
    }
    run.excuse({});
    const auto away = [&](const ArmSample& now) {
      return (run.q(i, now) - run.q(i, before)).lpNorm<Eigen::Infinity>();
    };
    // A sinking arm is stopped at once: the no-go below halts it.
    (void)run.watch(1, 1, [&](const Track& track) { return away(track.arms[i].back()) > kHoldDrift_rad; });
    const double moved = away(run.newest(i));
    result.at_most(name, "joint moved by stop and recovery", moved, "rad", kHoldDrift_rad,
                   "repeat the step on gravity: the arm sank or rose");
  });
}

// Waits until a person has guided the flange and it rests again. Returns its displacement [m].
double wait_for_guiding(Context& context, ArmIndex arm, const JointVector& from, double joints_apart) {
  ArmsRun& run = *context.run;
  ModelTerms terms = run.terms(arm);
  const Vector3 p0 = flange_of(terms, from);
  double led = 0;
  int still = 0;
  constexpr int kStill = 50;  // samples of 10 cycles
  (void)run.watch(kGuideWait_s, 10, [&](const Track& track) {
    const ArmSample& now = track.arms[arm].back();
    const JointVector q = run.q(arm, now);
    led = (flange_of(terms, q) - p0).norm();
    const bool there = led > kGuided_m && (q - from).lpNorm<Eigen::Infinity>() > joints_apart;
    still = there && run.fastest_joint(arm, now) < kStillSpeed ? still + 1 : 0;
    return still >= kStill;
  });
  context.check_stopped();
  return still >= kStill ? led : 0;
}

StepResult run_guiding(Context& context) {
  ArmsRun& run = *context.run;
  return each_arm(context, [&](ArmIndex i, const std::string& name, StepResult& result) {
    context.person.ready(
        "guiding." + name,
        fmt::format("Take the hand of arm '{}'. After this key it compensates its weight and you can guide "
                    "it. Move it at least {:.0f} cm, hold it still for half a second, then let go.",
                    name, 100 * kGuided_m));
    const JointVector from = run.q(i, run.newest(i));
    run.lead(i, Law::guide);
    const double led = wait_for_guiding(context, i, from, 0);
    ModelTerms terms = run.terms(i);
    const Vector3 p0 = flange_of(terms, run.q(i, run.newest(i)));
    double drift = 0;
    if (led > 0) {
      context.say("  now let go, for two seconds");
      (void)run.watch(2, 10, [&](const Track& track) {
        drift = (flange_of(terms, run.q(i, track.arms[i].back())) - p0).norm();
        return drift > kGuideDrift_m;
      });
    }
    run.lead(i, Law::hold);
    result.at_least(name, "guided distance", 100 * led, "cm", 100 * kGuided_m,
                    "guide the arm by its hand; if it is stiff, its friction is too high for this law",
                    fmt::format("within {:g} s", kGuideWait_s));
    result.at_most(name, "drift after release", 1e3 * drift, "mm", 1e3 * kGuideDrift_m,
                   "it sinks or rises: hand, tool and load in the scene or in the arm's settings differ from "
                   "the actual ones");
  });
}

// Poses for the payload check, guided by hand: a single pose cannot separate mass and center.
StepResult run_payload(Context& context) {
  ArmsRun& run = *context.run;
  constexpr int kPoses = 3;
  return each_arm(context, [&](ArmIndex i, const std::string& name, StepResult& result) {
    std::vector<RestSample> samples;
    double external = 0;
    for (int pose = 1; pose <= kPoses; ++pose) {
      if (pose > 1) {
        context.person.ready(
            fmt::format("payload.{}.{}", name, pose),
            fmt::format("Pose {} of {}: take the hand of arm '{}'. After this key, guide it to another pose "
                        "(a joint by at least {:.0f} degrees, the hand by {:.0f} cm) and hold it still for "
                        "half a second; it is then held, and you let go.",
                        pose, kPoses, name, 180 / M_PI * kPoseApart_rad, 100 * kGuided_m));
        run.lead(i, Law::guide);
        const double led = wait_for_guiding(context, i, samples.back().q, kPoseApart_rad);
        run.lead(i, Law::hold);
        result.at_least(name, "guided to another pose", 100 * led, "cm", 100 * kGuided_m,
                        "guide the arm further, then keep it still",
                        fmt::format("within {:g} s", kGuideWait_s));
        if (result.verdict == Verdict::no_go) return;
        context.person.ready(fmt::format("payload.{}.{}.free", name, pose),
                             "Let go of the arm, then press the key.");
      }
      const Track track = run.watch(1);
      const std::size_t n = run.joint_count(i);
      samples.push_back({track.mean(i, &ArmSample::q, n), track.mean(i, &ArmSample::tau_J, n)});
      external = std::max(external, track.mean(i, &ArmSample::tau_ext, n).lpNorm<Eigen::Infinity>());
    }
    const GravityFit fit = fit_gravity(context.arm(i), samples);
    const std::string remedy =
        "declare everything on the flange ('tool', 'load_declared', 'hand'), also in the arm's web interface";
    result.at_most(name, "payload beyond the declared one", std::abs(fit.mass_kg), "kg", kPayload_kg, remedy,
                   fit.text());
    result.at_most(name, "torque at rest in three poses: measured compared with scene", fit.largest_nm, "N m",
                   kPayloadTorque, remedy, fmt::format("at joint {}, {}", fit.joint + 1, fit.text()));
    result.at_most(name, "external torque at rest, as estimated by the arm", external, "N m", kPayloadTorque,
                   remedy);
    result.show(name, "tilt of the base against the scene", 180 / M_PI * fit.tilt_rad, "degrees");
  });
}

}  // namespace

void add_steps_in_hold(std::vector<Step>& steps, const TourSetup& setup) {
  const bool one = setup.scene.arms.size() == 1;
  const std::string all = one ? "The arm" : "All arms";
  steps.push_back(
      {"hold", "Hold: torque control begins",
       fmt::format(
           "{} should stay in place and yield softly when pushed. Stand clear, user stop in your hand. "
           "No-go: a flange that moves more than {:.0f} mm or a joint more than {:g} rad in 2 s. From here "
           "on {} in hold between the steps.",
           all, 1e3 * kHoldDrift_m, kHoldDrift_rad, one ? "it is" : "they are"),
       true, true, run_hold});
  steps.push_back(
      {"button", "User stop and recovery",
       fmt::format("You press and release the user stop of each arm in turn; then it holds again. No-go: a "
                   "button that is not seen within {:g} s or stops another arm, or a "
                   "joint that moves by {:g} rad.",
                   kButtonWait_s, kHoldDrift_rad),
       true, true, run_button});
  steps.push_back({"guiding", "Hand guiding",
                   fmt::format("You guide each arm by hand in turn. The arm does not move by itself. No-go: "
                               "it drifts more than {:.0f} mm when you let go.",
                               1e3 * kGuideDrift_m),
                   true, false, run_guiding});
  steps.push_back({"payload", "Payload, in three poses",
                   fmt::format("You guide each arm to two more poses. No-go: more than {:g} kg or {:g} N m "
                               "beyond the declared load.",
                               kPayload_kg, kPayloadTorque),
                   true, false, run_payload});
}

}  // namespace multipanda::commission
