#include "analysis/identification/rollouts.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include <mujoco/mjbatch.h>

#include "backends/arm/joint_friction.hpp"
#include "backends/mujoco/engine_errors.hpp"
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
  const JointVector zero = joint_constant(world_.joints, 0);
  for (std::size_t i = 0; i < members; ++i) {
    batch_->models.push_back(mj_copyModel(nullptr, model));
    members_.push_back({.model = const_cast<mjModel*>(batch_->models.back()),
                        .terms = std::make_unique<ModelTerms>(arm_model),
                        .q = zero,
                        .dq = zero,
                        .tau = zero});
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

// As MujocoPlant::drive and observe: friction's slope goes to MuJoCo's implicit damping, the rest is applied.
void Rollouts::period(RolloutMember& member, const JointVector& torque, const JointFriction* friction) const {
  const auto& places = world_.world->arm(0);
  member.tau.setZero();
  const double weight = 1.0 / static_cast<double>(world_.substeps);
  for (std::size_t step = 0; step < world_.substeps; ++step) {
    for (std::size_t j = 0; j < world_.joints; ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      const int dof = places.dof[j];
      double applied = torque[i];
      if (friction != nullptr) {
        const double slope = friction_slope(*friction, j, member.dq[i]);
        member.model->dof_damping[dof] = slope;
        applied -= friction_torque(*friction, j, member.dq[i]) - slope * member.dq[i];
      }
      member.data->qfrc_applied[dof] = applied;
      member.tau[i] += weight * applied;
    }
    mj_step(member.model, member.data);
    for (std::size_t j = 0; j < world_.joints; ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      member.q[i] = member.data->qpos[places.qpos[j]];
      member.dq[i] = member.data->qvel[places.dof[j]];
      if (friction != nullptr)
        member.tau[i] -= weight * member.model->dof_damping[places.dof[j]] * member.dq[i];
    }
  }
}

}  // namespace multipanda
