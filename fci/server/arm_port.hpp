#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/simulated_arm/simulated_arm.hpp"
#include "fci/server/datagram_faults.hpp"
#include "fci/server/sockets.hpp"
#include "fci/server/wire.hpp"
#include "fci/wire/frame_reader.hpp"
#include "fci/wire/requests.hpp"
#include "fci/wire/state_layout.hpp"

namespace multipanda::fci {

// A counter that one thread writes and any thread may read.
class Count {
 public:
  void add(std::uint64_t n = 1) {
    value_.store(value_.load(std::memory_order_relaxed) + n, std::memory_order_relaxed);
  }
  void set(std::uint64_t n) { value_.store(n, std::memory_order_relaxed); }
  std::uint64_t get() const { return value_.load(std::memory_order_relaxed); }

 private:
  std::atomic<std::uint64_t> value_{0};
};

// Counts of an arm's control port since its start.
struct PortStatistics {
  std::uint64_t clients = 0,
                refused = 0;  // programs that connected; that were refused because another was connected
  std::uint64_t motions = 0;  // started
  std::uint64_t states_sent = 0;
  std::uint64_t states_lost = 0;        // by injected faults, or because the program's socket was full
  std::uint64_t commands_received = 0;  // as datagrams
  std::uint64_t commands_used = 0;
  std::uint64_t commands_late = 0;    // arrived after the period of the state that they answer: dropped
  std::uint64_t commands_lost = 0;    // by injected faults
  std::uint64_t commands_missed = 0;  // periods of a motion without a command in time
  std::uint64_t bad_datagrams = 0, bad_requests = 0;
};

// The arm's model for download.
struct ModelDownload {
  std::string urdf;                // from version 8 on; ends at the flange
  std::vector<std::byte> library;  // shared library for x86-64 Linux, up to version 9; empty: none
};

struct ArmPortConfig {
  std::string name;  // "left", for messages
  std::string address = "127.0.0.1";
  std::uint16_t port = kArmPort;
  // The world waits for this arm's command. Otherwise a command must arrive before the end of the period.
  bool lockstep = false;
  // An answer is valid only for the last state and within kAnswerTime after it was sent.
  bool strict = false;
  bool own_clock = false;  // stepped() is called at the arm's own times, between steps of the world
  FixedConfig fixed;
  ModelDownload model;
  std::uint64_t seed = 1;  // of injected faults
};

// The control port of one virtual arm, as a real arm has it: one program at a time, TCP for requests, UDP for
// states and commands, the versions of the protocol that its system has. It passes commands to `arm` and
// publishes its states; the loop advances the world in between:
//
//   receive()  command()  [the world advances]  stepped()
//
// The port accepts a command that answers the last published state. It drops answers to older states as
// late, as Franka documents; the first command of a motion and commands of asynchronous motions may be
// older. In real time, torques that answer the state before the last are accepted for kGrace: the arms of one
// world tick together, and a program that reads one arm while it waits for the other would otherwise always
// be late. Set-points are not: their period has been extrapolated. In lock-step both are accepted until a
// newer answer arrives. With `strict` none is: an answer that is late is dropped, as by a real arm. A program
// that violates the protocol loses its connection.
//
// One thread; nothing blocks; receive(), command() and stepped() do not allocate.
class ArmPort : public Port {
 public:
  // Strict, in real time: from sending a state to the arrival of its answer. Ours: Franka names 1 ms for the
  // way there and back and the computing.
  static constexpr std::chrono::microseconds kAnswerTime{1000};

  ArmPort(ArmPortConfig config, SimulatedArm& arm);
  ~ArmPort() override;

  void open(Poll& poll) override;
  void ready(int file, std::uint32_t events) override;
  const std::string& name() const { return config_.name; }
  const std::string& address() const { return config_.address; }
  std::uint16_t port() const { return config_.port; }  // the actual port, after open()

  // --- the loop ---
  // Receives datagrams, and sends those that injected latency has delayed.
  void receive(HostTime now);
  // Passes this period's command, or its absence, to the arm. Before the world advances.
  void command();
  // After the world has advanced: publishes the state and sends the answers that waited for it.
  void stepped(std::int64_t period) override;
  // Timeouts of replies and connections.
  void tend(HostTime now);
  std::optional<HostTime> tend_due() const;  // when to call tend() at the latest
  std::optional<HostTime> next_due() const;  // of datagrams that injected latency delays

