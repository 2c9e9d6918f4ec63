#pragma once

#include <atomic>
#include <filesystem>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "backends/arm/arm_error.hpp"
#include "backends/arm/request_box.hpp"
#include "backends/mujoco/plant.hpp"
#include "core/rt/spsc_ring.hpp"
#include "core/rt/thread_setup.hpp"
#include "fci/server/arm_port.hpp"
#include "fci/server/datagram_faults.hpp"
#include "fci/server/end_effector_port.hpp"
#include "fci/server/statistics.hpp"
#include "fci/server/wake.hpp"
#include "fci/server/world_view.hpp"
#include "scene/scene.hpp"

namespace multipanda::fci {

enum class WorldPace : std::uint8_t {
  realtime,  // a period per millisecond of the wall clock
  lockstep   // the world waits for every moving arm's command
};

// Where an arm listens. Ports: 0 takes a free one; the maker's library knows only the defaults.
struct ArmPlace {
  std::string address;
  std::uint16_t port = kArmPort, gripper_port = kGripperPort, vacuum_port = kVacuumPort;
};

struct VirtualArmOptions {
  // Per arm; fewer or an empty address: 127.0.0.1 for the first arm, 127.0.0.2 for the second, and so on.
  std::vector<ArmPlace> places;
  WorldPace pace = WorldPace::realtime;
  bool grippers = true;     // of the hands and vacuum grippers in the scene, at their own ports
  DatagramFaults faults{};  // of every arm, from the start
  std::uint64_t seed = 1;   // of the faults
  // Lock-step: while no arm moves the world stands still, and programs that only read get nothing new.
  // Otherwise it goes on with the wall clock then.
  bool idle_stands_still = false;
  // Lock-step: how long the command of an arm in a motion is waited for; then the period counts as missed.
  std::chrono::milliseconds patience{500};
  std::optional<ThreadSetup> thread{};  // real-time scheduling of the loop; none: as it is
  std::filesystem::path meshes;
};

struct WorldStatistics {
  std::uint64_t periods = 0;
  std::uint64_t overruns = 0;  // real time: milliseconds that the wall clock ran away by, given up
};

// A scene's arms as programs of the maker's library see real ones: each at its own address, all in one world.
// docs/virtual_arm.md says what such an arm does like a real one and what it does not.
//
// One thread of its own serves all ports and moves the world; nothing in a period allocates, locks or waits
// for a program. In lock-step the world moves when every arm in a motion has its command, or the options'
// patience is over. A motion whose first command has not come holds up nobody; only where an idle world
// stands still it is waited for, for kFirstPatience.
class VirtualArms {
 public:
  static constexpr std::chrono::milliseconds kFirstPatience{500};

  // Throws std::invalid_argument: scene or options that cannot be.
  explicit VirtualArms(Scene scene, VirtualArmOptions options = {});
  ~VirtualArms();
  VirtualArms(const VirtualArms&) = delete;

  // Listens and begins. Throws std::runtime_error: an address that cannot be had, and why.
  void start();
  void stop();  // closes all connections; the arms cannot be started again
  bool running() const { return running_.load(); }
  bool failed() const { return failed_.load(); }
  std::string fault() const;  // of a world that failed; empty: none
  const std::vector<SetupStep>& thread_setup() const { return setup_; }  // after start()

  std::size_t arm_count() const { return names_.size(); }
  const std::vector<std::string>& names() const { return names_; }
  std::optional<ArmIndex> find(std::string_view name) const;
  const ArmPlace& place(ArmIndex arm) const { return places_[arm]; }          // as listened on, after start()
  bool has_gripper(ArmIndex arm) const { return grippers_[arm] != nullptr; }  // listens for its programs
  bool has_vacuum(ArmIndex arm) const { return vacuums_[arm] != nullptr; }
  PortStatistics statistics(ArmIndex arm) const;
  WorldStatistics world_statistics() const;
  const VirtualWorldView& view() const { return view_; }

  // --- any thread; carried out between two periods ---
  // SetUserStop, PlaceObject, ResetSimulation, and whatever a simulated arm can be asked.
  std::future<ArmAnswer> request(ArmIndex arm, ArmRequest request);
  // Of all that follow, false: too many at once, try again.
  bool set_faults(ArmIndex arm, const DatagramFaults& faults);  // throws std::invalid_argument
  DatagramFaults faults(ArmIndex arm) const;
  bool press_guiding(ArmIndex arm, bool pressed);
  bool raise(ArmIndex arm, ArmError error);   // a reflex, as if the arm had found this error
  bool freeze(ArmIndex arm, double seconds);  // its port neither sends nor receives
  bool close_connection(ArmIndex arm);
  bool push(ArmIndex arm, const Vector3& f_W, double seconds);  // on the flange, world axes [N]

 private:
  struct Control {
    enum class What : std::uint8_t { faults, guiding, raise, freeze, close, push } what{};
    ArmIndex arm = 0;
    DatagramFaults faults{};
    bool on = false;
    ArmError error{};
    std::int64_t periods = 0;
    Vector3 force = Vector3::Zero();
  };
  struct Push {
    Vector3 f_W = Vector3::Zero();
    std::int64_t periods = -1;  // left; -1: none
  };

  void listen();
  void run();
  void run_realtime();
  void run_lockstep();
  HostTime step_due() const;
  bool grippers_move() const;
  void step();
  void tend(HostTime now);
  void take_words();
  void carry_out(const Control& control);
  ArmReply apply(const RequestBox::Posted& posted);
  void something_happened();
  void apply_pushes();
  bool post(const Control& control);

  Scene scene_;
  VirtualArmOptions options_;
  std::vector<std::string> names_;
  std::vector<ArmPlace> places_;
  MujocoPlant plant_;
  VirtualWorldView view_;
  Poll poll_;
  std::vector<std::unique_ptr<ArmPort>> ports_;
  std::vector<std::unique_ptr<EndEffectorPort>> grippers_, vacuums_;  // per arm; null: has none
  WakeTimer timer_;
  WakeWord word_;

  std::vector<Push> pushes_;
  bool pushing_ = false;
  HostTime stepped_at_;
  bool word_happened_ = false;  // the next state must show something that a word from outside changed
  HostTime word_at_;
  Count periods_, overruns_;

  RequestBox requests_;
  SpscRing<Control> controls_{64};
  mutable std::mutex askers_;  // never taken by the loop
  std::vector<DatagramFaults> faults_;
  std::vector<SetupStep> setup_;
  std::atomic<bool> running_{false}, ending_{false}, failed_{false};
  std::thread thread_;
};

}  // namespace multipanda::fci
