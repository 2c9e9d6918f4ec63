#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "backends/mujoco/engine.hpp"
#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// One arm of the world.
struct WorldArm {
  // The carrier of this arm, on the link behind its joint number `joint`, from 0.
  struct Carrier {
    std::string name;  // of an earlier arm
    std::size_t joint = 0;
    Pose X_JB;  // base in the joint's frame
  };
  std::string name;
  std::string mjcf;  // of to_mjcf(): body link0, joints joint1..N, site flange
  std::size_t joint_count = 0;
  Pose X_WB;  // of a carried arm at the start
  std::optional<Carrier> carrier;
  JointVector q_start;
  Load tool, payload;  // the actual loads on the flange, without the hand; mass 0: none
  std::vector<ToolShape> tool_shapes;
  std::size_t finger_boxes = 0;     // collision boxes of each finger
  bool has_fingers = false;         // joints finger_joint1 and 2, coupled
  double fingers_start = 0;         // opening of each finger at the start [m]
  std::optional<Pose> X_FE_vacuum;  // opening of a suction cup on the flange, z outwards
};

struct WorldPhysics {
  double timestep = 0.001;    // [s]
  int noslip_iterations = 0;  // of the contact solver
  double stiction = 0;        // dry friction of every arm joint [N m]
  bool looks = true;          // with what only pictures show
};

struct EngineFree {
  void operator()(mjModel* m) const { mj_deleteModel(m); }
  void operator()(mjData* d) const { mj_deleteData(d); }
};
using ModelOwner = std::unique_ptr<mjModel, EngineFree>;

// The physical world in MuJoCo: arms, their loads, and objects, with rigid bodies, contact and gravity.
// SimulatedArm adds an arm's own behavior. Names: elements of an arm are "<arm>/<name in its MJCF>", tool
// and payload are "<arm>/tool" and "<arm>/payload", tool shapes "<arm>/tool_shape1" and so on, an object's
// body and geom have the object's name. The constructor throws std::invalid_argument if MuJoCo cannot compile
// the scene or if bodies penetrate at the start (with names and depth). No later call allocates.
class World {
 public:
  // `compiled`: by compose(), of the same scene; arms and free objects may start elsewhere.
  World(const mjModel& compiled, const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects,
        const WorldPhysics& physics);

  // Addresses of an arm's quantities in MuJoCo.
  struct ArmPlaces {
    std::vector<int> qpos, dof;  // per joint
    int flange_site = -1;
    int last_link = -1;  // body behind the last joint
    // Fingers, if they move; -1: none. A suction cup: one weld per object that can be held (free ones).
    std::array<int, 2> finger_qpos{-1, -1}, finger_dof{-1, -1};
    std::vector<int> welds;  // by object; -1: fixed
    std::optional<Pose> X_FE_vacuum;
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
  // Arm that a body belongs to (links, hand, tool, payload), or -1; not the arm that carries it.
  int arm_of_body(int body) const { return arm_of_body_[static_cast<std::size_t>(body)]; }
  // Whether a body is behind the last joint: last link, hand, fingers, tool and its shapes, payload.
  bool is_tip(int body) const { return tip_[static_cast<std::size_t>(body)] != 0; }

  void joints(std::size_t arm, JointVector& q, JointVector& dq) const;
  // The mass matrix' diagonal, motors included, at the beginning of the last physics step or forward() [kg
  // m^2].
  JointVector joint_inertia(std::size_t arm) const;
  Pose X_WF(std::size_t arm) const;
  Pose X_WO(std::size_t object) const;

  // The wrench that the arm's hand and tool (is_tip) exert on other bodies in the last physics step or
  // forward(), about the world point p_W, in world axes. It includes an object held by the suction cup.
  Wrench tip_wrench(std::size_t arm, const Vector3& p_W) const;

