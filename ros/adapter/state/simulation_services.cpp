#include "ros/adapter/state/simulation_services.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <future>
#include <memory>
#include <stdexcept>
#include <tuple>

#include <fmt/format.h>

#include "ros/adapter/names.hpp"
#include "ros/adapter/state/topic.hpp"

namespace multipanda::ros {
namespace {

constexpr double kPatience_s = 2;

// Of the answers that are there; a request without one failed.
std::vector<ArmAnswer> collected(std::vector<std::future<ArmAnswer>>& futures, double patience_s) {
  std::vector<ArmAnswer> answers;
  for (auto& future : futures) {
    if (future.wait_for(std::chrono::seconds(0)) != std::future_status::ready) {
      answers.push_back(
          {.reason = fmt::format("no answer within {:.4g} s; is the loop running?", patience_s)});
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
  Pose X_WR;  // the frame that the poses are given in
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
    const auto& [p, q] = std::tie(request.poses[i].position, request.poses[i].orientation);
    const Quaternion rotation(q.w, q.x, q.y, q.z);
    const Vector3 position(p.x, p.y, p.z);
    if (!position.allFinite() || std::abs(rotation.norm() - 1) > 0.01 || !rotation.coeffs().allFinite()) {
      throw std::invalid_argument(
          fmt::format("pose of '{}': expected finite numbers and a unit quaternion", request.names[i]));
    }
    places.push_back({request.names[i], X_WR * Pose::from(position, rotation)});
  }
  return places;
}

SimulationServices::SimulationServices(const AdapterWorld& world, ArmIndex simulated_arm)
    : world_(world),
      arm_(simulated_arm),
      reset_(*world.executor, *world.node, "simulation/reset",
             Doc{"", "The simulated world back to its start; loop time goes on, controllets let go."},
             [this](const auto&, auto reply) {
               ask({ResetSimulation{}}, kPatience_s, [this, reply](const auto& answers) {
                 std_srvs::srv::Trigger::Response out;
                 out.success = answers[0].success;
                 out.message = answers[0].reason;
                 count(out.success);
                 reply(out);
               });
             }),
      pause_(*world.executor, *world.node, "simulation/pause",
             Doc{"", "`true`: the simulated world stands still, with its clock; `false`: goes on."},
             [this](const auto& request, auto reply) {
               ask({PauseSimulation{static_cast<bool>(request.data)}}, kPatience_s,
                   [this, reply](const auto& answers) {
                     std_srvs::srv::SetBool::Response out;
                     out.success = answers[0].success;
                     out.message = answers[0].reason;
                     count(out.success);
                     reply(out);
                   });
             }),
      step_(*world.executor, *world.node, "simulation/step",
            Doc{"", "A paused world goes on by so many control periods; answered when they are over."},
            [this](const auto& request, auto reply) {
              if (request.periods == 0) {
                multipanda_msgs::srv::StepSimulation::Response out;
                out.error = "no period to go on by; expected at least 1";
                count(false);
                return reply(out);
              }
              // Ten times what they take in real time.
              const double patience = kPatience_s + 10 * request.periods * period_of(world_);
              ask({StepSimulation{request.periods}}, patience, [this, reply](const auto& answers) {
                multipanda_msgs::srv::StepSimulation::Response out;
                out.success = answers[0].success;
                out.error = answers[0].reason;
                count(out.success);
                reply(out);
              });
            }),
      place_(*world.executor, *world.node, "simulation/place_objects",
             Doc{"", "Puts free objects somewhere, at rest; refused where they would stand in something."},
             [this](const auto& request, auto reply) { place(request, reply); }) {}

void SimulationServices::count(bool success) const {
  world_.counters->requests.fetch_add(1, std::memory_order_relaxed);
  if (!success) world_.counters->requests_refused.fetch_add(1, std::memory_order_relaxed);
}

void SimulationServices::ask(std::vector<ArmRequest> requests, double patience_s, Answered answered) {
  auto futures = std::make_shared<std::vector<std::future<ArmAnswer>>>();
  for (auto& request : requests) futures->push_back(world_.backend->request(arm_, std::move(request)));
  const HostTime end = host_now() + std::chrono::nanoseconds(LoopTime::from_seconds(patience_s).ns);
  world_.executor->poll_until([=] {
    const bool all = std::all_of(futures->begin(), futures->end(), [](const auto& future) {
      return future.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
    });
    if (!all && host_now() < end) return false;
    answered(collected(*futures, patience_s));
    return true;
  });
}

void SimulationServices::place(const multipanda_msgs::srv::PlaceObjects::Request& request,
                               const Service<multipanda_msgs::srv::PlaceObjects>::Reply& reply) {
  multipanda_msgs::srv::PlaceObjects::Response out;
  out.placed.resize(request.names.size());
  std::vector<ArmRequest> requests;
  try {
    std::vector<std::pair<std::string, Pose>> bases;
    for (const auto& arm : world_.scene->arms) bases.emplace_back(base_frame(arm.name), arm.X_WB);
    for (auto& each : placements(request, bases)) requests.emplace_back(std::move(each));
  } catch (const std::invalid_argument& error) {
    out.error = error.what();
    count(false);
    return reply(out);
  }
  ask(std::move(requests), kPatience_s,
      [this, out, reply, names = request.names](const std::vector<ArmAnswer>& answers) mutable {
        out.success = true;
        for (std::size_t i = 0; i < answers.size(); ++i) {
          out.placed[i] = answers[i].success;
          if (answers[i].success) continue;
          out.success = false;
          out.error += (out.error.empty() ? "" : "; ") + names[i] + ": " + answers[i].reason;
        }
        count(out.success);
        reply(out);
      });
}

}  // namespace multipanda::ros
