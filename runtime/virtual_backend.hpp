#pragma once

#include <functional>
#include <memory>
#include <string>

#include "backends/simulation_view.hpp"
#include "core/cycle/backend.hpp"
#include "core/state/arm_state.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// A scene's arms as virtual arms in this process, driven through the control interface over loopback sockets:
// the world of MujocoBackend behind the whole control interface.
// Contact wrenches and object poses, which arms do not report, are read from the virtual world directly, for
// the same step as the arms' states.
enum class VirtualPace : std::uint8_t {
  realtime,  // the world follows the wall clock, as real arms do: late commands are lost
  waiting,   // a step every millisecond of the wall clock; the world waits for its commands (lock-step)
  unpaced    // lock-step, as fast as the loop runs
};

class VirtualBackend : public Backend, public SimulationView {
 public:
  // Throws std::invalid_argument if the scene cannot be built. `say` as in FciOptions, `real_sensors` as in
  // VirtualArmOptions.
  VirtualBackend(const Scene& scene, VirtualPace pace, std::function<void(const std::string&)> say,
                 bool real_sensors = true);
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
  // Requests to the world and SetUserStop go to the virtual arms directly, others through the connection.
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) override;
  std::future<RequestAnswer> request(ArmIndex arm, GripperRequest request) override;
  std::future<RequestAnswer> request(WorldRequest request) override;

  std::string fault() const override;
  std::optional<Pose> object_pose(const std::string& name) const override;

  std::optional<ConnectionStatistics> connection(ArmIndex arm) const override;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> self_;
};

}  // namespace multipanda
