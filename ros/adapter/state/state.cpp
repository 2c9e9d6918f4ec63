#include "ros/adapter/state/state.hpp"

#include "ros/adapter/state/arm_topics.hpp"
#include "ros/adapter/state/loop_topics.hpp"
#include "ros/adapter/state/simulation_services.hpp"
#include "ros/adapter/state/world_topics.hpp"

namespace multipanda::ros {

Parts make_state(const AdapterWorld& world) {
  Parts parts;
  // The clock first: what is stamped with a time is not ahead of it.
  if (world.stamps.simulated) parts.push_back(std::make_unique<ClockTopic>(world));
  parts.push_back(std::make_unique<ArmTopics>(world));
  for (std::size_t arm = 0; arm < world.layout->arms.size(); ++arm) {
    const auto index = static_cast<ArmIndex>(arm);
    if (!world.backend->capabilities(index).simulated) continue;
    if (world.options->rates_hz.object_poses > 0) parts.push_back(std::make_unique<ObjectPosesTopic>(world));
    parts.push_back(std::make_unique<SimulationServices>(world, index));
    break;
  }
  parts.push_back(std::make_unique<LoopTopics>(world));
  parts.push_back(std::make_unique<DiagnosticsTopic>(world));
  return parts;
}

}  // namespace multipanda::ros
