#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "core/model/model_terms.hpp"
#include "core/safety/torque_limiter.hpp"
#include "core/state/arm_condition.hpp"
#include "core/types/codes.hpp"
#include "core/types/time.hpp"

namespace multipanda {

// An axis-aligned box in the world that end effector, flange and the end of the tool must not leave [m].
struct WorkspaceBox {
  Vector3 min, max;
};

// The limits of one arm; those of the manufacturer by default. A scene may tighten them. Looser limits need
// an explicit key in the scene and are logged.
struct SafetyLimits {
  ArmLimits joints;
  std::optional<WorkspaceBox> workspace;
  double max_state_age_s = 0.002;  // if a state is older, all arms of the controllet are held
  // The same for the only arm of a controllet. Its torques are computed from its own packets only, so never
  // from an old state. The default is 20 periods, after which the arm itself stops.
  double max_silence_s = 0.02;
  // Added to max_state_age_s for an arm with a clock of its own: half a period of phase, and two lost
  // packets. The cycle sets it, from the backend's capabilities.
  double own_clock_slack_s = 0;
  double low_pass_hz = 0;            // of the torque, before its last limit; 0: none. Set as above.
  double implausible_factor = 10.0;  // a torque above this multiple of the limit is implausible
  double period_s = kArmPeriod;      // control period; the rate limit covers at most this

  // After a longer time without a state, of an arm that its owner has alone, it is held: by then it may be
  // anywhere. Also after a pause of the loop itself. A slow loop may miss two periods.
  double longest_gap_s() const { return std::max({max_silence_s, max_state_age_s, 3 * period_s}); }

  static SafetyLimits of(const ArmModel& model) { return {.joints = model.limits(), .workspace = {}}; }
};

// The last check before torques are sent, for all arms. Loop thread; counters may be read from any thread.
class SafetyStage {
 public:
  explicit SafetyStage(std::vector<SafetyLimits> limits);

  const SafetyLimits& limits(std::size_t arm) const { return arms_[arm].limits; }

  // Once per cycle, before inspect(): how far the arm is beyond its position limits and its workspace.
  // `held`: its hold owns it. Where a hold stops an arm that its owner moved outside, the next owner may
  // start, but it and all later ones can only move it back, until it is inside again, so that no arm creeps
  // out by many starts. `began`: the arm takes commands again; it may have been moved meanwhile.
  void track_limits(std::size_t arm, const ArmState& state, ModelTerms& terms, bool held, bool began = false);
  // After a stop and a resume by a person the next owner may start where its hold is, but no farther out than
  // at the first of these resumes, until the arm is inside again or was guided by hand.
  void release_limits(std::size_t arm);
  // Checks whether the arm's owner may continue from this measurement. Beyond a position limit or out of the
  // workspace, outward motion is a finding from 0.01 rad/s (m/s) on; 0.02 rad (5 mm) farther out than
  // track_limits() recorded, everything but motion back is. `alone`: the owner has no other arm.
  Finding inspect(std::size_t arm, const ArmCondition& condition, const ArmState& state, ModelTerms& terms,
                  bool alone = false) const;

  // Checks whether a controllet that observes the arm, and does not own it, may continue: the arm's state is
  // finite and no older than longest_gap_s(), and the arm is controlled or guided by hand.
  Finding inspect_observed(std::size_t arm, const ArmCondition& condition, const ArmState& state) const;

  // Checks a controllet's torque. Non-finite or implausible torques deactivate the controllet. A vector whose
  // size is not the arm's joint count is implausible.
  Finding judge(std::size_t arm, const JointVector& tau) const;
  // The same for the sum of a controllet's torque and its features'.
  Finding judge(std::size_t arm, const JointVector& tau_controllet, const JointVector& tau_feature) const;

  // Once per fresh state, before limit(): the torque that the arm has in use.
  void observe(std::size_t arm, const JointVector& in_use) { arms_[arm].torque.observe(in_use); }
  // The torque to send: see TorqueLimiter. `dt`: since the last one. Counts each clamped torque; `cut` is the
  // first rule that acted.
  const JointVector& limit(std::size_t arm, const JointVector& requested, double dt, Finding& cut);

  // The last command; at the start, and when the arm accepts commands again, the torque that it applies.
  const JointVector& last_command(std::size_t arm) const { return arms_[arm].torque.sent(); }
  void set_last_command(std::size_t arm, const JointVector& tau) { arms_[arm].torque.restart(tau); }

  void count(std::size_t arm, Intervention rule) {
    auto& n = arms_[arm].counts[static_cast<std::size_t>(rule)];
    n.store(n.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  }
  std::uint64_t counted(std::size_t arm, Intervention rule) const {
    return arms_[arm].counts[static_cast<std::size_t>(rule)].load(std::memory_order_relaxed);
  }
  std::uint64_t counted(std::size_t arm) const;  // over all rules

 private:
  struct Beyond {                                           // a limit
    double known = 0;                                       // >= 0
    double most = std::numeric_limits<double>::infinity();  // of `known`, from the first release on
    bool follows = true;                                    // the next hold
    bool released = false;                                  // since the last cycle
  };
  static constexpr std::size_t kPoints = 3;  // end effector, flange, end of the tool
  struct Point {
    Vector3 p, v;  // world [m], [m/s]
  };
  static std::array<Point, kPoints> points(ModelTerms& terms);

  struct Arm {
    SafetyLimits limits;
    TorqueLimiter torque;
    std::array<Beyond, kMaxJoints> joints;             // position limits [rad]
    std::array<std::array<Beyond, 3>, kPoints> space;  // workspace, along each axis [m]
    bool held = false;                                 // in the last cycle
    std::array<std::atomic<std::uint64_t>, static_cast<std::size_t>(Intervention::count_)> counts{};
  };
  std::vector<Arm> arms_;
};

}  // namespace multipanda
