#pragma once

#include <cstdint>

#include "core/types/codes.hpp"
#include "core/types/joints.hpp"
#include "core/types/time.hpp"

namespace multipanda {

// Result of a check: nothing (`none`), or the rule, the joint, and the values.
struct Finding {
  Intervention rule = Intervention::none;
  std::uint16_t joint = 0xFFFF;  // 0xFFFF: not specific to a joint
  double value = 0, limit = 0;
  explicit operator bool() const { return rule != Intervention::none; }
};

// The last stage of an arm's torque: its limits, and the limit of its rate.
//
// The arm counts the rate from the torque that it has in use. That is the torque sent last, unless the
// command was lost or came too late: then the arm continues with an older one, and a command that is one step
// away from the lost one may be several from that. A fresh state does not show whether the last command is
// only late. So the next torque is at most one step from both, or, if they are more than two steps apart,
// from the one in use, by which the arm judges. It is one period's step, however many were missed.
//
// No allocation, no exception.
class TorqueLimiter {
 public:
  struct Limits {
    JointVector tau_max;       // (n x 1) [N m]
    JointVector tau_rate_max;  // (n x 1) [N m/s]
    double period_s = kArmPeriod;
    double low_pass_hz = 0;  // first order, before the limit of the rate; 0: none
  };
  // What limit() cut: the first joint of each rule.
  struct Cuts {
    Finding torque, rate;
  };

  TorqueLimiter() = default;
  explicit TorqueLimiter(Limits limits);

  // The arm takes commands again: counts from this torque alone. Values that are not finite count as zero, as
  // do missing ones; values beyond the limit count as the limit.
  void restart(const JointVector& in_use);
  // A torque motion begins, and its state shows this torque in use. Counts from that, as Franka's own client
  // does, and also from zero, the documented start, if one command can be within a step of both.
  void begin(const JointVector& shown);
  // A fresh state shows which torque is in use. Differences within single precision do not count. Values that
  // are not finite or beyond the limit, and missing ones, are ignored.
  void observe(const JointVector& in_use);
  // The torque to send. `dt`: since the last one. Values that are not finite become zero.
  const JointVector& limit(const JointVector& requested, double dt, Cuts& cuts);

  const JointVector& sent() const { return sent_; }      // last
  const JointVector& in_use() const { return in_use_; }  // as observed, after restart() or limit(): as sent

 private:
  Limits limits_;
  double gain_ = 1;  // of the low-pass, per period
  JointVector sent_, in_use_;
};

}  // namespace multipanda
