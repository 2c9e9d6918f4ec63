#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "arm_interface/arm_interface.hpp"
#include "core/rt/triple_buffer.hpp"
#include "core/types/spatial.hpp"
#include "fci/client/arm_mode.hpp"
#include "fci/client/tcp_channel.hpp"
#include "fci/client/udp_port.hpp"
#include "fci/wire/requests.hpp"

namespace multipanda::fci {

struct ArmConnectionOptions {
  std::string name;     // for messages: "left"; empty: the address
  std::string address;  // IPv4 or a host name
  std::uint16_t port = kArmPort;
  int version = 0;  // of the protocol, 4 to 10; 0: the newest that the arm supports
  double connect_timeout_s = 1;
  double state_timeout_s = 1;      // of a wait for a state, unless the call gives its own
  double reply_timeout_s = 3;      // of all requests except the next two
  double recovery_timeout_s = 15;  // brakes may have to open
  double model_timeout_s = 10;
  // True: a loop on another thread calls receive() continuously, and requests use copies of its states.
  // False: requests read states themselves, everything on one thread.
  bool loop_reads_states = false;
};

// Outcome of a motion.
struct MotionOutcome {
  Status status = Status::success;
  std::string text;  // the reason; empty: as commanded
};

// The connection to one arm: the whole control interface, for protocol versions 4 to 10. Requests
// (TCP) wait for their answer and belong to one thread, off the loop; receive() and send() (UDP) never wait,
// allocate, lock or throw and also belong to one thread, the same or another (ArmConnectionOptions).
//
// All requests throw ConnectionError with the arm, the reason and the remedy. A fatal error closes the
// connection; connect() may be called again.
class ArmConnection {
 public:
  // Only opens the UDP port. Throws std::invalid_argument (version), std::runtime_error (no port).
  explicit ArmConnection(ArmConnectionOptions options);

  // --- connection ---
  // Connects, agrees on a version and waits for the first state. A version that the arm offered is tried
  // first the next time.
  void connect();
  void close() noexcept;
  bool is_connected() const { return channel_.is_open(); }
  GapWatch& gaps() const { return channel_.gaps(); }  // of the requests' thread
  int version() const { return dialect_ == nullptr ? 0 : dialect_->version; }
  const Dialect& dialect() const { return *dialect_; }  // after connect()
  const std::string& name() const { return options_.name; }

  // --- states, for the requests' thread ---
  // Waits for a state newer than the last one seen here. Throws after `timeout_s`. Here and below, the
  // default is ArmConnectionOptions::state_timeout_s.
  const RobotState& next_state(std::optional<double> timeout_s = {});
  const RobotState& last_state() const { return seen_; }
  const RobotState& look();  // the newest state, without waiting; message_id 0: none yet
  // Waits until a state meets the condition; false: timeout.
  bool wait_for_state(const std::function<bool(const RobotState&)>& condition,
                      std::optional<double> timeout_s = {});

  // --- settings; most arms take them only while no motion runs ---
  // Thresholds [N m], [N, N m]: the arm reports contact above the lower ones and stops above the upper ones.
  void set_collision_behavior(const SetCollisionBehaviorRequest& thresholds);
  // The same thresholds in motion and at rest.
  void set_collision_behavior(const std::array<double, 7>& lower_torque,
                              const std::array<double, 7>& upper_torque,
                              const std::array<double, 6>& lower_force,
                              const std::array<double, 6>& upper_force);
  void set_joint_impedance(const std::array<double, 7>& K_theta);      // [N m/rad] 0 to 14250
  void set_cartesian_impedance(const std::array<double, 6>& K_x);      // [N/m] 10 to 3000, [N m/rad] 1 to 300
  void set_guiding_mode(const std::array<bool, 6>& axes, bool elbow);  // free: x y z roll pitch yaw
  void set_K(const Pose& X_EK);                                        // EE_T_K
  void set_EE(const Pose& X_NE_E);                                     // NE_T_EE; F_T_EE = F_T_NE NE_T_EE
  void set_load(const Load& load);                                     // payload, in the flange
  void set_filters(const SetFiltersRequest& cut_off);                  // versions 4 and 5
  CartesianLimit cartesian_limit(int id);                              // versions 4 and 5: a virtual wall

  // --- model ---
  std::string robot_model();  // URDF; versions 8 and later
  std::vector<std::byte> model_library(LibraryArchitecture architecture = LibraryArchitecture::x64,
                                       LibrarySystem system = LibrarySystem::linux_os);  // up to version 9

  // --- motion ---
  // Starts a motion and returns when the arm has accepted it. With the generator `none` the arm takes torques
  // only, in every version. Throws std::invalid_argument for an unknown combination.
  void start_motion(const MotionRequest& request);
  // Waits until a state shows the started motion; throws if the motion ended before.
  void wait_until_running(std::optional<double> timeout_s = {});
  bool has_motion() const {
    return motion_.has_value();
  }  // a motion was started and its end is still unknown
  // Checks, without waiting, whether the running motion's end was reported. Throws if the connection is lost.
  std::optional<MotionOutcome> poll_motion();
  // The end of the motion; on a timeout throws ConnectionError::timeout and stays connected.
  MotionOutcome wait_for_end(double timeout_s);
  // Ends the running motion, if any, and waits until the arm is idle.
  void stop();
  // Finishes the motion as libfranka does: answers every new state with `last` marked as finished
  // until the arm is idle, then waits for the end. Only if requests read states themselves.
  MotionOutcome finish(RobotCommand last, double timeout_s = 2);
  void recover();  // AutomaticErrorRecovery

  // The descriptor that a loop must watch: when it is readable, call poll_motion(). -1: not connected.
  int tcp_file() const { return channel_.file(); }

  // --- loop ---
  int udp_file() const { return port_.file(); }
  bool receive() noexcept;  // takes received packets; true: newest() has changed
  const RobotState& newest() const noexcept { return port_.state(); }
  HostTime received_at() const noexcept { return port_.received_at(); }
  bool is_stale() const noexcept { return port_.is_stale(); }                // newest() is outdated
  bool send(RobotCommand& command) noexcept { return port_.send(command); }  // answers newest()
  // The command that ends the running motion: its flag depends on version and generator.
  static void mark_finished(const Dialect& dialect, bool has_generator, RobotCommand& command) noexcept;

  // --- any thread ---
  ConnectionStatistics statistics() const { return port_.statistics(); }

 private:
  template <class Request>
  std::vector<std::byte> ask(const Request& request, const char* what, double timeout_s);
  template <class Request>
  std::uint32_t post(const Request& request, const char* what);
  Status status_of_reply(Command command, const TcpChannel::Reply& reply, std::span<const std::byte>& rest);
  [[noreturn]] void refuse(ConnectionError::Kind kind, const std::string& text) const;
  bool try_version(int version, int& offered);
  bool try_offered_version(int version, int& offered);
  bool look_for_state(double timeout_s);
  MotionOutcome outcome(Status status) const;

  ArmConnectionOptions options_;
  TcpChannel channel_;
  UdpPort port_;
  const Dialect* dialect_ = nullptr;
  int spoken_version_ = 0;           // protocol version of an earlier connection; 0: unknown
  TripleBuffer<RobotState> copies_;  // loop -> requests
  RobotState seen_;                  // used by the requests' thread

  struct Motion {
    std::uint32_t command_id = 0;
    MotionGeneratorMode generator{};
    ControllerMode controller{};
  };
  std::optional<Motion> motion_;
};

}  // namespace multipanda::fci
