#pragma once

#include "models/robot_description.hpp"
#include "scene/mapping.hpp"
#include "scene/scene.hpp"

// The parts of load.cpp. Each reads its sections of the file and adds to the scene.
namespace multipanda {

struct SceneReader {
  explicit SceneReader(const Registry& types);

  const Registry& registry;
  Scene scene;
  std::vector<RobotDescription> robots;  // of each arm
  std::vector<InstanceConfig> holds;     // built in, one per arm; without those that the scene declares

  // A declared controllet or a built-in hold, by name.
  const InstanceConfig& instance(const Entry& name) const;
  std::vector<std::string> instance_names() const;  // the holds last
  ArmIndex arm(const Entry& name) const;
  std::size_t joint_count(const InstanceConfig& instance, std::size_t arm = 0) const {
    return robots[instance.arms[arm]].joint_count();
  }
};

void read_plant(const Mapping& root, SceneReader& reader);
void read_arms(const Mapping& root, SceneReader& reader);
void read_objects(const Mapping& root, SceneReader& reader);
void read_controllets(const Mapping& root, SceneReader& reader);
void read_active(const Mapping& root, SceneReader& reader);
void read_timeline(const Mapping& root, SceneReader& reader);  // after read_active
void read_ros(const Mapping& root, SceneReader& reader);

// What is said of the arm itself and of the way to it: fci, collision, its own stiffness.
void read_arm_interface(const Mapping& arm, const RobotDescription& robot, const SceneReader& reader,
                        SceneArm& out);

Pose read_pose(const Mapping& mapping);  // position_m, rpy_rad, quaternion_wxyz
// shape, and what gives the size of such a shape (SceneObject::size), by those of `size_keys` that it needs
std::pair<ShapeType, Vector3> read_shape(const Mapping& mapping, const std::vector<std::string>& size_keys);

// A parameter's specification by its full name ("stiffness", "joint_limits.range_rad"); refuses an unknown
// one.
const ParameterSpec& find_parameter(const SceneReader& reader, const InstanceConfig& instance,
                                    const Entry& at, const std::string& name);
// A value of it: checked, one number per place.
std::vector<double> read_parameter(const Entry& value, const ParameterSpec& spec, std::size_t joint_count);
// Refuses a feature that does not exist.
// That there is a feature of this name, and that what it needs to know of its instance's arms is in the
// scene.
void check_feature(const SceneReader& reader, const InstanceConfig& instance, const Entry& name);
// Refuses two of `names` owning the same arm. Returns their instances.
std::vector<const InstanceConfig*> read_owners(const SceneReader& reader, const std::vector<Entry>& names);
ArmSet arms_of(const InstanceConfig& instance);

}  // namespace multipanda
