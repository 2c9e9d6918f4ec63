#pragma once

#include <cmath>
#include <cstdint>

#include "core/controllets/parameters.hpp"
#include "core/model/coupled_modes.hpp"

// Damping for a full inertia matrix and a full stiffness matrix. With the generalized eigenvalues k of
// (stiffness, inertia), that is inertia = Q Q^T and stiffness = Q diag(k) Q^T,
//   damping = 2 zeta Q diag(sqrt(k)) Q^T
// gives every coupled mode the damping ratio zeta (Albu-Schaeffer et al., ICRA 2003). The result is
// symmetric and positive semi-definite for any arguments, so it only dissipates energy. A mode without
// stiffness has no damping.
//
// Damping acts one or two periods late and may excite a fast mode instead of damping it: with 2 zeta sqrt(k)
// and zeta = 1.5, modes above 185 rad/s grow behind two periods. No mode gets more than kLargestModalDamping:
// then modes of up to 295 rad/s decay behind two periods, and of up to 205 rad/s behind three, whatever zeta
// is. Only modes above 150 / zeta rad/s are concerned: hands far apart on one set-point, which turn a wrist
// with a long lever.
namespace multipanda {

inline constexpr double kLargestModalDamping = 300;  // [1/s]

// Matrix is one of the sizes of CoupledModes. Does not allocate. If an argument is not finite, the result is
// not finite either.
template <typename Matrix>
Matrix coupled_damping(const Matrix& inertia, const Matrix& stiffness, double zeta) {
  const CoupledModes<Matrix> modes(inertia, stiffness);
  const Matrix Q = modes.L.lazyProduct(modes.U);
  auto d = (2.0 * zeta * modes.k.cwiseSqrt()).eval();
  for (double& of_mode : d) {
    if (of_mode > kLargestModalDamping && std::isfinite(of_mode)) of_mode = kLargestModalDamping;
  }
  return (Q * d.asDiagonal()).lazyProduct(Q.transpose());
}

// The same for a task, linear first: [N s/m, N m s/rad] from [kg, kg m^2] and [N/m, N m/rad].
Matrix6 task_damping(const Matrix6& Lambda, const Matrix6& stiffness, double zeta);

// The same for joints, with diagonal stiffness (n x 1) [N m/rad]: (n x n) [N m s/rad].
JointMatrix joint_damping(const JointMatrix& M, const JointVector& stiffness, double zeta);

// Each joint alone: d_i = 2 zeta sqrt(k_i M_ii), (n x 1) [N m s/rad]. Cheaper; exact only if M is diagonal.
JointVector diagonal_damping(const JointMatrix& M, const JointVector& stiffness, double zeta);

// A given damping (n x n), symmetric and positive semi-definite, of which no mode gets more than
// kLargestModalDamping: with damping = Q diag(d) Q^T, every d is limited. Unchanged if none is above.
template <typename Matrix>
Matrix limited_damping(const Matrix& inertia, const Matrix& damping) {
  const CoupledModes<Matrix> modes(inertia, damping);
  if (modes.k.maxCoeff() <= kLargestModalDamping) return damping;
  const Matrix Q = modes.L.lazyProduct(modes.U);
  auto d = modes.k;
  for (double& of_mode : d) {
    if (of_mode > kLargestModalDamping && std::isfinite(of_mode)) of_mode = kLargestModalDamping;
  }
  return (Q * d.asDiagonal()).lazyProduct(Q.transpose());
}

// A spring whose torque acts T late takes the damping T K from a mode. That of two periods and the hold
// between samples is 2.5 ms: a given damping below kLeastDampingTime K could let the spring oscillate without
// end, so it counts as that.
inline constexpr double kLeastDampingTime = 0.004;  // [s]

// What a damping acts on.
enum class DampingOf : std::uint8_t {
  error,    // set-point minus arm: no lag behind a moving set-point
  velocity  // the arm alone, as in the manufacturer's examples: a set-point with velocity v leads by K^-1 D v
};
ParameterSpec damping_of_parameter();

}  // namespace multipanda
