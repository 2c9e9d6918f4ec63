#include <algorithm>
#include <cmath>

#include "backends/mujoco/world.hpp"

// Fingers and suction cups in the world.
namespace multipanda {
std::string weld_name(const WorldArm& arm, const SceneObject& object) {
  return arm.name + "/cup on " + object.name;
}

// MuJoCo's constraints neglect the rate of their Jacobians: a held object slips with the time constant of
// friction times the centripetal acceleration, 3 mm/s with MuJoCo's 20 ms. Friction therefore gets the
// shortest time that steps of 1 ms allow, and iterations against slip (WorldPhysics) remove the remainder.
void add_finger_pairs(mjSpec* spec, const std::vector<WorldArm>& arms,
                      const std::vector<SceneObject>& objects) {
  constexpr double kNormalTime = 0.005, kFrictionTime = 0.002;  // [s]
  for (const auto& arm : arms) {
    for (std::size_t box = 1; box <= arm.finger_boxes; ++box) {
      for (const std::string finger : {"/left_finger", "/right_finger"}) {
        const std::string geom = arm.name + finger + std::to_string(box);
        for (const auto& object : objects) {
          if (object.fixed) continue;
          mjsPair* pair = mjs_addPair(spec, nullptr);
          mjs_setString(pair->geomname1, geom.c_str());
          mjs_setString(pair->geomname2, object.name.c_str());
          pair->condim = object.friction > 0 ? 4 : 1;
          pair->friction[0] = pair->friction[1] = object.friction;
          pair->solref[0] = object.contact_time_constant_s.value_or(kNormalTime);
          pair->solref[1] = object.contact_damping_ratio.value_or(1);
          pair->solreffriction[0] = kFrictionTime;
          pair->solreffriction[1] = 1;
          pair->margin = pair->gap = 0;
        }
      }
    }
  }
}

void add_cup_welds(mjSpec* spec, const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects) {
  for (const auto& arm : arms) {
    if (!arm.X_FE_vacuum) continue;
    for (const auto& object : objects) {
      if (object.fixed) continue;
      mjsEquality* weld = mjs_addEquality(spec, nullptr);
      mjs_setName(weld->element, weld_name(arm, object).c_str());
      weld->type = mjEQ_WELD;
      weld->objtype = mjOBJ_BODY;
      weld->active = 0;
      mjs_setString(weld->name1, (arm.name + "/link" + std::to_string(arm.joint_count)).c_str());
      mjs_setString(weld->name2, object.name.c_str());
      weld->data[10] = 1;  // counts rotation errors directly, in meters per radian
      // A rubber lip: 0.1 mm deflection under one kilogram.
      weld->solref[0] = 0.005;
      weld->solimp[0] = weld->solimp[1] = 0.99;
    }
  }
}

void World::find_grippers(const WorldArm& arm, const std::vector<SceneObject>& objects,
                          ArmPlaces& places) const {
  const mjModel* m = model_.get();
  const auto find = [&](mjtObj type, const std::string& name) {
    const int id = mj_name2id(m, type, name.c_str());
    if (id < 0) throw std::invalid_argument("the compiled scene has no '" + name + "'");
    return id;
  };
  for (std::size_t f = 0; arm.has_fingers && f < 2; ++f) {
    const int joint = find(mjOBJ_JOINT, arm.name + "/finger_joint" + std::to_string(f + 1));
    places.finger_qpos[f] = m->jnt_qposadr[joint];
    places.finger_dof[f] = m->jnt_dofadr[joint];
  }
  places.X_FE_vacuum = arm.X_FE_vacuum;
  for (const auto& object : objects) {
    if (!arm.X_FE_vacuum) break;
    places.welds.push_back(object.fixed ? -1 : find(mjOBJ_EQUALITY, weld_name(arm, object)));
  }
}

World::FingerState World::fingers(std::size_t arm) const {
  const ArmPlaces& places = arms_[arm];
  FingerState state;
  for (std::size_t f = 0; f < 2; ++f) {
    state.width += data_->qpos[places.finger_qpos[f]];
    state.rate += data_->qvel[places.finger_dof[f]];
  }
  return state;
}

void World::push_fingers(std::size_t arm, double force) {
  for (const int dof : arms_[arm].finger_dof) data_->qfrc_applied[dof] = force;
}

Pose World::X_WV(std::size_t arm) const { return X_WF(arm) * *arms_[arm].X_FE_vacuum; }

// Rays start behind the opening, because the object's surface is inside a pressing cup.
std::optional<std::size_t> World::object_at_cup(std::size_t arm, double reach) const {
  constexpr double kBehind = 0.02;  // [m]
  const Pose X_WV_cup = X_WV(arm);
  const Vector3 z = X_WV_cup.rotation.col(2), from = X_WV_cup.position - kBehind * z;
  std::optional<std::size_t> nearest;
  double least = kBehind + reach;
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    if (objects_[i].qpos < 0) continue;
    const int geom = model_->body_geomadr[objects_[i].body];
    const mjtNum distance =
        mju_rayGeom(data_->geom_xpos + 3 * geom, data_->geom_xmat + 9 * geom, model_->geom_size + 3 * geom,
                    from.data(), z.data(), model_->geom_type[geom], nullptr);
    if (distance < 0 || distance > least) continue;
    least = distance;
    nearest = i;
  }
  return nearest;
}

