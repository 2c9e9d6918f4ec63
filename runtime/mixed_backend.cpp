#include "runtime/mixed_backend.hpp"

#include <stdexcept>

#include "backends/arm/request_box.hpp"

namespace multipanda {

MixedBackend::MixedBackend(Parts parts) : parts_(std::move(parts)) {
  if (!parts_.real || !parts_.simulated || parts_.real->arm_count() != parts_.real_arms.size() ||
      parts_.simulated->arm_count() != parts_.simulated_arms.size()) {
    throw std::invalid_argument("a mixed backend needs real and simulated arms, and a place for each");
  }
  places_.resize(parts_.real_arms.size() + parts_.simulated_arms.size());
  for (ArmIndex i = 0; i < parts_.real_arms.size(); ++i) places_.at(parts_.real_arms[i]) = {true, i};
  for (ArmIndex i = 0; i < parts_.simulated_arms.size(); ++i)
    places_.at(parts_.simulated_arms[i]) = {false, i};
  real_ = side_of(parts_.real_arms, *parts_.real);
  simulated_ = side_of(parts_.simulated_arms, *parts_.simulated);
}

MixedBackend::Side MixedBackend::side_of(const std::vector<ArmIndex>& arms, const Backend& part) {
  return {.arms = arms,
          .states = std::vector<ArmState>(part.arm_count()),
          .commands = std::vector<ArmCommand>(part.arm_count())};
}

ArmSet MixedBackend::Side::to_scene(ArmSet local) const {
  ArmSet set;
  for (ArmIndex i = 0; i < arms.size(); ++i) {
    if (local.contains(i)) set |= ArmSet::of(arms[i]);
  }
  return set;
}

ArmSet MixedBackend::Side::to_part(ArmSet due) const {
  ArmSet set;
  for (ArmIndex i = 0; i < arms.size(); ++i) {
    if (due.contains(arms[i])) set |= ArmSet::of(i);
  }
  return set;
}

Capabilities MixedBackend::capabilities(ArmIndex arm) const {
  const Place& place = places_[arm];
  Capabilities can =
      place.real ? parts_.real->capabilities(place.index) : parts_.simulated->capabilities(place.index);
  can.lockstep = parts_.lockstep;
  return can;
}

void MixedBackend::start() {
  parts_.real->start();  // may throw: then nothing runs
  parts_.simulated->start();
}

void MixedBackend::finish() {
  parts_.real->finish();
  parts_.simulated->finish();
}

ArmSet MixedBackend::wait() { return parts_.lockstep ? wait_in_lockstep() : wait_in_real_time(); }

// The simulated arms stand still while the virtual ones do.
ArmSet MixedBackend::wait_in_lockstep() {
  const ArmSet real = parts_.real->wait();
  now_ = parts_.real->now();
  if (real.empty()) return {};
  return real_.to_scene(real) | simulated_.to_scene(parts_.simulated->wait());
}

ArmSet MixedBackend::wait_in_real_time() {
  ArmSet due;
  if (!begun_) {  // everybody's first state
    due = real_.to_scene(parts_.real->wait());
    begun_ = true;
    origin_ = host_now();
    pacer_.start_at(origin_);
  } else {
    due = real_.to_scene(parts_.real->wait_until(next_));
    if (host_now() < next_) {
      now_ = {(host_now() - origin_).count()};
      return due;
    }
    pacer_.woke_at(host_now());
  }
  next_ = pacer_.advance();
  due |= simulated_.to_scene(parts_.simulated->wait());
  now_ = {(host_now() - origin_).count()};
  return due;
}

void MixedBackend::read(ArmSet due, std::span<ArmState> states) {
  parts_.real->read(real_.to_part(due), real_.states);
  parts_.simulated->read(simulated_.to_part(due), simulated_.states);
  for (const Side* side : {&real_, &simulated_}) {
    for (ArmIndex i = 0; i < side->arms.size(); ++i) {
      ArmState& state = states[side->arms[i]];
      if (due.contains(side->arms[i])) {
        state = side->states[i];
      } else if (side == &real_) {  // an arm that is lost says so without a packet
        state.mode = side->states[i].mode;
      }
    }
  }
}

void MixedBackend::write(ArmSet due, std::span<const ArmCommand> commands) {
  for (Side* side : {&real_, &simulated_}) {
    for (ArmIndex i = 0; i < side->arms.size(); ++i) side->commands[i] = commands[side->arms[i]];
  }
  const ArmSet real = real_.to_part(due), simulated = simulated_.to_part(due);
  if (!real.empty()) parts_.real->write(real, real_.commands);
  if (!simulated.empty()) parts_.simulated->write(simulated, simulated_.commands);
}

std::uint64_t MixedBackend::overruns() const { return parts_.real->overruns() + pacer_.overruns(); }

std::future<ArmAnswer> MixedBackend::request(ArmIndex arm, ArmRequest request) {
  if (std::holds_alternative<PauseSimulation>(request) || std::holds_alternative<StepSimulation>(request)) {
    return RequestBox::refused("this run has real arms, which cannot be paused: stop them instead");
  }
  if (std::holds_alternative<PlaceObject>(request) || std::holds_alternative<ResetSimulation>(request)) {
    return parts_.simulated->request(0, std::move(request));
  }
  if (arm >= places_.size()) {
    return RequestBox::refused("there is no arm " + std::to_string(arm) + ": the scene has " +
                               std::to_string(places_.size()));
  }
  const Place& place = places_[arm];
  return place.real ? parts_.real->request(place.index, std::move(request))
                    : parts_.simulated->request(place.index, std::move(request));
}

}  // namespace multipanda
