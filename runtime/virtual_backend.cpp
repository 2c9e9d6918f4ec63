#include "runtime/virtual_backend.hpp"

#include <algorithm>
#include <atomic>
#include <sched.h>
#include <unistd.h>

#include "core/rt/pacer.hpp"
#include "fci/client/end_effector.hpp"
#include "fci/client/fci_backend.hpp"
#include "fci/server/virtual_arms.hpp"

namespace multipanda {
namespace {

// The arms of the scene; fingers move only if the scene requests it.
Scene as_written(Scene scene) {
  for (SceneArm& arm : scene.arms) {
    arm.fci.reset();
    arm.movable_fingers = arm.movable_fingers.value_or(false);
  }
  fci::let_rotors_act(scene);
  return scene;
}

// In lock-step both ends are in this process: a silent end only waits for a processor.
constexpr std::chrono::seconds kLockstepPatience{20};

fci::VirtualArmOptions options_of(const Scene& scene, VirtualPace pace, bool real_sensors) {
  fci::VirtualArmOptions options;
  // Free ports, so that several worlds can run on one computer.
  options.places.assign(scene.arms.size(),
                        {.address = "127.0.0.1", .port = 0, .gripper_port = 0, .vacuum_port = 0});
  options.pace = pace == VirtualPace::realtime ? fci::WorldPace::realtime : fci::WorldPace::lockstep;
  options.real_sensors = real_sensors;
  options.strict = true;  // as real arms, because the client is our own
  options.patience = kLockstepPatience;
  options.idle_stands_still = true;  // the arms start in the scene's configuration
  // Real arms do not wait for a free core either. Below the loop: a late torque is worse than a late state.
  if (pace == VirtualPace::realtime) options.thread = ThreadSetup{.lock_memory = false, .fifo_priority = 75};
  return options;
}

// During its lifetime, threads started by the calling one may run on every core of the process; afterwards
// the calling thread keeps its core.
class OnEveryCore {
 public:
  OnEveryCore() {
    cpu_set_t all;  // of the process' first thread
    if (sched_getaffinity(0, sizeof(own_), &own_) != 0 || sched_getaffinity(getpid(), sizeof(all), &all) != 0)
      return;
    changed_ = sched_setaffinity(0, sizeof(all), &all) == 0;
  }
  ~OnEveryCore() {
    if (changed_) (void)sched_setaffinity(0, sizeof(own_), &own_);
  }
  OnEveryCore(const OnEveryCore&) = delete;

 private:
  cpu_set_t own_{};
  bool changed_ = false;
};

}  // namespace

struct VirtualBackend::Implementation {
  Implementation(const Scene& requested, VirtualPace requested_pace,
                 std::function<void(const std::string&)> voice, bool real_sensors)
      : scene(as_written(requested)),
        pace(requested_pace),
        say(std::move(voice)),
        world(scene, options_of(scene, pace, real_sensors)),
        truth(world.view().make_snapshot()) {}

  const Scene scene;
  bool lockstep() const { return pace != VirtualPace::realtime; }

  template <typename Request>
  std::future<RequestAnswer> ask_client(ArmIndex arm, Request request) {
    if (links.load(std::memory_order_acquire) == nullptr)
      return refuse_request("the run has not started yet");
    return client->request(arm, std::move(request));
  }

