#pragma once

#include <functional>
#include <memory>
#include <string>

#include "backends/simulation_view.hpp"
#include "core/cycle/backend.hpp"
#include "fci/client/arm_statistics.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// A scene's arms as virtual arms in this process, driven through the control interface over loopback sockets:
// the same world as MujocoBackend's, with the whole wire in between.
//
// What no arm tells but experiments want to know (contact wrenches, poses of objects) is read from the
// virtual world itself, past the wire, and belongs to the very step that the arms' states are of.
enum class VirtualPace : std::uint8_t {
  realtime,  // the world goes by the wall clock, as real arms do: what is late for an arm is lost
  waiting,   // a step every millisecond of the wall clock; the world waits for its commands (lock-step)
  unpaced    // the same as fast as the loop runs
};

class VirtualBackend : public Backend, public SimulationView {
 public:
  // Throws std::invalid_argument if the scene cannot be built. `say` as in FciOptions.
  VirtualBackend(const Scene& scene, VirtualPace pace, std::function<void(const std::string&)> say);
  ~VirtualBackend() override;

  std::size_t arm_count() const override;
  Capabilities capabilities(ArmIndex arm) const override;
  void start() override;
  void finish() override;
  ArmSet wait() override;
  bool ended() const override;
  LoopTime now() const override;
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  std::uint64_t overruns() const override;
  // Those to the world (PlaceObject, ResetSimulation, SetUserStop) go to the virtual arms, past the wire.
  std::future<ArmAnswer> request(ArmIndex arm, ArmRequest request) override;

  std::string fault() const override;
  std::optional<Pose> object_pose(const std::string& name) const override;

  fci::ArmStatistics statistics(ArmIndex arm) const;  // any thread

 private:
  struct Implementation;
  std::unique_ptr<Implementation> self_;
};

}  // namespace multipanda
