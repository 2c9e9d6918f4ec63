#pragma once

#include <cstdint>

// Energy tanks limit the net energy that a control law supplies to the arm and its environment.
namespace multipanda {

enum class ValveLaw : std::uint8_t {
  passive,  // F_f' = gamma alpha_f F_f where it supplies power, F_f where it absorbs power
  paper     // F_f' = (gamma + alpha_f (1 - gamma)) F_f, as the paper prints it: not passive
};

struct TankLimits {
  double min_j = 0, max_j = 100;
  double closing_j = 0.1;  // the valve closes over this range above min_j
};

// A store of energy with a valve. Positive work empties it, negative work fills it; energy above max_j is
// lost. The balance is exact and never clamped at min_j, since clamping would create energy: an overdraft
// shows as an energy below min_j, with the valve closed. Loop thread.
class EnergyTank {
 public:
  void start(double energy_j, const TankLimits& limits);  // clamped to the limits
  void give(double work_j);                               // > 0: out of the tank; < 0: into it
  double energy() const { return energy_; }               // [J]
  // 0 at min_j and below, 1 at min_j + closing_j and above, smooth between.
  double valve(const TankLimits& limits) const;
  // Factor in [0, 1] that keeps a work within `share` of the energy above min_j.
  double affordable(double work_j, double share, const TankLimits& limits) const;
  // For the paper's tank: refills it to min_j with energy that no source supplied. Returns the energy created
  // [J].
  double make_up(const TankLimits& limits);
  double lost() const { return lost_; }  // overflow so far [J]

 private:
  double energy_ = 0, max_ = 0, lost_ = 0;
};

// gamma = exp(-|x - x_c|^2 / d_max^2); distance and d_max in [m].
double contact_shape(double distance_m, double d_max_m);

// The factor applied to F_f. `speed_along` is the velocity along F_f [m/s]: positive where F_f supplies
// power. The passive law goes from gamma alpha_f to 1 over `incoming_speed` of incoming motion, so that the
// force has no step where the motion reverses; a force that opposes the motion dissipates energy.
inline constexpr double kIncomingSpeed = 0.02;  // [m/s]
double force_share(ValveLaw law, double gamma, double alpha_f, double speed_along,
                   double incoming_speed = kIncomingSpeed);

// The incoming speed over which that share is a damper of at most `damping` [N s/m] for a force [N]: in free
// air 30 N over kIncomingSpeed would be one of 2250 N s/m on one side only, which chatters. At least
// kIncomingSpeed; infinite without damping.
double incoming_speed_for(double force_n, double gamma, double alpha_f, double damping);

}  // namespace multipanda
