#pragma once

#include "core/controllets/force_law.hpp"

namespace multipanda {

struct GraspSettings {
  double contact_threshold_n = 6;    // estimated force of a hand that counts as contact [N]
  double closing_speed = 0.02;       // rate of the distance between the hands [m/s]
  double closing_stiffness = 0;      // stiffness of the spring that closes the hands [N/m]
  double ramp_s = 1;                 // from the first contact of both hands to the full squeeze [s]
  double release_distance_m = 0.02;  // distance by which the hands open after a grasp [m]
};

// State machine of two hands along the line between them, from rest to a squeeze and back. Loop thread.
//   rest      a spring keeps the distance
//   approach  the spring's set-point closes until both hands press
//   grasp     the spring fades out and the force in; F_d goes from the force at contact to the requested one
//   lost      contact was lost: the spring keeps the current distance until the requested force is 0
class GraspSequence {
 public:
  enum class Phase { rest, approach, grasp, lost };
  static constexpr double kLeastSqueeze = 1.0;  // requested force that starts a grasp; half of it ends it [N]
  static constexpr double kStrongestClosing = 10.0;  // limit of the spring force while the hands close [N]
  static constexpr double kLossTime = 0.03;          // time without contact after which it counts as lost [s]

  void start(double distance_m);

  struct Measured {
    double requested_n = 0;                        // requested squeeze [N]
    double first_n = 0, second_n = 0;              // estimated force of each hand, inwards positive [N]
    double distance_m = 0;                         // between the hands, along the line of squeezing
    double first_doubt_n = 0, second_doubt_n = 0;  // what the estimates may be wrong by [N]
  };
  void update(const Measured& measured, const GraspSettings& settings, double dt);

  Phase phase() const { return phase_; }
  bool both_touch() const { return first_.in_contact() && second_.in_contact(); }
  bool touched_now() const { return touched_now_; }             // the grasp begins in this cycle
  double distance_d() const { return distance_d_; }             // set-point of the spring [m]
  double distance_rate_d() const { return rate_; }              // its rate [m/s]
  double spring_share() const { return 1.0 - force_.value(); }  // factor on the spring along the line
  double force_share() const { return force_.value(); }         // factor on the force law
  double ramp() const;                                          // 0 at contact, 1 at the full squeeze
  double desired_n() const { return desired_; }                 // F_d [N]

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
