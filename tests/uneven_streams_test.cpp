// Uneven streams through whole simulated runs: MuJoCo, the law, the safety stage. At 10 to 100 Hz, with
// samples up to 30 % of a period late and 5 % lost (at most two in a row), no torque is rate-limited, and the
// hand moves with at most a tenth of the jerk that it has under a zero-order hold: a set-point that stands at
// the newest sample. The hold needs the rate limit, so the count can fail.
#include <cmath>
#include <deque>
#include <functional>
#include <random>

#include <gtest/gtest.h>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::uneven_streams_test {
namespace {

constexpr double kEnd = 8, kFrom = 1;  // [s]

struct Arrival {
  double at, of;
};

std::vector<Arrival> arrivals(double period) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> share(0, 1);
  std::vector<Arrival> all;
  int lost = 0;
  for (double due = 0; due < kEnd; due += period) {
    const double at = due + 0.3 * period * share(random);
    lost = share(random) < 0.05 && lost < 2 ? lost + 1 : 0;
    if (lost == 0) all.push_back({at, due});
  }
  return all;
}

// From rest, then 0.03 to 0.05 in each of three directions at up to 0.1 per second.
Vector3 offset(double t) {
  const double u = std::min(1.0, t), rise = u * u * u * (10 - 15 * u + 6 * u * u);
  return rise * Vector3(0.03 * std::sin(1.3 * t), 0.05 * std::sin(1.7 * t), 0.03 * (1 - std::cos(1.1 * t)));
}

struct Outcome {
  double jerk = 0;  // of the hand [m/s^3], third difference at 1 kHz
  double way = 0;   // of the hand [m]
  std::uint64_t rate_limited = 0, others = 0;
};

Outcome run(const std::string& law, double rate, bool hold) {
  const Registry registry = Registry::with_builtins();
  Scene scene = load_scene("one_arm", registry);
  scene.timeline.clear();
  scene.active = {law};
  for (auto& controllet : scene.controllets) {
    for (auto& input : controllet.inputs) input.timeout_s = 0.5;
    if (controllet.name == law && controllet.inputs.empty())
      controllet.inputs.push_back({.name = "joints", .timeout_s = 0.5});
  }
  MujocoBackend backend(scene, {.pace = Pace::unpaced});
  ControlCycle cycle(build_cycle_config(scene), registry, backend);
  MultimodeController& modes = cycle.modes();
  modes.activate_at_start(start_set(scene, modes));
  Reference& input = modes.instance(modes.find(law)).inputs()[0];
  ModelTerms terms(build_arm_model(scene.arms[0]));
  const ArmConfig config = arm_config(scene.arms[0]);
  terms.set_config(config.frames, config.tool, config.load);
  backend.start();

  Outcome outcome;
  JointVector q = joint_constant(7, 0), dq = q, q_start;
  Pose X_start;
  Vector3 p_start = Vector3::Zero();
  std::deque<Vector3> p;
  const auto sent = arrivals(1 / rate);
  std::size_t next = 0;
  for (int k = 0; k < static_cast<int>(1000 * kEnd); ++k) {
    const double t = 1e-3 * k;
    for (; k > 0 && next < sent.size() && sent[next].at <= t; ++next) {
      const Vector3 by = offset(sent[next].of);
      Pose X = X_start;
      X.position += by;
      JointVector q_d = q_start;
      if (law == "joint") q_d.head<3>() += by;
      Target target = pose_target(X, 0, Delivery::stream);
      if (law == "joint") {
        target.size = 7;
        std::copy(q_d.begin(), q_d.end(), target.values.begin());
      }
      if (!hold) {
        EXPECT_EQ(input.post(target), Verdict::accepted);
      } else if (law == "joint") {
        input.start(q_d);
      } else {
        input.start(X);
      }
    }
    cycle.step(backend.wait());
    backend.world().joints(0, q, dq);
    terms.update(q, dq);
    p.push_back(terms.X_WE().position);
    if (k == 0) {
      q_start = input.joints();
      X_start = input.pose();
      p_start = p.back();
    }
    outcome.way = std::max(outcome.way, (p.back() - p_start).norm());
    if (p.size() < 4) continue;
    if (t > kFrom) outcome.jerk = std::max(outcome.jerk, (p[3] - 3 * p[2] + 3 * p[1] - p[0]).norm() * 1e9);
    p.pop_front();
  }
  outcome.rate_limited = cycle.safety().counted(0, Intervention::torque_rate_clamped);
  outcome.others = cycle.safety().counted(0) - outcome.rate_limited;
  EXPECT_FALSE(backend.failed());
  return outcome;
}

