#include "core/cycle/backend.hpp"

namespace multipanda {

std::string check(const GripperRequest& request) {
  if (const auto* move = std::get_if<GripperMove>(&request)) {
    if (!(move->width >= 0 && move->width <= 1)) return "the width must be 0 to 1 m";
    if (!(move->speed > 0 && move->speed <= 10)) return "the speed must be above 0 and at most 10 m/s";
  } else if (const auto* grasp = std::get_if<GripperGrasp>(&request)) {
    if (auto why = check(GripperMove{grasp->width, grasp->speed}); !why.empty()) return why;
    if (!(grasp->force > 0 && grasp->force <= 1000)) return "the force must be above 0 and at most 1000 N";
    for (const double tolerance : {grasp->tolerance_inner, grasp->tolerance_outer})
      if (!(tolerance >= 0 && tolerance <= 1)) return "the tolerances must be 0 to 1 m";
  } else if (const auto* follow = std::get_if<GripperFollow>(&request)) {
    if (!(follow->silence > 0 && follow->silence <= GripperFollow::kMostSilence))
      return "the silence must be above 0 and at most 1 s";
    return check(GripperGrasp{follow->width.value_or(0), follow->speed, follow->force});
  } else if (const auto* on = std::get_if<VacuumOn>(&request)) {
    // Below 50, a gripper would report the vacuum as reached while its part falls; ambient pressure is
    // 1013 mbar.
    if (!(on->pressure_mbar >= 50 && on->pressure_mbar <= 1000)) return "the vacuum must be 50 to 1000 mbar";
    return check(VacuumDrop{on->timeout_s});
  } else if (const auto* drop = std::get_if<VacuumDrop>(&request)) {
    if (!(drop->timeout_s > 0 && drop->timeout_s <= 60))
      return "the timeout must be above 0 and at most 60 s";
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

// By value: backends with grippers or a world keep the request.
// NOLINTNEXTLINE(performance-unnecessary-value-param)
std::future<RequestAnswer> Backend::request(ArmIndex /*arm*/, GripperRequest /*request*/) {
  return refuse_request("this backend has no grippers");
}

// NOLINTNEXTLINE(performance-unnecessary-value-param)
std::future<RequestAnswer> Backend::request(WorldRequest /*request*/) {
  return refuse_request("this backend has no simulated world: this request needs simulated arms");
}

}  // namespace multipanda
