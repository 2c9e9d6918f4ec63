#pragma once

#include <cmath>
#include <cstdint>
#include <span>

#include "core/controllets/parameters.hpp"
#include "core/model/arm_model.hpp"
#include "core/model/coupled_modes.hpp"
#include "core/model/model_terms.hpp"
#include "core/types/triangular.hpp"

// Damping for a full inertia matrix and a full stiffness matrix. With the generalized eigenvalues k of
// (stiffness, inertia), that is inertia = Q Q^T and stiffness = Q diag(k) Q^T,
//   damping = 2 zeta Q diag(sqrt(k)) Q^T
// gives every coupled mode the damping ratio zeta (Albu-Schaeffer et al., ICRA 2003). The result is
// symmetric and positive semi-definite for any arguments, so it only dissipates energy. A mode without
// stiffness has no damping from it (brake()).
//
// Damping acts one or two periods late and may excite a fast mode instead of damping it: with 2 zeta sqrt(k)
// and zeta = 1.5, modes above 185 rad/s grow behind two periods. No mode gets more than kLargestModalDamping:
// then modes of up to 295 rad/s decay behind two periods, and of up to 205 rad/s behind three, whatever zeta
// is. Only modes above 150 / zeta rad/s are concerned: hands far apart on one set-point, which turn a wrist
// with a long lever.
//
// A spring whose torque acts late takes as much damping from a mode as that time T times its stiffness: 5.7
// ms behind motors of 50 Hz and two periods, and more if the mode is fast. Less damping than
// kLeastDampingTime K could let it oscillate without end, so every mode has that. With zeta = 1 this concerns
// none that is slower than 200 rad/s.
//
// So a mode decays behind motors of 50 Hz and two periods if
//   K <= kFastestMode^2 M,   kLeastDampingTime K <= D <= kLargestModalDamping M,
// and laws soften stiffer modes to that. M is the inertia that the model knows; rotors may add any more. What
// that is stable anyway is unchanged, bit for bit.
namespace multipanda {

inline constexpr double kLargestModalDamping = 300;  // [1/s]
inline constexpr double kLeastDampingTime = 0.010;   // [s]
inline constexpr double kFastestMode = 150;          // [rad/s]
inline constexpr double kBrake = 2;  // [1/s]: without stiffness an axis coasts to rest within v / kBrake
// Stiffness from which on an axis gets the full feed-forward and is not braked: [N/m], [N m/rad].
inline constexpr double kLedFrom = 5, kTurnedFrom = 0.25;

// Matrix is one of the sizes of CoupledModes. Does not allocate. If an argument is not finite, the result is
// not finite either.
template <typename Matrix>
Matrix coupled_damping(const Matrix& inertia, const Matrix& stiffness, double zeta) {
  const CoupledModes<Matrix> modes(inertia, stiffness);
  const Matrix Q = modes.L.lazyProduct(modes.U);
  auto d = (2.0 * zeta * modes.k.cwiseSqrt()).cwiseMax(kLeastDampingTime * modes.k).eval();
  for (double& of_mode : d) {
    if (of_mode > kLargestModalDamping && std::isfinite(of_mode)) of_mode = kLargestModalDamping;
  }
  return (Q * d.asDiagonal()).lazyProduct(Q.transpose());
}

JointMatrix coupled_damping(const JointMatrix& inertia, const JointMatrix& stiffness, double zeta);

// The same for a task, linear first: [N s/m, N m s/rad] from [kg, kg m^2] and [N/m, N m/rad].
Matrix6 task_damping(const Matrix6& Lambda, const Matrix6& stiffness, double zeta);

// Each joint alone: d_i = 2 zeta sqrt(k_i M_ii), (n x 1) [N m s/rad]. Cheaper; exact only if M is diagonal.
JointVector diagonal_damping(const JointMatrix& M, const JointVector& stiffness, double zeta);

// Limits the modes of K (n x n), a stiffness or a damping, to `most` times the inertia: every k of K = Q
// diag(k) Q^T. Returns the share of the largest that remains; 1 if none was larger: then K is unchanged, bit
// for bit.
template <typename Matrix>
double limit_modes(const Matrix& inertia, double most, Matrix& K) {
  Matrix L;
  if (cholesky_factor<Matrix>(most * inertia - K, L)) return 1;
  const CoupledModes<Matrix> modes(inertia, K);
  const double largest = modes.k.maxCoeff();
  if (largest <= most) return 1;
  const Matrix Q = modes.L.lazyProduct(modes.U);
  auto k = modes.k;
  for (double& of_mode : k) {
    if (of_mode > most && std::isfinite(of_mode)) of_mode = most;
  }
  K = (Q * k.asDiagonal()).lazyProduct(Q.transpose());
  return most / largest;
}

// Raises D (n x n) to `least` (n x n) in every mode that has less: to kLeastDampingTime K where the model
// states motors that M lacks, because D, designed from M, may then be too small for K.
template <typename Matrix>
void raise_modes(const Matrix& inertia, const Matrix& least, Matrix& D) {
  Matrix L;
  if (cholesky_factor<Matrix>(D - least, L)) return;
  const CoupledModes<Matrix> modes(inertia, least - D);  // those that have enough count as zero
  const Matrix Q = modes.L.lazyProduct(modes.U);
  D += (Q * modes.k.asDiagonal()).lazyProduct(Q.transpose());
}

// Softens the modes of a stiffness K (n x n) that are faster than kFastestMode; returns the share of its
// stiffness that the fastest one keeps; 1: none was softened.
template <typename Matrix>
double soften(const Matrix& inertia, Matrix& K) {
  return limit_modes(inertia, kFastestMode * kFastestMode, K);
}

inline constexpr const char* kStiffnessShareDoc =
    "Share of the stiffness that the fastest mode or lightest axis keeps: 1 unless it was reduced for "
    "stability.";

inline bool states_motors(const ArmModel& model) { return model.motor_inertia().size() > 0; }

// Mass matrix of links and motors (n x n), counting motors contained in M only once.
JointMatrix mass_with_motors(ModelTerms& terms);

// Share of the feed-forward of each joint (n x 1), from 0 without stiffness to 1 from kTurnedFrom or
// kLedFrom on.
JointVector led_shares(const JointVector& stiffness, const ArmModel& model);

// The velocity on which a damping acts.
enum class DampingOf : std::uint8_t {
  error,    // set-point minus arm: no lag behind a moving set-point
  velocity  // the arm alone, as in the manufacturer's examples: a set-point with velocity v leads by K^-1 D v
};
ParameterSpec damping_of_parameter();

// The largest damping with which a joint is stable in a sampled loop. A torque -D dq that is one period old
// when it acts on the inertia I is stable for D T / I < 1: v_next = v - (D T / I) v_before. Motors that lag
// and further delay need a margin; half of it is stable with torque tracking of 50 Hz and a delay of 1 ms
// (0.54, from the phase of the loop).

inline constexpr double kBearableShare = 0.5;  // of I / T

// kBearableShare I / T per joint (n x 1) [N m s/rad]. I is the least inertia that the joint has in any pose:
// links, hand, tool and, as far as the model states it, motor.
JointVector bearable_damping(const ArmModel& model);

// Lowers the upper bounds of parameter i, a damping with one number per joint, to that.
void bound_damping(const ArmModel& model, std::size_t i, ParameterSet& parameters);

}  // namespace multipanda
