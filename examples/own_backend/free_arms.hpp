#pragma once

#include <vector>

#include "core/cycle/backend.hpp"
#include "core/model/model_terms.hpp"
#include "core/modes/registry.hpp"
#include "core/rt/pacer.hpp"

// Rigid arms without friction, delay or contact: M(q) ddq + C(q, dq) dq = tau. Gravity is compensated, as on
// the arm. The world is paused while the loop computes; write() starts a period, the next wait() carries
// it out.
class FreeArms : public multipanda::Backend {
 public:
  explicit FreeArms(const multipanda::BackendSetup& setup);

  std::size_t arm_count() const override { return arms_.size(); }
  multipanda::Capabilities capabilities(multipanda::ArmIndex) const override {
    return {.simulated = true, .lockstep = true};
  }
  void start() override { pacer_.start(); }
  multipanda::ArmSet wait() override;
  multipanda::LoopTime now() const override { return {periods_ * multipanda::kArmPeriodNs.count()}; }
  void read(multipanda::ArmSet due, std::span<multipanda::ArmState> states) override;
  void write(multipanda::ArmSet due, std::span<const multipanda::ArmCommand> commands) override;
  std::uint64_t overruns() const override { return paced_ ? pacer_.overruns() : 0; }

  using Backend::request;  // grippers and the world: refused
  std::future<multipanda::RequestAnswer> request(multipanda::ArmIndex, multipanda::ArmRequest) override {
    return multipanda::refuse_request("free arms take no requests");
  }

 private:
  struct Arm {
    multipanda::BackendSetup::Arm setup;
    multipanda::ModelTerms terms;
    multipanda::JointVector q, dq, tau;
  };
  std::vector<Arm> arms_;
  bool paced_;
  multipanda::Pacer pacer_;
  std::int64_t periods_ = 0;
  bool commanded_ = false;
};
