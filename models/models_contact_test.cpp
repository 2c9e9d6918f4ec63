// Which bodies touch each other in MuJoCo.
#include <array>
#include <cmath>
#include <memory>
#include <string>

#include <gtest/gtest.h>
#include <mujoco/mujoco.h>

#include "models/robot_description.hpp"
#include "models/write_robot.hpp"

namespace multipanda::models_contact_test {
namespace {

using Spec = std::unique_ptr<mjSpec, void (*)(mjSpec*)>;

Spec parse(const std::string& mjcf) {
  std::array<char, 1000> error{};
  Spec spec(mj_parseXMLString(mjcf.c_str(), nullptr, error.data(), static_cast<int>(error.size())),
            mj_deleteSpec);
  if (!spec) throw std::runtime_error(error.data());
  return spec;
}

void add_geom(mjSpec* spec, mjtGeom type, const Vector3& position, const Vector3& size,
              const CollisionBits& bits) {
  mjsGeom* geom = mjs_addGeom(mjs_findBody(spec, "world"), nullptr);
  geom->type = type;
  geom->contype = bits.type;
  geom->conaffinity = bits.affinity;
  std::copy_n(position.data(), 3, geom->pos);
  std::copy_n(size.data(), 3, geom->size);
}

void add_floor(mjSpec* spec) {
  add_geom(spec, mjGEOM_PLANE, Vector3::Zero(), Vector3(3, 3, 0.1), {1, 1});  // MuJoCo's default bits
}

// Names of the bodies in contact with the arm at q, "link5-world link6-world".
class Scene {
 public:
  explicit Scene(mjSpec* spec)
      : model_(mj_compile(spec, nullptr), mj_deleteModel), data_(nullptr, mj_deleteData) {
    if (!model_) throw std::runtime_error(mjs_getError(spec));
    data_.reset(mj_makeData(model_.get()));
  }

  std::string contacts(const JointVector& q) {
    std::copy_n(q.data(), q.size(), data_->qpos);
    mj_forward(model_.get(), data_.get());
    std::string names;
    for (int i = 0; i < static_cast<int>(data_->ncon); ++i) {
      const auto& geoms = data_->contact[i].geom;
      names += name_of_body(geoms[0]) + "-" + name_of_body(geoms[1]) + " ";
    }
    return names;
  }

  int geoms_in_group(int group) const {
    int count = 0;
    for (int g = 0; g < static_cast<int>(model_->ngeom); ++g) count += model_->geom_group[g] == group ? 1 : 0;
    return count;
  }
  const mjModel& model() const { return *model_; }

 private:
  std::string name_of_body(int geom) const {
    return mj_id2name(model_.get(), mjOBJ_BODY, model_->geom_bodyid[geom]);
  }

