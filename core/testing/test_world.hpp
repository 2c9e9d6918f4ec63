#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/model/model_terms.hpp"
#include "core/testing/test_arm.hpp"
#include "core/types/time.hpp"

namespace multipanda::test {

// A world of arms without contacts or clock, for tests: M ddq = tau - c, one period per step, in lock-step.
// `tamper` injects faults, and `due_in_step` delays or drops packets. Steps neither allocate nor lock, unless
// the injected functions do.
class TestWorld final : public Backend {
 public:
  // `feels`: the estimated force is what `tamper` says, instead of the loop's own estimate.
  explicit TestWorld(const std::vector<std::shared_ptr<const ArmModel>>& models, bool feels = false);

  // Called for every arm that is due, before the loop reads its state.
  std::function<void(ArmIndex, std::uint64_t step, ArmState&)> tamper;
  // The arms whose packets arrive in step 0, 1, ...; each such arm advances by one period. Default: all.
  std::function<ArmSet(std::uint64_t step)> due_in_step;
  double step_s = kArmPeriod;  // loop time per step: less than a period if packets arrive at different times
  double start_s = 0;          // loop time of the first step

  void set_position(ArmIndex arm, const JointVector& q) { arms_[arm].q = q; }
  void set_velocity(ArmIndex arm, const JointVector& dq) { arms_[arm].dq = dq; }
  const JointVector& position(ArmIndex arm) const { return arms_[arm].q; }
  const JointVector& velocity(ArmIndex arm) const { return arms_[arm].dq; }
  const JointVector& torque(ArmIndex arm) const { return arms_[arm].tau; }  // last one received
  std::uint64_t steps() const { return step_; }

  std::size_t arm_count() const override { return arms_.size(); }
  Capabilities capabilities(ArmIndex) const override {
    return {.simulated = true, .lockstep = true, .has_external_torque = feels_};
  }
  ArmSet wait() override;
  LoopTime now() const override { return now_; }
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) override;

 private:
  struct Arm {
    ModelTerms terms;
    JointVector q, dq, tau;
    std::uint64_t sequence = 0;
  };
  std::vector<Arm> arms_;
  bool feels_;
  std::uint64_t step_ = 0;
  LoopTime now_;
};

// Arms of TestArm on rotated bases, named "arm0", "arm1", ...; the limits of every arm as in the URDF.
std::vector<std::shared_ptr<const ArmModel>> test_models(std::size_t arms, std::size_t joints = 7);
CycleConfig test_config(const std::vector<std::shared_ptr<const ArmModel>>& models,
                        std::vector<InstanceConfig> controllets, std::size_t record_capacity = 0);

// A test world with its control cycle.
struct TestLoop {
  TestLoop(std::size_t arms, std::vector<InstanceConfig> controllets, const Registry& registry,
           std::size_t record_capacity = 0);
  TestLoop(std::vector<std::shared_ptr<const ArmModel>> arms, CycleConfig config, const Registry& registry,
           bool feels = false);

  void step() { cycle.step(world.wait()); }
  void steps(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) step();
  }
  MultimodeController& modes() { return cycle.modes(); }
  InstanceIndex find(std::string_view name) { return cycle.modes().find(name); }
  InstanceSet set(std::initializer_list<std::string_view> names);
  // Posts the request, runs one step and returns the answer.
  Answer ask(const Request& request);
  Answer activate(std::initializer_list<std::string_view> names) {
    return ask({.activate = set(names), .deactivate = 0});
  }
  // Checks that every arm has exactly one owner, by the owners and by the arms of the active instances. Empty
  // if so.
  std::string ownership_fault();

  std::vector<std::shared_ptr<const ArmModel>> models;
  TestWorld world;
  ControlCycle cycle;
};

}  // namespace multipanda::test