std::optional<std::size_t> World::held(std::size_t arm) const {
  const auto& welds = arms_[arm].welds;
  for (std::size_t i = 0; i < welds.size(); ++i) {
    if (welds[i] >= 0 && data_->eq_active[welds[i]] != 0) return i;
  }
  return std::nullopt;
}

void World::let_go(std::size_t arm) {
  if (!data_) return;
  for (const int weld : arms_[arm].welds) {
    if (weld >= 0) data_->eq_active[weld] = 0;
  }
}

// The weld keeps the object's orientation in the last link, and the position of its point at the cup.
void World::hold(std::size_t arm, std::size_t object) {
  let_go(arm);
  const ArmPlaces& places = arms_[arm];
  const int weld = places.welds[object];
  if (weld < 0) return;
  const auto pose_of = [&](int body) {
    return Pose{matrix_at(data_->xmat + 9 * body), vector_at(data_->xpos + 3 * body)};
  };
  const Pose X_LO = pose_of(places.last_link).inverse() * X_WO(object);
  const Vector3 p_W = X_WV(arm).position;
  const Vector3 p_O = X_WO(object).inverse() * p_W, p_L = pose_of(places.last_link).inverse() * p_W;
  mjtNum* data = model_->eq_data + mjNEQDATA * weld;
  const Quaternion q = X_LO.quaternion();
  std::copy_n(p_O.data(), 3, data);
  std::copy_n(p_L.data(), 3, data + 3);
  const std::array<mjtNum, 4> wxyz{q.w(), q.x(), q.y(), q.z()};
  std::copy(wxyz.begin(), wxyz.end(), data + 6);
  data_->eq_active[weld] = 1;
}

// From the constraint forces on the object's own six coordinates: force in world axes at its origin, moment
// in its own axes.
Wrench World::weld_wrench(std::size_t arm, const Vector3& p_W) const {
  const auto object = held(arm);
  if (!object) return {};
  const int weld = arms_[arm].welds[*object];
  const ObjectPlaces& places = objects_[*object];
  const mjModel* m = model_.get();
  const mjData* d = data_.get();
  Vector6 generalized = Vector6::Zero();
  for (int row = 0; row < d->ne; ++row) {
    if (d->efc_type[row] != mjCNSTR_EQUALITY || d->efc_id[row] != weld) continue;
    if (mj_isSparse(m) != 0) {
      const int start = d->efc_J_rowadr[row], count = d->efc_J_rownnz[row];
      for (int k = start; k < start + count; ++k) {
        const int column = d->efc_J_colind[k] - places.dof;
        if (column >= 0 && column < 6) generalized[column] += d->efc_J[k] * d->efc_force[row];
      }
    } else {
      const mjtNum* J = d->efc_J + static_cast<std::ptrdiff_t>(row) * m->nv + places.dof;
      for (int k = 0; k < 6; ++k) generalized[k] += J[k] * d->efc_force[row];
    }
  }
  const Pose X_WO_held = X_WO(*object);
  Wrench F_O;
  F_O.force() = generalized.head<3>();
  F_O.torque() = X_WO_held.rotation * generalized.tail<3>();
  return shifted(F_O, X_WO_held.position - p_W);
}

Wrench World::cup_wrench(std::size_t arm) const {
  const Pose X_WV_cup = X_WV(arm);
  const Wrench F_W = weld_wrench(arm, X_WV_cup.position);
  Wrench F_V;
  F_V.force() = X_WV_cup.rotation.transpose() * F_W.force();
  F_V.torque() = X_WV_cup.rotation.transpose() * F_W.torque();
  return F_V;
}

}  // namespace multipanda
