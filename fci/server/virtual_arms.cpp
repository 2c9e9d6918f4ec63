#include "fci/server/virtual_arms.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "fci/model/model_library.hpp"
#include "fci/server/end_effector_port.hpp"
#include "fci/server/wire.hpp"
#include "scene/build.hpp"

namespace multipanda::fci {
namespace {

// Virtual hands have movable fingers if they have a port.
Scene prepared(Scene scene, bool grippers) {
  for (SceneArm& arm : scene.arms) {
    if (arm.hand && grippers && !arm.movable_fingers) arm.movable_fingers = true;
  }
  return scene;
}

ArmPlace default_place(ArmIndex arm) { return {.address = "127.0.0." + std::to_string(arm + 1)}; }

ArmPortConfig port_config(const Scene& scene, ArmIndex i, const ArmPlace& place,
                          const VirtualArmOptions& options) {
  const SceneArm& arm = scene.arms[i];
  const RobotDescription robot = robot_of(arm);
  FixedConfig fixed = fixed_config(arm);
  if (place.versions) fixed.versions = *place.versions;
  return {.name = arm.name,
          .address = place.address,
          .port = place.port,
          .lockstep = options.pace == WorldPace::lockstep,
          .strict = options.strict,
          .own_clock = options.pace == WorldPace::realtime && (options.strict || !options.clocks.empty()),
          .fixed = std::move(fixed),
          .model = {.urdf = model_urdf(robot), .library = model_library(robot, options.library)},
          .seed = options.seed + 2 * i};
}

}  // namespace

void let_rotors_act(Scene& scene) {
  if (scene.plant.rotor_hidden) return;
  for (SceneArm& arm : scene.arms) arm.rotor_hidden = 0;
}

VirtualArms::VirtualArms(Scene scene, VirtualArmOptions options)
    : scene_(prepared(std::move(scene), options.grippers)),
      options_(std::move(options)),
      plant_(scene_, {.timeline_waits = true,
                      .real_sensors = options_.real_sensors && scene_.plant.name.starts_with("realistic")}),
      view_(plant_),
      pushes_(plant_.arm_count()),
      faults_(plant_.arm_count(), options_.faults) {
  if (const auto why = check(options_.faults); !why.empty()) throw std::invalid_argument(why);
  if (options_.places.size() > scene_.arms.size()) {
    throw std::invalid_argument("the scene has " + std::to_string(scene_.arms.size()) + " arms, but " +
                                std::to_string(options_.places.size()) + " addresses were given");
  }
  if (options_.clocks.size() > scene_.arms.size()) throw std::invalid_argument("more clocks than arms");
  for (const ClockOffset& clock : options_.clocks) {
    if (!(clock.phase_s >= 0 && clock.phase_s <= 1e-3) || !(std::abs(clock.drift_ppm) <= 1e4)) {
      throw std::invalid_argument(
          "an arm's clock: expected a phase of 0 to 1 ms, a drift of up to 10000 ppm");
    }
    if (options_.pace == WorldPace::lockstep && (clock.phase_s != 0 || clock.drift_ppm != 0)) {
      throw std::invalid_argument("arms with clocks of their own need real time");
    }
  }
  for (ArmIndex i = 0; i < plant_.arm_count(); ++i) {
    names_.push_back(scene_.arms[i].name);
    const bool given = i < options_.places.size();
    places_.push_back(given ? options_.places[i] : default_place(i));
    if (places_[i].address.empty()) places_[i].address = default_place(i).address;
    ports_.push_back(std::make_unique<ArmPort>(port_config(scene_, i, places_[i], options_), plant_.arm(i)));
    ports_[i]->set_faults(options_.faults);
    grippers_.emplace_back();
    vacuums_.emplace_back();
    if (!options_.grippers) continue;
    const ArmPlace& place = places_[i];
    if (SimulatedGripper* gripper = plant_.gripper(i)) {
      grippers_[i] = std::make_unique<GripperPort>("the gripper of arm " + names_[i], place.address,
                                                   place.gripper_port, *gripper);
    }
    if (SimulatedVacuum* vacuum = plant_.vacuum(i)) {
      vacuums_[i] = std::make_unique<VacuumPort>("the vacuum gripper of arm " + names_[i], place.address,
                                                 place.vacuum_port, *vacuum);
    }
  }
}

VirtualArms::~VirtualArms() { stop(); }

void VirtualArms::listen() {
  timer_.open(poll_);
  word_.open(poll_);
  for (ArmIndex i = 0; i < ports_.size(); ++i) {
    ports_[i]->open(poll_);
    places_[i].port = ports_[i]->port();
    if (grippers_[i]) {
      grippers_[i]->open(poll_);
      places_[i].gripper_port = grippers_[i]->port();
    }
    if (vacuums_[i]) {
      vacuums_[i]->open(poll_);
      places_[i].vacuum_port = vacuums_[i]->port();
    }
  }
}

void VirtualArms::start() {
  if (thread_.joinable()) throw std::logic_error("the virtual arms are already running");
  listen();
  if (options_.pace == WorldPace::realtime) requests_.refuse_after_gaps();
  requests_.open();
  running_ = true;
  std::promise<void> set_up;
  auto ready = set_up.get_future();
  thread_ = std::thread([this, set_up = std::move(set_up)]() mutable {
    if (options_.thread) setup_ = set_up_thread(*options_.thread);
    set_up.set_value();
    run();
  });
  ready.wait();
}

void VirtualArms::stop() {
  ending_ = true;
  word_.call();
  if (thread_.joinable()) thread_.join();
}

std::string VirtualArms::fault() const { return failed() ? plant_.fault() : ""; }

std::optional<ArmIndex> VirtualArms::find(std::string_view name) const {
  const auto found = std::find(names_.begin(), names_.end(), name);
  if (found == names_.end()) return std::nullopt;
  return static_cast<ArmIndex>(found - names_.begin());
}

PortStatistics VirtualArms::statistics(ArmIndex arm) const { return ports_.at(arm)->statistics(); }

WorldStatistics VirtualArms::world_statistics() const {
  return {.periods = periods_.get(), .overruns = overruns_.get()};
}

// --- commands from other threads ---

std::future<RequestAnswer> VirtualArms::request(ArmIndex arm, ArmRequest request) {
  if (arm >= arm_count()) {
    return refuse_request(no_such_arm(arm, arm_count()));
  }
  if (auto why = check_request(request, plant_.arm(arm).model()); !why.empty()) {
    return refuse_request(std::move(why));
  }
  auto answer = requests_.post({.arm = arm, .request = std::move(request)});
  word_.call();
  return answer;
}

std::future<RequestAnswer> VirtualArms::request(WorldRequest request) {
  RequestBox::Posted posted;
  if (auto why = plant_.locate(request, posted.object); !why.empty()) return refuse_request(std::move(why));
  posted.request = std::move(request);
  auto answer = requests_.post(std::move(posted));
  word_.call();
  return answer;
}

bool VirtualArms::post(const Control& control) {
  if (control.arm >= arm_count()) return false;
  {
    const std::scoped_lock lock(callers_);
    if (!controls_.push(control)) return false;
    if (control.what == Control::What::faults) faults_[control.arm] = control.faults;
  }
  word_.call();
  return true;
}

bool VirtualArms::set_faults(ArmIndex arm, const DatagramFaults& faults) {
  if (const auto why = check(faults); !why.empty()) throw std::invalid_argument(why);
  return post({.what = Control::What::faults, .arm = arm, .faults = faults});
}

DatagramFaults VirtualArms::faults(ArmIndex arm) const {
  const std::scoped_lock lock(callers_);
  return faults_.at(arm);
}

bool VirtualArms::press_guiding(ArmIndex arm, bool pressed) {
  return post({.what = Control::What::guiding, .arm = arm, .on = pressed});
}

bool VirtualArms::raise(ArmIndex arm, ArmError error) {
  return post({.what = Control::What::raise, .arm = arm, .error = error});
}

bool VirtualArms::freeze(ArmIndex arm, double seconds) {
  return post({.what = Control::What::freeze, .arm = arm, .periods = std::lround(1000 * seconds)});
}

bool VirtualArms::close_connection(ArmIndex arm) { return post({.what = Control::What::close, .arm = arm}); }

bool VirtualArms::push(ArmIndex arm, const Vector3& f_W, double seconds) {
  return post(
      {.what = Control::What::push, .arm = arm, .periods = std::lround(1000 * seconds), .force = f_W});
}

bool VirtualArms::lead(ArmIndex arm, const Vector3& p_W, double seconds) {
  return post(
      {.what = Control::What::lead, .arm = arm, .periods = std::lround(1000 * seconds), .force = p_W});
}

}  // namespace multipanda::fci
