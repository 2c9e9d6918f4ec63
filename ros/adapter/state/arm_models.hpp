#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/model/model_terms.hpp"
#include "models/robot_description.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "scene/scene.hpp"

namespace multipanda::ros {

// Names, configuration and model of each arm at the newest record, shared by the topics about arms. Computes
// a model only when a topic needs it, at most once per record. One thread.
class ArmModels {
 public:
  struct Arm {
    std::string name, prefix;  // "left", "left_"
    std::size_t joint_count = 0;
    std::vector<std::string> joint_names;
    RobotDescription robot;
    bool hand = false;
    ArmFrames frames;  // active frames
    Load tool, load;
    std::uint32_t config_version = 0;
  };

  explicit ArmModels(const RunContext& run);

  void take(const Event& event);
  void take(const CycleRecord& record);  // valid until the next one

  const std::vector<Arm>& arms() const { return arms_; }
  ModelTerms& terms(std::size_t arm);

 private:
  std::vector<Arm> arms_;
  std::vector<ModelTerms> terms_;
  std::vector<bool> current_;  // whether terms_ belong to record_
  const CycleRecord* record_ = nullptr;
};

// Returns a URDF of all arms of a scene on the link `world`, with visual shapes. Names of links and joints
// begin with the arm's name. Includes the flange `<arm>_link8` (for seven joints) and hands with sliding
// fingers, but no objects.
std::string scene_urdf(const Scene& scene);

}  // namespace multipanda::ros
