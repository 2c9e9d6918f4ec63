#include "ros/adapter/state/world_topics.hpp"

#include "ros/adapter/names.hpp"
#include "ros/adapter/state/messages.hpp"

namespace multipanda::ros {

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

}  // namespace multipanda::ros
