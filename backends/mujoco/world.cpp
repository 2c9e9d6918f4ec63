#include "backends/mujoco/world.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "backends/mujoco/engine.hpp"

namespace multipanda {
namespace {

int find(const mjModel* m, mjtObj type, const std::string& name) {
  const int id = mj_name2id(m, type, name.c_str());
  if (id < 0) throw std::invalid_argument("the compiled scene has no '" + name + "'");
  return id;
}

std::string geom_name(const mjModel* m, int geom) {
  if (const char* name = mj_id2name(m, mjOBJ_GEOM, geom); name != nullptr && *name != '\0') return name;
  return mj_id2name(m, mjOBJ_BODY, m->geom_bodyid[geom]);
}

}  // namespace

World::World(const mjModel& compiled, const std::vector<WorldArm>& arms,
             const std::vector<SceneObject>& objects, const WorldPhysics& physics)
    : model_(mj_copyModel(nullptr, &compiled)) {
  find_places(arms, objects);
  for (const auto& arm : arms_) {
    for (const int dof : arm.dof) {
      // Stiffer than MuJoCo's default, which lets a joint at rest creep.
      model_->dof_frictionloss[dof] = physics.stiction;
      model_->dof_solref[mjNREF * dof] = 0.002;
      model_->dof_solimp[mjNIMP * dof] = model_->dof_solimp[mjNIMP * dof + 1] = 0.99;
    }
  }
  if (!without_engine_error([this] { data_.reset(mj_makeData(model_.get())); }) || !data_) {
    throw std::invalid_argument(std::string("MuJoCo cannot allocate the scene:  ") + last_engine_error());
  }
  qpos_start_.assign(model_->qpos0, model_->qpos0 + model_->nq);
  for (std::size_t a = 0; a < arms.size(); ++a) {
    for (std::size_t j = 0; j < arms[a].joint_count; ++j) {
      qpos_start_[static_cast<std::size_t>(arms_[a].qpos[j])] = arms[a].q_start[static_cast<Eigen::Index>(j)];
    }
    if (!arms[a].has_fingers) continue;
    for (const int finger : arms_[a].finger_qpos) {
      qpos_start_[static_cast<std::size_t>(finger)] = arms[a].fingers_start;
    }
  }
  for (const auto& object : objects_) set_place(object, object.X_WO_start, qpos_start_.data());
  if (!begin())
    throw std::invalid_argument(std::string("MuJoCo cannot start the scene:  ") + last_engine_error());
  refuse_penetration();
}

void World::find_places(const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects) {
  const mjModel* m = model_.get();
  const auto bodies = static_cast<std::size_t>(m->nbody);
  arm_of_body_.assign(bodies, -1);
  tip_.assign(bodies, 0);
  std::vector<int> roots;
  for (const auto& arm : arms) {
    ArmPlaces places;
    for (std::size_t j = 1; j <= arm.joint_count; ++j) {
      const int joint = find(m, mjOBJ_JOINT, arm.name + "/joint" + std::to_string(j));
      places.qpos.push_back(m->jnt_qposadr[joint]);
      places.dof.push_back(m->jnt_dofadr[joint]);
    }
    places.flange_site = find(m, mjOBJ_SITE, arm.name + "/flange");
    places.last_link = find(m, mjOBJ_BODY, arm.name + "/link" + std::to_string(arm.joint_count));
    roots.push_back(find(m, mjOBJ_BODY, arm.name + "/link0"));
    find_grippers(arm, objects, places);
    arms_.push_back(std::move(places));
  }
  // A parent comes before its children. The bodies of a carried arm are below those of its carrier.
  for (std::size_t b = 1; b < bodies; ++b) {
    const auto parent = static_cast<std::size_t>(m->body_parentid[b]);
    arm_of_body_[b] = arm_of_body_[parent];
    tip_[b] = tip_[parent];
    for (std::size_t a = 0; a < arms_.size(); ++a) {
      if (static_cast<int>(b) == roots[a]) {
        arm_of_body_[b] = static_cast<int>(a);
        tip_[b] = 0;
      }
      if (static_cast<int>(b) == arms_[a].last_link) tip_[b] = 1;
    }
  }
  for (const auto& object : objects) {
    ObjectPlaces places{
        .name = object.name, .body = find(m, mjOBJ_BODY, object.name), .X_WO_start = object.X_WO};
    if (!object.fixed) {
      const int joint = find(m, mjOBJ_JOINT, object.name);
      places.qpos = m->jnt_qposadr[joint];
      places.dof = m->jnt_dofadr[joint];
    }
    objects_.push_back(std::move(places));
  }
}

void World::refuse_penetration() const {
  for (int i = 0; i < data_->ncon; ++i) {
    const mjContact& contact = data_->contact[i];
    if (contact.dist > -kPenetration) continue;
    char depth[32];
    std::snprintf(depth, sizeof depth, "%.1f", -1000 * contact.dist);
    throw std::invalid_argument("at the start '" + geom_name(model_.get(), contact.geom[0]) + "' is " +
                                depth + " mm inside '" + geom_name(model_.get(), contact.geom[1]) +
                                "': move one of them, or change the start configuration");
  }
}

std::optional<std::size_t> World::find_object(std::string_view name) const {
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    if (objects_[i].name == name) return i;
  }
  return std::nullopt;
}

