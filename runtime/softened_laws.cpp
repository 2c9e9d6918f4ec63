#include "runtime/softened_laws.hpp"

#include <algorithm>
#include <map>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/text.hpp"
#include "core/controllets/goal_parameters.hpp"
#include "core/cycle/control_cycle.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

constexpr double kEnough = 0.5;  // of a stiffness: what is softened less is not worth a warning

// Arms that stand where the scene begins, whatever is commanded.
class StillArms final : public Backend {
 public:
  StillArms(const Scene& scene, const CycleConfig& config) {
    for (std::size_t i = 0; i < scene.arms.size(); ++i) {
      const ArmConfig arm = arm_config(scene.arms[i]);
      ArmState& state = states_.emplace_back();
      state.q = scene.arms[i].q_start;
      state.dq = state.tau_J_d = joint_constant(config.arms[i].model->joint_count(), 0);
      state.tau_J = state.dq;
      state.frames = arm.frames;
      state.tool = arm.tool;
      state.load = arm.load;
      state.config_version = 1;
      state.mode = ArmMode::move;
    }
  }
  std::size_t arm_count() const override { return states_.size(); }
  Capabilities capabilities(ArmIndex) const override { return {.simulated = true, .lockstep = true}; }
  ArmSet wait() override { return ArmSet::all(states_.size()); }
  LoopTime now() const override { return {periods_ * kArmPeriodNs.count()}; }
  void read(ArmSet, std::span<ArmState> states) override {
    for (ArmState& state : states_) {
      state.t_robot = {static_cast<std::int64_t>(++state.sequence) * kArmPeriodNs.count()};
      state.t_host = host_now();
    }
    std::ranges::copy(states_, states.begin());
  }
  void write(ArmSet, std::span<const ArmCommand>) override { ++periods_; }
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return refuse_request("they stand"); }

 private:
  std::vector<ArmState> states_;
  std::int64_t periods_ = 0;
};

// Arms at rest feel nothing, with and without a sensor.
CycleConfig estimating(CycleConfig config) {
  for (auto& arm : config.arms) arm.force_sensor.reset();
  return config;
}

class Trial {
 public:
  Trial(const Scene& scene, const Registry& registry)
      : config_(build_cycle_config(scene)),
        arms_(scene, config_),
        cycle_(estimating(config_), registry, arms_) {
    cycle_.step(arms_.wait());
  }
  MultimodeController& modes() { return cycle_.modes(); }
  bool ask(const Request& request, double then) {
    std::uint64_t ticket = 0;
    Answer answer;
    if (modes().post(std::span(&request, 1), ticket) != Verdict::accepted) return false;
    for (double t = 0; t <= then; t += kArmPeriod) cycle_.step(arms_.wait());
    return modes().poll(ticket, answer) && answer.accepted();
  }
  bool activate(InstanceIndex i) {
    Request request{.kind = Request::Kind::switch_controllets, .activate = bit(i)};
    request.only = true;
    return ask(request, 0);
  }
  void set(InstanceIndex i, std::size_t parameter, std::vector<double> values, double factor) {
    Request request{.kind = Request::Kind::set_parameter};
    request.instance = i;
    request.index = static_cast<std::uint16_t>(parameter);
    request.size = static_cast<std::uint8_t>(values.size());
    std::ranges::transform(values, request.values.begin(), [&](double value) { return factor * value; });
    (void)ask(request, ParameterSet::kRamp);
  }
  double share(InstanceIndex i) {
    double least = 1;
    std::size_t at = 0;
    for (const OutputSpec& spec : modes().instance(i).output_specs()) {
      if (spec.name.ends_with("stiffness_share")) least = std::min(least, modes().instance(i).outputs()[at]);
      at += spec.size;
    }
    return least;
  }

 private:
  CycleConfig config_;
  StillArms arms_;
  ControlCycle cycle_;
};

}  // namespace

std::vector<std::string> softened_laws(const Scene& scene, const Registry& registry) {
  std::vector<std::string> found;
  Trial trial(scene, registry);
  for (auto i = static_cast<InstanceIndex>(scene.arms.size()); i < trial.modes().instance_count(); ++i) {
    if (!trial.activate(i)) continue;
    const double share = trial.share(i);
    if (!(share < kEnough)) continue;
    const Instance& instance = trial.modes().instance(i);
    std::vector<std::string> arms, gains;
    for (const ArmIndex arm : instance.arm_list()) arms.push_back(scene.arms[arm].name);
    // Gains that are too large by themselves, with the others lowered.
    std::map<std::size_t, std::vector<double>> asked;
    for (std::size_t p = 0; p < instance.parameter_count(); ++p)
      if (is_stiffness(instance.parameter_spec(p))) asked[p] = instance.parameter(p);
    for (const auto& [p, values] : asked) trial.set(i, p, values, share);
    for (const auto& [p, values] : asked) {
      trial.set(i, p, values, 1);
      if (trial.share(i) < kEnough) gains.push_back(instance.parameter_names()[p]);
      trial.set(i, p, values, share);
    }
    found.push_back(fmt::format(
        "controllet '{}' has {:.2g} of the stiffness that it asks for, as {} {} no more at the start of the "
        "scene: lower {}, or declare the hand or tool, whose inertia bears it (stiffness_share shows it "
        "live)",
        instance.name(), share, fmt::join(arms, ", "), arms.size() == 1 ? "bears" : "bear",
        gains.empty() ? "its stiffness" : fmt::format("{}", fmt::join(gains, ", "))));
  }
  return found;
}

}  // namespace multipanda
