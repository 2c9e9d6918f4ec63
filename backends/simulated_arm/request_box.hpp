#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <future>
#include <mutex>
#include <thread>

#include "backends/simulated_arm/arm_reply.hpp"
#include "core/cycle/backend.hpp"
#include "core/rt/spsc_ring.hpp"
#include "device/request_patience.hpp"

namespace multipanda {

// Requests from any thread to the loop of a simulated backend, and their answers as futures.
//
// Callers share a mutex that the loop never touches. The loop takes requests from a ring at its step's start
// and marks each as answered in its slot; a helper thread, awake only while something is pending, fulfills
// the promises, because that allocates and locks.
class RequestBox {
 public:
  static constexpr std::size_t kSlots = 64;  // requests that wait or are being carried out, at most

  // What the loop finds after `patience_s` is refused.
  explicit RequestBox(double patience_s = kRequestPatience);
  ~RequestBox();
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
  void open();   // posts wait for the loop
  void close();  // answers what is still waiting; later posts are refused

  // --- loop thread; no lock, no allocation ---
  const Posted* front();        // the oldest request not taken and not refused; nullptr: none
  void answer(ArmReply reply);  // to front(), which is then removed
  // front() is being executed and is removed from the queue; the returned handle answers it later. close()
  // answers what is left.
  std::size_t defer();
  void answer(std::size_t deferred, ArmReply reply);

 private:
  enum class Stage : std::uint8_t { free, waiting, deferred, answered };
  struct Slot {
    std::atomic<Stage> stage{Stage::free};
    Posted posted;
    HostTime since;
    ArmReply reply = ArmReply::done;
    std::promise<RequestAnswer> promise;
  };
  void keep_promises();

  const double patience_s_;
  std::array<Slot, kSlots> slots_;
  SpscRing<std::uint8_t> ring_{kSlots};
  std::mutex askers_;
  std::condition_variable posted_;
  std::size_t pending_ = 0;  // guarded by askers_, as the next two
  bool closed_ = false, ending_ = false;
  std::thread helper_;
};

}  // namespace multipanda
