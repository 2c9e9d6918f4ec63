#include "fci/server/datagram_faults.hpp"

#include <algorithm>
#include <cmath>

namespace multipanda::fci {

std::string check(const DatagramFaults& faults) {
  for (const double share : {faults.loss, faults.duplicate, faults.reorder}) {
    if (!(share >= 0 && share <= 1)) return "loss, duplicate and reorder must be between 0 and 1";
  }
  for (const double time : {faults.latency_s, faults.jitter_s}) {
    if (!(time >= 0 && time <= 10)) return "latency and jitter must be between 0 and 10 s";
  }
  return {};
}

FaultyLine::Fate FaultyLine::draw() {
  // Always draws the same number of random values, so that one fault's rate does not affect the others.
  std::array<double, 4> u{};
  for (double& value : u) value = static_cast<double>(random_() >> 11) * 0x1p-53;
  Fate fate;
  fate.lost = u[0] < faults_.loss;
  fate.duplicated = u[1] < faults_.duplicate;
  fate.overtaken = u[2] < faults_.reorder;
  fate.delay = std::chrono::nanoseconds(
      static_cast<std::int64_t>(1e9 * (faults_.latency_s + u[3] * faults_.jitter_s)));
  return fate;
}

bool FaultyLine::put(std::span<const std::byte> datagram, HostTime now) {
  const Fate fate = draw();
  if (fate.lost || waiting_ == kSlots || datagram.size() > kLongest) return false;
  const HostTime due = now + fate.delay + (fate.overtaken ? kOvertaken : std::chrono::nanoseconds(0));
  keep(datagram, due);
  if (fate.duplicated && waiting_ < kSlots) keep(datagram, due);
  return true;
}

void FaultyLine::keep(std::span<const std::byte> datagram, HostTime due) {
  Slot& slot = *std::find_if(slots_.begin(), slots_.end(), [](const Slot& s) { return !s.used; });
  slot.used = true;
  slot.due = due;
  slot.number = number_++;
  slot.size = datagram.size();
  std::copy(datagram.begin(), datagram.end(), slot.bytes.begin());
  ++waiting_;
}

const FaultyLine::Slot* FaultyLine::earliest(HostTime now) const {
  const Slot* first = nullptr;
  for (const Slot& slot : slots_) {
    if (!slot.used || slot.due > now) continue;
    if (first == nullptr || slot.due < first->due ||
        (slot.due == first->due && slot.number < first->number)) {
      first = &slot;
    }
  }
  return first;
}

void FaultyLine::release(const Slot& slot) {
  slots_[static_cast<std::size_t>(&slot - slots_.data())].used = false;
  --waiting_;
}

std::optional<HostTime> FaultyLine::next_due() const {
  std::optional<HostTime> due;
  if (waiting_ == 0) return due;
  for (const Slot& slot : slots_) {
    if (slot.used && (!due || slot.due < *due)) due = slot.due;
  }
  return due;
}

void FaultyLine::clear() {
  for (Slot& slot : slots_) slot.used = false;
  waiting_ = 0;
}

}  // namespace multipanda::fci
