#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/arm/simulated_arm.hpp"
#include "fci/server/datagram_faults.hpp"
#include "fci/server/port.hpp"
#include "fci/server/sockets.hpp"
#include "fci/server/state_packet.hpp"
#include "fci/server/statistics.hpp"
#include "fci/wire/frame_reader.hpp"
#include "fci/wire/requests.hpp"
#include "fci/wire/state_layout.hpp"

namespace multipanda::fci {

// The arm's model as programs download it.
struct ModelDownload {
  std::string urdf;                // from version 8 on; ends at the flange
  std::vector<std::byte> library;  // shared library for x86-64 Linux, up to version 9; empty: none
};

struct ArmPortConfig {
  std::string name;  // "left", for messages
  std::string address = "127.0.0.1";
  std::uint16_t port = kArmPort;
  // The world waits for this arm's command. Otherwise a command counts that came before the period's end.
  bool lockstep = false;
  FixedConfig fixed;
  ModelDownload model;
  std::uint64_t seed = 1;  // of injected faults
};

// The control port of one virtual arm, as a real arm has it: one program at a time, TCP for requests, UDP for
// states and commands, every version of the protocol that fci/wire knows. It gives `arm` its commands and
// publishes its states; the loop moves the world in between:
//
//   receive()  command()  [the world moves on]  stepped()
//
// A command is taken if it answers the state published last. One that answers an older state came too late
// and is dropped, as the maker documents it; the first command of a motion and commands of asynchronous
// motions may be older. The state before the last is still good for kGrace in real time: arms of one world
// tick together, which real ones do not, and a program that reads one arm while it waits for the other would
// else be late with every command. In lock-step it is good until the better answer comes. Programs that do
// not keep to the protocol lose their connection, never more.
//
// One thread; nothing blocks; receive(), command() and stepped() do not allocate.
class ArmPort : public Port {
 public:
  ArmPort(ArmPortConfig config, SimulatedArm& arm);
  ~ArmPort() override;

  void open(Poll& poll) override;
  void ready(int file, std::uint32_t events) override;
  const std::string& name() const { return config_.name; }
  const std::string& address() const { return config_.address; }
  std::uint16_t port() const { return config_.port; }  // the one really listened on, after open()

  // --- the loop ---
  // Takes what UDP has brought, and sends on what injected latency held back.
  void receive(HostTime now);
  // Gives the arm this period's command, or that there is none. Before the world moves on.
  void command();
  // After the world moved on: publishes the state, answers what waited for it.
  void stepped(std::int64_t period) override;
  // Replies and connections that wait for time to pass.
  void tend(HostTime now);
  std::optional<HostTime> tend_due() const;  // when tend() is needed, if nothing comes before
  std::optional<HostTime> next_due() const;  // of datagrams that injected latency holds back

  // Lock-step: what the world is waiting for.
  enum class Awaits : std::uint8_t {
    nothing,        // no motion, or one that needs no command now
    first_command,  // a motion began, its program has not answered yet
    command,        // the answer to the last state
    answered        // it has come
  };
  Awaits awaits() const;
  bool has_command() const { return has_pending_; }  // for the period that comes
  HostTime published_at() const { return published_at_; }
  bool is_silent() const { return silent_; }  // the world went on without its last answer
  bool awaits_datagram() const {
    const Awaits a = awaits();
    return a == Awaits::command || a == Awaits::first_command;
  }
  // Lock-step: an answer to the state before the last is there, since then.
  bool has_stale_answer() const { return has_pending_ && !answered_; }
  HostTime stale_since() const { return stale_since_; }
  HostTime motion_shown_at() const { return motion_.shown; }  // by a state, the motion that runs
  // Whether something happened that the next state must show, and when.
  bool wants_state() const { return wants_state_; }
  HostTime wanted_at() const { return wanted_at_; }
  // A program is connected and the arm does not move.
  bool may_begin() const;

  // --- injection ---
  void set_faults(const DatagramFaults& faults);
  void freeze(std::int64_t periods);  // neither sends nor receives for so long
  void close_connection();
  PortStatistics statistics() const;

 private:
  struct Client;
  // The Move that runs or whose end is not yet told
  struct Motion {
    bool runs = false;
    std::uint32_t command_id = 0;   // of the Move request
    std::uint64_t first_state = 0;  // the first that shows it
    bool asynchronous = false;
    bool commanded = false;  // its first command came
    bool stop_requested = false;
    HostTime started{}, shown{};
    std::optional<Status> end{};  // to be told
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
  void want_state();

  // UDP
  void watch_datagrams();
  // `after`: how long after the last state it came, where that is known.
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
  struct Waiting {                   // requests whose answer waits for a later state
    std::array<std::uint32_t, 8> ids{};
    std::size_t count = 0;
  } stops_, recoveries_;
  bool wants_state_ = false;
  HostTime wanted_at_;
  bool parted_early_ = false;

  std::uint64_t message_id_ = 1;  // of the last state
  HostTime published_at_;
  RobotState state_;
  RobotCommand received_, pending_;  // the one just read; the one for this period
  bool has_pending_ = false;
  HostTime answered_at_, stale_since_;
  bool lagging_ = false;           // lock-step: the last period had to make do with a stale answer
  std::uint64_t left_out_ = 0;     // the last state that a lagging program did not get
  std::int64_t published_ns_ = 0;  // on the clock of the datagrams' time stamps
  bool answered_ = false;          // the program has answered the last state, whatever became of its answer
  bool silent_ = false;            // lock-step: the world went on without its answer
  std::uint64_t newest_command_ = 0;  // its message_id
  InterfaceCommand command_;
  std::array<std::byte, kMaxStateSize> state_bytes_{};

  FaultyLine out_, in_;
  // Lock-step: fates of this period's datagrams
  enum class AnswerFate : std::uint8_t { arrives, lost, late } answer_fate_ = AnswerFate::arrives;
  bool state_lost_ = false;
  std::optional<std::size_t> overtaken_;  // lock-step: a state held back, its size
  std::array<std::byte, kMaxStateSize> overtaken_bytes_{};
  std::int64_t frozen_ = 0;  // periods left

  struct {
    Count clients, refused, motions, states_sent, states_lost, commands_received, commands_used,
        commands_late, commands_lost, commands_missed, bad_datagrams, bad_requests;
  } counts_;
};

}  // namespace multipanda::fci
