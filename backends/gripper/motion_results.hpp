#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace multipanda {

// How a motion of a gripper ended.
enum class GripperResult : std::uint8_t {
  none,          // unknown or no longer stored
  running,       // not over yet
  success,       //
  unsuccessful,  // ended without success: nothing grasped, width not reached, or no vacuum in time
  aborted        // ended by a stop, or by another motion
};

// Results of the last motions, by ticket. Tickets count from 1.
class MotionResults {
 public:
  using Ticket = std::uint64_t;

  // Starts a motion and aborts the running one.
  Ticket begin() {
    end(GripperResult::aborted);
    at(++last_) = GripperResult::running;
    return last_;
  }
  // Ends the running motion, if any.
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
