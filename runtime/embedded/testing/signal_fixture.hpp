#pragma once

#include <algorithm>
#include <mutex>

#include <Eigen/Cholesky>

#include "runtime/embedded/testing/hosted_fixture.hpp"
#include "scene/load.hpp"

// A cycle in another program's loop, and two robots that offer only position, velocity and effort.
namespace multipanda::test {

using Gravity = HostedArm::Gravity;

inline const Registry& builtins() {
  static const Registry registry = Registry::with_builtins();
  return registry;
}

// Two arms on rotated and tilted bases.
inline Scene scene_of(const std::string& more) {
  return parse_scene(
      "arms:\n"
      "  left: {model: fer, hand: false, base: {position_m: [0, 0.5, 0], rpy_rad: [0.3, 0, 0.4]}}\n"
      "  right: {model: fr3, hand: false, base: {position_m: [0, -0.5, 0], rpy_rad: [0, 0.5, -1]}}\n" +
          more,
      "test", builtins());
}

inline const char* const kJoints =
    "controllets:\n"
    "  left_joints: {type: joint_impedance, arms: left}\n"
    "  right_pose: {type: cartesian_impedance, arms: right}\n"
    "active: [left_joints, right_pose]\n";

// M ddq = tau - c - g (without g if the robot compensates it), integrated over 1 ms in ten smaller steps.
struct Robot {
  Robot(std::shared_ptr<const ArmModel> model, bool heavy_, JointVector q_)
      : terms(model), heavy(heavy_), q(std::move(q_)), dq(joint_constant(model->joint_count(), 0)) {
    terms.set_config({}, {}, {});
  }
  void step(const JointVector& tau) {
    for (int k = 0; k < 10; ++k) {
      terms.update(q, dq);
      JointVector rest = tau - terms.c();
      if (heavy) rest -= terms.g();
      const JointVector ddq = terms.M().llt().solve(rest);
      dq += 1e-4 * ddq;
      q += 1e-4 * dq;
    }
    tau_J = tau;
    if (!heavy) tau_J += terms.g();
  }
  ModelTerms terms;
  bool heavy;
  JointVector q, dq, tau_J;
};

struct Counting : RunAdapter {
  void take(const CycleRecord& record) override {
    const std::lock_guard lock(mutex);
    cycles.push_back(record.cycle);
  }
  void take(const Event& event) override {
    const std::lock_guard lock(mutex);
    events.push_back(event);
  }
  std::mutex mutex;  // a test that holds it blocks the relay
  std::vector<std::uint64_t> cycles;
  std::vector<Event> events;
};

// The step of a later activation in which its controllets start: after one with the arms recovering and two
// in which they take commands.
inline constexpr int kFirstStart = 2 + static_cast<int>(HostedCycle::kSettled);

struct Fixture {
  explicit Fixture(const std::string& yaml = kJoints, bool effort = true,
                   std::vector<Gravity> gravity = {Gravity::cycle, Gravity::robot},
                   std::optional<HostedTraceOptions> trace = {}, HostedTrace::Report report = {})
      : scene(scene_of(yaml)) {
    HostedOptions options;
    options.trace = std::move(trace);
    options.report = std::move(report);
    for (ArmIndex i = 0; i < 2; ++i) {
      options.arms.push_back({.name = scene.arms[i].name, .joints = {}, .gravity = gravity[i]});
    }
    options.make_adapter = [this](const RunContext&) {
      auto adapter = std::make_unique<Counting>();
      counting = adapter.get();
      return adapter;
    };
    cycle = std::make_unique<HostedCycle>(scene, builtins(), options);
    for (ArmIndex i = 0; i < 2; ++i) {
      JointVector q = scene.arms[i].q_start;
      q[1] += 0.2;
      robots.emplace_back(cycle->models()[i], gravity[i] == Gravity::cycle, q);
      robots[i].step(joint_constant(7, 0));
      robots[i].q = q;
      robots[i].dq.setZero();
      cycle->signals(i).has_effort = effort;
    }
    take_in();
  }
  void take_in() {
    for (ArmIndex i = 0; i < 2; ++i) {
      ArmSignals& signals = cycle->signals(i);
      std::copy(robots[i].q.begin(), robots[i].q.end(), signals.position.begin());
      std::copy(robots[i].dq.begin(), robots[i].dq.end(), signals.velocity.begin());
      std::copy(robots[i].tau_J.begin(), robots[i].tau_J.end(), signals.effort.begin());
    }
  }
  JointVector command(ArmIndex i) const {
    return Eigen::Map<const Eigen::VectorXd>(cycle->signals(i).effort_command.data(), 7);
  }
  void move() {
    for (ArmIndex i = 0; i < 2; ++i) robots[i].step(command(i));
  }
  bool step() {
    take_in();
    const bool any = cycle->step(0.001);
    move();
    return any;
  }
  bool runs(const char* name) const {
    return (cycle->modes().active() & bit(cycle->modes().find(name))) != 0;
  }
  void steps(int n) {
    for (int i = 0; i < n; ++i) step();
  }
  // Steps until the scene's controllets run, at the latest when an activation is complete.
  bool start() {
    steps(kFirstStart);
    return runs("left_joints") && runs("right_pose");
  }
  // A user's request while the loop runs: taken at the next cycle boundary.
  Verdict post(const Request& request) {
    std::uint64_t ticket = 0;
    return cycle->modes().post(std::span(&request, 1), ticket);
  }
  Verdict activate(const char* name) { return post({.activate = bit(cycle->modes().find(name))}); }
  bool relayed() {  // the relay has seen all events
    return eventually([&] {
      const std::lock_guard lock(counting->mutex);
      return !counting->cycles.empty() && counting->cycles.back() == cycle->data().tick.cycle;
    });
  }
  // Number of starts of an instance, as far as the relay has reported.
  int starts(const char* name) {
    const std::lock_guard lock(counting->mutex);
    const InstanceSet one = bit(cycle->modes().find(name));
    return static_cast<int>(std::count_if(counting->events.begin(), counting->events.end(), [&](auto& e) {
      return e.kind == EventKind::switched && (e.started & one) != 0;
    }));
  }
  JointVector gravity(ArmIndex i) {
    robots[i].terms.update(robots[i].q, robots[i].dq);
    return robots[i].terms.g();
  }

  Scene scene;
  std::unique_ptr<HostedCycle> cycle;
  std::vector<Robot> robots;
  Counting* counting = nullptr;
};

}  // namespace multipanda::test
