#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "commission/limits.hpp"
#include "commission/measures.hpp"
#include "commission/tour.hpp"

// The arms move by themselves, in turn, slowly and by small amounts; the others stay in hold.
namespace multipanda::commission {
namespace {

constexpr const char* kClear = "Stand clear, user stop in your hand.";

void ready(Context& context, const std::string& step, ArmIndex arm, const std::string& what) {
  const std::string& name = context.arm(arm).name;
  context.person.ready(step + "." + name, fmt::format("Arm '{}' {} {}", name, what, kClear));
}

StepResult run_joint_motion(Context& context) {
  return each_arm(context, [&](ArmIndex i, const std::string& name, StepResult& result) {
    ready(context, "joint_motion", i,
          fmt::format("turns each joint in sequence by {:.1f} degrees and back, at {:.1f} degrees "
                      "per second at most; the hand moves up to {:.0f} cm. About {:.0f} s.",
                      180 / M_PI * kJointStep_rad, 180 / M_PI * kJointSpeed, 100 * kJointStep_rad * 0.9,
                      joint_motion_seconds(context.run->joint_count(i))));
    const auto figures = measure_joint_motion(*context.run, i);
    result.measured[name] = {{"joints", figures.curves},
                             {"friction_nm", list(figures.friction_nm)},
                             {"error_rad", list(figures.error_rad)}};
    result.at_least(name, "smallest joint motion in the requested direction", figures.moved_rad.minCoeff(),
                    "rad", kJointStep_rad - kJointError_rad,
                    "friction is too high, or a joint is locked or hindered; look at the curves of the page");
    result.at_most(name, "joint error at the end of the motion", figures.error_rad.maxCoeff(), "rad",
                   kJointError_rad, "look for friction or an obstacle; compare with the twin on the page");
    result.at_most(name, "motion of a joint that should not move", figures.others_rad, "rad", kOtherJoint_rad,
                   "compare the model with the arm's ('identify')");
    result.at_most(name, "largest joint friction", figures.friction_nm.cwiseAbs().maxCoeff(), "N m",
                   kFriction_nm,
                   "let the arm warm up and repeat; if friction stays high, ask the manufacturer");
  });
}

StepResult run_cartesian_motion(Context& context) {
  return each_arm(context, [&](ArmIndex i, const std::string& name, StepResult& result) {
    ready(context, "cartesian_motion", i,
          fmt::format("moves its hand by {:.0f} cm up and back, then along x and back, then along y and back "
                      "(axes of the world), at {:.0f} cm/s at most. Watch the directions.",
                      100 * kCartesianStep_m, 100 * kCartesianSpeed));
    const auto figures = measure_cartesian_motion(*context.run, i);
    result.measured[name] = {{"hand", figures.curves}, {"error_m", figures.error_m}};
    result.at_most(name, "distance of the hand from its goal", 1e3 * figures.error_m, "mm",
                   1e3 * kCartesianError_m,
                   "look for friction or an obstacle; compare with the twin on the page");
    result.at_most(name, "rotation of the hand from its goal", figures.error_rad, "rad", kCartesianError_rad,
                   "as above");
    // Torques do not show a base that is turned about the vertical: only a person can see it.
    if (!context.person.yes("cartesian_motion." + name + ".direction",
                            fmt::format("Did the hand of arm '{}' move first up, then along the world's x, "
                                        "then along the world's y, according to the base in the scene?",
                                        name))) {
      result.fail(fmt::format("arm '{}' moved along other directions than the scene's x and y", name),
                  "the directions of the scene",
                  "correct the yaw of 'base: rpy_rad' in the scene; gravity cannot show it");
    }
  });
}

StepResult run_stop(Context& context) {
  ArmsRun& run = *context.run;
  return each_arm(context, [&](ArmIndex i, const std::string& name, StepResult& result) {
    ready(context, "stop", i,
          fmt::format("turns joint 1 by up to {:.1f} degrees, at {:.1f} degrees per second at most, and this "
                      "program stops it on the way.",
                      180 / M_PI * kStopStep_rad, 180 / M_PI * kStopSpeed));
    const auto figures = measure_stop(run, i);
    result.measured[name] = {{"stop_s", figures.time_s}, {"stop_rad", figures.angle_rad}};
    result.at_most(name, "time to rest after a stop", figures.time_s, "s", kStopTime_s,
                   "do not continue: the program's stop is too slow");
    result.at_most(name, "angle turned after a stop", figures.angle_rad, "rad", kStopAngle_rad,
                   "do not continue: the program's stop is too slow");
  });
}

StepResult run_delay(Context& context) {
  return each_arm(context, [&](ArmIndex i, const std::string& name, StepResult& result) {
    ready(context, "delay", i,
          fmt::format("swings joint 4 by {:.2f} degrees, {:.0f} times a second, for 2 s, then half as far "
                      "and twice as fast: the hand moves by about {:.0f} mm.",
                      180 / M_PI * kWiggle_rad, 1 / kWigglePeriod_s, 1e3 * kWiggle_rad * 0.6));
    const auto figures = measure_delay(*context.run, i);
    result.measured[name] = {{"torque_delay_s", figures.torque_delay_s}};
    result.at_most(
        name, "delay from command to measured torque", 1e3 * figures.torque_delay_s, "ms",
        1e3 * kTorqueDelay_s,
        "check the steps on network and doctor, and end other programs that use the connection to the arm");
    result.at_least(name, "share of the torque explained by this delay", figures.fit, "", 0.5,
                    "the delay could not be measured, or it is 19 ms or more: see network and doctor");
    if (const auto connection = context.run->connection(i)) {
      result.at_least(name, "commands in time, by the arm", connection->command_success_rate, "",
                      context.virtual_arms() ? kSuccessRateVirtual : kSuccessRate,
                      "see the doctor's line on timer wake-up, and the network");
      result.show(name, "mean computing time of an answer", 1e6 * connection->answer_delay_mean_s, "us");
      result.show(name, "states lost since the hold began", static_cast<double>(connection->lost), "");
    }
  });
}

StepResult run_noise(Context& context) {
  return each_arm(context, [&](ArmIndex i, const std::string& name, StepResult& result) {
    const auto figures = measure_noise(*context.run, i, 2);
    result.measured[name] = {{"noise_dq", list(figures.dq_rad_per_s)}, {"noise_tau", list(figures.tau_nm)}};
    result.at_most(name, "rms velocity noise, worst joint", figures.dq_rad_per_s.maxCoeff(), "rad/s",
                   kNoiseVelocity, "the arm vibrates in hold: look for a loose mounting or a soft table");
    result.at_most(name, "rms torque noise, worst joint", figures.tau_nm.maxCoeff(), "N m", kNoiseTorque,
                   "the arm vibrates in hold: look for a loose mounting or a soft table");
  });
}

// Change of the estimated force when a known weight hangs at the hand: it pulls down, the arm pulls up.
StepResult run_weight(Context& context) {
  ArmsRun& run = *context.run;
  const auto mean_force = [&](ArmIndex arm) {
    (void)run.watch(1.5);  // lets the hold's spring settle
    const Track track = run.watch(1);
    Vector3 sum = Vector3::Zero();
    for (const auto& sample : track.arms[arm])
      sum += Vector3(sample.F_K_W_est[0], sample.F_K_W_est[1], sample.F_K_W_est[2]);
    return Vector3(sum / static_cast<double>(track.t.size()));
  };
  return each_arm(context, [&](ArmIndex i, const std::string& name, StepResult& result) {
    const double kg =
        context.person.number("weight." + name,
                              fmt::format("Mass of the weight that you will hang at the hand of arm '{}' "
                                          "[kg], 0.2 to 1.5; 0: none, forces are not checked",
                                          name),
                              0, 1.5);
    if (kg < 0.2) {
      result.notes.push_back("arm '" + name + "': no weight; its forces were not checked");
      if (result.verdict == Verdict::go) result.verdict = Verdict::skipped;
      return;
    }
    context.person.ready("weight." + name + ".without",
                         "Nothing at the hand, hands off; then press the key.");
    const Vector3 before = mean_force(i);
    context.person.ready(
        "weight." + name + ".with",
        "Hang the weight at the hand, let it come to rest, hands off; then press the key. The "
        "hand sinks by a few millimeters.");
    const Vector3 change = mean_force(i) - before;
    const double expected = 9.81 * kg, most = std::max(kWeightForce, kWeightShare * expected);
    const std::string found =
        fmt::format("the estimate changed by [{:.1f}, {:.1f}, {:.1f}] N, expected [0, 0, {:.1f}] N",
                    change.x(), change.y(), change.z(), expected);
    result.measured[name] = {{"weight_kg", kg}, {"force_n", {change.x(), change.y(), change.z()}}};
    result.at_most(name, fmt::format("error of the estimated force with {:g} kg", kg),
                   (change - Vector3(0, 0, expected)).norm(), "N", most,
                   "repeat with the weight at rest; if it fails again, repeat the payload step or run "
                   "'identify'; do not use force control until then",
                   found);
    context.person.ready("weight." + name + ".off", "Take the weight off; then press the key.");
  });
}

}  // namespace

void add_steps_in_motion(std::vector<Step>& steps, const TourSetup& setup) {
  const std::string each = setup.scene.arms.size() == 1 ? "The arm" : "One arm at a time";
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
  steps.push_back(
      {"delay", "Delay",
       per_arm(fmt::format("swings joint 4 so that the hand moves by a few millimeters. No-go: more than "
                           "{:g} ms, or too few commands in time",
                           1e3 * kTorqueDelay_s)),
       true, false, run_delay});
  steps.push_back({"noise", "Noise in hold",
                   fmt::format("Nothing moves, hands off. No-go: more than {:g} rad/s or {:g} N m (rms).",
                               kNoiseVelocity, kNoiseTorque),
                   false, false, run_noise});
  steps.push_back({"weight", "Forces of a known weight",
                   fmt::format("Nothing moves by itself. You hang a known weight at each hand. No-go: an "
                               "error above {:g} N or {:g} %, whichever is larger.",
                               kWeightForce, 100 * kWeightShare),
                   true, false, run_weight});
}

}  // namespace multipanda::commission
