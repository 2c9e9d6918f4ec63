#include "ros/adapter/arms/request_arm.hpp"

#include <chrono>
#include <future>
#include <memory>

#include "ros/rcl/executor.hpp"
#include "runtime/request_text.hpp"

namespace multipanda::ros {
namespace {

template <typename Request>
void send(const AdapterContext& run, ArmIndex arm, Request request, double timeout_s,
          std::function<void(const RequestAnswer&)> answered) {
  const bool ends = ends_motion(request);
  if (!ends) {
    if (const std::string why = run.executor->late(kRequestPatience); !why.empty())
      return answered({.success = false, .reason = why});
  }
  std::shared_ptr<std::future<RequestAnswer>> future;
  try {
    auto answer = [&] {
      if constexpr (std::is_same_v<Request, ArmRequest>)
        return multipanda::request_arm(*run.modes, *run.backend, arm, std::move(request));
      else
        return run.backend->request(arm, std::move(request));
    };
    future = std::make_shared<std::future<RequestAnswer>>(answer());
  } catch (const std::exception& error) {
    return answered({.success = false, .reason = error.what()});
  }
  const HostTime end = host_now() + std::chrono::nanoseconds(LoopTime::from_seconds(timeout_s).ns);
  (ends ? run.stops : run.executor)->poll_until([=, answered = std::move(answered)] {
    if (future->wait_for(std::chrono::seconds(0)) == std::future_status::ready) {
      RequestAnswer answer;
      try {
        answer = future->get();
      } catch (const std::exception&) {  // a broken promise
        answer.reason = "the backend did not answer";
      }
      answered(answer);
      return true;
    }
    if (host_now() < end) return false;
    answered({.success = false, .reason = kRequestUnfinished});
    return true;
  });
}

}  // namespace

void request_arm(const AdapterContext& run, ArmIndex arm, ArmRequest request, double timeout_s,
                 std::function<void(const RequestAnswer&)> answered) {
  send(run, arm, std::move(request), timeout_s, std::move(answered));
}

void request_arm(const AdapterContext& run, ArmIndex arm, GripperRequest request, double timeout_s,
                 std::function<void(const RequestAnswer&)> answered) {
  send(run, arm, std::move(request), timeout_s, std::move(answered));
}

}  // namespace multipanda::ros