TEST(UnevenStreams, MoveTheHandSmoothlyAndWithoutTheRateLimit) {
  for (const std::string law : {"cartesian", "joint"}) {
    for (const double rate : {10.0, 20.0, 50.0, 100.0}) {
      const Outcome stream = run(law, rate, false), hold = run(law, rate, true);
      std::printf(
          "%-9s %3.0f Hz: jerk of the hand %5.1f m/s^3, under a hold %6.0f; rate-limited cycles %d, under a "
          "hold %d\n",
          law.c_str(), rate, stream.jerk, hold.jerk, static_cast<int>(stream.rate_limited),
          static_cast<int>(hold.rate_limited));
      EXPECT_EQ(stream.rate_limited + stream.others, 0u) << law << ", " << rate << " Hz";
      const double share = law == "joint" && rate >= 50 ? 0.25 : 0.1;
      EXPECT_LE(stream.jerk, share * hold.jerk) << law << ", " << rate << " Hz";
      EXPECT_GT(stream.way, 0.02);  // it moves at all
      if (rate <= 20) {
        EXPECT_GT(hold.rate_limited, 0u);
      }
    }
  }
}

// Joints 1 and 3 of an FR3 without hand, upper arm nearly upright, turn about nearly the same axis: together
// they move 3 kg m^2, against each other 0.04. A leader's steps drive both alike, as a late bunch of samples
// does. The arm moves no faster than the set-point may, and less than one cycle in a hundred is rate-limited.
TEST(UnevenStreams, StepsOfALeaderDoNotShakeJointsAgainstEachOther) {
  constexpr int kCycles = 8000;
  const Registry registry = Registry::with_builtins();
  Scene scene = parse_scene(
      "plant: {fidelity: realistic}\n"
      "arms: [{name: arm, model: fr3, hand: false, start_rad: [0.22, 0.15, 0.02, -2.02, -0.91, 1.45, 1.74],\n"
      "  tool: {mass_kg: 0.7, com_m: [0, 0, 0.07], inertia_kg_m2: {xx: 0.0014, yy: 0.0014, zz: 0.0006}}}]\n"
      "controllets: [{name: joint, type: joint_impedance, arms: arm}]\n"
      "active: [joint]\n",
      "steps.yaml", registry);
  for (const std::uint32_t seed : {1U, 2U, 3U}) {
    MujocoBackend backend(scene, {.pace = Pace::unpaced});
    ControlCycle cycle(build_cycle_config(scene), registry, backend);
    MultimodeController& modes = cycle.modes();
    modes.activate_at_start(start_set(scene, modes));
    Reference& input = modes.instance(modes.find("joint")).inputs()[0];
    backend.start();
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> share(0, 1);
    double fastest = 0, step = 0, side = 0.01;
    JointVector q = joint_constant(7, 0), dq = q;
    for (int k = 0, next = 100; k < kCycles; ++k) {
      if (k >= next) {
        step = side * share(random);
        side = -side;
        next = k + 40 + static_cast<int>(200 * share(random));
      }
      if (k % 7 == 6) {
        Target target;
        target.delivery = Delivery::stream;
        target.size = 7;
        std::copy(scene.arms[0].q_start.begin(), scene.arms[0].q_start.end(), target.values.begin());
        for (const std::size_t joint : {0U, 2U}) target.values[joint] += step;
        ASSERT_EQ(input.post(target), Verdict::accepted);
      }
      cycle.step(backend.wait());
      backend.world().joints(0, q, dq);
      fastest = std::max(fastest, dq.lpNorm<Eigen::Infinity>());
    }
    const auto limited = cycle.safety().counted(0, Intervention::torque_rate_clamped);
    std::printf("steps, seed %u: fastest joint %.2f rad/s, rate-limited cycles %d\n", seed, fastest,
                static_cast<int>(limited));
    EXPECT_LT(fastest, input.spec().max_speed);
    EXPECT_LT(limited, kCycles / 100);
    EXPECT_EQ(cycle.safety().counted(0), limited);
  }
}

}  // namespace
}  // namespace multipanda::uneven_streams_test
