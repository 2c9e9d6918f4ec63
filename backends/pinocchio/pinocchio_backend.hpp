#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "backends/simulated_arm/request_box.hpp"
#include "backends/simulated_arm/simulated_arm.hpp"
#include "core/cycle/backend.hpp"
#include "core/rt/pacer.hpp"
#include "core/types/time.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// The scene's arms as rigid bodies in empty space, in lock-step: an independent reference for contact-free
// MuJoCo, and a world for tests without an engine. Objects of the scene are ignored.
//
//   (M(q) + J) ddq = tau_motor - tau_f(dq) - C(q, dq) dq - g(q)
//
// with the motors' inertia J, the hand, the tool and the actual load, integrated by the
// classical fourth-order Runge-Kutta method, motor torques constant over a physics step. The arm's own
// behavior (frames, load, modes, delay, noise) is backends/simulated_arm, as in all simulated backends.
class PinocchioBackend : public Backend {
 public:
  // Throws std::invalid_argument if the scene cannot be built or has friction beyond the torque sensor.
  explicit PinocchioBackend(const Scene& scene, bool paced = false);

  std::size_t arm_count() const override { return arms_.size(); }
  Capabilities capabilities(ArmIndex arm) const override;
  void start() override;
  void finish() override;
  ArmSet wait() override;
  LoopTime now() const override { return {periods_ * kArmPeriodNs.count()}; }
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  std::uint64_t overruns() const override { return paced_ ? pacer_.overruns() : 0; }
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) override;
  std::future<RequestAnswer> request(WorldRequest request) override;

 private:
  struct Arm {
    SimulatedArm behavior;
    ModelTerms plant;  // with the actual loads
    std::optional<JointFriction> friction;
    JointVector motor_inertia;  // before the torque sensor; empty: none
    JointVector q_start, q, dq;
    PlantMeasurement measurement;
  };
  struct Rates {
    JointVector dq, ddq;
  };
  void advance();
  void step(Arm& arm, double dt);
  Rates rates(Arm& arm, const JointVector& q, const JointVector& dq, const JointVector& tau_motor);
  void measure(Arm& arm);
  void take_requests();
  ArmReply apply(const WorldRequest& request);
  void reset();

  bool paced_;
  std::size_t substeps_;
  std::deque<Arm> arms_;
  Pacer pacer_;
  std::int64_t periods_ = 0;
  bool commanded_ = false;  // commands are ready for the next period
  bool paused_ = false;
  RequestBox requests_;
};

}  // namespace multipanda
