#pragma once

#include "core/types/time.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"
#include "yaml_reader/archive.hpp"

// Parts of load.cpp: each structure declares its keys (yaml_reader/archive.hpp) and checks its values.
namespace multipanda {

inline constexpr double kFarthest = 100;       // largest distance in a scene [m]
inline constexpr double kSmallest = 0.001;     // smallest length [m] and mass [kg]; physics engines fail
                                               // below
inline constexpr double kLongestTime = 86400;  // one day [s]

// State while a scene is read.
struct SceneReader {
  explicit SceneReader(const Registry& types) : registry(types) {}

  const Registry& registry;
  Scene scene;
  std::vector<RobotDescription> robots;  // of each arm
  std::vector<InstanceConfig> holds;     // built in, one per arm; without those that the scene declares

  // A declared controllet or a built-in hold, by name.
  const InstanceConfig& instance(const Node& name) const;
  std::vector<std::string> instance_names() const;  // the holds last
  ArmIndex arm(const Node& name) const;
  std::size_t joint_count(const InstanceConfig& instance, std::size_t arm = 0) const {
    return robots[instance.arms[arm]].joint_count();
  }
};

// Overrides of a controllet's input in a scene.
struct PoseInput : InputSpec {};
struct JointsInput : InputSpec {};
struct OtherInput : InputSpec {};

void visit(Archive& archive, SceneReader& reader);
void visit(Archive& archive, PlantFidelity& plant, Scene& scene);
void visit(Archive& archive, ContactBounds& bounds, Scene& scene);
void visit(Archive& archive, SceneArm& arm, SceneReader& reader);
void visit(Archive& archive, Load& load);
void visit(Archive& archive, ToolShape& shape);
void visit(Archive& archive, SafetyLimits& safety, SceneArm& arm);
void visit(Archive& archive, FciConnection& fci, SceneReader& reader);
void visit(Archive& archive, SceneForceSensor& sensor);
void visit(Archive& archive, SetCollisionThresholds& collision, const RobotDescription& robot);
void visit(Archive& archive, SceneObject& object, SceneReader& reader);
void visit(Archive& archive, SurfaceContact& contact);
void visit(Archive& archive, InstanceConfig& controllet, SceneReader& reader);
void visit(Archive& archive, PoseInput& input);
void visit(Archive& archive, JointsInput& input);
void visit(Archive& archive, OtherInput& input);
void visit(Archive& archive, RosSection& ros);
void visit(Archive& archive, RosSection::Rates& rates);
void visit(Archive& archive, Pose& X);  // in a section of its own
void visit(Archive& archive, BaseMount& mount, SceneReader& reader, SceneArm& arm);
void note_near_leaders(Scene& scene);
void read_active(Archive& archive, SceneReader& reader);
void read_timeline(Archive& archive, SceneReader& reader);  // after read_active

// Keys `base` and `base_on` of an arm, after `model` and `hand`; `robot` is null while describing.
void read_base(Archive& archive, SceneArm& arm, SceneReader& reader, const RobotDescription* robot);
// Keys of a pose inside another section: position_m, rpy_rad, quaternion_wxyz.
void visit_pose(Archive& archive, Pose& X, Key position);
// Keys of a shape and its size: `shapes` are those allowed here, no longer than `longest` [m].
void visit_shape(Archive& archive, ShapeType& type, Vector3& size, const std::vector<std::string>& shapes,
                 double longest, const std::string& shape_doc);
// The address of an arm that is written without its section.
void check_address(const Node& address, const FciConnection& fci, const SceneReader& reader);

// A parameter's specification by its full name ("stiffness", "joint_limits.range_rad"); refuses an
// unknown one.
const ParameterSpec& find_parameter(const SceneReader& reader, const InstanceConfig& instance, const Node& at,
                                    const std::string& name);
// The same for the controllet's arm: a prismatic joint has another bound. Limits of each joint are checked
// when the controllet is built.
ParameterSpec spec_here(const ParameterSpec& spec, const SceneReader& reader, const InstanceConfig& instance);
// A checked value of it, one number per component.
std::vector<double> read_parameter(const Node& value, const ParameterSpec& spec, std::size_t joint_count);
// Refuses an unknown feature, or one that needs data of the arms that the scene lacks.
void check_feature(const SceneReader& reader, const InstanceConfig& instance, const Node& name);
// Refuses two of `names` that own the same arm. Returns their instances.
std::vector<const InstanceConfig*> read_owners(const SceneReader& reader, const std::vector<Node>& names);
ArmSet arms_of(const InstanceConfig& instance);

}  // namespace multipanda
