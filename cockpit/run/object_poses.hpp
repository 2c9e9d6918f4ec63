#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/rt/triple_buffer.hpp"
#include "core/types/tick.hpp"
#include "scene/scene.hpp"

namespace multipanda::cockpit {

// Where the objects of a simulated world are, from the loop to the cockpit. The loop copies a few numbers in
// every 16th cycle, by triple buffer: it neither allocates nor waits.
class ObjectPoses {
 public:
  static constexpr std::size_t kMost = 64;     // objects; further ones are shown as the scene has them
  static constexpr std::uint64_t kEvery = 16;  // cycles

  explicit ObjectPoses(const Scene& scene) {
    for (const auto& object : scene.objects) {
      if (names_.size() < kMost) names_.push_back(object.name);
    }
  }

  void on_loop(const Tick& tick, const Backend& backend) {
    take(tick.cycle, [&](const std::string& name) { return backend.object_pose(name); });
  }
  // `pose_of(name)`: the pose of an object, if it is known.
  void take(std::uint64_t cycle, const auto& pose_of) {
    if (names_.empty() || cycle % kEvery != 0) return;
    for (std::size_t i = 0; i < names_.size(); ++i) {
      const std::optional<Pose> X = pose_of(names_[i]);
      next_[i] = {X.value_or(Pose{}), X.has_value()};
    }
    buffer_.write(next_);
  }

  // Cockpit's thread: the newest poses, in the order of the scene.
  void read(std::vector<std::optional<Pose>>& poses) {
    buffer_.take();
    poses.assign(names_.size(), std::nullopt);
    for (std::size_t i = 0; i < names_.size(); ++i) {
      if (buffer_.value()[i].known) poses[i] = buffer_.value()[i].X_WO;
    }
  }

 private:
  struct Place {
    Pose X_WO;
    bool known = false;
  };
  using Places = std::array<Place, kMost>;

  std::vector<std::string> names_;
  Places next_{};
  TripleBuffer<Places> buffer_;
};

}  // namespace multipanda::cockpit