void World::joints(std::size_t arm, JointVector& q, JointVector& dq) const {
  const ArmPlaces& places = arms_[arm];
  for (std::size_t j = 0; j < places.qpos.size(); ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    q[i] = data_->qpos[places.qpos[j]];
    dq[i] = data_->qvel[places.dof[j]];
  }
}

JointVector World::joint_inertia(std::size_t arm) const {
  const auto& dof = arms_[arm].dof;
  JointVector inertia(static_cast<Eigen::Index>(dof.size()));
  for (std::size_t j = 0; j < dof.size(); ++j) {  // a row of M ends with its diagonal
    const int last = model_->M_rowadr[dof[j]] + model_->M_rownnz[dof[j]] - 1;
    inertia[static_cast<Eigen::Index>(j)] = data_->M[last];
  }
  return inertia;
}

Pose World::X_WF(std::size_t arm) const {
  const int site = arms_[arm].flange_site;
  return {matrix_at(data_->site_xmat + 9 * site), vector_at(data_->site_xpos + 3 * site)};
}

Pose World::X_WO(std::size_t object) const {
  const int body = objects_[object].body;
  return {matrix_at(data_->xmat + 9 * body), vector_at(data_->xpos + 3 * body)};
}

Wrench World::tip_wrench(std::size_t arm, const Vector3& p_W) const {
  const mjModel* m = model_.get();
  const mjData* d = data_.get();
  const int self = static_cast<int>(arm);
  Wrench total;
  for (int i = 0; i < d->ncon; ++i) {
    const mjContact& contact = d->contact[i];
    if (contact.geom[0] < 0 || contact.geom[1] < 0 || contact.efc_address < 0) continue;
    const int body0 = m->geom_bodyid[contact.geom[0]], body1 = m->geom_bodyid[contact.geom[1]];
    const int arm0 = arm_of_body(body0), arm1 = arm_of_body(body1);
    if ((arm0 == self) == (arm1 == self)) continue;  // contact of another arm, or self-contact
    if (!is_tip(arm0 == self ? body0 : body1)) continue;
    // MuJoCo's wrench acts on the second geom, in the contact's frame, whose axes are the matrix's rows.
    mjtNum local[6];
    mj_contactForce(m, d, i, local);
    const double sign = arm0 == self ? 1 : -1;
    const Matrix3 R_WC = matrix_at(contact.frame).transpose();
    Wrench at_contact;
    at_contact.force() = sign * (R_WC * vector_at(local));
    at_contact.torque() = sign * (R_WC * vector_at(local + 3));
    total.vector += shifted(at_contact, vector_at(contact.pos) - p_W).vector;
  }
  if (has_cup(arm)) total.vector += weld_wrench(arm, p_W).vector;
  return total;
}

// MuJoCo's cfrc_int is the wrench by which a body's parent acts on it [m; f], about the center of mass of the
// whole tree, world axes. The bodies on the last link are what the flange carries; the suction cup acts on
// the link itself.
Wrench World::sensor_load(std::size_t arm, const Pose& X_FS) const {
  const mjModel* m = model_.get();
  const mjData* d = data_.get();
  const Pose X_WS = X_WF(arm) * X_FS;
  Wrench load;
  for (int body = arms_[arm].last_link + 1; body < m->nbody; ++body) {
    if (m->body_parentid[body] != arms_[arm].last_link || arm_of_body(body) != static_cast<int>(arm))
      continue;
    const Vector3 p = vector_at(d->subtree_com + 3 * m->body_rootid[body]);
    Wrench by_link;
    by_link.force() = vector_at(d->cfrc_int + 6 * body + 3);
    by_link.torque() = vector_at(d->cfrc_int + 6 * body);
    load.vector -= shifted(by_link, p - X_WS.position).vector;
  }
  if (has_cup(arm)) load.vector -= weld_wrench(arm, X_WS.position).vector;
  Wrench F_S;
  F_S.force() = X_WS.rotation.transpose() * load.force();
  F_S.torque() = X_WS.rotation.transpose() * load.torque();
  return F_S;
}

