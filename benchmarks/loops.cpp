#include "benchmarks/loops.hpp"

#include <cmath>
#include <numbers>
#include <stdexcept>

#include <fmt/format.h>

#include "scene/load.hpp"

namespace multipanda::bench {

namespace {

constexpr double kGoalTime = 3600;  // [s]

std::vector<std::shared_ptr<const ArmModel>> first_models(const Arms& arms, std::size_t count) {
  return {arms.models.begin(), arms.models.begin() + static_cast<std::ptrdiff_t>(count)};
}

CycleConfig cycle_config(const Arms& arms, std::size_t count, std::vector<InstanceConfig> instances) {
  CycleConfig config;
  config.arms.assign(arms.arms.begin(), arms.arms.begin() + static_cast<std::ptrdiff_t>(count));
  config.controllets = std::move(instances);
  config.obstacles = arms.obstacles;
  return config;
}

void expect(const MultimodeController& modes, InstanceSet expected) {
  if ((modes.active() & expected) == expected) return;  // an arm that is only observed is in hold
  throw std::runtime_error(
      fmt::format("expected instances {:#x} to run, but {:#x} ran: the safety stage deactivated one",
                  expected, modes.active()));
}

InstanceSet laws_of(const MultimodeController& modes, std::size_t instances) {
  InstanceSet set = 0;
  for (std::size_t i = 0; i < instances; ++i) set |= bit(modes.find(fmt::format("law{}", i)));
  return set;
}

Target slow_goal(const Reference& input) {
  Target target;
  if (input.spec().quantity == Quantity::pose) {
    Pose X = input.pose();
    X.position += Vector3(0.02, 0.01, -0.02);
    target = pose_target(X);
  } else {
    target.size = static_cast<std::uint8_t>(input.size());
    for (std::size_t i = 0; i < input.size(); ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      target.values[i] = input.spec().quantity == Quantity::joints ? input.joints()[k] + 0.02 : 0.02;
    }
  }
  target.duration_s = kGoalTime;
  return target;
}

}  // namespace

Scene scene_of(std::size_t arms, const Registry& registry) {
  std::string text = "name: benchmark\narms:\n";
  for (std::size_t i = 0; i < arms; ++i) {
    text += fmt::format(
        "  - {{name: arm{}, model: fer, known_friction: model, base: {{position_m: [{}, {}, 0]}}}}\n", i,
        2 * (i / 2), i % 2 == 0 ? 0.26 : -0.26);
  }
  text += "objects:\n  - {name: floor, shape: plane}\n";
  return parse_scene(text, "benchmark.yaml", registry);
}

Arms::Arms(const Registry& registry) : Arms(scene_of(kMaxArms, registry)) {}

Arms::Arms(const Scene& scene) {
  const CycleConfig config = build_cycle_config(scene);
  arms = config.arms;
  obstacles = config.obstacles;
  // All arms of the scene are equal.
  configs.assign(scene.arms.size(), arm_config(scene.arms.front()));
  for (const auto& arm : arms) models.push_back(arm.model);
}

std::vector<InstanceConfig> instances_of(const ControlletType& type, std::size_t arms,
                                         const std::vector<std::string>& features) {
  std::vector<InstanceConfig> instances;
  const std::size_t each = type.descriptor.arms, observed = type.descriptor.observes;
  for (std::size_t first = 0; first + each + observed <= arms; first += each) {
    InstanceConfig config{.name = fmt::format("law{}", instances.size()), .type = type.descriptor.type};
    for (std::size_t k = 0; k < each; ++k) config.arms.push_back(first + k);
    for (std::size_t k = 0; k < observed; ++k) config.observes.push_back(first + each + k);
    config.features = features;
    instances.push_back(config);
  }
  return instances;
}

void post_slow_goals(ControlCycle& cycle, InstanceSet instances) {
  for (InstanceIndex i = 0; i < cycle.modes().instance_count(); ++i) {
    if ((instances & bit(i)) == 0) continue;
    for (Reference& input : cycle.modes().instance(i).inputs()) {
      if (const Verdict verdict = input.post(slow_goal(input)); verdict != Verdict::accepted) {
        throw std::runtime_error(
            fmt::format("goal of input {}: {}", input.spec().name, std::string(to_string(verdict))));
      }
    }
  }
}

MotionLoop::MotionLoop(const Arms& arms, std::size_t count, std::vector<InstanceConfig> instances,
                       const Registry& registry, SmoothMotion::Pace pace)
    : world(first_models(arms, count), arms.configs, pace),
      cycle(cycle_config(arms, count, std::move(instances)), registry, world) {}

InstanceSet MotionLoop::set(std::initializer_list<std::string_view> names) const {
  InstanceSet set = 0;
  for (const auto name : names) set |= bit(cycle.modes().find(name));
  return set;
}

void MotionLoop::activate(InstanceSet instances) {
  cycle.modes().activate_at_start(instances);
  step();
  expect_active(instances);
  post_slow_goals(cycle, instances);
  step();
}

void MotionLoop::expect_active(InstanceSet instances) const { expect(cycle.modes(), instances); }

std::shared_ptr<MotionLoop> motion_loop(const Arms& arms, std::size_t count, const ControlletType& type,
                                        const Registry& registry, const std::vector<std::string>& features) {
  auto instances = instances_of(type, count, features);
  const std::size_t n = instances.size();
  auto loop = std::make_shared<MotionLoop>(arms, count, std::move(instances), registry);
  loop->activate(laws_of(loop->cycle.modes(), n));
  return loop;
}

Scene simulation_scene(std::size_t arms, const Registry& registry) {
  Scene scene = arms == 2 ? load_scene("two_arms", registry) : scene_of(arms, registry);
  const char* law = arms == 1 ? "cartesian_impedance" : "dual_cartesian_impedance";
  scene.controllets = instances_of(*registry.controllet(law), arms);
  scene.contact_bounds = ContactBounds::lifted();
  return scene;
}

SimulationLoop::SimulationLoop(std::size_t arms, const Registry& registry,
                               const std::vector<std::string>& features)
    : scene_(simulation_scene(arms, registry)) {
  for (auto& law : scene_.controllets) law.features = features;
  world_ = std::make_unique<MujocoBackend>(scene_, MujocoOptions{.pace = Pace::unpaced});
  cycle_ = std::make_unique<ControlCycle>(build_cycle_config(scene_), registry, *world_);
  laws_ = laws_of(cycle_->modes(), scene_.controllets.size());
  world_->start();
  cycle_->modes().activate_at_start(laws_);
  step();
  expect(cycle_->modes(), laws_);
  post_slow_goals(*cycle_, laws_);
}

void SimulationLoop::verify() const {
  if (world_->failed()) throw std::runtime_error(world_->fault());
  expect(cycle_->modes(), laws_);
}

SmoothMotion::SmoothMotion(const std::vector<std::shared_ptr<const ArmModel>>& models,
                           const std::vector<ArmConfig>& configs, Pace pace)
    : pace_(pace) {
  for (std::size_t i = 0; i < models.size(); ++i) {
    arms_.push_back({models[i]->q_home(), joint_constant(models[i]->joint_count(), 0), configs[i]});
  }
  constexpr double kOmega = 2 * std::numbers::pi / (1e-3 * kPeriods);
  for (std::size_t k = 0; k < kPeriods; ++k) {
    for (std::size_t j = 0; j < kMaxJoints; ++j) {
      const double phase = kOmega * 1e-3 * static_cast<double>(k) + static_cast<double>(j);
      swing_[k].q[j] = kAmplitude * std::sin(phase);
      swing_[k].dq[j] = kAmplitude * kOmega * std::cos(phase);
    }
  }
}

ArmSet SmoothMotion::wait() {
  if (pace_ == Pace::realtime) pacer_.wait();
  ++step_;
  now_ = {static_cast<std::int64_t>(step_) * 1'000'000};
  return ArmSet::all(arms_.size());
}

void SmoothMotion::read(ArmSet due, std::span<ArmState> states) {
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    if (!due.contains(i)) continue;
    const Arm& arm = arms_[i];
    const Offset& offset = swing_[(step_ + 37 * i) % kPeriods];
    ArmState& state = states[i];
    if (state.sequence == 0) {
      state.mode = ArmMode::move;
      state.config_version = 1;
      state.frames = arm.config.frames;
      state.tool = arm.config.tool;
      state.load = arm.config.load;
    }
    state.sequence = step_;
    state.t_robot = {now_.ns};
    const Eigen::Index n = arm.q_home.size();
    state.q = arm.q_home + Eigen::Map<const Eigen::VectorXd>(offset.q.data(), n);
    state.dq = Eigen::Map<const Eigen::VectorXd>(offset.dq.data(), n);
    state.tau_J = state.tau_J_d = arm.tau;
  }
}

void SmoothMotion::write(ArmSet due, std::span<const ArmCommand> commands) {
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    if (due.contains(i)) arms_[i].tau = commands[i].tau_cmd;
  }
}

std::future<RequestAnswer> SmoothMotion::request(ArmIndex, ArmRequest) {
  return refuse_request("this world only plays back a motion");
}

}  // namespace multipanda::bench
