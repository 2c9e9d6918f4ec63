#include "backends/mujoco/mujoco_backend.hpp"

#include <type_traits>

#include "core/cycle/gripper_requests.hpp"

namespace multipanda {
namespace {

template <class Request, class... Kinds>
constexpr bool kIsOneOf = (std::is_same_v<Request, Kinds> || ...);

// Off the loop: why a request to a gripper cannot be meant, or nothing.
std::string check_gripper(const ArmRequest& request) {
  return std::visit(
      [](const auto& r) -> std::string {
        using Kind = std::decay_t<decltype(r)>;
        if constexpr (kIsOneOf<Kind, GripperMove, GripperGrasp>) return check(r);
        if constexpr (kIsOneOf<Kind, VacuumOn, VacuumDrop>) return SimulatedVacuum::check(r);
        return {};
      },
      request);
}

}  // namespace

MujocoBackend::MujocoBackend(const Scene& scene, MujocoOptions options)
    : pace_(options.pace), plant_(scene, {.meshes = std::move(options.meshes)}) {
  gripper_motions_.reserve(RequestBox::kSlots);
}

Capabilities MujocoBackend::capabilities(ArmIndex arm) const {
  return {.simulated = true,
          .lockstep = true,
          .compensates_gravity = true,
          .compensates_friction = plant_.is_frictionless(arm),
          .has_external_torque = false,
          .has_contact_truth = true,
          .has_gripper = plant_.has_gripper(arm),
          .has_vacuum = plant_.has_vacuum(arm),
          .period_s = kPeriod};
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

LoopTime MujocoBackend::now() const { return {plant_.periods() * 1'000'000}; }

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

// The period that the last write() began. It runs in wait(), so that a cycle's time is the loop's own and not
// the engine's.
void MujocoBackend::advance() {
  if (!commanded_) return;
  commanded_ = false;
  plant_.advance();
  if (steps_left_ > 0 && --steps_left_ == 0) requests_.answer(step_slot_, ArmReply::done);
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
  if (auto why = check_gripper(posted.request); !why.empty()) return RequestBox::refused(std::move(why));
  if (auto why = plant_.locate(posted); !why.empty()) return RequestBox::refused(std::move(why));
  return requests_.post(std::move(posted));
}

void MujocoBackend::take_requests() {
  while (const auto* posted = requests_.front()) {
    const auto* step = std::get_if<StepSimulation>(&posted->request);
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
      posted.request);
}

void MujocoBackend::answer_gripper_motions() {
  std::erase_if(gripper_motions_, [this](const GripperMotion& motion) {
    const GripperResult result = motion.vacuum ? plant_.vacuum(motion.arm)->result(motion.ticket)
                                               : plant_.gripper(motion.arm)->result(motion.ticket);
    if (result == GripperResult::running) return false;
    requests_.answer(motion.slot, result == GripperResult::success        ? ArmReply::done
                                  : result == GripperResult::unsuccessful ? ArmReply::gripper_unsuccessful
                                                                          : ArmReply::gripper_aborted);
    return true;
  });
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
    if (!paused_ && steps_left_ > 0) {  // it runs anyway now
      steps_left_ = 0;
      requests_.answer(step_slot_, ArmReply::done);
    }
    return ArmReply::done;
  }
  if (const auto* step = std::get_if<StepSimulation>(&posted.request)) {
    if (step->periods == 0) return ArmReply::done;
    return paused_ ? ArmReply::still_stepping : ArmReply::not_paused;
  }
  if (const bool of_vacuum = std::holds_alternative<VacuumStop>(posted.request);
      of_vacuum || std::holds_alternative<GripperStop>(posted.request)) {
    if (of_vacuum ? !plant_.has_vacuum(posted.arm) : !plant_.has_gripper(posted.arm)) {
      return ArmReply::no_gripper;
    }
    if (of_vacuum) {
      plant_.vacuum(posted.arm)->stop();
    } else {
      plant_.gripper(posted.arm)->stop();
    }
    return ArmReply::done;
  }
  const bool to_gripper = std::visit(
      [](const auto& r) {
        return kIsOneOf<std::decay_t<decltype(r)>, GripperHoming, GripperMove, GripperGrasp, VacuumOn,
                        VacuumDrop>;
      },
      posted.request);
  if (to_gripper) return ArmReply::no_gripper;
  return plant_.arm(posted.arm).apply(posted.request);
}

}  // namespace multipanda
