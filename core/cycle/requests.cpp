#include <cmath>

#include "core/cycle/backend.hpp"

namespace multipanda {

std::string check(const GripperMove& request) {
  if (!std::isfinite(request.width) || request.width < 0) return "the width must be 0 or more meters";
  if (!std::isfinite(request.speed) || request.speed <= 0) return "the speed must be above 0 m/s";
  return {};
}

std::string check(const GripperGrasp& request) {
  if (auto why = check(GripperMove{request.width, request.speed}); !why.empty()) return why;
  if (!std::isfinite(request.force) || request.force <= 0) return "the force must be above 0 N";
  if (!(request.tolerance_inner >= 0) || !(request.tolerance_outer >= 0)) {
    return "the tolerances must be 0 or more meters";
  }
  return {};
}

std::future<RequestAnswer> answer_now(RequestAnswer answer) {
  std::promise<RequestAnswer> promise;
  promise.set_value(std::move(answer));
  return promise.get_future();
}

std::future<RequestAnswer> refuse_request(std::string reason) {
  return answer_now({.success = false, .reason = std::move(reason)});
}

std::string no_such_arm(std::size_t arm, std::size_t count) {
  return "there is no arm " + std::to_string(arm) + ": the run has " + std::to_string(count);
}

std::future<RequestAnswer> Backend::request(ArmIndex /*arm*/, GripperRequest /*request*/) {
  return refuse_request("this backend has no grippers");
}

// By value: backends with a world keep the request.
// NOLINTNEXTLINE(performance-unnecessary-value-param)
std::future<RequestAnswer> Backend::request(WorldRequest /*request*/) {
  return refuse_request("this backend has no simulated world: this request needs simulated arms");
}

}  // namespace multipanda
