#pragma once

#include <memory>
#include <vector>

#include "backends/simulation_view.hpp"
#include "core/cycle/backend.hpp"
#include "core/rt/pacer.hpp"

namespace multipanda {

// Simulated and real arms of one scene in one loop.
//
// In real time every packet of a real arm triggers a step, and every millisecond one with all simulated arms;
// no arm waits for another, so that real arms get their torques without delay. In lock-step (virtual arms of
// another process) all arms step together, by the virtual arms' time.
//
// The simulated world holds the scene's objects and the simulated arms only: real arms do not touch them.
class MixedBackend : public Backend, public SimulationView {
 public:
  struct Parts {
    std::unique_ptr<Backend> real;
    std::unique_ptr<Backend> simulated;               // in lock-step, unpaced: this class sets the pace
    std::vector<ArmIndex> real_arms, simulated_arms;  // the scene's indices, in the parts' order
    bool lockstep = false;                            // mode of `real`
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
  std::uint64_t overruns() const override;  // lost packets of real arms, and missed milliseconds
  // Requests to the world go to the simulated part. It cannot be paused, because real arms cannot.
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) override;
  std::future<RequestAnswer> request(ArmIndex arm, GripperRequest request) override;
  std::future<RequestAnswer> request(WorldRequest request) override;

  std::optional<ConnectionStatistics> connection(ArmIndex arm) const override;

  const ForceReading* force_reading(ArmIndex arm) override {
    return part_of(places_[arm]).force_reading(places_[arm].index);
  }
  std::string fault() const override { return view_ != nullptr ? view_->fault() : ""; }
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
  template <typename Request>
  std::future<RequestAnswer> ask_part(ArmIndex arm, Request request);
  ArmSet wait_in_lockstep();
  ArmSet wait_in_real_time();

  Backend& part_of(const Place& place) const { return place.real ? *parts_.real : *parts_.simulated; }

  Parts parts_;
  const SimulationView* view_ = nullptr;  // of the simulated part
  std::vector<Place> places_;             // of the scene's arms
  Side real_, simulated_;
  Pacer pacer_;
  HostTime next_, origin_;  // the grid of the simulated arms
  LoopTime now_;
  bool begun_ = false;
};

}  // namespace multipanda