  // Lock-step: what the world waits for.
  enum class Awaits : std::uint8_t {
    nothing,        // no motion, or no command needed now
    first_command,  // a motion has started without a command yet
    command,        // the answer to the last state
    answered        // that answer has arrived
  };
  Awaits awaits() const;
  bool has_command() const { return has_pending_; }  // for the next period
  HostTime published_at() const { return published_at_; }
  bool is_silent() const { return silent_; }  // the world advanced without its last answer
  bool awaits_datagram() const {
    const Awaits a = awaits();
    return a == Awaits::command || a == Awaits::first_command;
  }
  // Lock-step: when an answer to the state before the last arrived.
  bool has_stale_answer() const { return has_pending_ && !answered_; }
  HostTime stale_since() const { return stale_since_; }
  HostTime motion_shown_at() const {
    return motion_.shown;
  }  // time when a state first showed the running
     // motion
  // Whether and when an event occurred that the next state must show.
  bool state_due() const { return state_due_; }
  HostTime state_due_since() const { return state_due_since_; }
  bool is_recovering() const { return recoveries_.count > 0; }  // a program waits for its end
  // Whether a program is connected and the arm does not move.
  bool may_begin() const;

  // --- injection ---
  void set_faults(const DatagramFaults& faults);
  void freeze(std::int64_t periods);  // neither sends nor receives for this many periods
  void close_connection();
  PortStatistics statistics() const;

 private:
  struct Client;
  // The running Move, or one whose end is not yet reported
  struct Motion {
    bool runs = false;
    std::uint32_t command_id = 0;   // of the Move request
    std::uint64_t first_state = 0;  // the first that shows it
    bool asynchronous = false;
    bool commanded = false;  // its first command has arrived
    bool stop_requested = false;
    HostTime started{}, shown{};
    std::optional<Status> end{};  // still to be reported
  };

  // TCP
  void accept();
  void read_requests();
  bool serve_waiting();
  bool serve(const Message& message);
  bool connect(const Message& message);
  void move(std::uint32_t command_id, const MoveRequest& request);
  void stop_move(std::uint32_t command_id);
  void recover(std::uint32_t command_id);
  Status apply(const std::optional<ArmRequest>& request);
  void reply(Command command, std::uint32_t command_id, Status status, std::span<const std::byte> more = {});
  void notice_end();
  void tell_end(HostTime now);
  void answer_waiting();
  void part_early(HostTime now);
  void drop_client();
  void mark_state_due();

  // UDP
  void watch_datagrams();
  // `after`: time since the last state, if known.
  void take_datagram(std::span<const std::byte> datagram, std::chrono::nanoseconds after);
  void publish();
  void publish_with_fates(std::span<const std::byte> bytes);
  void send_state(std::span<const std::byte> datagram);

  ArmPortConfig config_;
  SimulatedArm& arm_;
  Poll* poll_ = nullptr;
  Socket listener_;
  FrameReader reader_{HeaderKind::arm, kMaxRequestSize};
  std::unique_ptr<Client> client_;

  Motion motion_;
  std::uint64_t motions_ended_ = 0;  // of the arm, as last seen
  struct Waiting {                   // requests that are answered after a later state
    std::array<std::uint32_t, 8> ids{};
    std::size_t count = 0;
  } stops_, recoveries_;
  bool state_due_ = false;
  HostTime state_due_since_;
  bool parted_early_ = false;

  std::uint64_t message_id_ = 1;  // of the last state
  HostTime published_at_;
  RobotState state_;
  RobotCommand received_, pending_;  // just received; for this period
  bool has_pending_ = false;
  HostTime answered_at_, stale_since_;
  bool lagging_ = false;              // the last period used a stale answer, or two in a row were late
  std::uint64_t left_out_ = 0;        // the last state that was skipped
  std::int64_t published_ns_ = 0;     // on the clock of the datagrams' time stamps
  bool answered_ = false;             // the program has answered the last state, even if the answer was lost
  bool silent_ = false;               // lock-step: the world advanced without its answer
  std::uint64_t newest_command_ = 0;  // its message_id
  std::uint64_t latest_late_ = 0;     // of the last answer dropped as late
  InterfaceCommand command_;
  std::array<std::byte, kMaxStateSize> state_bytes_{};

  FaultyLine out_, in_;
  // Lock-step: outcome of this period's datagrams
  enum class AnswerFate : std::uint8_t { arrives, lost, late } answer_fate_ = AnswerFate::arrives;
  bool state_lost_ = false;
  std::optional<std::size_t> overtaken_;  // lock-step: a delayed state, its size
  std::array<std::byte, kMaxStateSize> overtaken_bytes_{};
  std::int64_t frozen_ = 0;  // periods left

  struct {
    Count clients, refused, motions, states_sent, states_lost, commands_received, commands_used,
        commands_late, commands_lost, commands_missed, bad_datagrams, bad_requests;
  } counts_;
};

// The connected program.
struct ArmPort::Client {
  Client(Accepted accepted, Poll& poll, Port& port)
      : stream(std::move(accepted.socket), accepted.peer, poll, port), since(host_now()) {}

  TcpStream stream;
  HostTime since;
  const Dialect* dialect = nullptr;  // none before Connect
  Socket udp;
  bool watches_udp = false;
  bool closing = false;  // once everything is sent
};

}  // namespace multipanda::fci