  const VirtualPace pace;
  const std::function<void(const std::string&)> say;
  fci::VirtualArms world;
  std::unique_ptr<fci::FciBackend> client;
  std::atomic<const fci::FciBackend*> links{nullptr};  // client, once it exists
  fci::VirtualWorldView::Snapshot truth;               // of the newest states read
  Pacer pacer;                                         // for a waiting world
};

VirtualBackend::VirtualBackend(const Scene& scene, VirtualPace pace,
                               std::function<void(const std::string&)> say, bool real_sensors)
    : self_(std::make_unique<Implementation>(scene, pace, std::move(say), real_sensors)) {}

VirtualBackend::~VirtualBackend() {
  self_->client.reset();
  self_->world.stop();
}

std::size_t VirtualBackend::arm_count() const { return self_->scene.arms.size(); }

Capabilities VirtualBackend::capabilities(ArmIndex arm) const {
  const SceneArm& of = self_->scene.arms[arm];
  return {.simulated = true,
          .lockstep = self_->lockstep(),
          .compensates_gravity = true,
          .compensates_friction = !self_->scene.plant.joint_friction,
          .has_external_torque = true,
          .has_contact_truth = true,
          .has_gripper = of.hand && of.movable_fingers.value_or(false),
          .has_vacuum = of.vacuum,
          .every_command_arrives = self_->lockstep(),
          .own_clock = !self_->lockstep(),
          .torque_rate_max = fci::kTorqueRateMax};
}

void VirtualBackend::start() {
  auto& self = *self_;
  const OnEveryCore threads;  // the arms' world and its clients do not share the loop's core
  self.world.start();
  std::vector<fci::FciArmConfig> arms;
  for (ArmIndex i = 0; i < self.scene.arms.size(); ++i) {
    const fci::ArmPlace& place = self.world.place(i);
    arms.push_back(fci::fci_arm_config(self.scene.arms[i], place.address));
    fci::FciArmConfig& arm = arms.back();
    arm.port = place.port;
    arm.end_effector = {};
    if (capabilities(i).has_vacuum) {
      arm.end_effector = [name = arm.name, place] {
        return fci::vacuum_link(name, place.address, place.vacuum_port);
      };
    } else if (capabilities(i).has_gripper) {
      arm.end_effector = [name = arm.name, place] {
        return fci::gripper_link(name, place.address, place.gripper_port);
      };
    }
  }
  fci::FciOptions options{
      .lockstep = self.lockstep(), .lockstep_wait_s = kLockstepPatience.count(), .report = self.say};
  self.client = std::make_unique<fci::FciBackend>(std::move(arms), std::move(options));
  self.client->start();
  self.pacer.start();
  self.links.store(self.client.get(), std::memory_order_release);
}

void VirtualBackend::finish() {
  if (self_->client) self_->client->finish();
  self_->world.stop();
}

// In real time the packets of one world arrive within microseconds. One step takes them all.
ArmSet VirtualBackend::wait() {
  auto& self = *self_;
  ArmSet due = self.client->wait();
  if (due.empty() || self.pace == VirtualPace::unpaced) return due;
  if (self.pace == VirtualPace::waiting) {
    self.pacer.wait();
    return due;
  }
  constexpr std::chrono::microseconds kGap{200};
  const HostTime deadline = host_now() + kGap;
  const ArmSet all = ArmSet::all(arm_count());
  while (due != all && host_now() < deadline) due |= self.client->wait_until(deadline);
  return due;
}
bool VirtualBackend::ended() const { return self_->client->ended() || self_->world.failed(); }
LoopTime VirtualBackend::now() const { return self_->client->now(); }

void VirtualBackend::read(ArmSet due, std::span<ArmState> states) {
  auto& self = *self_;
  self.client->read(due, states);
  for (ArmIndex i = 0; i < states.size(); ++i) {
    if (!due.contains(i)) continue;
    ArmState& state = states[i];
    const auto period = self.world.view().period_of(i, state.sequence);
    if (!period || (self.truth.period != *period && !self.world.view().read(*period, self.truth))) continue;
    state.has_contact_truth = true;
    state.F_K_W_true = self.truth.F_K_W_true[i];
  }
}

void VirtualBackend::write(ArmSet due, std::span<const ArmCommand> commands) {
  self_->client->write(due, commands);
}

// Lost packets, and milliseconds missed by world or loop.
std::uint64_t VirtualBackend::overruns() const {
  return (self_->client ? self_->client->overruns() : 0) + self_->world.world_statistics().overruns +
         (self_->pace == VirtualPace::waiting ? self_->pacer.overruns() : 0);
}

std::future<RequestAnswer> VirtualBackend::request(ArmIndex arm, ArmRequest request) {
  if (std::holds_alternative<SetUserStop>(request)) return self_->world.request(arm, std::move(request));
  return self_->ask_client(arm, std::move(request));
}

std::future<RequestAnswer> VirtualBackend::request(ArmIndex arm, GripperRequest request) {
  return self_->ask_client(arm, std::move(request));
}

std::future<RequestAnswer> VirtualBackend::request(WorldRequest request) {
  return self_->world.request(std::move(request));
}

std::string VirtualBackend::fault() const { return self_->world.fault(); }

std::optional<Pose> VirtualBackend::object_pose(const std::string& name) const {
  const auto& names = self_->world.view().objects();
  const auto at = std::find(names.begin(), names.end(), name);
  if (at == names.end() || self_->truth.period == 0) return std::nullopt;
  return self_->truth.X_WO[static_cast<std::size_t>(at - names.begin())];
}

std::optional<ConnectionStatistics> VirtualBackend::connection(ArmIndex arm) const {
  const fci::FciBackend* client = self_->links.load(std::memory_order_acquire);
  return client != nullptr ? client->connection(arm) : ConnectionStatistics{};
}

}  // namespace multipanda
