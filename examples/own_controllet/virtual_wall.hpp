#pragma once

#include "core/controllets/controllet.hpp"

// A user's own controllet: the arm can be guided by hand, except through a wall.
//   tau = J_p^T n (k d + b max(0, -n^T v)) + C dq   if d = h - n^T p > 0, otherwise C dq
// n the wall's normal (world), h its distance from the world's origin, p and v the end effector's position
// and velocity, J_p the linear rows of its Jacobian.
multipanda::ControlletType virtual_wall_controllet();
