#include "ros/adapter/state/state.hpp"

#include "ros/adapter/state/arm_topics.hpp"
#include "ros/adapter/state/loop_topics.hpp"
#include "ros/adapter/state/markers.hpp"
#include "ros/adapter/state/simulation_services.hpp"
#include "ros/adapter/state/world_topics.hpp"

namespace multipanda::ros {

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
