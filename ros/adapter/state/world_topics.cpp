#include "ros/adapter/state/world_topics.hpp"

#include "backends/simulation_view.hpp"
#include "ros/adapter/names.hpp"
#include "ros/adapter/state/messages.hpp"

namespace multipanda::ros {

ClockTopic::ClockTopic(const AdapterWorld& world)
    : clock_(*world.node, "/clock", Qos::reliable(1), world.options->rates_hz.clock, period_of(world),
             "Simulated time: set `use_sim_time` in nodes that are to follow it.") {}

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

ObjectPosesTopic::ObjectPosesTopic(const AdapterWorld& world)
    : world_(world),
      names_(free_objects(*world.scene)),
      every_(world.options->rates_hz.object_poses, period_of(world)),
      seen_(names_.size()),
      newest_(seen_),
      publisher_(*world.node, "simulation/object_poses", Qos::reliable(),
                 Doc{every_.words(period_of(world)), "Free objects of the simulated world."}) {
  message_.header.frame_id = kWorldFrame;
  message_.names = names_;
  message_.poses.resize(names_.size());
}

void ObjectPosesTopic::on_loop(const Tick& tick, const Backend& backend) {
  if (!every_.due(tick.cycle)) return;
  const SimulationView* simulation = simulation_of(backend);
  if (simulation == nullptr) return;
  for (std::size_t i = 0; i < names_.size(); ++i) {
    const std::optional<Pose> X_WO = simulation->object_pose(names_[i]);
    if (!X_WO) return;  // it cannot tell now
    seen_.X_WO[i] = *X_WO;
  }
  seen_.tick = tick;
  newest_.write(seen_);
}

void ObjectPosesTopic::take(const CycleRecord&) {
  if (!newest_.take() || publisher_.subscribers() == 0) return;
  const Seen& seen = newest_.value();
  message_.header.stamp = to_time(world_.stamps.at(seen.tick.t, seen.tick.start));
  for (std::size_t i = 0; i < names_.size(); ++i) set_pose(message_.poses[i], seen.X_WO[i]);
  publisher_.publish(message_);
}

}  // namespace multipanda::ros
