#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/types/time.hpp"

namespace multipanda::cockpit {

using ClientId = std::uint64_t;  // counts up from 1

// At most one client commands, all others watch. Free control goes to the first who takes it; a
// held one is requested from its holder, who hands it over or keeps it. One thread; the caller has the clock.
class Control {
 public:
  // A request that the holder does not answer is granted after this time, unless the holder is moving
  // something at that moment.
  static constexpr double kPatience = 10;  // [s]

  struct Requested {
    ClientId client = 0;
    HostTime at;
  };

  std::optional<ClientId> holder() const { return holder_; }
  const std::vector<Requested>& requests() const { return requests_; }
  bool held_by(ClientId client) const { return holder_ == client; }

  // True: granted. False: requested from the holder.
  bool take(ClientId client, HostTime now) {
    if (!holder_ || holder_ == client) {
      holder_ = client;
      forget(client);
      return true;
    }
    if (std::ranges::none_of(requests_, [client](const auto& r) { return r.client == client; }))
      requests_.push_back({client, now});
    return false;
  }
  // The holder hands it over. False: that client has not requested it.
  bool give(ClientId to) {
    if (std::ranges::none_of(requests_, [to](const auto& r) { return r.client == to; })) return false;
    holder_ = to;
    forget(to);
    return true;
  }
  // The holder releases control: the oldest request is granted.
  void give_up() {
    holder_.reset();
    if (requests_.empty()) return;
    holder_ = requests_.front().client;
    requests_.erase(requests_.begin());
  }
  void keep() { requests_.clear(); }  // refuses all requests
  // A client has disconnected.
  void leave(ClientId client) {
    forget(client);
    if (holder_ == client) give_up();
  }
  // Grants the oldest expired request. `moving`: the holder is in a motion. True: granted.
  bool pass_on(HostTime now, bool moving) {
    if (moving || requests_.empty() || seconds(now - requests_.front().at) < kPatience) return false;
    give_up();
    return true;
  }

 private:
  void forget(ClientId client) {
    std::erase_if(requests_, [client](const auto& r) { return r.client == client; });
  }

  std::optional<ClientId> holder_;
  std::vector<Requested> requests_;  // oldest first
};

// Whether an operator holds a button, from beats that the page sends while the button is pressed. One thread;
// the caller provides the clock.
class DeadMan {
 public:
  static constexpr double kTimeout = 0.2;  // without a beat for this time, it counts as released [s]

  void beat(HostTime now) { last_ = now; }
  void release() { last_.reset(); }
  // Between a beat and the following release or silence.
  bool begun() const { return last_.has_value(); }
  bool held(HostTime now) const { return last_ && seconds(now - *last_) <= kTimeout; }
  // The beats have stopped without a release.
  bool silent(HostTime now) const { return begun() && !held(now); }

 private:
  std::optional<HostTime> last_;  // beat
};

}  // namespace multipanda::cockpit
