#pragma once

#include <string>
#include <vector>

#include "backends/mujoco/world.hpp"

// Contact between tool shapes and objects in SI units (SurfaceContact). Each such pair of geoms is an
// explicit MuJoCo pair, whose values override those of the geoms.
//
// Law. MuJoCo's contact force in one dimension, with constant impedance d and direct solref (-k, -b), is
//   f = (-a - (b/d) v - (k/d) r) / R,  R = (1 - d)/d A,
// where r < 0 is the penetration and A the sum of the two bodies' inverse weights. At rest f = -k r / ((1-d)
// A):
//   k = K (1 - d) A,  b = B (1 - d) A,  along the surface b_t = B_t (1 - d) A / impratio.
// The term with a acts like a mass d / ((1-d) A) of both bodies in contact; d is small.
//
// A box that lies flat on a box or a plane touches at its four corners, so each gets a quarter of K, B and
// B_t, and an impedance that gives four points the added mass of one.
namespace multipanda {

// Name of a tool shape's geom, in the arm's own model: "tool_shape1", ...
std::string tool_shape_name(std::size_t index);

// Pairs every tool shape with every object that has a `contact`; before compilation.
void add_surface_pairs(mjSpec* spec, const std::vector<WorldArm>& arms,
                       const std::vector<SceneObject>& objects);
// Sets their values, which depend on the compiled inverse weights.
void set_surface_figures(mjModel* model, const std::vector<WorldArm>& arms,
                         const std::vector<SceneObject>& objects);

}  // namespace multipanda
