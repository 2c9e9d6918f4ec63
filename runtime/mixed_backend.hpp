#pragma once

#include <memory>
#include <vector>

#include "backends/mujoco/mujoco_backend.hpp"
#include "backends/simulation_view.hpp"
#include "core/rt/pacer.hpp"
#include "fci/client/fci_backend.hpp"

namespace multipanda {

// Simulated and real arms of one scene in one loop.
//
// In real time a step comes with every packet of a real arm, and every millisecond with all simulated ones;
// nobody waits for anybody, so that a real arm gets its torque as soon as without the others. In lock-step
// (virtual arms of another process) all arms step together, by the virtual arms' time.
//
// The simulated world holds the scene's objects and the simulated arms only: real arms do not touch them.
class MixedBackend : public Backend, public SimulationView {
 public:
  struct Parts {
    std::unique_ptr<fci::FciBackend> real;
    std::unique_ptr<MujocoBackend> simulated;         // unpaced: this class gives the pace
    std::vector<ArmIndex> real_arms, simulated_arms;  // the scene's indices, in the parts' order
    bool lockstep = false;                            // as `real` was made
  };
  explicit MixedBackend(Parts parts);

  std::size_t arm_count() const override { return places_.size(); }
  Capabilities capabilities(ArmIndex arm) const override;
  void start() override;
  void finish() override;
  ArmSet wait() override;
  bool ended() const override { return parts_.real->ended(); }
  LoopTime now() const override { return now_; }
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  std::uint64_t overruns() const override;  // real arms' packets lost, and milliseconds that were missed
  // To the world (PlaceObject, ResetSimulation): the simulated part. It cannot be paused: real arms cannot.
  std::future<ArmAnswer> request(ArmIndex arm, ArmRequest request) override;

  std::string fault() const override { return parts_.simulated->fault(); }
  std::optional<Pose> object_pose(const std::string& name) const override {
    return parts_.simulated->object_pose(name);
  }

 private:
  struct Place {
    bool real = false;
    ArmIndex index = 0;  // in its part
  };
  // One part's states and commands, in its own order.
  struct Side {
    std::vector<ArmIndex> arms;
    std::vector<ArmState> states;
    std::vector<ArmCommand> commands;
    ArmSet to_scene(ArmSet local) const;
    ArmSet to_part(ArmSet due) const;
  };
  static Side side_of(const std::vector<ArmIndex>& arms, const Backend& part);
  ArmSet wait_in_lockstep();
  ArmSet wait_in_real_time();

  Parts parts_;
  std::vector<Place> places_;  // of the scene's arms
  Side real_, simulated_;
  Pacer pacer_;
  HostTime next_, origin_;  // of the simulated arms' grid
  LoopTime now_;
  bool begun_ = false;
};

}  // namespace multipanda
