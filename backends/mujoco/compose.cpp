#include <algorithm>
#include <cmath>
#include <memory>
#include <set>
#include <stdexcept>

#include <Eigen/Eigenvalues>

#include "backends/mujoco/engine.hpp"
#include "backends/mujoco/plant.hpp"
#include "backends/mujoco/world.hpp"
#include "models/write_robot.hpp"

namespace multipanda {
namespace {

struct FreeSpec {
  void operator()(mjSpec* s) const { mj_deleteSpec(s); }
};
using SpecPtr = std::unique_ptr<mjSpec, FreeSpec>;

[[noreturn]] void refuse(const std::string& what, const std::string& why) {
  throw std::invalid_argument(what + ": " + why);
}

void set_pose(const Pose& X, double pos[3], double quat[4]) {
  const Quaternion q = X.quaternion();
  std::copy_n(X.position.data(), 3, pos);
  quat[0] = q.w();
  quat[1] = q.x();
  quat[2] = q.y();
  quat[3] = q.z();
}

void set_color(const std::array<double, 4>& rgba, float to[4]) {
  for (std::size_t i = 0; i < 4; ++i) to[i] = static_cast<float>(rgba[i]);
}

// Elliptic friction cones and implicit joint damping; MuJoCo's automatic reset after a divergence is off,
// since the backend handles it.
void set_options(mjSpec* spec, const WorldPhysics& physics) {
  spec->option.timestep = physics.timestep;
  spec->option.noslip_iterations = physics.noslip_iterations;
  spec->option.integrator = mjINT_IMPLICITFAST;
  spec->option.cone = mjCONE_ELLIPTIC;
  spec->option.gravity[0] = spec->option.gravity[1] = 0;
  spec->option.gravity[2] = -9.81;
  spec->option.disableflags |= mjDSBL_AUTORESET;
  spec->compiler.degree = 0;
  spec->compiler.usethread = 0;
}

// Light, sky and, if the scene has no plane, a visible floor, all without collision.
void add_surroundings(mjSpec* spec, const std::vector<WorldArm>& arms, bool has_plane) {
  mjsBody* world = mjs_findBody(spec, "world");

  mjsTexture* sky = mjs_addTexture(spec, nullptr);
  mjs_setName(sky->element, "sky");
  sky->type = mjTEXTURE_SKYBOX;
  sky->builtin = mjBUILTIN_GRADIENT;
  std::copy_n(std::array{0.93, 0.95, 0.97}.data(), 3, sky->rgb1);
  std::copy_n(std::array{0.72, 0.78, 0.85}.data(), 3, sky->rgb2);
  sky->width = 256;
  sky->height = 256 * 6;
  mjsTexture* tiles = mjs_addTexture(spec, nullptr);
  mjs_setName(tiles->element, "tiles");
  tiles->type = mjTEXTURE_2D;
  tiles->builtin = mjBUILTIN_CHECKER;
  tiles->mark = mjMARK_EDGE;
  std::copy_n(std::array{0.80, 0.82, 0.84}.data(), 3, tiles->rgb1);
  std::copy_n(std::array{0.76, 0.78, 0.80}.data(), 3, tiles->rgb2);
  std::copy_n(std::array{0.68, 0.70, 0.73}.data(), 3, tiles->markrgb);
  tiles->width = tiles->height = 512;
  mjsMaterial* floor_material = mjs_addMaterial(spec, nullptr);
  mjs_setName(floor_material->element, "floor");
  mjs_setInStringVec(floor_material->textures, mjTEXROLE_RGB, "tiles");
  floor_material->texrepeat[0] = floor_material->texrepeat[1] = 2;
  floor_material->texuniform = 1;
  floor_material->specular = 0.1F;
  floor_material->reflectance = 0.03F;

  Vector3 middle = Vector3::Zero();
  double lowest = 0;
  for (const auto& arm : arms) {
    middle += arm.X_WB.position / static_cast<double>(arms.size());
    lowest = std::min(lowest, arm.X_WB.position.z());
  }
  const auto add_light = [&](const Vector3& from, float strength, bool shadow) {
    mjsLight* light = mjs_addLight(world, nullptr);
    light->type = mjLIGHT_DIRECTIONAL;
    const Vector3 place = middle + from, direction = -from.normalized();
    std::copy_n(place.data(), 3, light->pos);
    std::copy_n(direction.data(), 3, light->dir);
    light->castshadow = shadow ? 1 : 0;
    for (int i = 0; i < 3; ++i) {
      light->diffuse[i] = strength;
      light->specular[i] = 0.2F;
      light->ambient[i] = 0;
    }
  };
  add_light({1.2, -1.5, 3.5}, 0.55F, true);
  add_light({-1.5, 2.0, 2.5}, 0.25F, false);
  for (int i = 0; i < 3; ++i) {
    spec->visual.headlight.ambient[i] = 0.35F;
    spec->visual.headlight.diffuse[i] = 0.25F;
    spec->visual.headlight.specular[i] = 0.1F;
  }
  spec->visual.quality.shadowsize = 2048;
  spec->visual.quality.offsamples = 4;
  spec->visual.global.offwidth = 1920;
  spec->visual.global.offheight = 1440;

  if (has_plane) return;
  mjsGeom* floor = mjs_addGeom(world, nullptr);
  mjs_setName(floor->element, "visible floor");
  floor->type = mjGEOM_PLANE;
  floor->size[0] = floor->size[1] = 0;
  floor->size[2] = 0.05;
  floor->pos[2] = lowest - 1e-3;
  floor->contype = floor->conaffinity = 0;
  floor->group = 2;
  mjs_setString(floor->material, "floor");
}

// Point masses and thin rods are valid loads of an arm. MuJoCo needs their principal moments.
void set_inertia(const Matrix3& I, mjsBody* body) {
  const Eigen::SelfAdjointEigenSolver<Matrix3> principal(I);
  const Vector3 moments = principal.eigenvalues();
  const double rounding = 1e-9 * moments.cwiseAbs().maxCoeff();
  if (moments[0] > rounding) {
    const std::array full{I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2)};
    std::copy_n(full.data(), 6, body->fullinertia);
    return;
  }
  Matrix3 axes = principal.eigenvectors();
  axes.col(0) *= axes.determinant();  // right-handed
  const Quaternion q(axes);
  const std::array turn{q.w(), q.x(), q.y(), q.z()};
  std::copy_n(turn.data(), 4, body->iquat);
  const double of_rod = (moments[1] + moments[2]) / 2;  // equal except for rounding
  const std::array bare{0.0, of_rod, of_rod};
  std::copy_n(bare.data(), 3, body->inertia);
}

// A rigid body on the flange, drawn as a ball whose size indicates the mass.
void add_load(mjsBody* last_link, const mjsSite* flange, const char* name, const Load& load,
              const std::array<double, 4>& rgba) {
  if (load.mass <= 0) return;
  mjsBody* body = mjs_addBody(last_link, nullptr);
  mjs_setName(body->element, name);
  std::copy_n(flange->pos, 3, body->pos);
  std::copy_n(flange->quat, 4, body->quat);
  body->mass = load.mass;
  body->explicitinertial = 1;
  std::copy_n(load.p_FC.data(), 3, body->ipos);
  set_inertia(load.inertia_C, body);
  mjsGeom* ball = mjs_addGeom(body, nullptr);
  ball->type = mjGEOM_SPHERE;
  ball->size[0] = 0.02 + 0.03 * std::cbrt(load.mass);
  std::copy_n(load.p_FC.data(), 3, ball->pos);
  ball->contype = ball->conaffinity = 0;
  ball->mass = 0;
  ball->group = 2;
  set_color(rgba, ball->rgba);
}

// `length_m` of a capsule, as of a cylinder, is that of its straight part.
void set_size(ShapeType shape, const Vector3& size, mjsGeom* geom) {
  switch (shape) {
    case ShapeType::plane:
      geom->type = mjGEOM_PLANE;
      geom->size[0] = geom->size[1] = 0;  // drawn infinitely large
      geom->size[2] = 0.05;
      break;
    case ShapeType::box:
      geom->type = mjGEOM_BOX;
      for (int i = 0; i < 3; ++i) geom->size[i] = 0.5 * size[i];
      break;
    case ShapeType::sphere:
      geom->type = mjGEOM_SPHERE;
      geom->size[0] = 0.5 * size.x();
      break;
    case ShapeType::cylinder:
    case ShapeType::capsule:
      geom->type = shape == ShapeType::capsule ? mjGEOM_CAPSULE : mjGEOM_CYLINDER;
      geom->size[0] = 0.5 * size.x();
      geom->size[1] = 0.5 * size.z();
      break;
  }
}

// Number of size values of a shape.
std::vector<int> size_axes(ShapeType shape) {
  if (shape == ShapeType::plane) return {};
  if (shape == ShapeType::box) return {0, 1, 2};
  return shape == ShapeType::sphere ? std::vector<int>{0} : std::vector<int>{0, 2};
}

void check_size(const std::string& whose, ShapeType shape, const Vector3& size) {
  for (const int i : size_axes(shape)) {
    if (!(size[i] > 0) || !std::isfinite(size[i])) refuse(whose, "each of its lengths must be above 0");
  }
}

// Collision shapes without mass, in a separate body, so that they may touch bodies that the last link
// may not.
void add_tool_shapes(mjsBody* last_link, const mjsSite* flange, const WorldArm& arm) {
  if (arm.tool_shapes.empty()) return;
  mjsBody* body = mjs_addBody(last_link, nullptr);
  mjs_setName(body->element, "tool_shapes");
  std::copy_n(flange->pos, 3, body->pos);
  std::copy_n(flange->quat, 4, body->quat);
  for (std::size_t i = 0; i < arm.tool_shapes.size(); ++i) {
    const ToolShape& shape = arm.tool_shapes[i];
    if (shape.shape == ShapeType::plane) refuse("arm '" + arm.name + "'", "a tool shape cannot be a plane");
    check_size("tool shape of arm '" + arm.name + "'", shape.shape, shape.size);
    mjsGeom* geom = mjs_addGeom(body, nullptr);
    mjs_setName(geom->element, tool_shape_name(i).c_str());
    set_size(shape.shape, shape.size, geom);
    set_pose(shape.X_FS, geom->pos, geom->quat);
    geom->mass = 0;
    geom->contype = kArmBits.type;
    geom->conaffinity = kArmBits.affinity;
    geom->group = 2;
    set_color({0.25, 0.27, 0.3, 1}, geom->rgba);
  }
}

std::string link_name(const std::string& arm, std::size_t link) {
  return arm + "/link" + std::to_string(link);
}

// The body on which the arm's base stands. In to_mjcf, the frame of a link's body is that of the joint before
// it, and so X_JB holds here.
mjsBody* ground_of(mjSpec* spec, const WorldArm& arm) {
  if (!arm.carrier) return mjs_findBody(spec, "world");
  const std::string name = link_name(arm.carrier->name, arm.carrier->joint + 1);
  mjsBody* ground = mjs_findBody(spec, name.c_str());
  if (ground == nullptr)
    refuse("arm '" + arm.name + "'", "it stands on '" + name + "', which no earlier arm of the world has");
  return ground;
}

// Pairs that overlap where an arm stands on another one: its base is mounted inside the shapes of the link
// below and of that link's neighbors, and its first link turns inside the former. MuJoCo ignores parent and
// child by itself; all pairs are excluded explicitly, as in to_mjcf, because a pair in permanent contact
// would push the arms apart.
void exclude_mount(mjSpec* spec, const WorldArm& arm) {
  if (!arm.carrier) return;
  const auto exclude = [&](std::size_t own, std::size_t below) {
    const std::string mine = link_name(arm.name, own), other = link_name(arm.carrier->name, below);
    if (mjs_findBody(spec, other.c_str()) == nullptr) return;  // beyond the last link
    mjsExclude* pair = mjs_addExclude(spec);
    mjs_setString(pair->bodyname1, mine.c_str());
    mjs_setString(pair->bodyname2, other.c_str());
  };
  const std::size_t ground = arm.carrier->joint + 1;
  for (const std::size_t below : {ground - 1, ground, ground + 1}) exclude(0, below);
  exclude(1, ground);
}

// link0 and link1 do not collide with fixed objects, on which they are mounted (kBaseBits); those of a
// carried arm do.
void let_touch(mjSpec* child, const char* link) {
  mjsBody* body = mjs_findBody(child, link);
  for (mjsElement* e = mjs_firstChild(body, mjOBJ_GEOM, 0); e != nullptr; e = mjs_nextChild(body, e, 0)) {
    mjsGeom* geom = mjs_asGeom(e);
    if (geom->contype != kBaseBits.type) continue;
    geom->contype = kArmBits.type;
    geom->conaffinity = kArmBits.affinity;
  }
}

void add_arm(mjSpec* spec, const WorldArm& arm, bool carries, const WorldPhysics& physics) {
  char error[1024] = "";
  const SpecPtr child(mj_parseXMLString(arm.mjcf.c_str(), nullptr, error, sizeof error));
  if (!child) refuse("arm '" + arm.name + "'", std::string("MuJoCo cannot load its model:  ") + error);
  set_options(child.get(), physics);  // equal options avoid a warning

  const std::string last = "link" + std::to_string(arm.joint_count);
  mjsBody* last_link = mjs_findBody(child.get(), last.c_str());
  const mjsElement* site = mjs_findElement(child.get(), mjOBJ_SITE, "flange");
  mjsBody* root = mjs_findBody(child.get(), "link0");
  if (last_link == nullptr || site == nullptr || root == nullptr) {
    refuse("arm '" + arm.name + "'", "its model lacks body 'link0', body '" + last + "' or site 'flange'");
  }
  if (arm.carrier) let_touch(child.get(), "link0");
  if (arm.carrier || carries) let_touch(child.get(), "link1");
  const mjsSite* flange = mjs_asSite(const_cast<mjsElement*>(site));
  add_load(last_link, flange, "tool", arm.tool, {0.35, 0.37, 0.4, 1});
  add_load(last_link, flange, "payload", arm.payload, {0.85, 0.45, 0.1, 1});
  add_tool_shapes(last_link, flange, arm);

  mjsFrame* frame = mjs_addFrame(ground_of(spec, arm), nullptr);
  set_pose(arm.carrier ? arm.carrier->X_JB : arm.X_WB, frame->pos, frame->quat);
  // Attaches a copy, because attaching moves the child.
  mjs_setDeepCopy(spec, 1);
  if (mjs_attach(frame->element, root->element, (arm.name + "/").c_str(), "") == nullptr) {
    refuse("arm '" + arm.name + "'", mjs_getError(spec));
  }
  exclude_mount(spec, arm);
}

void add_object(mjSpec* spec, const SceneObject& object, bool looks) {
  if (!object.fixed && object.shape == SceneObject::Shape::plane) {
    refuse("object '" + object.name + "'", "a plane cannot be free");
  }
  mjsBody* body = mjs_addBody(mjs_findBody(spec, "world"), nullptr);
  mjs_setName(body->element, object.name.c_str());
  set_pose(object.X_WO, body->pos, body->quat);
  if (!object.fixed) mjs_setName(mjs_addFreeJoint(body)->element, object.name.c_str());
  mjsGeom* geom = mjs_addGeom(body, nullptr);
  mjs_setName(geom->element, object.name.c_str());
  check_size("object '" + object.name + "'", object.shape, object.size);
  set_size(object.shape, object.size, geom);
  if (looks && object.shape == ShapeType::plane) mjs_setString(geom->material, "floor");
  if (!object.fixed) geom->mass = object.mass;
  // Bases are mounted on fixed objects, so link0 and link1 do not collide with these.
  const CollisionBits bits = object.fixed ? kFloorBits : kObjectBits;
  geom->contype = bits.type;
  geom->conaffinity = bits.affinity;
  // The object's values apply to its contacts with arms; between two objects MuJoCo mixes them.
  // Four dimensions: without torsional friction an object held at two points would turn about the
  // line between them.
  geom->priority = 1;
  geom->condim = object.friction > 0 ? 4 : 1;
  geom->friction[0] = object.friction;
  if (object.contact_time_constant_s) geom->solref[0] = *object.contact_time_constant_s;
  if (object.contact_damping_ratio) geom->solref[1] = *object.contact_damping_ratio;
  geom->group = 2;
  set_color(object.rgba, geom->rgba);
}

void check_names(const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects) {
  std::set<std::string> names{"world", ""};
  for (const auto& arm : arms) {
    if (!names.insert(arm.name).second) refuse("arm '" + arm.name + "'", "the name is empty or taken");
    if (static_cast<std::size_t>(arm.q_start.size()) != arm.joint_count) {
      refuse("arm '" + arm.name + "'", "the start configuration must have " +
                                           std::to_string(arm.joint_count) + " values, not " +
                                           std::to_string(arm.q_start.size()));
    }
  }
  for (const auto& object : objects) {
    if (!names.insert(object.name).second)
      refuse("object '" + object.name + "'", "the name is empty or taken");
  }
}

}  // namespace

mjModel* compose(const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects,
                 const WorldPhysics& physics) {
  load_engine();
  check_names(arms, objects);
  const SpecPtr spec(mj_makeSpec());
  set_options(spec.get(), physics);
  const auto is_plane = [](const SceneObject& object) { return object.shape == SceneObject::Shape::plane; };
  if (physics.looks) add_surroundings(spec.get(), arms, std::ranges::any_of(objects, is_plane));
  for (const auto& arm : arms) {
    const bool carries = std::any_of(arms.begin(), arms.end(), [&](const WorldArm& other) {
      return other.carrier && other.carrier->name == arm.name;
    });
    add_arm(spec.get(), arm, carries, physics);
  }
  for (const auto& object : objects) add_object(spec.get(), object, physics.looks);
  add_surface_pairs(spec.get(), arms, objects);
  add_finger_pairs(spec.get(), arms, objects);
  add_cup_welds(spec.get(), arms, objects);
  mjModel* model = mj_compile(spec.get(), nullptr);
  if (model == nullptr)
    throw std::invalid_argument(std::string("MuJoCo cannot compile the scene:  ") + mjs_getError(spec.get()));
  set_surface_figures(model, arms, objects);
  return model;
}

}  // namespace multipanda
