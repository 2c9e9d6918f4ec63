#pragma once

#include "core/types/time.hpp"
#include "fci/server/port.hpp"
#include "fci/server/sockets.hpp"

namespace multipanda::fci {

// A time on the steady clock at which the loop wakes. One thread.
class WakeTimer : public Port {
 public:
  WakeTimer();  // throws std::system_error
  void open(Poll& poll) override;
  void ready(int file, std::uint32_t events) override;
  // Wakes at `at` or before. A past time wakes at once.
  void ensure(HostTime at) {
    if (!armed_ || at < at_) set(at);
  }

 private:
  void set(HostTime at);

  Socket file_;
  HostTime at_;
  bool armed_ = false;
};

// A wake-up from another thread.
class WakeWord : public Port {
 public:
  WakeWord();  // throws std::system_error
  void open(Poll& poll) override;
  void ready(int file, std::uint32_t events) override;
  void call() const;  // any thread

 private:
  Socket file_;
};

}  // namespace multipanda::fci
