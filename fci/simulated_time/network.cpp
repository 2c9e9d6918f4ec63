#include <algorithm>
#include <cmath>

#include "fci/simulated_time/implementation.hpp"

// The world, the arms' own periods, and the datagrams in between.
namespace multipanda::fci {

void SimulatedTime::Implementation::step_world() {
  apply_pushes();
  plant.advance();
  if (!plant.failed()) events.after(kArmPeriodNs.count(), [this] { step_world(); });
}

// A force on the flange. MuJoCo expects force and moment at the body's center of mass.
void SimulatedTime::Implementation::apply_pushes() {
  World& world = plant.world();
  for (ArmIndex i = 0; i < arms.size(); ++i) {
    if (arms[i].push_until_ns < 0) continue;
    const bool over = events.now_ns() >= arms[i].push_until_ns;
    const Vector3 f_W = over ? Vector3::Zero() : arms[i].push_W;
    if (over) arms[i].push_until_ns = -1;
    const int body = world.arm(i).last_link;
    const Eigen::Map<const Vector3> p_WC(world.data()->xipos + 3 * body);
    Eigen::Map<Vector6> F_C_W(world.data()->xfrc_applied + 6 * body);
    F_C_W.head<3>() = f_W;
    F_C_W.tail<3>() = (world.X_WF(i).position - p_WC).cross(f_W);
  }
}

// Applies its command, if any, and sends its newest measurements. The next period of its clock counts from
// the first one, so that rounding does not accumulate.
void SimulatedTime::Implementation::arm_period(ArmIndex i) {
  if (plant.failed()) return;
  Arm& arm = arms[i];
  const auto used = arm.side->counts().answers_used;
  const auto bytes = arm.side->period(events.now_ns());
  if (arm.side->counts().answers_used != used) plant.begin_timeline();
  if (arm.states_to_lose > 0) {
    --arm.states_to_lose;
    ++arm.side->counts().states_lost;
  } else {
    travel(i, false, bytes, 0);
  }
  tell_end(i);
  ++arm.periods;
  const double period_ns = 1e6 / (1 + 1e-6 * arm.timing.drift_ppm);
  const auto since_first = std::llround(period_ns * static_cast<double>(arm.periods));
  events.at(kArmPeriodNs.count() + arm.timing.phase_ns + since_first, [this, i] { arm_period(i); });
}

SimulatedTime::Implementation::Datagram* SimulatedTime::Implementation::take_slot() {
  if (free_datagrams.empty()) return &datagrams.emplace_back();
  Datagram* slot = free_datagrams.back();
  free_datagrams.pop_back();
  return slot;
}

void SimulatedTime::Implementation::travel(ArmIndex i, bool to_arm, std::span<const std::byte> bytes,
                                           std::int64_t extra_ns) {
  Arm& arm = arms[i];
  const LinkTiming& link = to_arm ? arm.timing.to_arm : arm.timing.to_client;
  const std::int64_t delay = draw_network.time(link.delay);
  const bool lost = draw_network.happens(link.loss);
  if (lost || arm.cable_pulled) {
    ++(to_arm ? arm.side->counts().answers_lost : arm.side->counts().states_lost);
    return;
  }
  Datagram* slot = take_slot();
  slot->size = bytes.size();
  std::copy(bytes.begin(), bytes.end(), slot->bytes.begin());
  events.after(delay + extra_ns, [this, i, to_arm, slot] {
    const std::span<const std::byte> whole(slot->bytes.data(), slot->size);
    if (arms[i].cable_pulled) {
      ++(to_arm ? arms[i].side->counts().answers_lost : arms[i].side->counts().states_lost);
    } else if (to_arm) {
      arms[i].side->take_answer(whole, events.now_ns());
    } else {
      arms[i].client->take_state(whole, events.now_ns());
    }
    free_datagrams.push_back(slot);
  });
}

}  // namespace multipanda::fci
