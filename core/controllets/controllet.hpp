#pragma once

#include <memory>
#include <span>

#include "core/controllets/statement.hpp"
#include "core/model/model_terms.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

// One of the arms that a controllet owns, as it sees it during a cycle.
struct OwnedArm {
  const ArmState* state = nullptr;  // this cycle's measurement
  ModelTerms* terms = nullptr;      // this cycle's model, computed on demand
  JointVector* tau =
      nullptr;  // to be filled: torque without gravity and friction [N m] (n x 1), zero at entry

  const ArmModel& model() const { return terms->model(); }
  const JointVector& q() const { return state->q; }
  const JointVector& dq() const { return state->dq; }
};

// What update() has to work with. Everything in it was built before the loop.
struct ControlContext {
  double dt = 0;      // since this instance's last tick [s]
  double time_s = 0;  // the loop's time [s]
  std::span<OwnedArm> arms;
  std::span<Reference> inputs;  // in the order of Statement::inputs, already advanced to this cycle
  const ParameterSet* parameters = nullptr;
  std::span<double> outputs;  // Statement::outputs one behind the other
  // Every arm of the scene, in its order, whoever owns it: to look at, tau is nullptr.
  std::span<OwnedArm> scene_arms = {};
};

enum class LawResult { ok, fault };

// One control law, owning one or more arms. All members are called by the loop's thread and never allocate,
// lock, log, throw or do I/O. What it needs is built in its constructor, from the models of its arms.
class Controllet {
 public:
  virtual ~Controllet() = default;

  // Takes over from the measured state: the references have been started at the measurement, parameters are
  // at their values. Called in the cycle of the hand-over, right before the first update(). `fault` refuses.
  virtual LawResult start(ControlContext& context) = 0;

  // One tick. Fills arms[i].tau. `fault` takes the controllet out and its arms to hold.
  virtual LawResult update(ControlContext& context) = 0;

  // How update() sets references at the start: by default each input begins at the measured state (pose of E,
  // joint positions, zero otherwise). A controllet whose input means something else (a shared frame) says so
  // here.
  virtual void start_references(ControlContext& context);
};

// What a controllet's factory gets: the models of the arms it will own, in the order of the scene file.
using ArmModels = std::span<const std::shared_ptr<const ArmModel>>;

struct ControlletType {
  Statement statement;
  std::unique_ptr<Controllet> (*create)(ArmModels arms) = nullptr;
};

}  // namespace multipanda
