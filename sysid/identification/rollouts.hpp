#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "backends/mujoco/plant.hpp"
#include "backends/simulated_arm/friction.hpp"
#include "core/model/model_terms.hpp"
#include "models/robot_description.hpp"

// Many short simulations of one arm of a scene at once, on MuJoCo's own thread pool (mjbatch).
namespace multipanda {

// One simulation's world and workspace, owned by the batch; used by one thread at a time.
struct RolloutMember {
  mjModel* model = nullptr;                   // its own, since candidates change it
  mjData* data = nullptr;                     // valid during the call
  std::unique_ptr<ModelTerms> terms;          // the arm's own model, with declared tool and load
  std::optional<LinkFriction> link_friction;  // of the plant model, beyond the torque sensor
  JointVector q, dq, tau, before;             // workspace (n x 1)
};

// The data that a rollout needs from its world; the same for all members.
struct RolloutWorld {
  const World* world = nullptr;  // indices of joints and bodies in the model
  std::size_t joints = 0;
  std::size_t substeps = 1;
  double dt = 0.001;  // of a physics step [s]
};

class Rollouts {
 public:
  // The scene's arm alone with its plant model, and the scene's fixed objects. Fingers are closed, and
  // nothing of the timeline happens. Throws std::invalid_argument if the scene cannot be built. threads 0:
  // one per core.
  Rollouts(const Scene& scene, std::size_t arm, std::size_t members, int threads = 0);
  ~Rollouts();

  std::size_t size() const { return members_.size(); }
  const RolloutWorld& world() const { return world_; }
  RolloutMember& member(std::size_t i) { return members_[i]; }
  // Runs `work` for the members 0 to count - 1, on all threads. `work` must not throw. Returns false if
  // MuJoCo reported an error or the state diverged; error() has the text.
  using Work = std::function<void(RolloutMember& member, std::size_t index)>;
  bool run(std::size_t count, const Work& work);
  const std::string& error() const { return error_; }

  // Sets the arm of a member to a state and everything else to the start (n x 1 each).
  void begin(RolloutMember& member, const JointVector& q, const JointVector& dq) const;
  // Runs friction with memory through the measured velocities (rows of `dq`) before row `first`.
  void lead_in(RolloutMember& member, const Eigen::MatrixXd& dq, Eigen::Index first) const;
  // One control period. `torque` acts on the joints apart from `friction` [N m] (n x 1). Afterwards q and dq
  // of the member are updated, and `tau` is the torque on the joints.
  void period(RolloutMember& member, const JointVector& torque, const JointFriction* friction) const;

 private:
  std::unique_ptr<MujocoPlant> plant_;  // its world: indices by name
  RolloutWorld world_;
  JointVector motor_inertia_;  // before the torque sensor [kg m^2]; empty: none
  JointVector joint_inertia_;  // of each joint alone at the start, for friction beyond the sensor [kg m^2]
  std::vector<RolloutMember> members_;
  struct Batch;
  std::unique_ptr<Batch> batch_;
  std::string error_;
};

}  // namespace multipanda
