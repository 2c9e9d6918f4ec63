#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "arm_interface/arm_error.hpp"
#include "backends/mujoco/plant.hpp"
#include "backends/simulated_arm/request_box.hpp"
#include "core/rt/spsc_ring.hpp"
#include "core/rt/thread_setup.hpp"
#include "core/types/time.hpp"
#include "fci/model/model_library.hpp"
#include "fci/server/arm_port.hpp"
#include "fci/server/datagram_faults.hpp"
#include "fci/server/end_effector_port.hpp"
#include "fci/server/sockets.hpp"
#include "fci/server/world_view.hpp"
#include "scene/scene.hpp"

namespace multipanda::fci {

// Deviation of an arm's clock from the world's.
struct ClockOffset {
  double phase_s = 0;    // delay of its states after the world's steps; 0 to 1 ms
  double drift_ppm = 0;  // positive: its clock is fast, and it sends more often
};

// When a virtual arm with a clock of its own sends its states. A state that was sent late leaves its program
// at least kLeast for the answer: the clock is set back then, so that stalls of the server are never charged
// to the program.
class ArmClock {
 public:
  static constexpr std::int64_t kLeastNs = 900'000;

  ArmClock(const ClockOffset& offset, HostTime begin)
      : period_ns_(1e6 / (1 + 1e-6 * offset.drift_ppm)), begin_(begin), due_ns_(1e9 * offset.phase_s) {}

  HostTime due() const { return {begin_.ns + static_cast<std::int64_t>(std::llround(due_ns_))}; }
  // The state that was due has been sent.
  void sent(HostTime at) {
    const double earliest = static_cast<double>(at.ns - begin_.ns + kLeastNs), planned = due_ns_ + period_ns_;
    if (earliest > planned) set_back_ns_ += static_cast<std::uint64_t>(earliest - planned);
    due_ns_ = std::max(planned, earliest);
  }
  std::uint64_t set_back_ns() const { return set_back_ns_; }  // total

 private:
  double period_ns_;
  HostTime begin_;
  double due_ns_;  // after begin_
  std::uint64_t set_back_ns_ = 0;
};

enum class WorldPace : std::uint8_t {
  realtime,  // a period per millisecond of the wall clock
  lockstep   // the world waits for every moving arm's command
};

// Address of an arm. Ports: 0 selects a free one; libfranka uses only the defaults.
struct ArmPlace {
  std::string address;
  std::uint16_t port = kArmPort, gripper_port = kGripperPort, vacuum_port = kVacuumPort;
  std::optional<VersionRange> versions = {};  // that it accepts; none: those of fixed_config()
};

// As on real arms: unless the scene's plant hides a part of the rotors' inertia, all of it acts. Links
// without it are too light for gains with which real arms are stable, such as those of Franka's examples.
void let_rotors_act(Scene& scene);

struct VirtualArmOptions {
  // Per arm; fewer or an empty address: 127.0.0.1 for the first arm, 127.0.0.2 for the second, and so on.
  std::vector<ArmPlace> places;
  WorldPace pace = WorldPace::realtime;
  // Late answers are dropped as by a real arm: ArmPortConfig::strict. In real time the answer's time counts
  // from the actual sending of the state.
  bool strict = false;
  // Real time: per arm, fewer: none. Arms with an offset, and strict ones, send at instants of their own the
  // newest step of the world, numbered by themselves.
  std::vector<ClockOffset> clocks;
  LibraryModel library = LibraryModel::own;  // what arms send up to protocol version 9
  // With fidelity `realistic`, sensors and estimates as on real arms (MujocoPlant's PlantOptions), which are
  // not part of any model: off where a simulation is compared with its own model.
  bool real_sensors = true;
  bool grippers = true;     // of the hands and vacuum grippers in the scene, at their own ports
  DatagramFaults faults{};  // of every arm, from the start
  std::uint64_t seed = 1;   // of the faults
  // Lock-step: while no arm moves the world is paused, and programs that only read get nothing new.
  // Otherwise it follows the wall clock.
  bool idle_stands_still = false;
  // Lock-step: longest wait for the command of an arm in a motion; afterwards the period counts as missed.
  std::chrono::milliseconds patience{500};
  std::optional<ThreadSetup> thread{};  // real-time scheduling of the loop; none: unchanged
  // Called on the loop's thread before the first and after every period. It must neither block nor throw.
  std::function<void(const MujocoPlant&)> on_period;
};

struct WorldStatistics {
  std::uint64_t periods = 0;
  std::uint64_t overruns = 0;  // real time: milliseconds that were skipped
};

// A scene's arms behind Franka's control interface: each at its own address, all in one world.
// docs/virtual_arm.md describes the differences from real arms.
//
// One thread serves all ports and advances the world; nothing in a period allocates, locks or waits
// for a program. In lock-step the world advances when every arm in a motion has its command, or the options'
// patience is over. A motion without a first command does not delay the world, except that an idle world
// waits for it for kFirstPatience.
class VirtualArms {
 public:
  static constexpr std::chrono::milliseconds kFirstPatience{500};

