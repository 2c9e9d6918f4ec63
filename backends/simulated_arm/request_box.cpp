#include "backends/simulated_arm/request_box.hpp"

#include <chrono>
#include <utility>

namespace multipanda {

std::string_view to_string(ArmReply reply) {
  switch (reply) {
    case ArmReply::done:
      return "done";
    case ArmReply::nothing_to_recover:
      return "the arm has no error and was not stopped: there is nothing to recover from";
    case ArmReply::user_stop_pressed:
      return "the user stop is pressed: release it first";
    case ArmReply::takes_no_load:
      return "the arm has stopped or is guided by hand, and another load would move it: recover or let go of "
             "it first";
    case ArmReply::not_supported:
      return "this backend does not support this request";
    case ArmReply::would_penetrate:
      return "the object would penetrate another: choose another position";
    case ArmReply::not_paused:
      return "the simulation is running: pause it before stepping";
    case ArmReply::still_stepping:
      return "an earlier step is still running: try again";
    case ArmReply::no_gripper:
      return "the arm has no such gripper: in a scene, write 'fingers: movable' or 'vacuum: true'";
    case ArmReply::gripper_unsuccessful:
      return "the gripper motion did not succeed: nothing of that width was grasped, or the width was not "
             "reached";
    case ArmReply::vacuum_unsuccessful:
      return "the vacuum gripper did not succeed in time: nothing was picked up, or what it held was not "
             "released";
    case ArmReply::gripper_aborted:
      return "the gripper's motion was ended by a stop or by another motion";
    case ArmReply::loop_ended:
      return "the control loop is not running: start it and try again";
    case ArmReply::too_late:
      return kRequestTooOld;
    case ArmReply::count_:
      break;
  }
  return "unknown reply";
}

RequestBox::RequestBox(double patience_s) : patience_s_(patience_s) {}

RequestBox::~RequestBox() {
  close();
  {
    const std::lock_guard lock(callers_);
    ending_ = true;
  }
  posted_.notify_all();
  if (helper_.joinable()) helper_.join();
}

std::future<RequestAnswer> RequestBox::post(Posted posted) {
  const std::lock_guard lock(callers_);
  if (closed_) return refuse_request(std::string(to_string(ArmReply::loop_ended)));
  for (std::size_t i = ends_motion(posted.request) ? 0 : kOnlyForStops; i < kSlots; ++i) {
    Slot& slot = slots_[i];
    if (slot.stage.load(std::memory_order_acquire) != Stage::free) continue;
    slot.posted = std::move(posted);
    slot.since = host_now();
    slot.promise.emplace();
    slot.stage.store(Stage::waiting, std::memory_order_release);
    auto future = slot.promise->get_future();
    ring_.push(static_cast<std::uint8_t>(i));  // never full: as many places as slots
    ++pending_;
    if (!helper_.joinable()) helper_ = std::thread([this] { keep_promises(); });
    posted_.notify_one();
    return future;
  }
  return refuse_request("too many requests are pending: wait for answers before sending more");
}

void RequestBox::open() {
  const std::lock_guard lock(callers_);
  closed_ = false;
  gaps_.restart();
}

void RequestBox::close() {
  const std::lock_guard lock(callers_);
  closed_ = true;
  while (ring_.front() != nullptr) answer(ArmReply::loop_ended);
  for (std::size_t i = 0; i < kSlots; ++i) {
    if (slots_[i].stage.load(std::memory_order_acquire) == Stage::deferred) answer(i, ArmReply::loop_ended);
  }
}

const RequestBox::Posted* RequestBox::front() {
  const HostTime now = host_now();
  const HostTime restarted = watches_gaps_ ? gaps_.look(now) : HostTime{};
  while (const std::uint8_t* index = ring_.front()) {
    const Slot& slot = slots_[*index];
    const bool late =
        std::visit([&](const auto& r) { return is_past(r.begin_by, now); }, slot.posted.request);
    if (ends_motion(slot.posted.request)) return &slot.posted;
    if (!late && slot.since >= restarted && seconds(now - slot.since) < patience_s_) return &slot.posted;
    answer(ArmReply::too_late);
  }
  return nullptr;
}

void RequestBox::answer(ArmReply reply) { answer(defer(), reply); }

std::size_t RequestBox::defer() {
  const std::size_t index = *ring_.front();
  ring_.pop();
  slots_[index].stage.store(Stage::deferred, std::memory_order_relaxed);
  return index;
}

void RequestBox::answer(std::size_t deferred, ArmReply reply) {
  Slot& slot = slots_[deferred];
  slot.reply = reply;
  slot.stage.store(Stage::answered, std::memory_order_release);
}

void RequestBox::keep_promises() {
  // The loop must not signal (that could lock), so pending slots are polled often.
  constexpr auto kLook = std::chrono::microseconds(500);
  std::unique_lock lock(callers_);
  while (true) {
    posted_.wait(lock, [this] { return pending_ > 0 || ending_; });
    for (Slot& slot : slots_) {
      if (slot.stage.load(std::memory_order_acquire) != Stage::answered) continue;
      slot.promise->set_value(
          {.success = slot.reply == ArmReply::done,
           .reason = slot.reply == ArmReply::done ? std::string{} : std::string(to_string(slot.reply))});
      slot.stage.store(Stage::free, std::memory_order_release);
      --pending_;
    }
    if (ending_ && pending_ == 0) return;
    if (pending_ > 0) posted_.wait_for(lock, kLook, [this] { return ending_; });
  }
}

}  // namespace multipanda
