#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "commission/limits.hpp"
#include "commission/measures.hpp"
#include "commission/tour.hpp"

// The arms move by themselves: one at a time, a little, slowly; the others stay in hold.
namespace multipanda::commission {
namespace {

constexpr const char* kClear = "Stand clear, user stop in your hand.";

void ready(Context& context, const std::string& step, ArmIndex arm, const std::string& what) {
  const std::string& name = context.arm(arm).name;
  context.person.ready(step + "." + name, fmt::format("Arm '{}' {} {}", name, what, kClear));
}

StepResult run_joint_motion(Context& context) {
  StepResult result;
  for (ArmIndex i = 0; i < context.arm_count(); ++i) {
    const std::string& name = context.arm(i).name;
    ready(context, "joint_motion", i,
          fmt::format("turns each joint, one after the other, by {:.1f} degrees and back, at {:.1f} degrees "
                      "per second at most; the hand moves up to {:.0f} cm. About {:.0f} s.",
                      180 / M_PI * kJointStep_rad, 180 / M_PI * kJointSpeed, 100 * kJointStep_rad * 0.9,
                      joint_motion_seconds(context.run->joint_count(i))));
    const auto figures = measure_joint_motion(*context.run, i);
    result.measured[name] = {{"joints", figures.curves},
                             {"friction_nm", list(figures.friction_nm)},
                             {"error_rad", list(figures.error_rad)}};
    result.add(
        {.arm = name,
         .quantity = "joint motion in the requested direction, least",
         .value = figures.moved_rad.minCoeff(),
         .unit = "rad",
         .limit = kJointStep_rad - kJointError_rad,
         .at_least = true,
         .remedy = "friction is too high, or a joint is locked or hindered; look at the curves of the page"});
    result.add({.arm = name,
                .quantity = "joint error at the end of the way",
                .value = figures.error_rad.maxCoeff(),
                .unit = "rad",
                .limit = kJointError_rad,
                .remedy = "look for friction or an obstacle; compare with the twin on the page"});
    result.add({.arm = name,
                .quantity = "motion of a joint that should rest",
                .value = figures.others_rad,
                .unit = "rad",
                .limit = kOtherJoint_rad,
                .remedy = "compare the model with the arm's ('identify')"});
    result.add({.arm = name,
                .quantity = "friction, worst joint",
                .value = figures.friction_nm.cwiseAbs().maxCoeff(),
                .unit = "N m",
                .limit = kFriction_nm,
                .remedy = "let the arm warm up and repeat; if it stays, ask the manufacturer"});
    if (result.verdict == Verdict::no_go) break;
  }
  return result;
}

StepResult run_cartesian_motion(Context& context) {
  StepResult result;
  for (ArmIndex i = 0; i < context.arm_count(); ++i) {
    const std::string& name = context.arm(i).name;
    ready(context, "cartesian_motion", i,
          fmt::format("moves its hand by {:.0f} cm up and back, then along x and back, then along y and back "
                      "(axes of the world), at {:.0f} cm/s at most. Watch the directions.",
                      100 * kCartesianStep_m, 100 * kCartesianSpeed));
    const auto figures = measure_cartesian_motion(*context.run, i);
    result.measured[name] = {{"hand", figures.curves}, {"error_m", figures.error_m}};
    result.add({.arm = name,
                .quantity = "hand off its goal",
                .value = 1e3 * figures.error_m,
                .unit = "mm",
                .limit = 1e3 * kCartesianError_m,
                .remedy = "look for friction or an obstacle; compare with the twin on the page"});
    result.add({.arm = name,
                .quantity = "hand turned off its goal",
                .value = figures.error_rad,
                .unit = "rad",
                .limit = kCartesianError_rad,
                .remedy = "as above"});
    // A base that is turned about the vertical shows in no torque: only a person sees it.
    if (!context.person.yes("cartesian_motion." + name + ".direction",
                            fmt::format("Did the hand of arm '{}' go first up, then along the world's x, "
                                        "then along the world's y, as the scene places the base?",
                                        name))) {
      result.fail(fmt::format("arm '{}' moved along other directions than the scene's x and y", name),
                  "the directions of the scene",
                  "correct the yaw of 'base: rpy_rad' in the scene; gravity cannot show it");
    }
    if (result.verdict == Verdict::no_go) break;
  }
  return result;
}

StepResult run_stop(Context& context) {
  StepResult result;
  ArmsRun& run = *context.run;
  for (ArmIndex i = 0; i < context.arm_count(); ++i) {
    const std::string& name = context.arm(i).name;
    ready(context, "stop", i,
          fmt::format("turns joint 1 by up to {:.1f} degrees, at {:.1f} degrees per second at most, and is "
                      "stopped on the way by this program.",
                      180 / M_PI * kStopStep_rad, 180 / M_PI * kStopSpeed));
    const auto figures = measure_stop(run, i);
    result.measured[name] = {{"stop_s", figures.time_s}, {"stop_rad", figures.angle_rad}};
    result.add({.arm = name,
                .quantity = "time to rest after a stop",
                .value = figures.time_s,
                .unit = "s",
                .limit = kStopTime_s,
                .remedy = "do not go on: the stop of the program is too slow"});
    result.add({.arm = name,
                .quantity = "angle turned after a stop",
                .value = figures.angle_rad,
                .unit = "rad",
                .limit = kStopAngle_rad,
                .remedy = "do not go on: the stop of the program is too slow"});
    if (result.verdict == Verdict::no_go) break;
  }
  return result;
}

StepResult run_delay(Context& context) {
  StepResult result;
  for (ArmIndex i = 0; i < context.arm_count(); ++i) {
    const std::string& name = context.arm(i).name;
    ready(context, "delay", i,
          fmt::format("swings joint 4 by {:.2f} degrees, {:.0f} times a second, for 2 s, then by half of it "
                      "twice as fast: the hand trembles by about {:.0f} mm.",
                      180 / M_PI * kWiggle_rad, 1 / kWigglePeriod_s, 1e3 * kWiggle_rad * 0.6));
    const auto figures = measure_delay(*context.run, i);
    result.measured[name] = {{"torque_delay_s", figures.torque_delay_s}};
    result.add({.arm = name,
                .quantity = "delay from command to measured torque",
                .value = 1e3 * figures.torque_delay_s,
                .unit = "ms",
                .limit = 1e3 * kTorqueDelay_s,
                .remedy = "see network and doctor: no other program between this computer and the arm"});
    result.add({.arm = name,
                .quantity = "share of the torque that this delay explains",
                .value = figures.fit,
                .unit = "",
                .limit = 0.5,
                .at_least = true,
                .remedy = "the delay could not be measured, or it is 19 ms or more: see network and doctor"});
    if (const auto connection = context.run->connection(i)) {
      result.add({.arm = name,
                  .quantity = "commands in time, by the arm",
                  .value = connection->command_success_rate,
                  .unit = "",
                  .limit = context.virtual_arms() ? kSuccessRateVirtual : kSuccessRate,
                  .at_least = true,
                  .remedy = "see the doctor's line on timer wake-up, and the network"});
      result.readings.push_back({.arm = name,
                                 .quantity = "computing time of an answer, mean",
                                 .value = 1e6 * connection->answer_delay_mean_s,
                                 .unit = "us",
                                 .limit = kShown});
      result.readings.push_back({.arm = name,
                                 .quantity = "states lost since the hold began",
                                 .value = static_cast<double>(connection->lost),
                                 .unit = "",
                                 .limit = kShown});
    }
    if (result.verdict == Verdict::no_go) break;
  }
  return result;
}

StepResult run_noise(Context& context) {
  StepResult result;
  for (ArmIndex i = 0; i < context.arm_count(); ++i) {
    const std::string& name = context.arm(i).name;
    const auto figures = measure_noise(*context.run, i, 2);
    result.measured[name] = {{"noise_dq", list(figures.dq_rad_per_s)}, {"noise_tau", list(figures.tau_nm)}};
    result.add({.arm = name,
                .quantity = "noise of a velocity, worst joint, rms",
                .value = figures.dq_rad_per_s.maxCoeff(),
                .unit = "rad/s",
                .limit = kNoiseVelocity,
                .remedy = "the arm trembles in hold: look for a loose mounting or a soft table"});
    result.add({.arm = name,
                .quantity = "noise of a torque, worst joint, rms",
                .value = figures.tau_nm.maxCoeff(),
                .unit = "N m",
                .limit = kNoiseTorque,
                .remedy = "the arm trembles in hold: look for a loose mounting or a soft table"});
  }
  return result;
}

// The change of the estimated force when a known weight hangs at the hand. It pulls down, the arm up.
StepResult run_weight(Context& context) {
  StepResult result;
  ArmsRun& run = *context.run;
  const auto mean_force = [&](ArmIndex arm) {
    (void)run.watch(1.5);  // the hold's spring comes to rest
    const Track track = run.watch(1);
    Vector3 sum = Vector3::Zero();
    for (const auto& sample : track.arms[arm])
      sum += Vector3(sample.F_K_W_est[0], sample.F_K_W_est[1], sample.F_K_W_est[2]);
    return Vector3(sum / static_cast<double>(track.t.size()));
  };
  for (ArmIndex i = 0; i < context.arm_count(); ++i) {
    const std::string& name = context.arm(i).name;
    const double kg =
        context.person.number("weight." + name,
                              fmt::format("Mass of the weight that you will hang at the hand of arm '{}' "
                                          "[kg], 0.2 to 1.5; 0: none, the force is not checked",
                                          name),
                              0, 1.5);
    if (kg < 0.2) {
      result.notes.push_back("arm '" + name + "': no weight; its forces were not checked");
      if (result.verdict == Verdict::go) result.verdict = Verdict::skipped;
      continue;
    }
    context.person.ready("weight." + name + ".without", "Nothing at the hand, hands off; then this key.");
    const Vector3 before = mean_force(i);
    context.person.ready("weight." + name + ".with",
                         "Hang the weight at the hand, let it come to rest, hands off; then this key. The "
                         "hand sinks by a few millimeters.");
    const Vector3 change = mean_force(i) - before;
    const double expected = 9.81 * kg, most = std::max(kWeightForce, kWeightShare * expected);
    const std::string found =
        fmt::format("the estimate changed by [{:.1f}, {:.1f}, {:.1f}] N, expected [0, 0, {:.1f}] N",
                    change.x(), change.y(), change.z(), expected);
    result.measured[name] = {{"weight_kg", kg}, {"force_n", {change.x(), change.y(), change.z()}}};
    result.add({.arm = name,
                .quantity = fmt::format("force of {:g} kg, error", kg),
                .value = (change - Vector3(0, 0, expected)).norm(),
                .unit = "N",
                .limit = most,
                .found = found,
                .remedy = "repeat with a weight that rests; then the payload step, and 'identify'; do not "
                          "use force control before"});
    context.person.ready("weight." + name + ".off", "Take the weight off; then this key.");
    if (result.verdict == Verdict::no_go) break;
  }
  return result;
}

}  // namespace

void add_steps_in_motion(std::vector<Step>& steps, const TourSetup& setup) {
  const std::string each = setup.scene.arms.size() == 1 ? "The arm" : "One arm after the other";
  const auto per_arm = [&](const std::string& what) {
    return each + " " + what + "; you are asked again before each motion.";
  };
  steps.push_back({"joint_motion", "Small joint motions and friction",
                   per_arm(fmt::format("turns each joint by {:.1f} degrees and back. No-go: an error above "
                                       "{:g} rad, or friction above {:g} N m",
                                       180 / M_PI * kJointStep_rad, kJointError_rad, kFriction_nm)),
                   true, false, run_joint_motion});
  steps.push_back({"cartesian_motion", "Small Cartesian motions",
                   per_arm(fmt::format("moves its hand by {:.0f} cm along three axes. No-go: more than "
                                       "{:.0f} mm or {:g} rad off, or a wrong direction",
                                       100 * kCartesianStep_m, 1e3 * kCartesianError_m, kCartesianError_rad)),
                   true, false, run_cartesian_motion});
  steps.push_back({"stop", "Stop",
                   per_arm(fmt::format("is stopped in a small motion. No-go: more than "
                                       "{:g} s or {:g} rad until it rests",
                                       kStopTime_s, kStopAngle_rad)),
                   true, false, run_stop});
  steps.push_back({"delay", "Delay",
                   per_arm(fmt::format("swings joint 4 by a few millimeters at the hand. No-go: more than "
                                       "{:g} ms, or too few commands in time",
                                       1e3 * kTorqueDelay_s)),
                   true, false, run_delay});
  steps.push_back({"noise", "Noise in hold",
                   fmt::format("Nothing moves, hands off. No-go: more than {:g} rad/s or {:g} N m (rms).",
                               kNoiseVelocity, kNoiseTorque),
                   false, false, run_noise});
  steps.push_back({"weight", "Forces against a known weight",
                   fmt::format("Nothing moves by itself. You hang a known weight at each hand. No-go: an "
                               "error above {:g} N or {:g} %, whichever is larger.",
                               kWeightForce, 100 * kWeightShare),
                   true, false, run_weight});
}

}  // namespace multipanda::commission
