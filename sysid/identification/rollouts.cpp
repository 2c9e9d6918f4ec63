#include "sysid/identification/rollouts.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "backends/mujoco/engine.hpp"
#include "backends/simulated_arm/friction.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

Scene one_arm(const Scene& scene, std::size_t arm) {
  Scene alone = scene;
  alone.arms = {scene.arms.at(arm)};
  alone.arms[0].movable_fingers = false;
  alone.arms[0].vacuum = false;
  alone.timeline.clear();
  std::erase_if(alone.objects, [](const SceneObject& object) { return !object.fixed; });
  return alone;
}

}  // namespace

struct Rollouts::Batch {
  mjBatch* batch = nullptr;
  std::vector<const mjModel*> models;
  std::vector<int> ids;
  ~Batch() {
    if (batch != nullptr) mjb_deleteBatch(batch);
    for (const mjModel* model : models) mj_deleteModel(const_cast<mjModel*>(model));
  }
};

Rollouts::Rollouts(const Scene& scene, std::size_t arm, std::size_t members, int threads)
    : batch_(std::make_unique<Batch>()) {
  const Scene alone = one_arm(scene, arm);
  plant_ = std::make_unique<MujocoPlant>(alone);
  const mjModel* model = plant_->world().model();
  world_ = {.world = &plant_->world(),
            .joints = plant_->world().arm(0).dof.size(),
            .substeps = alone.substeps,
            .dt = model->opt.timestep};
  const auto config = arm_config(alone.arms[0]);
  const auto arm_model = build_arm_model(alone.arms[0]);
  const RobotDescription robot = plant_robot_of(alone.arms[0]);
  motor_inertia_ = robot.motor_inertia;
  std::optional<LinkFriction> link_friction;
  if (robot.link_friction) link_friction.emplace(*robot.link_friction, world_.joints);
  joint_inertia_ = plant_->world().joint_inertia(0);
  const JointVector zero = joint_constant(world_.joints, 0);
  for (std::size_t i = 0; i < members; ++i) {
    batch_->models.push_back(mj_copyModel(nullptr, model));
    members_.push_back({.model = const_cast<mjModel*>(batch_->models.back()),
                        .terms = std::make_unique<ModelTerms>(arm_model),
                        .link_friction = link_friction,
                        .q = zero,
                        .dq = zero,
                        .tau = zero,
                        .before = zero});
    members_.back().terms->set_config(config.frames, config.tool, config.load);
  }
  batch_->ids.resize(members);
  std::iota(batch_->ids.begin(), batch_->ids.end(), 0);
  mjBatchConfig settings;
  mjb_defaultConfig(&settings);
  settings.nthread = threads;
  char why[512] = "";
  batch_->batch = mjb_makeBatch(model, static_cast<int>(members), &settings, why, sizeof why);
  if (batch_->batch == nullptr)
    throw std::invalid_argument(std::string("MuJoCo cannot batch the scene: ") + why);
  mjb_setModels(batch_->batch, batch_->models.data());
}

Rollouts::~Rollouts() = default;

bool Rollouts::run(std::size_t count, const Work& work) {
  struct Call {
    Rollouts* self;
    const Work* work;
  } call{this, &work};
  const auto one = [](const mjModel*, mjData* data, int sim, void* argument) {
    const Call& c = *static_cast<Call*>(argument);
    RolloutMember& member = c.self->members_[static_cast<std::size_t>(sim)];
    member.data = data;
    (*c.work)(member, static_cast<std::size_t>(sim));
  };
  const int failed = mjb_apply(batch_->batch, batch_->ids.data(), static_cast<int>(count), one, &call, 0);
  error_.clear();
  if (failed == 0) return true;
  for (std::size_t i = 0; i < count && error_.empty(); ++i)
    error_ = mjb_error(batch_->batch, static_cast<int>(i));
  return false;
}

void Rollouts::begin(RolloutMember& member, const JointVector& q, const JointVector& dq) const {
  mj_resetData(member.model, member.data);
  const auto& places = world_.world->arm(0);
  for (std::size_t j = 0; j < world_.joints; ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    member.data->qpos[places.qpos[j]] = q[i];
    member.data->qvel[places.dof[j]] = dq[i];
  }
  member.q = q;
  member.dq = dq;
}

void Rollouts::lead_in(RolloutMember& member, const Eigen::MatrixXd& dq, Eigen::Index first) const {
  if (!member.link_friction) return;
  constexpr Eigen::Index kRows = 500;
  const double period = world_.dt * static_cast<double>(world_.substeps);
  member.link_friction->reset();
  for (Eigen::Index row = std::max<Eigen::Index>(0, first - kRows); row < first; ++row) {
    member.before = dq.row(row);
    member.link_friction->begin(member.before, joint_inertia_, period);
    member.before = dq.row(row + 1);
    member.link_friction->end(member.before, period);
  }
}

// As MujocoPlant::drive and observe: the slope of friction goes to MuJoCo's implicit damping, the
// rest is applied.
void Rollouts::period(RolloutMember& member, const JointVector& torque, const JointFriction* friction) const {
  const auto& places = world_.world->arm(0);
  member.tau.setZero();
  const double weight = 1.0 / static_cast<double>(world_.substeps);
  for (std::size_t step = 0; step < world_.substeps; ++step) {
    member.before = member.dq;
    if (member.link_friction) member.link_friction->begin(member.before, joint_inertia_, world_.dt);
    for (std::size_t j = 0; j < world_.joints; ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      const int dof = places.dof[j];
      double applied = torque[i], slope = 0;
      if (friction != nullptr) {
        slope = friction_slope(*friction, j, member.dq[i]);
        applied -= friction_torque(*friction, j, member.dq[i]) - slope * member.dq[i];
      }
      member.tau[i] += weight * applied;
      member.model->dof_damping[dof] = slope;
      member.data->qfrc_applied[dof] = applied;
      if (member.link_friction) {
        member.model->dof_damping[dof] += member.link_friction->slope()[i];
        member.data->qfrc_applied[dof] -= member.link_friction->constant()[i];
      }
    }
    mj_step(member.model, member.data);
    for (std::size_t j = 0; j < world_.joints; ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      member.q[i] = member.data->qpos[places.qpos[j]];
      member.dq[i] = member.data->qvel[places.dof[j]];
      double slope = member.model->dof_damping[places.dof[j]];
      if (member.link_friction) slope -= member.link_friction->slope()[i];
      member.tau[i] -= weight * slope * member.dq[i];
      if (motor_inertia_.size() > 0) {
        member.tau[i] -= weight * motor_inertia_[i] * (member.dq[i] - member.before[i]) / world_.dt;
      }
    }
    if (member.link_friction) member.link_friction->end(member.dq, world_.dt);
  }
}

}  // namespace multipanda
