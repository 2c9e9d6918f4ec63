#pragma once

#include <algorithm>
#include <array>

#include "core/controllets/contact_bounds.hpp"
#include "core/controllets/energy_tank.hpp"
#include "core/controllets/force_law.hpp"

// The force part of `ufic` along a subset of six axes of a frame, each with its own loop:
//   F_i = sigma_i rho_i s_i f_i,   f_i = max(0, d_i + w_i (P e + D de/dt + I int w_i e dt))
//   d_i = max(0, s_i F_d,i),   e = d_i - s_i F_hat,i,   w_i = c_i gamma_i alpha_f;   moments without D
// s_i = +-1: the side that F_d presses towards; a desired force of the other sign is one of 0 until contact
// is lost. sigma fades in while the axis is selected, c while it is in contact. gamma falls with the way from
// the place of the last contact, that of a moment with the angle, too. rho is the valve of the force tank,
// with this gamma. Where an axis has little inertia, f keeps to `unfelt`, which its speed can end in time,
// plus the reaction where the axis withstands what acts (axis_force.hpp). Forces in N along, moments in N m
// about the axes of R, at E, that the arm exerts. Loop thread, no allocation.
namespace multipanda {

// --- descriptor ---
enum UficAxesParameter : std::size_t {
  kFirstForceAxis,
  kForceFrame = kFirstForceAxis + 6,
  kMomentIntegral,
  kMomentLimit,
  kMomentThreshold,
  kMomentReach,
  kUficAxesParameterCount
};
SpecsAt<ParameterSpec, 0, kUficAxesParameterCount> ufic_axes_parameters();

class UficAxes {
 public:
  // About an axis, or of several together; they fall with the speed along them from half of it on [rad/s].
  static constexpr double kTurnLimit = 0.5;
  // Largest slope of a force over the speed of its axis, and largest damping of D_z and of the valve, divided
  // by the axis's inertia [1/s]: they act some periods late. A moment ends at kTopTurning [rad/s].
  static constexpr double kSteepest = 200, kDamping = 60, kTopTurning = 1.5;

  void start();
  // Advances the selection; before the others. Another frame is taken when no axis has a force any more.
  void select(const ParameterSet& parameters, std::size_t first, const Matrix3& R_WE, double dt);
  void end_effector_moved(const Pose& X);
  // Inertia along the axes, from the mobility at E in world axes; before the others.
  void bear(const Matrix6& mobility);

  bool any() const { return (sigma_.array() > 0).any(); }
  // 0: the law along one direction, 1: these axes, between while one fades into the other.
  double weight() const { return all_.value(); }
  // D_z v along the axes, for D_z = `damping`, limited by their inertia. World axes.
  Vector3 damped(const Vector3& v, double damping) const;

  struct Instant {
    Vector6 F_d, F_hat;  // at E
    Vector6 V, pull;     // of E; of the impedance
    const Matrix6& D;    // damping of the impedance
    const Pose& X_WE;
    double alpha_f;  // valve of the force tank
    const ContactBounds& bounds;
    // What motion adds to the threshold of moments, and what they may be wrong by [N m].
    double turning = 0, turning_doubt = 0;
  };
  // F, all in world axes.
  Vector6 update(const ForceSettings& settings, ValveLaw law, double reach, const ParameterSet& parameters,
                 std::size_t first, const Instant& now, double dt);
  // F of the last update, axes of the frame.
  const Vector6& force() const { return F_; }
  bool in_contact(std::size_t i) const { return axis_[i].detector.in_contact(); }
  bool touches() const {  // or was in contact near this place
    return std::any_of(axis_.begin(), axis_.end(), [](const Axis& axis) { return axis.gamma > 0.5; });
  }

 private:
  struct Axis {
    void start();
    Fade selection, contact;
    ContactDetector detector;
    ForceLoop loop;
    ForceRoom room;
    Pose touched_at;
    bool touched = false;
    double gamma = 0, sign = 1;
    double pushed = 0;  // acting force along `sign` in the last tick
    double borne = 0;   // share of the reaction that counts
  };
  struct Limits {
    double room, unfelt;  // besides the others and the pull; without a reaction [N, N m]
    double slow;          // up to it a reaction counts [m/s, rad/s]
  };
  double update(std::size_t i, const ForceGains& gains, double threshold, double doubt, double shape,
                const Limits& limits, ValveLaw law, const Instant& now, double dt);
  static constexpr double kBearing = 0.5, kGivingWay = 0.02;  // time of Axis::borne from 0 to 1, and back [s]
  Vector6 in_frame(const Vector6& x) const;
  Vector6 in_world(const Vector6& y) const;

  std::array<Axis, 6> axis_;
  Fade all_;
  Vector6 sigma_ = Vector6::Zero(), F_ = Vector6::Zero();
  Vector6 inertia_ = Vector6::Ones();
  std::size_t frame_ = 0;
  Matrix3 R_ = Matrix3::Identity(), R_EF_ = Matrix3::Identity();  // axes in the world; and in E
};

}  // namespace multipanda
