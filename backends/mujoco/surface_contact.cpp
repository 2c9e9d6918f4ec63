#include <cmath>
#include <stdexcept>

#include "backends/mujoco/plant.hpp"

namespace multipanda {
namespace {

constexpr double kImpedance = 0.2;  // d of a contact in one point

std::string pair_name(const WorldArm& arm, std::size_t shape, const SceneObject& object) {
  return arm.name + "/" + tool_shape_name(shape) + " on " + object.name;
}

int contact_points(const ToolShape& tool, const SceneObject& object) {
  const bool flat = object.shape == ShapeType::box || object.shape == ShapeType::plane;
  return tool.shape == ShapeType::box && flat ? 4 : 1;
}

template <typename Work>
void each_pair(const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects, Work work) {
  for (const auto& object : objects) {
    if (!object.contact) continue;
    for (const auto& arm : arms) {
      for (std::size_t i = 0; i < arm.tool_shapes.size(); ++i) work(arm, i, object);
    }
  }
}

}  // namespace

std::string tool_shape_name(std::size_t index) { return "tool_shape" + std::to_string(index + 1); }

void add_surface_pairs(mjSpec* spec, const std::vector<WorldArm>& arms,
                       const std::vector<SceneObject>& objects) {
  each_pair(arms, objects, [&](const WorldArm& arm, std::size_t shape, const SceneObject& object) {
    mjsPair* pair = mjs_addPair(spec, nullptr);
    mjs_setName(pair->element, pair_name(arm, shape, object).c_str());
    mjs_setString(pair->geomname1, (arm.name + "/" + tool_shape_name(shape)).c_str());
    mjs_setString(pair->geomname2, object.name.c_str());
    // With torsional friction: without it an object held at two points would turn about the
    // line between them.
    pair->condim = object.friction > 0 ? 4 : 1;
    pair->friction[0] = pair->friction[1] = object.friction;
    pair->margin = pair->gap = 0;
  });
}

void set_surface_figures(mjModel* model, const std::vector<WorldArm>& arms,
                         const std::vector<SceneObject>& objects) {
  each_pair(arms, objects, [&](const WorldArm& arm, std::size_t shape, const SceneObject& object) {
    const int pair = mj_name2id(model, mjOBJ_PAIR, pair_name(arm, shape, object).c_str());
    if (pair < 0) throw std::logic_error("the compiled scene lacks a contact pair");
    const SurfaceContact& contact = *object.contact;
    const double points = contact_points(arm.tool_shapes[shape], object);
    const double K = contact.stiffness_n_per_m / points;
    const double B = 2 * contact.damping_ratio *
                     std::sqrt(contact.stiffness_n_per_m * SurfaceContact::kContactMass) / points;
    const double B_t = contact.tangential_damping_n_s_per_m / points;
    const double d = kImpedance / (points - (points - 1) * kImpedance);
    const auto inverse_weight = [&](int geom) {
      return model->body_invweight0[2 * model->geom_bodyid[geom]];
    };
    const double scale =
        (1 - d) * (inverse_weight(model->pair_geom1[pair]) + inverse_weight(model->pair_geom2[pair]));
    mjtNum* solref = model->pair_solref + mjNREF * pair;
    mjtNum* along = model->pair_solreffriction + mjNREF * pair;
    mjtNum* solimp = model->pair_solimp + mjNIMP * pair;
    solref[0] = -K * scale;
    solref[1] = -B * scale;
    along[0] = 0;  // no stiffness along the surface
    along[1] = -B_t * scale / model->opt.impratio;
    solimp[0] = solimp[1] = d;
    solimp[2] = 1e-3;
    solimp[3] = 0.5;
    solimp[4] = 2;
  });
}

}  // namespace multipanda
