#pragma once

#include <atomic>
#include <deque>
#include <span>
#include <string>

#include "core/modes/instance.hpp"

namespace multipanda {

// Poses that the hands cannot reach, whatever the joints do. The bound is the length of the stretched arm:
// the distances from the first joint to the second, and so on to the end effector, which turning joints do
// not change. Arms that stand on others are not bounded.
class Reach {
 public:
  explicit Reach(const ArmBlocks& blocks);

  // The active end effector. Without one, nothing is refused. Any thread; no allocation.
  void set_end_effector(ArmIndex arm, const Pose& X_FE);

  // Whether the pose in the world that an input requests may be in reach; also true if the input carries
  // something else. For a controllet of one arm, the pose is its end effector's. For several arms it may be
  // that of the input's arm or the middle of the hands: out of reach if neither can be there. `why`: nullptr,
  // or gets the reason. Any thread.
  bool contains(const Instance& instance, const InputSpec& input, std::span<const double> values,
                std::string* why) const;

 private:
  struct Arm {
    std::string name;
    Vector3 first_joint, last_joint;  // in the world, in one configuration
    double between = 0;               // along the joints, from the first to the last [m]
    Pose X_WF;                        // of the flange, in that configuration
    bool moves = false;               // its base
    std::atomic<double> length;       // with the end effector [m]
  };
  std::deque<Arm> arms_;
};

}  // namespace multipanda
