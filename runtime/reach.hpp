#pragma once

#include <atomic>
#include <deque>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/model/arm_model.hpp"
#include "core/modes/multimode_controller.hpp"
#include "core/record/cycle_record.hpp"

namespace multipanda {

// Which poses the hands cannot come to, whatever the joints do, for every way into a run. The bound is the
// length of the stretched arm: the distances from the first joint to the second, and so on to the end
// effector, which turning joints do not change.
class Reach {
 public:
  explicit Reach(const std::vector<std::shared_ptr<const ArmModel>>& models);  // builds the models' data

  // The end effector in force. Without one, nothing of the arm is refused. Any thread.
  void set_end_effector(ArmIndex arm, const Pose& X_FE);
  void take(const Event& event);  // the same, as the loop reports it

  // Why the pose in the world that an input asks for is out of reach; empty: it may be in reach, or the input
  // carries something else. For a controllet of one arm, the pose is its end effector's. For several arms it
  // may be that of the input's arm or the middle of the hands: refused if neither can be there. Any thread.
  std::string refusal(const Instance& instance, const InputSpec& input, std::span<const double> values) const;
  // The same for the poses of a timeline. Throws std::invalid_argument with the time of the event.
  void check(const std::vector<ScheduledRequest>& timeline, const MultimodeController& modes) const;

 private:
  struct Arm {
    std::string name;
    Vector3 first_joint, last_joint;  // in the world, in one configuration
    double between = 0;               // along the joints, from the first to the last [m]
    Pose X_WF;                        // of the flange, in that configuration
    std::atomic<double> length;       // with the end effector [m]
  };
  std::deque<Arm> arms_;
};

}  // namespace multipanda
