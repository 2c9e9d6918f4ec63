#include "ros/adapter/state/simulation_services.hpp"

#include <algorithm>
#include <chrono>
#include <future>
#include <memory>
#include <stdexcept>

#include <fmt/format.h>

#include "arm_interface/arm_interface.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/arms/arm_requests.hpp"
#include "ros/adapter/state/arm_topics.hpp"
#include "ros/adapter/state/loop_topics.hpp"
#include "ros/adapter/state/markers.hpp"
#include "ros/adapter/state/messages.hpp"
#include "ros/adapter/topic.hpp"

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
               forward<std_srvs::srv::Trigger>(ResetSimulation{}, kAnswerTimeout, reply);
             }),
      pause_(*run.executor, *run.node, "simulation/pause",
             Doc{"", "`true` pauses the simulated world and its clock; `false` continues."},
             [this](const auto& request, auto reply) {
               forward<std_srvs::srv::SetBool>(PauseSimulation{static_cast<bool>(request.data)},
                                               kAnswerTimeout, reply);
             }),
      step_(*run.executor, *run.node, "simulation/step",
            Doc{"", "Runs a paused world for a number of control periods; responds when they are over."},
            [this](const auto& request, auto reply) {
              if (request.periods == 0)
                return reply(response_of<Step::Response>(
                    run_, {.reason = "the number of periods is 0; expected at least 1"}));
              // Ten times their duration in real time.
              const double timeout_s = kAnswerTimeout + 10 * request.periods * period_of(run_);
              forward<Step>(StepSimulation{request.periods}, timeout_s, reply);
            }),
      place_(*run.executor, *run.node, "simulation/place_objects",
             Doc{"", "Places free objects, at rest. Refused where an object would intersect another one."},
             [this](const auto& request, auto reply) { place(request, reply); }) {}

template <class S>
void SimulationServices::forward(WorldRequest request, double timeout_s,
                                 const typename Service<S>::Reply& reply) {
  send({std::move(request)}, timeout_s,
       [this, reply](const auto& answers) { reply(response_of<typename S::Response>(run_, answers[0])); });
}

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

ClockTopic::ClockTopic(const AdapterContext& run)
    : clock_(*run.node, "/clock", Qos::reliable(1), run.options->rates_hz.clock, period_of(run),
             "Simulated time. Set `use_sim_time` in nodes that should follow it.") {}

void ClockTopic::take(const CycleRecord& record) {
  if (!clock_.due(record.cycle)) return;
  clock_.message.clock = to_time(record.t.ns);
  clock_.publish();
}

namespace {

std::vector<std::string> free_objects(const Scene& scene) {
  std::vector<std::string> names;
  for (const auto& object : scene.objects) {
    if (!object.fixed) names.push_back(object.name);
  }
  return names;
}

}  // namespace

ObjectPosesTopic::ObjectPosesTopic(const AdapterContext& run)
    : run_(run),
      names_(free_objects(*run.scene)),
      every_(run.options->rates_hz.object_poses, period_of(run)),
      snapshot_(names_.size()),
      newest_(snapshot_),
      publisher_(*run.node, "simulation/object_poses", Qos::reliable(),
                 Doc{every_.text(period_of(run)), "Poses of the free objects of the simulated run."}) {
  message_.header.frame_id = kWorldFrame;
  message_.names = names_;
  message_.poses.resize(names_.size());
}

void ObjectPosesTopic::on_loop(const Tick& tick, const Backend& backend) {
  if (!every_.due(tick.cycle)) return;
  for (std::size_t i = 0; i < names_.size(); ++i) {
    const std::optional<Pose> X_WO = backend.object_pose(names_[i]);
    if (!X_WO) return;  // not available at this moment
    snapshot_.X_WO[i] = *X_WO;
  }
  snapshot_.tick = tick;
  newest_.write(snapshot_);
}

void ObjectPosesTopic::take(const CycleRecord&) {
  if (!newest_.take() || publisher_.subscribers() == 0) return;
  const Snapshot& snapshot = newest_.value();
  message_.header.stamp = to_time(run_.stamps.at(snapshot.tick.t, snapshot.tick.start));
  for (std::size_t i = 0; i < names_.size(); ++i) set_pose(message_.poses[i], snapshot.X_WO[i]);
  publisher_.publish(message_);
}

AdapterParts make_state(const AdapterContext& run) {
  AdapterParts parts;
  // The clock comes first, so that no stamp is ahead of it.
  if (run.stamps.simulated) parts.push_back(std::make_unique<ClockTopic>(run));
  parts.push_back(std::make_unique<ArmTopics>(run));
  for (std::size_t arm = 0; arm < run.layout->arms.size(); ++arm) {
    const auto index = static_cast<ArmIndex>(arm);
    if (!run.backend->capabilities(index).simulated) continue;
    if (run.options->rates_hz.object_poses > 0) parts.push_back(std::make_unique<ObjectPosesTopic>(run));
    parts.push_back(std::make_unique<SimulationServices>(run));
    break;
  }
  if (run.options->rates_hz.markers > 0) parts.push_back(std::make_unique<Markers>(run));
  parts.push_back(std::make_unique<LoopTopics>(run));
  parts.push_back(std::make_unique<DiagnosticsTopic>(run));
  return parts;
}

}  // namespace multipanda::ros
