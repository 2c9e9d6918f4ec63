#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/model/model_terms.hpp"
#include "models/robot_description.hpp"
#include "ros/adapter/part.hpp"

namespace multipanda::ros {

// What the topics about arms share: names, what is set on each arm, and the model at the newest record,
// computed once and only if a topic asks. One thread.
class ArmsView {
 public:
  struct Arm {
    std::string name, prefix;  // "left", "left_"
    std::size_t joint_count = 0;
    std::vector<std::string> joint_names;
    RobotDescription robot;
    bool hand = false;
    ArmFrames frames;  // in force
    Load tool, load;
    std::uint32_t config_version = 0;
  };

  explicit ArmsView(const RunWorld& world);

  void take(const Event& event);
  void take(const CycleRecord& record);  // valid until the next one

  const std::vector<Arm>& arms() const { return arms_; }
  ModelTerms& terms(std::size_t arm);

 private:
  std::vector<Arm> arms_;
  std::vector<ModelTerms> terms_;
  std::vector<bool> current_;  // terms_ are of record_
  const CycleRecord* record_ = nullptr;
};

}  // namespace multipanda::ros
