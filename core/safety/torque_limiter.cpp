#include "core/safety/torque_limiter.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace multipanda {
namespace {

// Two units in the last place of single precision, in which arms report: 2e-5 N m at 87 N m.
bool explained_by_rounding(double shown, double sent) {
  constexpr double kRelative = 2.4e-7, kSmallest = 1e-7;  // [-], [N m]
  return std::abs(shown - sent) <= kRelative * std::abs(sent) + kSmallest;
}

Finding finding_at(Intervention rule, Eigen::Index joint, double value, double limit) {
  return {rule, static_cast<std::uint16_t>(joint), value, limit};
}

}  // namespace

TorqueLimiter::TorqueLimiter(Limits limits) : limits_(std::move(limits)) {
  sent_ = in_use_ = JointVector::Zero(limits_.tau_max.size());
  if (limits_.low_pass_hz > 0) {
    const double T = limits_.period_s;
    gain_ = T / (T + 1 / (2 * std::numbers::pi * limits_.low_pass_hz));
  }
}

void TorqueLimiter::restart(const JointVector& in_use) {
  for (Eigen::Index i = 0; i < sent_.size(); ++i) {
    const double bound = limits_.tau_max[i];
    const bool known = i < in_use.size() && std::isfinite(in_use[i]);
    sent_[i] = in_use_[i] = known ? std::clamp(in_use[i], -bound, bound) : 0.0;
  }
}

void TorqueLimiter::begin(const JointVector& shown) {
  restart({});
  observe(shown);
}

void TorqueLimiter::observe(const JointVector& in_use) {
  for (Eigen::Index i = 0; i < sent_.size(); ++i) {
    // The torque sent is within the limit. A number beyond it is not in use: a step from there would exceed
    // it, too.
    const bool known = i < in_use.size() && std::abs(in_use[i]) <= limits_.tau_max[i];
    in_use_[i] = known && !explained_by_rounding(in_use[i], sent_[i]) ? in_use[i] : sent_[i];
  }
}

const JointVector& TorqueLimiter::limit(const JointVector& requested, double dt, Cuts& cuts) {
  cuts = {};
  const double step_time = std::clamp(dt, 0.0, limits_.period_s);
  for (Eigen::Index i = 0; i < sent_.size(); ++i) {
    const double sent = sent_[i], in_use = in_use_[i];
    const double bound = limits_.tau_max[i], rate = limits_.tau_rate_max[i];
    const double w = i < requested.size() && std::isfinite(requested[i]) ? requested[i] : 0.0;
    const double within = std::clamp(w, -bound, bound);
    const double goal = gain_ < 1 ? in_use + gain_ * (within - in_use) : within;
    // If the two differ, a whole period's step applies: the arm compares its periods, not our steps.
    const double step = rate * (sent == in_use ? step_time : limits_.period_s);
    double low = std::max(sent, in_use) - step, high = std::min(sent, in_use) + step;
    if (low > high) {
      low = in_use - step;
      high = in_use + step;
    }
    const double next = std::clamp(goal, low, high);
    if (within != w && !cuts.torque) cuts.torque = finding_at(Intervention::torque_clamped, i, w, bound);
    if (next != goal && !cuts.rate) {
      const double asked = step_time > 0 ? (goal - in_use) / step_time : 0;
      cuts.rate = finding_at(Intervention::torque_rate_clamped, i, asked, rate);
    }
    sent_[i] = in_use_[i] = next;
  }
  return sent_;
}

}  // namespace multipanda
