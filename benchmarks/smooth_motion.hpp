#pragma once

#include <array>
#include <optional>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/model/arm_model.hpp"
#include "core/rt/pacer.hpp"
#include "scene/build.hpp"

namespace multipanda::bench {

// A backend of negligible cost: every arm swings about its home configuration along one table of states and
// ignores its torque, so that a step contains only the control cycle.
class SmoothMotion final : public Backend {
 public:
  enum class Pace { unpaced, realtime };
  static constexpr double kAmplitude = 0.02;    // [rad]
  static constexpr std::size_t kPeriods = 256;  // control periods per swing

  // `configs`: frames and loads of each arm.
  SmoothMotion(const std::vector<std::shared_ptr<const ArmModel>>& models,
               const std::vector<ArmConfig>& configs, Pace pace = Pace::unpaced);

  std::size_t arm_count() const override { return arms_.size(); }
  Capabilities capabilities(ArmIndex) const override {
    return {.simulated = true, .lockstep = true, .every_command_arrives = true};
  }
  void start() override { pacer_.start(); }
  ArmSet wait() override;
  LoopTime now() const override { return now_; }
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) override;

 private:
  struct Arm {
    JointVector q_home, tau;
    ArmConfig config;
  };
  struct Offset {
    std::array<double, kMaxJoints> q, dq;
  };
  std::vector<Arm> arms_;
  std::array<Offset, kPeriods> swing_;
  Pace pace_;
  Pacer pacer_;
  std::size_t step_ = 0;
  LoopTime now_;
};

}  // namespace multipanda::bench
