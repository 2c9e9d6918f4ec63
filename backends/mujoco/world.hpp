#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <mujoco/mujoco.h>

#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// One arm as the world needs it.
struct WorldArm {
  std::string name;
  std::string mjcf;  // of models/to_mjcf.hpp: body link0, joints joint1..N, site flange
  std::size_t joint_count = 0;
  Pose X_WB;
  JointVector q_start;
  Load tool, payload;  // what really hangs on the flange, beyond the hand; mass 0: nothing
  std::vector<ToolShape> tool_shapes;
};

struct WorldPhysics {
  double timestep = 0.001;    // [s]
  int noslip_iterations = 0;  // of the contact solver
  double stiction = 0;        // dry friction of every arm joint [N m]
};

// The physical world in MuJoCo: arms, what they carry, objects. Rigid bodies, contact and gravity only; how
// an arm behaves is SimulatedArm's business. Names: everything of an arm is "<arm>/<name in its MJCF>",
// tool and payload are "<arm>/tool" and "<arm>/payload", tool shapes "<arm>/tool_shape1" and so on, an
// object's body and geom have the object's name.
//
// Construction throws std::invalid_argument if MuJoCo refuses the scene or if anything stands inside
// something else at the start (names both and the depth). Afterwards no call allocates.
class World {
 public:
  World(const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects,
        const WorldPhysics& physics);

  // Where MuJoCo keeps an arm's quantities; found by name.
  struct ArmPlaces {
    std::vector<int> qpos, dof;  // per joint
    int flange_site = -1;
    int last_link = -1;  // body behind the last joint
  };
  struct ObjectPlaces {
    std::string name;
    int body = -1;
    int qpos = -1, dof = -1;  // of the free joint; -1: fixed
    Pose X_WO_start;
  };

  std::size_t arm_count() const { return arms_.size(); }
  const ArmPlaces& arm(std::size_t i) const { return arms_[i]; }
  const std::vector<ObjectPlaces>& objects() const { return objects_; }
  std::optional<std::size_t> find_object(std::string_view name) const;
  // Arm that a body belongs to (links, hand, tool, payload), or -1.
  int arm_of_body(int body) const { return arm_of_body_[static_cast<std::size_t>(body)]; }
  // Whether a body is behind the last joint: last link, hand, fingers, tool and its shapes, payload.
  bool is_tip(int body) const { return tip_[static_cast<std::size_t>(body)] != 0; }

  void joints(std::size_t arm, JointVector& q, JointVector& dq) const;
  Pose X_WF(std::size_t arm) const;
  Pose X_WO(std::size_t object) const;

  // What the arm's hand and tool (is_tip) exert on everything that is not of the same arm, at the instant of
  // the last physics step or forward(), about the world point p_W, in world axes.
  Wrench tip_wrench(std::size_t arm, const Vector3& p_W) const;

  // Dry friction of a joint in the last physics step: what it adds to the motor's torque [N m].
  double stiction_torque(int dof) const;

  // Everything as at the start; the clock of MuJoCo too. False: engine error.
  bool reset();
  // Positions to contacts and forces, without moving on. False: engine error.
  bool forward();
  // One physics step. False: engine error, or positions, velocities or accelerations ran away.
  bool step();
  // Puts an object elsewhere, a free one at rest. False (and nothing changed): it would stand more than
  // kPenetration in something.
  bool place(std::size_t object, const Pose& X_WO);
  static constexpr double kPenetration = 1e-3;  // [m]

  mjModel* model() { return model_.get(); }
  const mjModel* model() const { return model_.get(); }
  mjData* data() { return data_.get(); }
  const mjData* data() const { return data_.get(); }

 private:
  void find_places(const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects);
  void refuse_penetration() const;
  void set_place(const ObjectPlaces& object, const Pose& X_WO);
  Pose placed_at(const ObjectPlaces& object) const;
  bool stands_inside(int body) const;

  struct Free {
    void operator()(mjModel* m) const { mj_deleteModel(m); }
    void operator()(mjData* d) const { mj_deleteData(d); }
  };
  std::unique_ptr<mjModel, Free> model_;
  std::unique_ptr<mjData, Free> data_;
  std::vector<ArmPlaces> arms_;
  std::vector<ObjectPlaces> objects_;
  std::vector<int> arm_of_body_;
  std::vector<char> tip_;
  std::vector<double> qpos_start_;
};

}  // namespace multipanda
