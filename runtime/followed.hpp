#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "core/cycle/requests.hpp"

namespace multipanda {

// Whose widths the grippers follow, shared by all interfaces of a run.
struct Followed {
  static constexpr std::int64_t kShortestPause = 200'000'000;  // [ns]
  struct Gripper {
    const void* client = nullptr;            // whose width was the last one
    HostTime until, pause;                   // when that is silent; when its stream has paused
    std::map<const void*, HostTime> paused;  // clients whose widths are refused until then
    // While widths are followed, others may only stop the gripper and open it beyond `width`.
    bool refuses(const GripperRequest& request, const void* asker, double width, HostTime now) const {
      const auto* move = std::get_if<GripperMove>(&request);
      const bool opens = move != nullptr && move->width > width;
      return asker != client && now < until && !opens && !ends_motion(request);
    }
    // Without a pause the next width of the same stream would move the fingers again.
    void end(HostTime now, bool pauses) {
      if (pauses && now < pause) paused[client] = std::max(pause, HostTime{now.ns + kShortestPause});
      until = pause = {};
    }
  };
  static std::string refusal(const std::string& arm) {
    return "the gripper of arm '" + arm +
           "' follows widths of another client: end that stream first, or 'stop' the gripper; a move that "
           "opens it is accepted";
  }
  std::mutex mutex;
  std::vector<Gripper> grippers;  // per arm
};

}  // namespace multipanda
