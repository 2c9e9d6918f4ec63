#include "ros/adapter/state/simulation_services.hpp"

#include <algorithm>
#include <chrono>
#include <future>
#include <memory>
#include <stdexcept>

#include <fmt/format.h>

#include "arm_interface/request_patience.hpp"
#include "ros/adapter/arms/arm_requests.hpp"
#include "ros/adapter/names.hpp"
#include "ros/adapter/state/topic.hpp"

namespace multipanda::ros {
namespace {

constexpr double kAnswerTimeout = 2;

// Collects answers; a request without answer counts as failed.
std::vector<RequestAnswer> collected(std::vector<std::future<RequestAnswer>>& futures, double timeout_s) {
  std::vector<RequestAnswer> answers;
  for (auto& future : futures) {
    if (future.wait_for(std::chrono::seconds(0)) != std::future_status::ready) {
      answers.push_back(
          {.reason = fmt::format("no answer within {:.4g} s; check that the loop is running", timeout_s)});
      continue;
    }
    try {
      answers.push_back(future.get());
    } catch (const std::exception& error) {
      answers.push_back({.reason = error.what()});
    }
  }
  return answers;
}

}  // namespace

std::vector<PlaceObject> placements(const multipanda_msgs::srv::PlaceObjects::Request& request,
                                    const std::vector<std::pair<std::string, Pose>>& bases) {
  if (request.names.empty()) throw std::invalid_argument("no object is named; expected at least one");
  if (request.names.size() != request.poses.size()) {
    throw std::invalid_argument(fmt::format("expected one pose per name, found {} names and {} poses",
                                            request.names.size(), request.poses.size()));
  }
  Pose X_WR;  // frame of the poses
  if (!request.frame_id.empty() && request.frame_id != kWorldFrame) {
    const auto base = std::find_if(bases.begin(), bases.end(),
                                   [&](const auto& each) { return each.first == request.frame_id; });
    if (base == bases.end()) {
      throw std::invalid_argument(
          fmt::format("unknown frame '{}'; expected '{}' or the base of an arm, '<arm>_link0'",
                      request.frame_id, kWorldFrame));
    }
    X_WR = base->second;
  }
  std::vector<PlaceObject> places;
  for (std::size_t i = 0; i < request.names.size(); ++i) {
    const Pose X_RO = read_pose(request.poses[i], "pose of '" + request.names[i] + "'");
    places.push_back({request.names[i], X_WR * X_RO});
  }
  return places;
}

SimulationServices::SimulationServices(const AdapterContext& run)
    : run_(run),
      reset_(*run.executor, *run.node, "simulation/reset",
             Doc{"",
                 "Resets the simulated world to its start. Loop time continues, and controllets release the "
                 "arms."},
             [this](const auto&, auto reply) {
               send({ResetSimulation{}}, kAnswerTimeout, [this, reply](const auto& answers) {
                 std_srvs::srv::Trigger::Response out;
                 out.success = answers[0].success;
                 out.message = answers[0].reason;
                 run_.count_request(out.success);
                 reply(out);
               });
             }),
      pause_(*run.executor, *run.node, "simulation/pause",
             Doc{"", "`true` pauses the simulated world and its clock; `false` continues."},
             [this](const auto& request, auto reply) {
               send({PauseSimulation{static_cast<bool>(request.data)}}, kAnswerTimeout,
                    [this, reply](const auto& answers) {
                      std_srvs::srv::SetBool::Response out;
                      out.success = answers[0].success;
                      out.message = answers[0].reason;
                      run_.count_request(out.success);
                      reply(out);
                    });
             }),
      step_(*run.executor, *run.node, "simulation/step",
            Doc{"", "Runs a paused world for a number of control periods; responds when they are over."},
            [this](const auto& request, auto reply) {
              if (request.periods == 0) {
                multipanda_msgs::srv::StepSimulation::Response out;
                out.error = "the number of periods is 0; expected at least 1";
                run_.count_request(false);
                return reply(out);
              }
              // Ten times their duration in real time.
              const double timeout_s = kAnswerTimeout + 10 * request.periods * period_of(run_);
              send({StepSimulation{request.periods}}, timeout_s, [this, reply](const auto& answers) {
                multipanda_msgs::srv::StepSimulation::Response out;
                out.success = answers[0].success;
                out.error = answers[0].reason;
                run_.count_request(out.success);
                reply(out);
              });
            }),
      place_(*run.executor, *run.node, "simulation/place_objects",
             Doc{"", "Places free objects, at rest. Refused where an object would intersect another one."},
             [this](const auto& request, auto reply) { place(request, reply); }) {}

void SimulationServices::send(std::vector<WorldRequest> requests, double timeout_s, Answered answered) {
  if (const std::string why = run_.executor->late(kRequestPatience); !why.empty())
    return answered(std::vector<RequestAnswer>(requests.size(), {.success = false, .reason = why}));
  auto futures = std::make_shared<std::vector<std::future<RequestAnswer>>>();
  for (auto& request : requests) futures->push_back(run_.backend->request(std::move(request)));
  const HostTime end = host_now() + std::chrono::nanoseconds(LoopTime::from_seconds(timeout_s).ns);
  run_.executor->poll_until([=] {
    const bool all = std::all_of(futures->begin(), futures->end(), [](const auto& future) {
      return future.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
    });
    if (!all && host_now() < end) return false;
    answered(collected(*futures, timeout_s));
    return true;
  });
}

void SimulationServices::place(const multipanda_msgs::srv::PlaceObjects::Request& request,
                               const Service<multipanda_msgs::srv::PlaceObjects>::Reply& reply) {
  multipanda_msgs::srv::PlaceObjects::Response out;
  out.placed.resize(request.names.size());
  std::vector<WorldRequest> requests;
  try {
    std::vector<std::pair<std::string, Pose>> bases;
    for (const auto& arm : run_.scene->arms) bases.emplace_back(base_frame(arm.name), arm.X_WB);
    for (auto& each : placements(request, bases)) requests.emplace_back(std::move(each));
  } catch (const std::invalid_argument& error) {
    out.error = error.what();
    run_.count_request(false);
    return reply(out);
  }
  send(std::move(requests), kAnswerTimeout,
       [this, out, reply, names = request.names](const std::vector<RequestAnswer>& answers) mutable {
         out.success = true;
         for (std::size_t i = 0; i < answers.size(); ++i) {
           out.placed[i] = answers[i].success;
           if (answers[i].success) continue;
           out.success = false;
           out.error += (out.error.empty() ? "" : "; ") + names[i] + ": " + answers[i].reason;
         }
         run_.count_request(out.success);
         reply(out);
       });
}

}  // namespace multipanda::ros
