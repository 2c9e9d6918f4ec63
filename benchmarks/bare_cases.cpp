#include <stdexcept>

#include <fmt/format.h>

#include "benchmarks/bare/bare_libraries.hpp"
#include "benchmarks/cases.hpp"

namespace multipanda::bench {
namespace {

constexpr double kTolerance = 1e-9;  // [N m]
constexpr std::size_t kInputs = SmoothMotion::kPeriods;

using Input = BareDualImpedance::Input;

struct Recorded {
  std::vector<std::array<Input, 2>> inputs;
  std::vector<std::array<Vector7, 2>> torques;  // of the controllet
};

// States, set-points and torques of DC, in its own control cycle.
Recorded record(const Arms& arms, const Registry& registry, BareDualImpedance::Gains& gains) {
  auto instances = instances_of(*registry.controllet("dual_cartesian_impedance"), 2);
  instances[0].parameters = {{"goals", {1}}};  // separate: set-points are its inputs
  MotionLoop loop(arms, 2, instances, registry);
  const InstanceSet law = loop.set({"law0"});
  loop.activate(law);
  const Instance& dual = loop.cycle.modes().instance(loop.cycle.modes().find("law0"));
  const auto parameter = [&](const char* name) { return dual.parameter(dual.find_parameter(name)); };
  gains.translational_stiffness =
      Eigen::Map<const Vector3>(parameter("translational_stiffness_n_per_m").data());
  gains.rotational_stiffness = parameter("rotational_stiffness_nm_per_rad")[0];
  gains.damping_ratio = parameter("damping_ratio")[0];
  gains.null_space_stiffness = parameter("nullspace_stiffness_nm_per_rad")[0];

  // It started in the first step of activate(); its null-space posture is the state of that step.
  const std::size_t first_input = dual.find_input("first_pose");
  const auto& data = loop.cycle.data();
  Recorded recorded;
  SmoothMotion fresh(arms.models, arms.configs);
  std::vector<ArmState> start(arms.models.size());
  fresh.read(fresh.wait(), start);
  for (std::size_t k = 0; k < kInputs; ++k) {
    loop.step();
    auto& inputs = recorded.inputs.emplace_back();
    auto& torques = recorded.torques.emplace_back();
    for (std::size_t i = 0; i < 2; ++i) {
      const Reference& pose = dual.inputs()[first_input + i];
      inputs[i] = {data.state[i].q,     data.state[i].dq,           pose.pose(),
                   pose.twist().vector, pose.acceleration().vector, start[i].q};
      torques[i] = data.tau_controllet[i];
    }
  }
  loop.expect_active(law);
  return recorded;
}

Case dual_case(const Arms& arms, const Registry& registry) {
  BareDualImpedance::Gains gains;
  auto recorded = std::make_shared<Recorded>(record(arms, registry, gains));
  auto bare = std::make_shared<BareDualImpedance>(*arms.models[0], *arms.models[1],
                                                  arms.configs[0].frames.X_FE, gains);
  const auto check = [recorded, bare] {
    double worst = 0;
    for (std::size_t k = 0; k < kInputs; ++k) {
      const auto& tau = bare->torques(recorded->inputs[k]);
      for (std::size_t i = 0; i < 2; ++i) {
        const double off = (tau[i] - recorded->torques[k][i]).lpNorm<Eigen::Infinity>();
        worst = off <= kTolerance ? std::max(worst, off) : std::numeric_limits<double>::infinity();
      }
    }
    if (!(worst <= kTolerance)) {
      throw std::runtime_error("the bare two-arm math and the controllet give different torques");
    }
  };
  check();
  return {"limits_us/dual_cartesian_impedance",
          [recorded, bare, k = std::size_t{0}]() mutable {
            (void)bare->torques(recorded->inputs[k]);
            k = (k + 1) % kInputs;
          },
          check};
}

Case pinocchio_case(const Arms& arms) {
  auto terms = std::make_shared<BarePinocchioTerms>(*arms.models[0]);
  auto world = std::make_shared<SmoothMotion>(arms.models, arms.configs);
  auto states = std::make_shared<std::vector<ArmState>>(arms.models.size());
  auto inputs = std::make_shared<std::vector<std::pair<Vector7, Vector7>>>();
  for (std::size_t k = 0; k < kInputs; ++k) {
    world->read(world->wait(), *states);
    inputs->emplace_back((*states)[0].q, (*states)[0].dq);
  }
  return {"limits_us/pinocchio_terms",
          [terms, inputs, k = std::size_t{0}]() mutable {
            terms->compute((*inputs)[k].first, (*inputs)[k].second);
            k = (k + 1) % kInputs;
          },
          {}};
}

Case mujoco_case(std::size_t count, const Registry& registry, const std::string& name) {
  auto backend = std::make_shared<MujocoBackend>(simulation_scene(count, registry),
                                                 MujocoOptions{.pace = Pace::unpaced});
  backend->start();
  World& world = backend->world();
  return {name, [backend, &world] { mj_step(world.model(), world.data()); }, {}};
}

}  // namespace

std::vector<Case> bare_cases(const Arms& arms, const Registry& registry, const Filter& selected) {
  std::vector<Case> cases;
  if (selected("limits_us/pinocchio_terms")) cases.push_back(pinocchio_case(arms));
  if (selected("limits_us/dual_cartesian_impedance")) cases.push_back(dual_case(arms, registry));
  for (const std::size_t count : kArmCounts) {
    const std::string name = fmt::format("limits_us/mj_step/{}", count);
    if (selected(name)) cases.push_back(mujoco_case(count, registry, name));
  }
  return cases;
}

}  // namespace multipanda::bench
