#include "ros/adapter/arms/ask_arm.hpp"

#include <chrono>
#include <future>
#include <memory>

#include <fmt/format.h>

#include "ros/rcl/executor.hpp"

namespace multipanda::ros {

void ask_arm(const AdapterWorld& world, ArmIndex arm, ArmRequest request, double patience_s,
             std::function<void(const ArmAnswer&)> answered) {
  std::shared_ptr<std::future<ArmAnswer>> future;
  try {
    future = std::make_shared<std::future<ArmAnswer>>(world.backend->request(arm, std::move(request)));
  } catch (const std::exception& error) {
    return answered({.success = false, .reason = error.what()});
  }
  const HostTime end = host_now() + std::chrono::nanoseconds(LoopTime::from_seconds(patience_s).ns);
  world.executor->poll_until([=, answered = std::move(answered)] {
    if (future->wait_for(std::chrono::seconds(0)) == std::future_status::ready) {
      ArmAnswer answer;
      try {
        answer = future->get();
      } catch (const std::exception&) {  // a promise that was given up
        answer.reason = "the backend gave no answer";
      }
      answered(answer);
      return true;
    }
    if (host_now() < end) return false;
    answered(
        {.success = false,
         .reason = fmt::format("the arm did not answer within {:.0f} s; does the run go on?", patience_s)});
    return true;
  });
}

void count_request(const AdapterWorld& world, bool success) {
  if (world.counters == nullptr) return;
  world.counters->requests.fetch_add(1, std::memory_order_relaxed);
  if (!success) world.counters->requests_refused.fetch_add(1, std::memory_order_relaxed);
}

}  // namespace multipanda::ros
