#include "fci/simulated_time/testing/tested_run.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "scene/build.hpp"

namespace multipanda::fci::test {
namespace {

// A square wave of 25 Hz, which the limit of the rate makes a triangle, and damping.
class Slew final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    return {.type = "slew", .doc = "For tests.", .arms = 1, .inputs = {}, .parameters = {}, .outputs = {}};
  }
  LawResult start(ControlContext&) override {
    t_ = 0;
    return LawResult::ok;
  }
  LawResult update(ControlContext& context) override {
    t_ += context.dt;
    OwnedArm& arm = context.arms[0];
    const double sign = std::fmod(t_, 0.04) < 0.02 ? 1 : -1;
    *arm.tau = -2 * arm.dq();
    for (Eigen::Index i = 0; i < 4; ++i) (*arm.tau)[i] += (i % 2 == 0 ? 12 : -12) * sign;
    return LawResult::ok;
  }

 private:
  double t_ = 0;
};

InstanceConfig instance(const std::string& name, const std::string& type, std::vector<ArmIndex> arms) {
  return {
      .name = name, .type = type, .arms = std::move(arms), .features = {}, .parameters = {}, .inputs = {}};
}

Target goal(std::size_t size, double duration_s) {
  Target target;
  target.size = static_cast<std::uint8_t>(size);
  target.duration_s = duration_s;
  return target;
}

Request request_of(const MultimodeController& modes, const std::string& name, const std::string& input,
                   const Target& target) {
  Request request;
  request.kind = Request::Kind::set_target;
  request.instance = modes.find(name);
  request.index = static_cast<std::uint16_t>(modes.instance(request.instance).find_input(input));
  request.target = target;
  return request;
}

}  // namespace

Scene two_arms(const PlantFidelity& plant) {
  Scene scene;
  scene.name = "two arms in simulated time";
  scene.seed = 7;
  scene.plant = plant;
  for (int i = 0; i < 2; ++i) {
    SceneArm arm;
    arm.name = i == 0 ? "left" : "right";
    arm.model = i == 0 ? "fer" : "fr3";
    arm.hand = i == 0;
    arm.movable_fingers = false;
    // Real arms have motors; without their inertia a bare wrist is not stable behind 1 to 2 ms of delay.
    auto robot = std::make_shared<RobotDescription>(robot_of(arm));
    robot->motor_inertia = joint_constant(7, kAssumedMotorInertia);
    arm.plant_robot = std::move(robot);
    arm.X_WB = {rotation_from_rpy({0.05, -0.1, 0.7 * i}), Vector3(0.3, 1.0 - 2.0 * i, 0.4)};
    const auto model = build_arm_model(arm);
    arm.q_start = model->q_home();
    arm.safety = SafetyLimits::of(*model);
    scene.arms.push_back(arm);
  }
  ModelTerms left(build_arm_model(scene.arms[0]));
  left.set_config(arm_config(scene.arms[0]).frames, {}, {});
  left.update(scene.arms[0].q_start, joint_constant(7, 0));
  const Vector3 p_WE = left.X_WE().position;
  SceneObject table;
  table.name = "table";
  table.size = Vector3(0.4, 0.4, 0.1);
  table.X_WO.position = p_WE - Vector3(0, 0, 0.02 + 0.05);
  scene.objects.push_back(table);
  scene.controllets = {
      instance("left_joints", "joint_impedance", {0}),
      instance("right_joints", "joint_impedance", {1}),
      {.name = "left_pose",
       .type = "cartesian_impedance",
       .arms = {0},
       .features = {},
       .parameters = {{.name = "translational_stiffness_n_per_m", .values = {600}}},
       .inputs = {}},
      instance("both", "dual_cartesian_impedance", {0, 1}),
      instance("left_slew", "slew", {0}),
      instance("right_slew", "slew", {1}),
  };
  return scene;
}

Registry laws() {
  Registry registry = Registry::with_builtins();
  registry.add(controllet_type<Slew>());
  return registry;
}

SimulatedTimeOptions plain_times(std::size_t arms, std::uint64_t seed) {
  const LinkTiming link{.delay = {.least_ns = 100'000}, .loss = 0};
  SimulatedTimeOptions options{.seed = seed};
  options.arms.assign(arms, {.to_client = link, .to_arm = link});
  options.client = {.wake = {}, .compute = {.least_ns = 100'000}, .stalls_per_s = 0, .stall = {}};
  return options;
}

Request switch_to(const MultimodeController& modes, const std::vector<std::string>& names) {
  Request request;
  for (const auto& name : names) request.activate |= bit(modes.find(name));
  return request;
}

Request joint_goal(const MultimodeController& modes, const std::string& name, const JointVector& q,
                   double duration_s) {
  Target target = goal(static_cast<std::size_t>(q.size()), duration_s);
  std::copy(q.begin(), q.end(), target.values.begin());
  return request_of(modes, name, "joints", target);
}

Request pose_goal(const SimulatedRun& run, MultimodeController& modes, const std::string& name,
                  const std::string& input, ArmIndex arm, const Vector3& by_W, double duration_s) {
  const ArmState& state = run.data().state[arm];
  ModelTerms terms(run.data().terms[arm].shared_model());
  terms.update(state);
  Pose X_WE = terms.X_WE();
  X_WE.position += by_W;
  return request_of(modes, name, input, pose_target(X_WE, duration_s));
}

}  // namespace multipanda::fci::test
