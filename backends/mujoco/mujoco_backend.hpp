#pragma once

#include <array>
#include <deque>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "backends/arm/request_box.hpp"
#include "backends/arm/simulated_arm.hpp"
#include "backends/mujoco/world.hpp"
#include "core/cycle/backend.hpp"
#include "core/rt/pacer.hpp"

namespace multipanda {

enum class Pace : std::uint8_t {
  realtime,  // a step per millisecond of the wall clock
  unpaced    // as fast as the loop runs
};

struct MujocoOptions {
  Pace pace = Pace::realtime;
  std::filesystem::path meshes;  // shown in pictures in place of the primitives; empty: primitives
};

// A scene in MuJoCo, in lock-step with the loop: the world stands still while the loop computes; after
// write() the next wait() moves it on by one control period of 1 ms in `substeps` physics steps. All arms are
// due in every cycle. docs/simulation.md says what is simulated and what is not.
//
// Deterministic: the same scene, seed and commands give the same bits, on the same machine and libraries.
//
// Events `place` of the scene's timeline are carried out here, each at the beginning of the first period that
// does not begin before its time; where the object would stand inside something the world stops (fault()).
//
// Requests are taken at the next wait(). Beyond those to the arm: PlaceObject (a free object, at rest;
// refused if it would stand in something), ResetSimulation (everything to the start; loop time goes on; the
// arms report `recovering` for one period, so that the controllets let go), PauseSimulation (the loop goes on
// at the wall clock's pace with the same states, commands are ignored, now() stands still: dt is 0).
//
// If MuJoCo fails or its state runs away, the world stops, wait() returns nothing from then on and fault()
// says why.
class MujocoBackend : public Backend {
 public:
  static constexpr double kPeriod = 0.001;  // [s]

  // Throws std::invalid_argument if the scene cannot be built; nothing moves before start().
  explicit MujocoBackend(const Scene& scene, MujocoOptions options = {});

  std::size_t arm_count() const override { return arms_.size(); }
  Capabilities capabilities(ArmIndex arm) const override;
  void start() override;
  void finish() override;
  ArmSet wait() override;
  LoopTime now() const override;
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  std::uint64_t overruns() const override { return options_.pace == Pace::realtime ? pacer_.overruns() : 0; }
  std::future<ArmAnswer> request(ArmIndex arm, ArmRequest request) override;

  bool failed() const { return failed_; }
  std::string fault() const { return fault_.data(); }  // empty: none

  // For pictures and tests; loop thread, or while the loop stands.
  const World& world() const { return world_; }
  World& world() { return world_; }
  const SimulatedArm& arm(ArmIndex i) const { return arms_[i].behaviour; }

 private:
  struct Arm {
    SimulatedArm behaviour;
    std::optional<JointFriction> friction;
    JointVector q_start;
    JointVector q, dq;              // of the plant
    JointVector tau_motor;          // in the present physics step
    JointVector friction_explicit;  // friction less its part that MuJoCo integrates implicitly
    PlantMeasurement measurement;   // of the present period
  };
  struct PlannedPlace {
    std::int64_t period = 0;  // at the beginning of which it happens
    std::size_t object = 0;
    Pose X_WO;
  };
  void plan_places(const Scene& scene);
  bool carry_out_places();
  void advance();
  void take_requests();
  ArmReply apply(const RequestBox::Posted& posted);
  void reset();
  void measure_start(ArmIndex arm);
  void drive(ArmIndex arm, double dt);
  void observe(ArmIndex arm, double weight);
  void fail(const char* why);

  MujocoOptions options_;
  std::size_t substeps_;
  World world_;
  std::deque<Arm> arms_;
  Pacer pacer_;
  std::vector<PlannedPlace> places_;  // by time
  std::size_t next_place_ = 0;
  bool has_stiction_ = false;
  std::int64_t periods_ = 0;
  bool commanded_ = false;  // a period's commands wait to be carried out
  bool paused_ = false;
  bool failed_ = false;
  std::array<char, 512> fault_{};
  RequestBox requests_;
};

}  // namespace multipanda