  // Throws std::invalid_argument: invalid scene or options.
  explicit VirtualArms(Scene scene, VirtualArmOptions options = {});
  ~VirtualArms();
  VirtualArms(const VirtualArms&) = delete;

  // Starts listening. Throws std::runtime_error: an address cannot be used, with the reason.
  void start();
  void stop();  // closes all connections; the arms cannot be started again
  bool running() const { return running_.load(); }
  bool failed() const { return failed_.load(); }
  std::string fault() const;  // of a world that failed; empty: none
  const std::vector<SetupStep>& thread_setup() const { return setup_; }  // after start()

  std::size_t arm_count() const { return names_.size(); }
  const std::vector<std::string>& names() const { return names_; }
  std::optional<ArmIndex> find(std::string_view name) const;
  const ArmPlace& place(ArmIndex arm) const { return places_[arm]; }  // the actual ports, after start()
  bool has_gripper(ArmIndex arm) const { return grippers_[arm] != nullptr; }  // listens for its programs
  bool has_vacuum(ArmIndex arm) const { return vacuums_[arm] != nullptr; }
  PortStatistics statistics(ArmIndex arm) const;
  WorldStatistics world_statistics() const;
  const VirtualWorldView& view() const { return view_; }

  // --- any thread; executed between two periods ---
  // Requests to a simulated arm; PlaceObject, PushObject and ResetSimulation.
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request);
  std::future<RequestAnswer> request(WorldRequest request);
  // All following functions return false if too many commands are waiting: try again.
  bool set_faults(ArmIndex arm, const DatagramFaults& faults);  // throws std::invalid_argument
  DatagramFaults faults(ArmIndex arm) const;
  bool press_guiding(ArmIndex arm, bool pressed);
  bool raise(ArmIndex arm, ArmError error);   // a reflex, as if the arm had found this error
  bool freeze(ArmIndex arm, double seconds);  // its port neither sends nor receives
  bool close_connection(ArmIndex arm);
  bool push(ArmIndex arm, const Vector3& f_W, double seconds);  // on the flange, world axes [N]
  // A person's hand moves the end effector's origin to a place in the world [m]: spring, damper, 10 N at
  // most; it keeps the present orientation.
  bool lead(ArmIndex arm, const Vector3& p_W, double seconds);

 private:
  struct Control {
    enum class What : std::uint8_t { faults, guiding, raise, freeze, close, push, lead } what{};
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
    bool leads = false;         // f_W is then the position that the hand moves to, and R_WE its orientation
    Matrix3 R_WE = Matrix3::Identity();
  };
  Wrench led_wrench(ArmIndex arm, const Push& hand) const;

  void listen();
  void run();
  void run_realtime();
  void run_own_clocks();
  bool has_own_clocks() const;
  void run_lockstep();
  HostTime step_due() const;
  bool grippers_move() const;
  void step();
  void send_state(ArmIndex arm, std::int64_t count);  // sends the arm's state number `count`
  void advance_world();
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
  bool word_happened_ = false;  // the next state must show an external change
  HostTime word_at_;
  Count periods_, overruns_;

  RequestBox requests_;
  SpscRing<Control> controls_{64};
  mutable std::mutex callers_;  // never taken by the loop
  std::vector<DatagramFaults> faults_;
  std::vector<SetupStep> setup_;
  std::atomic<bool> running_{false}, ending_{false}, failed_{false};
  std::thread thread_;
};

// Executes one line, such as `loss left 0.1`, and answers with one line: "ok", or what was expected.
// control_help() lists the commands. Any thread.
std::string control(VirtualArms& arms, const std::string& line);
std::string control_help();

}  // namespace multipanda::fci
