#pragma once

// Inside of SimulatedTime, for its own files.
#include <array>
#include <deque>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "fci/simulated_time/arm_side.hpp"
#include "fci/simulated_time/client_side.hpp"
#include "fci/simulated_time/draw.hpp"
#include "fci/simulated_time/event_queue.hpp"
#include "fci/simulated_time/simulated_time.hpp"

namespace multipanda::fci {

struct SimulatedTime::Implementation {
  struct Datagram {
    std::size_t size = 0;
    std::array<std::byte, kMaxStateSize> bytes;
  };
  // A request of the program: its steps are events, one request of an arm after the other.
  struct Asked {
    ArmRequest request;
    std::promise<RequestAnswer> promise;
  };
  struct Arm {
    std::string name;
    ArmTiming timing;
    std::unique_ptr<ArmSide> side;
    std::unique_ptr<ClientSide> client;
    std::uint64_t periods = 0;
    std::uint64_t ends_told = 0;  // ends of motions that the program knows
    int answers_to_lose = 0, states_to_lose = 0, answers_to_delay = 0;
    std::int64_t delay_ns = 0;
    bool cable_pulled = false;
    std::deque<Asked> asked;
    bool asking = false;     // the first of them is being carried out
    std::uint64_t turn = 0;  // counts requests and losses of the connection: events of earlier ones are void
    Vector3 push_W = Vector3::Zero();
    std::int64_t push_until_ns = -1;
  };

  Implementation(const Scene& scene, SimulatedTimeOptions requested);

  // --- World and arms ---
  void step_world();
  void arm_period(ArmIndex i);
  void apply_pushes();
  void travel(ArmIndex i, bool to_arm, std::span<const std::byte> bytes, std::int64_t extra_ns);
  Datagram* take_slot();

  // --- Program ---
  ArmSet unread() const;
  ArmSet wait(std::int64_t deadline_ns, bool for_all);
  std::int64_t cost(Stall where);  // of a part of the cycle that can stall
  void hold_all(bool last);
  bool run_until(const std::function<bool()>& done, std::int64_t deadline_ns, bool last);

  // --- Requests ---
  void ask_next(ArmIndex i);
  void answer(ArmIndex i, RequestAnswer answer);
  void over_network(ArmIndex i, std::function<void()> what);  // reaches the other end later; void if lost
  void recover(ArmIndex i);
  void start_motion(ArmIndex i);
  void wait_for_start(ArmIndex i, std::int64_t deadline_ns);
  void change_setting(ArmIndex i);
  void tell_end(ArmIndex i);
  void lose_connection(ArmIndex i);

  SimulatedTimeOptions options;
  MujocoPlant plant;
  EventQueue events;
  Draw draw_network, draw_client;
  std::deque<Arm> arms;
  std::deque<Datagram> datagrams;
  std::vector<Datagram*> free_datagrams;

  bool running = false, first = true, holding = false;
  std::int64_t begun_ns = 0, woken_ns = 0, busy_until_ns = 0, sending_ns = 0;
  std::int64_t stall_reading_ns = 0, stall_sending_ns = 0;  // asked for, of the next cycle
  LoopTime now;
};

}  // namespace multipanda::fci
