#pragma once

#include <functional>
#include <memory>
#include <span>
#include <type_traits>

#include "core/controllets/contact_bounds.hpp"
#include "core/controllets/descriptor.hpp"
#include "core/controllets/spec_table.hpp"
#include "core/model/model_terms.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

// An arm during one cycle, as a controllet or feature sees it.
struct OwnedArm {
  const ArmState* state = nullptr;  // this cycle's measurement
  ModelTerms* terms = nullptr;      // this cycle's model, computed on demand
  JointVector* tau = nullptr;  // output: torque without gravity and friction [N m] (n x 1), zero at entry
  // The arm that stands on this one, on the link behind carried_joint (0 to n-1); nullptr: none.
  ModelTerms* carried = nullptr;
  std::size_t carried_joint = 0;

  const ArmModel& model() const { return terms->model(); }
  const JointVector& q() const { return state->q; }
  const JointVector& dq() const { return state->dq; }
};

// Data for start() and update(), all built before the loop.
struct ControlContext {
  double dt = 0;      // since this instance's last tick [s]
  double time_s = 0;  // the loop's time [s]
  std::span<OwnedArm> arms;
  std::span<Reference> inputs;  // in the order of ControlletDescriptor::inputs, advanced to this cycle
  const ParameterSet* parameters = nullptr;
  std::span<double> outputs;  // ControlletDescriptor::outputs, concatenated in order
  // All arms of the scene, in order, for reading only. tau: of own arms what the law does, else nullptr.
  std::span<OwnedArm> scene_arms = {};
  // Bounds for laws that pull a hand to a set-point (bound_pull), reported by Reference::resist.
  ContactBounds contact = ContactBounds::lifted();
  bool stopped = false;  // of a hold: its arm was stopped and must not move until resumed
  // The arms that it observes, in order, for reading only: tau is nullptr. Their newest states, which may be
  // older than this cycle (ArmState::age_s).
  std::span<OwnedArm> observed = {};
};

enum class LawResult { ok, fault };

// A control law that owns one or more arms. All members are called by the loop's thread and never allocate,
// lock, log, throw or do I/O. The constructor builds whatever the law needs, from the models of its arms.
class Controllet {
 public:
  virtual ~Controllet() = default;

  // Takes over from the measured state. The references already begin at the measurement, and parameters
  // have their values. Called in the cycle of the switch, directly before the first update(). `fault`
  // refuses the start.
  virtual LawResult start(ControlContext& context) = 0;

  // One tick. Fills arms[i].tau. `fault` deactivates the controllet; its arms are held.
  virtual LawResult update(ControlContext& context) = 0;

  // Sets the references at the start. By default each input begins at the measured state (pose of E, joint
  // positions, zero otherwise). Override it for an input with another meaning, such as a shared frame.
  virtual void start_references(ControlContext& context);

  // The end effector of `arm` was redefined while this controllet runs: it is now X away from the old one,
  // E_new = E_old X. The model in the context already has the new one. Moves set-points along, so that the
  // arm does not move. By default all pose inputs of that arm; override it for poses that the law
  // keeps itself.
  virtual void end_effector_moved(ControlContext& context, std::size_t arm, const Pose& X);

  // Lowers upper bounds of parameters to the limits of these arms. Before the loop, once.
  virtual void bound_parameters(ParameterSet& /*parameters*/) const {}
};

// Argument of a controllet's factory: the models of its arms, in the order of the scene file, then of those
// that it observes.
using ArmModels = std::span<const std::shared_ptr<const ArmModel>>;

struct ControlletType {
  ControlletDescriptor descriptor;
  std::function<std::unique_ptr<Controllet>(ArmModels arms)> create;
};

// The type of a class with a static descriptor(). Its constructor takes the models, or nothing.
template <typename Law>
ControlletType controllet_type() {
  return {Law::descriptor(), [](ArmModels arms) -> std::unique_ptr<Controllet> {
            if constexpr (std::is_constructible_v<Law, ArmModels>) {
              return std::make_unique<Law>(arms);
            } else {
              return std::make_unique<Law>();
            }
          }};
}

}  // namespace multipanda
