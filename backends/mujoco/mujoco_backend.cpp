#include "backends/mujoco/mujoco_backend.hpp"

#include <type_traits>

#include "arm_interface/arm_settings.hpp"
#include "core/types/time.hpp"

namespace multipanda {
namespace {

template <class Request, class... Kinds>
constexpr bool kIsOneOf = (std::is_same_v<Request, Kinds> || ...);

}  // namespace

MujocoBackend::MujocoBackend(const Scene& scene, MujocoOptions options, const PlantParts& parts)
    : pace_(options.pace), plant_(scene, parts) {
  gripper_motions_.reserve(RequestBox::kSlots);
  if (pace_ == Pace::realtime) requests_.refuse_after_gaps();
}

Capabilities MujocoBackend::capabilities(ArmIndex arm) const {
  return {.simulated = true,
          .lockstep = true,
          .compensates_gravity = true,
          .compensates_friction = plant_.is_frictionless(arm),
          .has_external_torque = plant_.arm(arm).estimates_forces(),
          .has_contact_truth = true,
          .has_gripper = plant_.has_gripper(arm),
          .has_vacuum = plant_.has_vacuum(arm),
          .every_command_arrives = true};
}

void MujocoBackend::start() {
  requests_.open();
  pacer_.start();
}

void MujocoBackend::finish() {
  for (ArmIndex i = 0; i < arm_count(); ++i) plant_.arm(i).stop_motion();
  requests_.close();
}

ArmSet MujocoBackend::wait() {
  advance();
  if (pace_ == Pace::realtime || (paused_ && pace_ != Pace::hosted)) pacer_.wait();
  take_requests();
  return plant_.failed() ? ArmSet() : ArmSet::all(plant_.arm_count());
}

LoopTime MujocoBackend::now() const { return {plant_.periods() * kArmPeriodNs.count()}; }

void MujocoBackend::read(ArmSet due, std::span<ArmState> states) {
  for (ArmIndex i = 0; i < plant_.arm_count(); ++i) {
    if (!due.contains(i)) continue;
    states[i] = plant_.arm(i).state();
    states[i].gripper = plant_.gripper_state(i);
  }
}

void MujocoBackend::write(ArmSet due, std::span<const ArmCommand> commands) {
  if ((paused_ && steps_left_ == 0) || plant_.failed()) return;
  for (ArmIndex i = 0; i < plant_.arm_count(); ++i) {
    if (told_.contains(i)) continue;
    if (due.contains(i)) {
      plant_.arm(i).take_command(commands[i].tau_cmd);
    } else {
      plant_.arm(i).miss_command();
    }
  }
  told_ = {};
  commanded_ = true;
}

void MujocoBackend::command(ArmIndex arm, const InterfaceCommand& command) {
  if ((paused_ && steps_left_ == 0) || plant_.failed()) return;
  plant_.arm(arm).take_command(command);
  told_ |= ArmSet::of(arm);
}

// Executes the period started by the last write(), in wait(), so that cycle times exclude the engine.
void MujocoBackend::advance() {
  if (!commanded_) return;
  commanded_ = false;
  plant_.advance();
  if (steps_left_ > 0 && --steps_left_ == 0) requests_.answer(step_slot_, ArmReply::done);
}

std::future<RequestAnswer> MujocoBackend::request(ArmIndex arm, ArmRequest request) {
  if (arm >= arm_count()) return refuse_request(no_such_arm(arm, arm_count()));
  if (auto why = check_request(request, plant_.arm(arm).model()); !why.empty())
    return refuse_request(std::move(why));
  return requests_.post({.arm = arm, .request = std::move(request)});
}

std::future<RequestAnswer> MujocoBackend::request(ArmIndex arm, GripperRequest request) {
  if (arm >= arm_count()) return refuse_request(no_such_arm(arm, arm_count()));
  if (auto why = check(request); !why.empty()) return refuse_request(std::move(why));
  return requests_.post({.arm = arm, .request = std::move(request)});
}

std::future<RequestAnswer> MujocoBackend::request(WorldRequest request) {
  RequestBox::Posted posted;
  if (auto why = plant_.locate(request, posted.object); !why.empty()) return refuse_request(std::move(why));
  posted.request = std::move(request);
  return requests_.post(std::move(posted));
}

void MujocoBackend::take_requests() {
  while (const auto* posted = requests_.front()) {
    const auto* of_world = std::get_if<WorldRequest>(&posted->request);
    const auto* step = of_world != nullptr ? std::get_if<StepSimulation>(of_world) : nullptr;
    if (auto motion = begin_gripper_motion(*posted)) {
      motion->slot = requests_.defer();
      gripper_motions_.push_back(*motion);
    } else if (step != nullptr && step->periods > 0 && paused_ && steps_left_ == 0) {
      steps_left_ = step->periods;
      step_slot_ = requests_.defer();
    } else {
      requests_.answer(apply(*posted));
    }
  }
  answer_gripper_motions();
}

std::optional<MujocoBackend::GripperMotion> MujocoBackend::begin_gripper_motion(
    const RequestBox::Posted& posted) {
  const auto* request = std::get_if<GripperRequest>(&posted.request);
  if (request == nullptr) return std::nullopt;
  SimulatedGripper* gripper = plant_.gripper(posted.arm);
  SimulatedVacuum* vacuum = plant_.vacuum(posted.arm);
  return std::visit(
      [&](const auto& r) -> std::optional<GripperMotion> {
        using Kind = std::decay_t<decltype(r)>;
        if constexpr (kIsOneOf<Kind, GripperHoming, GripperMove, GripperGrasp>) {
          if (gripper != nullptr) return GripperMotion{0, posted.arm, false, gripper->start(r)};
        } else if constexpr (kIsOneOf<Kind, VacuumOn, VacuumDrop>) {
          if (vacuum != nullptr) return GripperMotion{0, posted.arm, true, vacuum->start(r)};
        }
        return std::nullopt;
      },
      *request);
}

void MujocoBackend::answer_gripper_motions() {
  std::erase_if(gripper_motions_, [this](const GripperMotion& motion) {
    const GripperResult result = motion.vacuum ? plant_.vacuum(motion.arm)->result(motion.ticket)
                                               : plant_.gripper(motion.arm)->result(motion.ticket);
    if (result == GripperResult::running) return false;
    const ArmReply failed = motion.vacuum ? ArmReply::vacuum_unsuccessful : ArmReply::gripper_unsuccessful;
    requests_.answer(motion.slot, result == GripperResult::success        ? ArmReply::done
                                  : result == GripperResult::unsuccessful ? failed
                                                                          : ArmReply::gripper_aborted);
    return true;
  });
}

ArmReply MujocoBackend::apply(const RequestBox::Posted& posted) {
  if (const auto* of_world = std::get_if<WorldRequest>(&posted.request))
    return apply_to_world(posted, *of_world);
  if (const auto* of_gripper = std::get_if<GripperRequest>(&posted.request))
    return apply_to_gripper(posted.arm, *of_gripper);
  return plant_.arm(posted.arm).apply(std::get<ArmRequest>(posted.request));
}

ArmReply MujocoBackend::apply_to_world(const RequestBox::Posted& posted, const WorldRequest& request) {
  if (const auto* place = std::get_if<PlaceObject>(&request)) {
    return plant_.place(posted.object, place->X_WO) ? ArmReply::done : ArmReply::would_penetrate;
  }
  if (const auto* push = std::get_if<PushObject>(&request)) {
    plant_.push(posted.object, push->f_W, push->duration);
    return ArmReply::done;
  }
  if (const auto* pause = std::get_if<PauseSimulation>(&request)) {
    if (pause->paused && !paused_ && pace_ == Pace::unpaced) pacer_.start();
    paused_ = pause->paused;
    if (!paused_ && steps_left_ > 0) {  // resumed during the step
      steps_left_ = 0;
      requests_.answer(step_slot_, ArmReply::done);
    }
    return ArmReply::done;
  }
  if (const auto* step = std::get_if<StepSimulation>(&request)) {
    if (step->periods == 0) return ArmReply::done;
    return paused_ ? ArmReply::still_stepping : ArmReply::not_paused;
  }
  plant_.reset();
  return ArmReply::done;
}

// Handles stops and widths to follow. begin_gripper_motion() has started motions of existing grippers.
ArmReply MujocoBackend::apply_to_gripper(ArmIndex arm, const GripperRequest& request) {
  SimulatedGripper* gripper = plant_.gripper(arm);
  SimulatedVacuum* vacuum = plant_.vacuum(arm);
  if (gripper != nullptr && std::holds_alternative<GripperStop>(request)) {
    gripper->stop();
    return ArmReply::done;
  }
  if (const auto* follow = std::get_if<GripperFollow>(&request); follow != nullptr && gripper != nullptr) {
    gripper->follow(*follow);
    return ArmReply::done;
  }
  if (vacuum != nullptr && std::holds_alternative<VacuumStop>(request)) {
    vacuum->stop();
    return ArmReply::done;
  }
  return ArmReply::no_gripper;
}

}  // namespace multipanda