  std::unique_ptr<mjModel, void (*)(mjModel*)> model_;
  std::unique_ptr<mjData, void (*)(mjData*)> data_;
};

JointVector configuration(std::initializer_list<double> values) {
  JointVector q(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), q.data());
  return q;
}

const std::string kUr5e = MULTIPANDA_SOURCE_DIR "/tests/models/ur5e.yaml";

TEST(Contacts, NoneAtHomeOnAFloor) {
  for (const std::string& name : {std::string("fer"), std::string("fr3v2"), std::string("fr3"), kUr5e}) {
    const RobotDescription robot = load_robot(name);
    const Spec spec = parse(to_mjcf(robot, {.hand = robot.hand.has_value()}));
    add_floor(spec.get());
    Scene scene(spec.get());
    EXPECT_EQ(scene.contacts(robot.q_home), "") << name;
    const auto capsules = robot.capsules.size() + (robot.hand ? 2 : 0);
    EXPECT_EQ(scene.geoms_in_group(3), static_cast<int>(capsules)) << name;
  }
}

TEST(Contacts, HandReachesTheFloor) {
  const RobotDescription fer = load_robot("fer");
  const Spec spec = parse(to_mjcf(fer, {.hand = true}));
  add_floor(spec.get());
  EXPECT_NE(Scene(spec.get()).contacts(configuration({0, 1.3, 0, -1.0, 0, 2.5, 0})).find("hand"),
            std::string::npos);
}

TEST(Contacts, ArmFoldsOntoItself) {
  const RobotDescription fer = load_robot("fer");
  const Spec spec = parse(to_mjcf(fer, {.hand = true}));
  Scene scene(spec.get());
  EXPECT_NE(scene.contacts(configuration({0, -1.7, 0, -3.05, 0, 0.5, 0})), "");
  EXPECT_EQ(scene.contacts(fer.q_home), "");
}

TEST(Contacts, ObjectsTouchEvenTheBase) {
  const RobotDescription fer = load_robot("fer");
  const Spec spec = parse(to_mjcf(fer));
  add_geom(spec.get(), mjGEOM_BOX, Vector3(0.1, 0, 0.2), Vector3(0.06, 0.06, 0.06), kObjectBits);
  EXPECT_NE(Scene(spec.get()).contacts(fer.q_home).find("link1"), std::string::npos);
}

TEST(Contacts, ArmsTouchEachOther) {
  const RobotDescription fer = load_robot("fer");
  const Spec scene_spec = parse("<mujoco><worldbody/></mujoco>");
  mjs_setDeepCopy(scene_spec.get(), 1);
  const Spec arm = parse(to_mjcf(fer, {.hand = true}));
  for (int i = 0; i < 2; ++i) {
    mjsFrame* frame = mjs_addFrame(mjs_findBody(scene_spec.get(), "world"), nullptr);
    frame->pos[0] = i == 0 ? 0 : 0.65;
    frame->quat[0] = i == 0 ? 1 : 0;  // the second faces the first
    frame->quat[3] = i == 0 ? 0 : 1;
    const std::string prefix = "arm" + std::to_string(i) + "/";
    ASSERT_NE(mjs_attach(frame->element, mjs_findBody(arm.get(), "link0")->element, prefix.c_str(), ""),
              nullptr);
  }
  Scene scene(scene_spec.get());
  ASSERT_EQ(scene.model().nu, 14);
  ASSERT_STREQ(mj_id2name(&scene.model(), mjOBJ_ACTUATOR, 7), "arm1/joint1");
  JointVector q(14);
  q << fer.q_home, fer.q_home;
  const std::string contacts = scene.contacts(q);
  EXPECT_NE(contacts.find("arm0/"), std::string::npos);
  EXPECT_NE(contacts.find("arm1/"), std::string::npos);
}

TEST(Mjcf, IsARigidArmWithTorqueMotors) {
  const RobotDescription fer = load_robot("fer");
  Scene scene(parse(to_mjcf(fer, {.hand = true, .prefix = "left_"})).get());
  const mjModel& m = scene.model();
  ASSERT_EQ(m.nu, 7);
  EXPECT_GE(mj_name2id(&m, mjOBJ_SITE, "left_hand_tcp"), 0);
  for (int i = 0; i < 7; ++i) {
    EXPECT_EQ("left_joint" + std::to_string(i + 1), mj_id2name(&m, mjOBJ_ACTUATOR, i));
    EXPECT_EQ(m.actuator_gear[6 * i], 1);
    EXPECT_FALSE(m.actuator_ctrllimited[i]);
    EXPECT_EQ(m.dof_armature[i], 0);
    EXPECT_EQ(m.dof_damping[i], 0);
    EXPECT_EQ(m.dof_frictionloss[i], 0);
    EXPECT_EQ(m.jnt_range[2 * i], fer.limits.q_min[i]);
    EXPECT_EQ(m.jnt_range[2 * i + 1], fer.limits.q_max[i]);
  }
}

// Both fingers follow the single actuator, mirrored.
TEST(Mjcf, MovableFingersFollowTheirActuator) {
  const RobotDescription fer = load_robot("fer");
  const Spec spec = parse(to_mjcf(fer, {.hand = true, .fingers = Fingers::movable}));
  spec->option.timestep = 0.001;
  spec->option.gravity[2] = 0;
  const std::unique_ptr<mjModel, void (*)(mjModel*)> model(mj_compile(spec.get(), nullptr), mj_deleteModel);
  ASSERT_TRUE(model) << mjs_getError(spec.get());
  const std::unique_ptr<mjData, void (*)(mjData*)> data(mj_makeData(model.get()), mj_deleteData);
  std::copy_n(fer.q_home.data(), 7, data->qpos);
  const int fingers = mj_name2id(model.get(), mjOBJ_ACTUATOR, "fingers");
  ASSERT_GE(fingers, 0);
  for (const double opening : {0.03, 0.002}) {
    data->ctrl[fingers] = opening;
    for (int i = 0; i < 1500; ++i) mj_step(model.get(), data.get());
    EXPECT_NEAR(data->qpos[7], opening, 2e-4);
    EXPECT_NEAR(data->qpos[8], data->qpos[7], 2e-4);
  }
}

}  // namespace
}  // namespace multipanda::models_contact_test
