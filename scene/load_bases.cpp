#include <cmath>
#include <memory>

#include "common/text.hpp"
#include "core/model/model_terms.hpp"
#include "core/types/capacity.hpp"
#include "models/arm_source.hpp"
#include "scene/load_parts.hpp"

// Bases of a scene's arms: in the world, or on another arm.
namespace multipanda {
namespace {

// Two arms of one robot may share their base (its torso), but not the place of their first joints.
void check_distance(const Archive& archive, const RobotDescription& robot, const SceneReader& reader,
                    const SceneArm& arm) {
  constexpr double kNearest = 0.1;  // smallest distance of bases that do not collide [m]
  const auto near = [](const Vector3& a, const Vector3& b) { return (a - b).norm() < kNearest; };
  const std::string key = arm.mount ? "base_on" : "base";
  for (std::size_t i = 0; i < reader.scene.arms.size(); ++i) {
    const SceneArm& other = reader.scene.arms[i];
    if (near(other.X_WB.position, arm.X_WB.position) &&
        near(other.X_WB * reader.robots[i].joints[0].position, arm.X_WB * robot.joints[0].position)) {
      archive.at(key).refuse("is inside arm '" + other.name + "'; expected bases at least " +
                             number_text(kNearest) + " m apart (" + key + ": {position_m: [x, y, z]})");
    }
  }
}

// The arm with this name; only arms earlier in the file are known.
ArmIndex carrier_of(const Node& name, const SceneReader& reader, const SceneArm& arm) {
  const std::string& requested = name.yaml().Scalar();
  if (requested == arm.name) name.refuse("an arm cannot stand on itself; expected the name of another arm");
  const auto& arms = reader.scene.arms;
  std::vector<std::string> names;
  for (ArmIndex i = 0; i < arms.size(); ++i) {
    if (arms[i].name == requested) return i;
    names.push_back(arms[i].name);
  }
  name.refuse("there is no arm " + in_quotes(requested) +
              " before this one; the arm that carries it must come earlier in the file" +
              name_hint(requested, names, "; this is the first arm"));
}

void check_carrier(const Node& name, const SceneReader& reader, const BaseMount& mount) {
  const SceneArm& carrier = reader.scene.arms[mount.carrier];
  const std::string who = "arm " + in_quotes(carrier.name);
  if (carrier.mount) {
    name.refuse(who + " stands on arm " + in_quotes(reader.scene.arms[carrier.mount->carrier].name) +
                "; expected an arm that stands in the world (key 'base')");
  }
  for (const SceneArm& other : reader.scene.arms) {
    if (other.mount && other.mount->carrier == mount.carrier) {
      name.refuse(who + " already carries arm " + in_quotes(other.name) + ", line " +
                  std::to_string(other.mount_place.line) + "; expected one carried arm per carrier");
    }
  }
  if (carrier.fci) {
    name.refuse(who +
                " has the key 'fci'; expected a simulated arm: only the simulation (backend mujoco) "
                "can move the base of an arm");
  }
}

// Initial pose of the base on its carrier. Refuses a carrier whose joints would tilt the base, as the
// loop would.
Pose base_at_start(const Node& joint, const SceneReader& reader, const BaseMount& mount) {
  const SceneArm& carrier = reader.scene.arms[mount.carrier];
  ArmModelSource source = arm_model_source(reader.robots[mount.carrier], carrier.X_WB, carrier.hand);
  source.name = carrier.name;
  const auto model = std::make_shared<const ArmModel>(std::move(source));
  if (const std::string why = turns_against_gravity(*model, mount.joint); !why.empty()) joint.refuse(why);
  ModelTerms terms(model);
  terms.update(carrier.q_start, joint_constant(model->joint_count(), 0));
  return terms.X_WJ(mount.joint) * mount.X_JB;
}

}  // namespace

void visit(Archive& archive, Pose& X) {
  archive.about("Pose", "A frame in its parent. Missing keys are zero.");
  visit_pose(archive, X, Key("position_m", "Origin of the frame."));
}

void visit_pose(Archive& archive, Pose& X, Key position) {
  std::optional<Vector3> rpy;
  std::optional<std::array<double, 4>> wxyz;
  archive(position.within(-kFarthest, kFarthest), X.position);
  archive(
      Key("rpy_rad",
          "Roll, pitch, yaw about the fixed axes x, y, z: R = Rz(yaw) Ry(pitch) Rx(roll). `pi`, `-pi/2` and "
          "`3*pi/4` are valid numbers."),
      rpy);
  archive(Key("quaternion_wxyz", "Unit quaternion, w first, in place of `rpy_rad`.").within(-1.01, 1.01),
          wxyz);
  if (!archive.reading()) return;
  if (rpy && wxyz) archive.at("quaternion_wxyz").refuse("expected rpy_rad or quaternion_wxyz, found both");
  if (rpy) X.rotation = rotation_from_rpy(*rpy);
  if (!wxyz) return;
  const Quaternion q((*wxyz)[0], (*wxyz)[1], (*wxyz)[2], (*wxyz)[3]);
  constexpr double kFarFromUnit = 1e-2;
  if (std::abs(q.norm() - 1) > kFarFromUnit) {
    archive.at("quaternion_wxyz")
        .refuse("expected a unit quaternion [w, x, y, z], found length " + number_text(q.norm()));
  }
  X.rotation = q.normalized().toRotationMatrix();
}

void visit(Archive& archive, BaseMount& mount, SceneReader& reader, SceneArm& arm) {
  archive.about(
      "Base on",
      "The base stands on a link of another arm, its carrier, whose joints up to this link (a torso) move "
      "it. Revolute ones need a vertical axis, prismatic ones a level axis. Only the simulation (backend "
      "`mujoco`) runs such a scene.");
  std::string carrier;
  archive(Key("arm",
              "The carrier: an arm that comes earlier in the file and stands in the world. It carries "
              "one arm at most.")
              .identifier()
              .required(),
          carrier);
  std::size_t joint = 1;
  archive(Key("joint", "Number of the carrier's joint behind which the link is; 1: its first joint.")
              .within(1, static_cast<double>(kMaxJoints))
              .required(),
          joint);
  visit_pose(archive, mount.X_JB,
             Key("position_m",
                 "Origin of the base in the joint's frame J: the frame of its link in the model, with the "
                 "joint's axis as z."));
  if (!archive.reading()) return;
  mount.carrier = carrier_of(archive.at("arm"), reader, arm);
  check_carrier(archive.at("arm"), reader, mount);
  const std::size_t n = reader.robots[mount.carrier].joint_count();
  if (joint > n) {
    archive.at("joint").refuse(
        "arm " + in_quotes(carrier) + " has " + std::to_string(n) +
        (n == 1 ? " joint; expected 1" : " joints; expected 1 to " + std::to_string(n)) + ", found " +
        std::to_string(joint));
  }
  mount.joint = joint - 1;
  arm.X_WB = base_at_start(archive.at("joint"), reader, mount);
}

void read_base(Archive& archive, SceneArm& arm, SceneReader& reader, const RobotDescription* robot) {
  archive.section(Key("base", "X_WB: base in the world."), arm.X_WB);
  archive.section(
      Key("base_on", "In place of `base`: the base stands on a link of another arm, which moves it."),
      arm.mount, reader, arm);
  if (robot == nullptr) return;
  if (arm.mount) {
    const Node here = archive.at("base_on");
    arm.mount_place = archive.self().key_of("base_on").place();
    if (archive.has("base")) here.refuse("expected base or base_on, found both; remove one");
    if (archive.has("fci")) {
      here.refuse(
          "the arm has the key 'fci'; expected a simulated arm: only the simulation (backend mujoco) "
          "can move the base of an arm");
    }
  }
  check_distance(archive, *robot, reader, arm);
}

}  // namespace multipanda
