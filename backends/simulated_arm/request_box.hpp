#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <future>
#include <mutex>
#include <optional>
#include <string_view>
#include <thread>

#include "arm_interface/arm_interface.hpp"
#include "core/cycle/backend.hpp"
#include "core/rt/spsc_ring.hpp"
#include "core/types/gap_watch.hpp"

namespace multipanda {

// Reply of a simulated backend's loop to a request; its text is composed off the loop.
enum class ArmReply : std::uint8_t {
  done,
  nothing_to_recover,    // RecoverFromError without an error or stop
  user_stop_pressed,     // RecoverFromError while the user stop is pressed
  takes_no_load,         // SetLoad in a reflex, a stop or while it is guided
  not_supported,         // this backend does not support the request
  would_penetrate,       // PlaceObject into another object
  not_paused,            // StepSimulation of a running world
  still_stepping,        // StepSimulation while an earlier one is running
  no_gripper,            // the arm has no such gripper
  gripper_unsuccessful,  // the gripper motion did not succeed
  vacuum_unsuccessful,   // no vacuum in time
  gripper_aborted,       // by a stop or another motion
  loop_ended,            // the loop ended before it took the request
  too_late,              // the caller may have given up by then
  count_
};

std::string_view to_string(ArmReply reply);

// Requests from any thread to the loop of a simulated backend, and their answers as futures.
//
// Callers share a mutex that the loop never touches. The loop takes requests from a ring at the start of a
// step and marks each as answered in its slot; a helper thread, which the first request starts and which is
// awake only while requests are pending, fulfills the promises, which allocates and locks.
class RequestBox {
 public:
  static constexpr std::size_t kSlots = 64;         // largest number of pending requests ...
  static constexpr std::size_t kOnlyForStops = 16;  // ... of which these only for requests that end a motion

  // Requests that the loop finds after `patience_s` are refused.
  explicit RequestBox(double patience_s = kRequestPatience);
  ~RequestBox();
  // For a loop on the wall clock: requests posted before it stalled (GapWatch) are refused, too.
  void refuse_after_gaps() { watches_gaps_ = true; }
  RequestBox(const RequestBox&) = delete;
  RequestBox& operator=(const RequestBox&) = delete;

  struct Posted {
    ArmIndex arm = 0;
    BackendRequest request;
    std::size_t object = 0;  // PlaceObject, PushObject: the requested object, looked up off the loop
  };

  // --- any thread ---
  std::future<RequestAnswer> post(Posted posted);

  // --- before and after the loop runs ---
  void open();   // posts wait for the loop from now on
  void close();  // answers pending requests; later posts are refused

  // --- loop thread; no lock, no allocation ---
  const Posted* front();        // the oldest request not taken and not refused; nullptr: none
  void answer(ArmReply reply);  // to front(), which is then removed
  // Takes front() from the queue while it is executed; the returned handle answers it later. close() answers
  // the rest.
  std::size_t defer();
  void answer(std::size_t deferred, ArmReply reply);

 private:
  enum class Stage : std::uint8_t { free, waiting, deferred, answered };
  struct Slot {
    std::atomic<Stage> stage{Stage::free};
    Posted posted;
    HostTime since;
    ArmReply reply = ArmReply::done;
    std::optional<std::promise<RequestAnswer>> promise;  // none before its first request
  };
  void keep_promises();

  const double patience_s_;
  std::array<Slot, kSlots> slots_;
  SpscRing<std::uint8_t> ring_{kSlots};
  GapWatch gaps_;  // loop
  bool watches_gaps_ = false;
  std::mutex callers_;
  std::condition_variable posted_;
  std::size_t pending_ = 0;  // protected by callers_, like the next two
  bool closed_ = false, ending_ = false;
  std::thread helper_;
};

}  // namespace multipanda
