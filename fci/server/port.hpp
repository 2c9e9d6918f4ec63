#pragma once

#include <cstdint>
#include <vector>

#include "core/types/time.hpp"

namespace multipanda::fci {

class Port;

// The descriptors that the loop of the virtual arms waits for, with their ports. One thread. Only
// add() may allocate.
class Poll {
 public:
  Poll();  // throws std::system_error
  ~Poll();
  Poll(const Poll&) = delete;
  Poll& operator=(const Poll&) = delete;

  // `events`: EPOLLIN, EPOLLOUT, level-triggered. Throws std::system_error.
  void add(int file, std::uint32_t events, Port& port);
  void change(int file, std::uint32_t events);
  void remove(int file);  // before the descriptor is closed

  // Waits at most `timeout_ms` (-1: forever) and passes ready descriptors to their ports.
  // Returns their count.
  int serve(int timeout_ms);

 private:
  int file_;
  std::vector<Port*> ports_;  // by descriptor; nullptr: none
};

// A part of the single-threaded loop of the virtual arms with descriptors: the control port of an arm, its
// gripper, the loop's timer. All calls come from the loop's thread and must not block.
class Port {
 public:
  virtual ~Port() = default;
  // Binds, listens, and puts its descriptors into `poll`, which outlives it. Throws std::runtime_error with
  // address, port and remedy.
  virtual void open(Poll& /*poll*/) {}
  // A descriptor of this port is ready; `events` as epoll has them.
  virtual void ready(int file, std::uint32_t events) = 0;
  // The world has advanced by one period of 1 ms; `period` counts them. No allocation.
  virtual void stepped(std::int64_t /*period*/) {}
};

}  // namespace multipanda::fci