  // The load on a sensor between flange and all that is on it, with its weight and inertia: about S, axes of
  // S, in the last physics step; call update_loads() first. `at_rest`: without accelerations, as before the
  // first step, in which no motor acts yet.
  void update_loads(bool at_rest) {
    if (at_rest) std::fill_n(data_->qacc, model_->nv, 0.0);
    mj_rnePostConstraint(model_.get(), data_.get());
  }
  Wrench sensor_load(std::size_t arm, const Pose& X_FS) const;

  // --- hand with fingers that move ---
  struct FingerState {
    double width = 0, rate = 0;  // of the opening between the pads [m, m/s]
  };
  bool has_fingers(std::size_t arm) const { return arms_[arm].finger_dof[0] >= 0; }
  FingerState fingers(std::size_t arm) const;
  void push_fingers(std::size_t arm, double force);  // force on each finger from now on, above 0 opens [N]

  // --- suction cup ---
  bool has_cup(std::size_t arm) const { return arms_[arm].X_FE_vacuum.has_value(); }
  // The free object whose surface is nearest to the cup, straight ahead and at most `reach` away [m].
  std::optional<std::size_t> object_at_cup(std::size_t arm, double reach) const;
  // Holds an object at its current pose to the cup; releases the previous one.
  void hold(std::size_t arm, std::size_t object);
  void let_go(std::size_t arm);
  std::optional<std::size_t> held(std::size_t arm) const;
  // The wrench of the cup on the held object, about the cup, in its axes; zero without an object.
  Wrench cup_wrench(std::size_t arm) const;

  // Dry friction torque of a joint in the last physics step [N m].
  double stiction_torque(int dof) const;

  // Resets everything to the start, including MuJoCo's clock. Returns false on an engine error.
  bool reset();
  // Updates contacts and forces without a step. False: engine error.
  bool forward();
  // One physics step. False: engine error, or positions, velocities or accelerations diverged.
  bool step();
  // Moves a free object, at rest. Returns false, changing nothing, if it would penetrate another by more
  // than kPenetration.
  bool place(std::size_t object, const Pose& X_WO);
  static constexpr double kPenetration = 1e-3;  // [m]

  mjModel* model() { return model_.get(); }
  const mjModel* model() const { return model_.get(); }
  mjData* data() { return data_.get(); }
  const mjData* data() const { return data_.get(); }

 private:
  bool begin();
  void find_places(const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects);
  void refuse_penetration() const;
  void set_place(const ObjectPlaces& object, const Pose& X_WO, double* qpos);
  Pose placed_at(const ObjectPlaces& object) const;
  bool stands_inside(int body) const;
  void find_grippers(const WorldArm& arm, const std::vector<SceneObject>& objects, ArmPlaces& places) const;
  Pose X_WV(std::size_t arm) const;  // of the cup
  Wrench weld_wrench(std::size_t arm, const Vector3& p_W) const;

  ModelOwner model_;
  std::unique_ptr<mjData, EngineFree> data_;
  std::vector<ArmPlaces> arms_;
  std::vector<ObjectPlaces> objects_;
  std::vector<int> arm_of_body_;
  std::vector<char> tip_;
  std::vector<double> qpos_start_;
};

inline Eigen::Map<const Vector3> vector_at(const mjtNum* values) { return Eigen::Map<const Vector3>(values); }
// MuJoCo's matrices are row-major.
inline Matrix3 matrix_at(const mjtNum* values) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(values);
}

// Compiles arms and objects to one MuJoCo model, owned by the caller. Throws std::invalid_argument with
// MuJoCo's reason.
mjModel* compose(const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects,
                 const WorldPhysics& physics);

// Stiffer contacts between fingers and free objects, so that fingers can hold them.
void add_finger_pairs(mjSpec* spec, const std::vector<WorldArm>& arms,
                      const std::vector<SceneObject>& objects);

// One weld for each pair of a suction cup and a free object; none is active at the start.
void add_cup_welds(mjSpec* spec, const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects);

}  // namespace multipanda
