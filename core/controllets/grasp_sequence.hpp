#pragma once

#include "core/controllets/force_law.hpp"

namespace multipanda {

struct GraspSettings {
  double contact_threshold_n = 2;    // estimated push of a hand that counts as contact [N]
  double closing_speed = 0.02;       // of the distance between the hands [m/s]
  double closing_stiffness = 0;      // of the spring that closes the hands [N/m]
  double ramp_s = 1;                 // from the first touch of both to the whole squeeze [s]
  double release_distance_m = 0.02;  // that the hands open after a grasp [m]
};

// What two hands do along the line between them, from rest to a squeeze and back. Loop thread.
//   rest      a spring keeps the distance
//   approach  the spring's set-point closes until both hands press
//   grasp     the spring fades out, the force fades in, F_d goes from the force at the touch to the wanted
//   one lost      a hand presses no more: the spring takes the distance where it is; until the wanted force
//   is 0
class GraspSequence {
 public:
  enum class Phase { rest, approach, grasp, lost };
  static constexpr double kLeastSqueeze = 1.0;  // wanted force that starts a grasp; half of it ends it [N]
  static constexpr double kStrongestClosing = 10.0;  // of the spring while it closes: its lead is cut [N]
  static constexpr double kLossTime = 0.03;          // without contact before it counts as lost [s]

  void start(double distance_m);

  struct Measured {
    double wanted_n = 0;               // squeeze asked for [N]
    double first_n = 0, second_n = 0;  // estimated push of each hand, inwards positive [N]
    double distance_m = 0;             // between the hands, along the line of squeezing
  };
  void update(const Measured& measured, const GraspSettings& settings, double dt);

  Phase phase() const { return phase_; }
  bool both_touch() const { return first_.in_contact() && second_.in_contact(); }
  bool touched_now() const { return touched_now_; }             // the grasp begins in this very cycle
  double distance_d() const { return distance_d_; }             // set-point of the spring [m]
  double distance_rate_d() const { return rate_; }              // its rate [m/s]
  double spring_share() const { return 1.0 - force_.value(); }  // of the spring along the line
  double force_share() const { return force_.value(); }         // of the force law
  double ramp() const;                           // 0 at the touch, 1 where the squeeze is whole
  double desired_n() const { return desired_; }  // F_d [N]

 private:
  void move_set_point(double aim_speed, double distance, const GraspSettings& settings, double dt);

  Phase phase_ = Phase::rest;
  ContactDetector first_, second_;
  Fade force_;
  double distance_d_ = 0, rate_ = 0, to_open_ = 0;
  double ramp_u_ = 0, at_touch_ = 0, desired_ = 0, apart_s_ = 0;
  bool touched_now_ = false;
};

}  // namespace multipanda
