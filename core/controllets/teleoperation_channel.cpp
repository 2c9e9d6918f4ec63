#include "core/controllets/teleoperation_channel.hpp"

#include <algorithm>

namespace multipanda {

void TeleoperationChannel::start(std::uint32_t seed) {
  first_ = count_ = 0;
  newest_ = {};
  any_ = false;
  under_way_ = lost_ = trust_ = 0;
  random_.seed(seed);
}

void TeleoperationChannel::send(const TeleoperationPacket& packet, double loss) {
  constexpr double kRange = std::minstd_rand::max() - std::minstd_rand::min() + 1.0;
  const double drawn =
      static_cast<double>(random_() - std::minstd_rand::min()) / kRange;  // drawn in every tick, lost or not
  if (drawn < loss || count_ == kCapacity) {
    lost_ += packet.energy;
    return;
  }
  ring_[(first_ + count_++) % kCapacity] = packet;
  under_way_ += packet.energy;
}

double TeleoperationChannel::receive(double now_s, double delay_s, double dt) {
  constexpr double kLate = 0.005, kFade = 0.02;  // [s]
  constexpr double kRounding = 1e-6;             // of loop times [s]
  double energy = 0;
  while (count_ > 0 && ring_[first_].sent_s + delay_s <= now_s + kRounding) {
    newest_ = ring_[first_];
    any_ = true;
    energy += newest_.energy;
    under_way_ -= newest_.energy;
    first_ = (first_ + 1) % kCapacity;
    --count_;
  }
  if (count_ == 0) under_way_ = 0;  // clears accumulated rounding
  const bool late = !any_ || now_s - newest_.sent_s > delay_s + kLate;
  trust_ = std::clamp(trust_ + (late ? -dt : dt) / kFade, 0.0, 1.0);
  return energy;
}

}  // namespace multipanda