// One row per joint that has dry friction, and its Jacobian is 1.
double World::stiction_torque(int dof) const {
  for (int i = data_->ne; i < data_->ne + data_->nf; ++i) {
    if (data_->efc_type[i] == mjCNSTR_FRICTION_DOF && data_->efc_id[i] == dof) return data_->efc_force[i];
  }
  return 0;
}

bool World::reset() {
  return without_engine_error([this] { mj_resetData(model_.get(), data_.get()); }) && begin();
}

// From data that MuJoCo has just made or reset.
bool World::begin() {
  for (std::size_t a = 0; a < arms_.size(); ++a) let_go(a);
  for (const auto& object : objects_) {
    if (object.qpos < 0) set_place(object, object.X_WO_start, nullptr);
  }
  std::ranges::copy(qpos_start_, data_->qpos);
  return forward();
}

bool World::forward() {
  return without_engine_error([this] { mj_forward(model_.get(), data_.get()); });
}

bool World::step() {
  const auto ran_away = [this] {
    return data_->warning[mjWARN_BADQPOS].number + data_->warning[mjWARN_BADQVEL].number +
           data_->warning[mjWARN_BADQACC].number;
  };
  const int before = ran_away();
  return without_engine_error([this] { mj_step(model_.get(), data_.get()); }) && ran_away() == before;
}

// The model has the pose of a fixed body; MuJoCo reads it in every step.
void World::set_place(const ObjectPlaces& object, const Pose& X_WO, double* qpos) {
  const bool fixed = object.qpos < 0;
  mjtNum* p = fixed ? model_->body_pos + 3 * object.body : qpos + object.qpos;
  mjtNum* quaternion = fixed ? model_->body_quat + 4 * object.body : p + 3;
  std::copy_n(X_WO.position.data(), 3, p);
  const Quaternion q = X_WO.quaternion();
  const std::array<mjtNum, 4> wxyz{q.w(), q.x(), q.y(), q.z()};
  std::copy(wxyz.begin(), wxyz.end(), quaternion);
}

Pose World::placed_at(const ObjectPlaces& object) const {
  const bool fixed = object.qpos < 0;
  const mjtNum* p = fixed ? model_->body_pos + 3 * object.body : data_->qpos + object.qpos;
  const mjtNum* q = fixed ? model_->body_quat + 4 * object.body : p + 3;
  return {Quaternion(q[0], q[1], q[2], q[3]).toRotationMatrix(), vector_at(p)};
}

bool World::stands_inside(int body) const {
  return std::any_of(data_->contact, data_->contact + data_->ncon, [&](const mjContact& contact) {
    const bool ours =
        model_->geom_bodyid[contact.geom[0]] == body || model_->geom_bodyid[contact.geom[1]] == body;
    return ours && contact.dist < -kPenetration;
  });
}

bool World::place(std::size_t index, const Pose& X_WO) {
  const ObjectPlaces& object = objects_[index];
  const Pose X_WO_before = placed_at(object);
  std::array<mjtNum, 6> velocity_before{};
  if (object.dof >= 0) {
    mjtNum* velocity = data_->qvel + object.dof;
    std::copy_n(velocity, 6, velocity_before.begin());
    std::fill_n(velocity, 6, 0.0);
  }
  set_place(object, X_WO, data_->qpos);
  if (forward() && !stands_inside(object.body)) {
    for (std::size_t a = 0; a < arms_.size(); ++a) {
      if (held(a) == index) let_go(a);
    }
    return true;
  }
  set_place(object, X_WO_before, data_->qpos);
  if (object.dof >= 0) std::copy(velocity_before.begin(), velocity_before.end(), data_->qvel + object.dof);
  forward();
  return false;
}

}  // namespace multipanda
