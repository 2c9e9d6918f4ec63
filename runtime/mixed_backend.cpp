#include "runtime/mixed_backend.hpp"

#include <stdexcept>

namespace multipanda {

MixedBackend::MixedBackend(Parts parts) : parts_(std::move(parts)) {
  if (!parts_.real || !parts_.simulated || parts_.real->arm_count() != parts_.real_arms.size() ||
      parts_.simulated->arm_count() != parts_.simulated_arms.size()) {
    throw std::invalid_argument("a mixed backend needs real and simulated arms, and an index for each");
  }
  places_.resize(parts_.real_arms.size() + parts_.simulated_arms.size());
  for (ArmIndex i = 0; i < parts_.real_arms.size(); ++i) places_.at(parts_.real_arms[i]) = {true, i};
  for (ArmIndex i = 0; i < parts_.simulated_arms.size(); ++i)
    places_.at(parts_.simulated_arms[i]) = {false, i};
  real_ = side_of(parts_.real_arms, *parts_.real);
  simulated_ = side_of(parts_.simulated_arms, *parts_.simulated);
  view_ = simulation_of(*parts_.simulated);
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
  Capabilities can = part_of(place).capabilities(place.index);
  can.lockstep = parts_.lockstep;
  return can;
}

// Real arms start last: from then on they need an answer every millisecond, which only the loop gives.
void MixedBackend::start() {
  parts_.simulated->start();
  try {
    parts_.real->start();
  } catch (...) {
    parts_.simulated->finish();
    throw;
  }
}

void MixedBackend::finish() {
  parts_.real->finish();
  parts_.simulated->finish();
}

ArmSet MixedBackend::wait() { return parts_.lockstep ? wait_in_lockstep() : wait_in_real_time(); }

// The simulated arms pause while the virtual ones do.
ArmSet MixedBackend::wait_in_lockstep() {
  const ArmSet real = parts_.real->wait();
  now_ = parts_.real->now();
  if (real.empty()) return {};
  return real_.to_scene(real) | simulated_.to_scene(parts_.simulated->wait());
}

ArmSet MixedBackend::wait_in_real_time() {
  ArmSet due;
  if (!begun_) {  // the first state of every arm
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
      } else if (side == &real_) {  // a lost arm has no packet, but its mode changes
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

std::optional<ConnectionStatistics> MixedBackend::connection(ArmIndex arm) const {
  const Place& place = places_[arm];
  return part_of(place).connection(place.index);
}

template <typename Request>
std::future<RequestAnswer> MixedBackend::ask_part(ArmIndex arm, Request request) {
  if (arm >= places_.size()) {
    return refuse_request(no_such_arm(arm, places_.size()));
  }
  const Place& place = places_[arm];
  return part_of(place).request(place.index, std::move(request));
}

std::future<RequestAnswer> MixedBackend::request(ArmIndex arm, ArmRequest request) {
  return ask_part(arm, std::move(request));
}

std::future<RequestAnswer> MixedBackend::request(ArmIndex arm, GripperRequest request) {
  return ask_part(arm, std::move(request));
}

std::future<RequestAnswer> MixedBackend::request(WorldRequest request) {
  if (std::holds_alternative<PauseSimulation>(request) || std::holds_alternative<StepSimulation>(request)) {
    return refuse_request("this run has real arms and cannot be paused: stop the arms instead");
  }
  // Laws may couple a simulated arm to a real one, which would feel the push.
  if (std::holds_alternative<PushObject>(request) || std::holds_alternative<ResetSimulation>(request)) {
    return refuse_request(
        "this run has real arms: objects cannot be pushed and the world cannot be reset during the run");
  }
  return parts_.simulated->request(std::move(request));
}

}  // namespace multipanda
