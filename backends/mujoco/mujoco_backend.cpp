#include "backends/mujoco/mujoco_backend.hpp"

namespace multipanda {

MujocoBackend::MujocoBackend(const Scene& scene, MujocoOptions options)
    : pace_(options.pace), plant_(scene, {.meshes = std::move(options.meshes)}) {}

Capabilities MujocoBackend::capabilities(ArmIndex arm) const {
  return {.simulated = true,
          .lockstep = true,
          .compensates_gravity = true,
          .compensates_friction = plant_.is_frictionless(arm),
          .has_external_torque = false,
          .has_contact_truth = true,
          .period_s = kPeriod};
}

void MujocoBackend::start() {
  requests_.open();
  pacer_.start();
}

void MujocoBackend::finish() {
  for (ArmIndex i = 0; i < arm_count(); ++i) plant_.arm(i).stop_moving();
  requests_.close();
}

ArmSet MujocoBackend::wait() {
  advance();
  if (pace_ == Pace::realtime || paused_) pacer_.wait();
  take_requests();
  return plant_.failed() ? ArmSet() : ArmSet::all(plant_.arm_count());
}

LoopTime MujocoBackend::now() const { return {plant_.periods() * 1'000'000}; }

void MujocoBackend::read(ArmSet due, std::span<ArmState> states) {
  for (ArmIndex i = 0; i < plant_.arm_count(); ++i) {
    if (due.contains(i)) states[i] = plant_.arm(i).state();
  }
}

void MujocoBackend::write(ArmSet due, std::span<const ArmCommand> commands) {
  if (paused_ || plant_.failed()) return;
  for (ArmIndex i = 0; i < plant_.arm_count(); ++i) {
    if (due.contains(i)) {
      plant_.arm(i).take_command(commands[i].tau_cmd);
    } else {
      plant_.arm(i).miss_command();
    }
  }
  commanded_ = true;
}

// The period that the last write() began. It runs in wait(), so that a cycle's time is the loop's own and not
// the engine's.
void MujocoBackend::advance() {
  if (!commanded_) return;
  commanded_ = false;
  plant_.advance();
}

std::future<ArmAnswer> MujocoBackend::request(ArmIndex arm, ArmRequest request) {
  RequestBox::Posted posted{.arm = arm, .request = std::move(request)};
  if (arm >= plant_.arm_count()) {
    return RequestBox::refused("there is no arm " + std::to_string(arm) + ": the scene has " +
                               std::to_string(plant_.arm_count()));
  }
  if (auto why = SimulatedArm::check(posted.request, plant_.arm(arm).joint_count()); !why.empty()) {
    return RequestBox::refused(std::move(why));
  }
  if (const auto* place = std::get_if<PlaceObject>(&posted.request)) {
    const auto object = plant_.world().find_object(place->object);
    if (!object) return RequestBox::refused("there is no object '" + place->object + "' in the scene");
    if (plant_.world().objects()[*object].qpos < 0) {
      return RequestBox::refused("object '" + place->object + "' is fixed: only free objects can be placed");
    }
    if (auto why = SimulatedArm::check(SetFrames{place->X_WO, {}}, 0); !why.empty()) {
      return RequestBox::refused("X_WO must be a finite position and a rotation");
    }
    posted.object = *object;
  }
  return requests_.post(std::move(posted));
}

void MujocoBackend::take_requests() {
  while (const auto* posted = requests_.front()) requests_.answer(apply(*posted));
}

ArmReply MujocoBackend::apply(const RequestBox::Posted& posted) {
  if (const auto* place = std::get_if<PlaceObject>(&posted.request)) {
    return plant_.world().place(posted.object, place->X_WO) ? ArmReply::done : ArmReply::would_penetrate;
  }
  if (std::holds_alternative<ResetSimulation>(posted.request)) {
    plant_.reset();
    return ArmReply::done;
  }
  if (const auto* pause = std::get_if<PauseSimulation>(&posted.request)) {
    if (pause->paused && !paused_ && pace_ == Pace::unpaced) pacer_.start();
    paused_ = pause->paused;
    return ArmReply::done;
  }
  return plant_.arm(posted.arm).apply(posted.request);
}

}  // namespace multipanda
