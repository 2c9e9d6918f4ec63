#pragma once

#include <limits>

#include "core/controllets/force_law.hpp"

// Force or moment along one axis of a frame, for laws that control a subset of six axes. Numbers are in N, m,
// m/s, kg for forces and in N m, rad, rad/s, kg m^2 for moments. Loop thread, no allocation.
//
//   f = sigma (w gamma f_c + (1 - w) f_0)
//   f_c = F_d + w gamma (P e_f + I int w gamma e_f dt),  e = F_d - F_hat    in contact
//   f_0 = K int (v_a - v) dt, between 0 and F_d                            without contact
// sigma fades in while the axis is selected, w while it is in contact, and gamma fades beyond the last
// contact. f_0 is the spring of a set-point that advances at v_a towards F_d: a free axis moves at v_a, and
// an obstacle that the estimate does not show is pushed with F_d at most.
// An axis with little inertia is fast before a bound on its speed can act, some periods late. There f keeps
// to `unfelt`, plus the reaction F_hat along f where the axis has been slow: a wrong estimate holds no axis.
// Without contact the integral is no larger than what is still felt, so that it drives no free axis.
namespace multipanda {

// Differences between forces and moments.
struct AxisKind {
  double least;        // below it, F_d has no direction [N, N m]
  double loss;         // distance beyond the last contact at which contact counts as lost [m, rad]
  double pulls_up_to;  // below it f may act against F_d, fading: a tool cannot pull on a surface [N, N m]
  double most;  // f is at most this against F_d, and this + 2 |F_d| along F_d, whatever the bound [N, N m]
};
inline constexpr AxisKind kForceAxis{
    .least = ForceDirection::kLeastForce, .loss = 0.005, .pulls_up_to = 2, .most = 60};
inline constexpr AxisKind kMomentAxis{.least = 0.05, .loss = 0.03, .pulls_up_to = 0.2, .most = 15};

struct AxisSettings {
  AxisKind kind = kForceAxis;
  ForceGains gains;           // always with feed-forward; `may_pull` follows from F_d
  double threshold = 0;       // contact [N, N m]
  double approach_speed = 0;  // v_a [m/s, rad/s]
  double reach = 0;           // width of gamma [m, rad]
  double doubt = 0;           // what the estimate may be wrong by [N, N m]
};

// One axis at one instant.
struct AxisState {
  double desired = 0, estimated = 0;  // F_d, F_hat [N, N m]
  double speed = 0;                   // of the arm along the axis [m/s, rad/s]
  double stiffness = 0;               // K_c along it [N/m, N m/rad]
  double room = 0;                    // bound on f and `pull` together [N, N m]
  double pull = 0;                    // along it, of the impedance, which fades out
  // Largest f without a measured reaction, and the speed up to which a reaction counts.
  double unfelt = std::numeric_limits<double>::infinity();  // [N, N m]
  double slow = std::numeric_limits<double>::infinity();    // [m/s, rad/s]
};

// Switches for the six axes, forces first, and the choice of the frame that they belong to.
SpecsAt<ParameterSpec, 0, 7> axis_selection_parameters();

class AxisForce {
 public:
  void start();
  // Advances sigma; before update(), so that the impedance has left the axis by the same share.
  void select(bool selected, double dt);
  double weight() const { return selection_.value(); }  // sigma
  bool selected() const { return selected_; }
  // Whether the impedance has completely left the axis.
  bool full() const { return weight() >= 1; }
  // Whether the axis is not selected and its force has faded out.
  bool idle() const { return weight() <= 0; }

  // f, after select() of the same tick.
  double update(const AxisSettings& settings, const AxisState& now, double dt);
  bool in_contact() const { return contact_; }
  bool pressing() const { return pressing_; }

 private:
  void update_contact(const AxisSettings& settings, const AxisState& now, int sign, double dt);
  void rest();  // deselects: the next selection starts again, except for the contact state

  static constexpr double kBearing = 0.5, kGivingWay = 0.02;  // borne_ from one end to the other [s]

  Fade selection_, pressing_fade_;
  ContactDetector plus_, minus_;  // of a force along and against the axis
  ForceLoop loop_;
  double free_ = 0;  // f_0
  double gamma_ = 1;
  double beyond_ = 0;  // distance along F_d since the last contact
  double pushed_ = 0;  // f of the last tick, without sigma
  double borne_ = 0;   // share of the reaction that counts: of an axis that withstands half of `unfelt`
  int sign_ = 0;       // of F_d when it last had a direction
  bool selected_ = false, contact_ = false, pressing_ = false;
};

// The share of each axis of a frame in the inertia that it moves while the others are free to move [kg, kg
// m^2]: axes with a weight that move the same joint share it. The largest eigenvalue of B_ij = sqrt(s_i s_j)
// A_ij / sqrt(A_ii A_jj) is their combined effect on one mode: 1 for axes that are not coupled. `mobility` A:
// in the axes of the frame.
Vector6 borne_inertias(const Matrix6& mobility, const Vector6& weight);

// The share of a force that is left at the speed `along` it: 1 up to half the limit, 0 from one and a half
// times the limit on. It falls by no more than `steepest` per speed, because it acts like damping and some
// periods late.
double share_at_axis_speed(double force, double along, double limit, double steepest);

}  // namespace multipanda
