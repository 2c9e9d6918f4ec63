#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "fci/simulated_time/arm_side.hpp"
#include "fci/simulated_time/client_side.hpp"
#include "fci/simulated_time/simulated_time.hpp"
#include "fci/simulated_time/timing.hpp"

// Internals of SimulatedTime, for its own files.
namespace multipanda::fci {

inline std::int64_t nanoseconds(double s) { return static_cast<std::int64_t>(std::llround(1e9 * s)); }

// Events of a discrete-event simulation, in whole nanoseconds. Simultaneous events keep the order in which
// they were added, so that runs are deterministic.
class EventQueue {
 public:
  using Action = std::function<void()>;

  std::int64_t now_ns() const { return now_ns_; }
  // At `time_ns`, or now if that has passed.
  void at(std::int64_t time_ns, Action action) {
    events_.push_back({std::max(time_ns, now_ns_), added_++, std::move(action)});
    std::push_heap(events_.begin(), events_.end());
  }
  void after(std::int64_t delay_ns, Action action) { at(now_ns_ + delay_ns, std::move(action)); }
  bool empty() const { return events_.empty(); }
  std::int64_t next_ns() const { return events_.front().time_ns; }
  // The next event.
  void step() {
    std::pop_heap(events_.begin(), events_.end());
    Event event = std::move(events_.back());
    events_.pop_back();
    now_ns_ = event.time_ns;
    event.action();
  }
  // Executes all events up to `time_ns`, which becomes the present time.
  void run_until(std::int64_t time_ns) {
    while (!empty() && next_ns() <= time_ns) step();
    now_ns_ = std::max(now_ns_, time_ns);
  }

 private:
  struct Event {
    std::int64_t time_ns = 0;
    std::uint64_t number = 0;
    Action action;
    bool operator<(const Event& other) const {  // the heap's largest element is the earliest event
      return time_ns != other.time_ns ? time_ns > other.time_ns : number > other.number;
    }
  };
  std::vector<Event> events_;
  std::int64_t now_ns_ = 0;
  std::uint64_t added_ = 0;
};

struct SimulatedTime::Implementation {
  struct Datagram {
    std::size_t size = 0;
    std::array<std::byte, kMaxStateSize> bytes;
  };
  // A request of the program: its steps are events, in sequence for each arm.
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
    std::uint64_t ends_known = 0;  // ends of motions that the program knows
    int answers_to_lose = 0, states_to_lose = 0, answers_to_delay = 0;
    std::int64_t delay_ns = 0;
    bool cable_pulled = false;
    std::deque<Asked> asked;
    bool asking = false;     // the first of them is in progress
    std::uint64_t turn = 0;  // counts requests and connection losses: events of earlier ones are void
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
  std::int64_t cost(Stall where);  // duration of a part of the cycle that can stall
  void hold_all(bool last);
  bool run_until(const std::function<bool()>& done, std::int64_t deadline_ns, bool last);

  // --- Requests ---
  void ask_next(ArmIndex i);
  void answer(ArmIndex i, RequestAnswer answer);
  void over_network(ArmIndex i, std::function<void()> what);  // reaches the other end later, or is void if
                                                              // lost
  void recover(ArmIndex i);
  void await_recovery(ArmIndex i);
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
  std::int64_t stall_reading_ns = 0, stall_sending_ns = 0;  // requested for the next cycle
  LoopTime now;
};

}  // namespace multipanda::fci
