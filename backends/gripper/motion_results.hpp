#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace multipanda {

// How a motion of a gripper ended.
enum class GripperResult : std::uint8_t {
  none,          // there was no such motion, or it is forgotten
  running,       // not over yet
  success,       //
  unsuccessful,  // over, but not as asked: nothing grasped, the width not reached, no vacuum in time
  aborted        // by a stop, or by another motion
};

// Results of the last motions, by ticket. Tickets count from 1.
class MotionResults {
 public:
  using Ticket = std::uint64_t;

  // Begins a motion; the one that runs is aborted.
  Ticket begin() {
    end(GripperResult::aborted);
    at(++last_) = GripperResult::running;
    return last_;
  }
  // The running motion is over; nothing if none runs.
  void end(GripperResult result) {
    if (running()) at(last_) = result;
  }
  bool running() const { return last_ > 0 && at(last_) == GripperResult::running; }
  GripperResult of(Ticket ticket) const {
    return ticket == 0 || ticket > last_ || last_ - ticket >= kKept ? GripperResult::none : at(ticket);
  }

 private:
  static constexpr std::size_t kKept = 64;
  GripperResult& at(Ticket ticket) { return results_[static_cast<std::size_t>(ticket % kKept)]; }
  const GripperResult& at(Ticket ticket) const { return results_[static_cast<std::size_t>(ticket % kKept)]; }

  std::array<GripperResult, kKept> results_{};
  Ticket last_ = 0;
};

}  // namespace multipanda
