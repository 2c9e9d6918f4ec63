#include "cockpit/virtual/world_feed.hpp"

#include "core/cycle/sample_state.hpp"
#include "core/record/arm_config.hpp"
#include "scene/build.hpp"

namespace multipanda::cockpit {
namespace {

constexpr std::size_t kRecords = 1024;  // 1 s

RecordLayout layout_of(const Scene& scene) {
  RecordLayout layout;
  RecordLayout::Instance program;
  program.name = program.type = "program";
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    layout.arms.push_back({scene.arms[i].name, robot_of(scene.arms[i]).joint_count()});
    program.arms |= 1u << i;
  }
  layout.instances.push_back(std::move(program));
  return layout;
}

}  // namespace

WorldFeed::WorldFeed(const Scene& scene)
    : layout_(layout_of(scene)), ring_(layout_, kRecords), objects_(scene), arms_(scene.arms.size()) {}

void WorldFeed::take(const MujocoPlant& plant) {
  const auto period = static_cast<std::uint64_t>(plant.periods());
  objects_.take([&](const std::string& name) { return plant.object_pose(name); });
  CycleRecord* record = ring_.ring.back();
  if (record == nullptr) {
    ring_.dropped_records.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  record->cycle = period;
  record->t.ns = plant.periods() * kArmPeriodNs.count();
  record->start = host_now();
  record->period_s = before_.ns == 0 ? 0 : seconds(record->start - before_);
  before_ = record->start;
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    const ArmState& state = plant.arm(i).state();
    ArmSample& sample = record->arms[i];
    set_state(sample, state);
    const GripperState gripper = plant.gripper_state(i);
    sample.has_gripper = gripper.present;
    sample.gripper_grasped = gripper.grasped;
    sample.gripper_moving = gripper.moving;
    sample.gripper_width = gripper.width;
    sample.gripper_max_width = gripper.max_width;
    sample.due = true;
    sample.tau_controllet = sample.tau_cmd = sample.tau_J_d;
    watch(i, state, *record);
  }
  frames_.write(next_);
  ring_.ring.push();
}

// Events for changes of mode or frames; for a new arm, its frames.
void WorldFeed::watch(ArmIndex arm, const ArmState& state, const CycleRecord& record) {
  Arm& known = arms_[arm];
  Event event{.t = record.t, .cycle = record.cycle, .arm = static_cast<std::uint16_t>(arm)};
  if (state.mode != known.mode) {
    known.mode = state.mode;
    event.kind = EventKind::arm_mode;
    event.index = static_cast<std::uint16_t>(state.mode);
    if (!ring_.events.push(event)) ring_.dropped_events.fetch_add(1, std::memory_order_relaxed);
  }
  if (state.config_version == known.config_version) return;
  known.config_version = state.config_version;
  next_[arm] = state.frames;
  event.index = static_cast<std::uint16_t>(state.config_version);
  put_arm_config(event, state.frames, state.tool, state.load);
  if (!ring_.events.push(event)) ring_.dropped_events.fetch_add(1, std::memory_order_relaxed);
}

}  // namespace multipanda::cockpit
