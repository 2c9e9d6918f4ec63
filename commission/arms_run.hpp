#pragma once

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "runtime/session.hpp"

namespace multipanda::commission {

// An arm left the control of the tour: a reflex, its button, a lost connection, a limit. By then it is in
// hold, or holds itself.
struct ArmLeft : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Law of an arm during a step.
enum class Law { hold, guide, joint, cartesian };

// Measurements of all arms over a time of the loop.
struct Track {
  std::vector<double> t;                     // since its begin [s]
  std::vector<std::vector<ArmSample>> arms;  // per arm, one element per time

  bool empty() const { return t.empty(); }
  JointVector mean(ArmIndex arm, JointArray ArmSample::*quantity, std::size_t joints) const;
};

// The scene with the tour's controllets and careful bounds: collision thresholds at most
// careful_thresholds(), hand speeds as the tour's motions need, spring forces at most the usual ones,
// no timeline.
Scene commission_scene(Scene scene);

// The run of a tour: all arms in hold from its start to its end. Every motion is a goal of a controllet that
// owns one arm; the others stay in hold. Off the loop, one thread.
class ArmsRun {
 public:
  // `scene`: of commission_scene(). Nothing is connected yet.
  // `stopped`: polled during every wait; true ends it with ArmLeft (Ctrl-C).
  ArmsRun(Scene scene, const Registry& registry, const BackendOptions& backend, bool paced,
          std::function<bool()> stopped = {});
  ~ArmsRun();  // end()
  ArmsRun(const ArmsRun&) = delete;

  void start();  // until all arms are in hold; throws std::runtime_error with the reason
  void end();    // arms hold, then hold themselves
  void halt();   // all arms go to hold, whatever their law; does not wait
  // Throws ArmLeft if an arm is not under the law that the tour gave it, falls during hand guiding, or the
  // run has ended.
  void check();

  const Scene& scene() const { return session_->scene(); }
  std::size_t arm_count() const { return scene().arms.size(); }
  std::size_t joint_count(ArmIndex arm) const { return session_->layout().arms[arm].joint_count; }
  ModelTerms terms(ArmIndex arm) const;  // the controllers' model with frames, tool and load of the scene
  ArmSample newest(ArmIndex arm) const;
  JointVector q(ArmIndex arm, const ArmSample& sample) const;         // (n x 1) [rad]
  double fastest_joint(ArmIndex arm, const ArmSample& sample) const;  // [rad/s]

  // Records every `every`th cycle for `seconds` of the loop's time, or until `enough`. Throws ArmLeft.
  Track watch(double seconds, unsigned every = 1, const std::function<bool(const Track&)>& enough = {});
  // An arm whose stop is part of the step (its button), until it is back in hold; none: no arm.
  void excuse(std::optional<ArmIndex> arm);

  void lead(ArmIndex arm, Law law);  // throws ArmLeft with the verdict of a refused switch
  void stop(ArmIndex arm);           // the stop of every run: hold until resume()
  // Ends stop(), and no other stop: throws ArmLeft if the arm was stopped again since.
  void resume(ArmIndex arm);
  void joint_goal(ArmIndex arm, const JointVector& q, double seconds);
  void pose_goal(ArmIndex arm, const Pose& X_WE, double seconds);
  void wiggle(ArmIndex arm, std::size_t joint, double amplitude, double period_s, double cycles);
  RequestAnswer request(ArmIndex arm, ArmRequest request);
  std::optional<ConnectionStatistics> connection(ArmIndex arm) { return session_->backend().connection(arm); }

 private:
  void take(const CycleRecord& record);
  void ask(const Request& request, ArmIndex arm, const char* what, HostTime asked = host_now());
  Request goal(ArmIndex arm, Law law) const;
  InstanceIndex instance(ArmIndex arm, Law law) const;
  std::string why_left(ArmIndex arm) const;  // empty: as expected. With mutex_
  std::string why_left() const;              // of the first arm that left
  bool unexplained() const;                  // every arm that left has stopped without a known reason so far

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<ArmSample> newest_;
  std::vector<InstanceIndex> expected_;
  std::optional<ArmIndex> excused_;
  std::uint64_t cycle_ = 0, expected_from_ = 0;  // the newest record's; since when expected_ holds
  std::uint64_t answered_ = 0;                   // the cycle of the last answer
  std::optional<ArmIndex> stopping_;             // requested to hold, and not yet observed in hold
  HostTime stopped_by_;                          // end of the cycle that did so
  double t_ = 0;
  bool recording_ = false;
  HostTime stop_asked_, watched_from_;  // of a stop that no watch() has seen; older records are no watch's
  double begin_ = 0;
  unsigned every_ = 1, skip_ = 0;
  Track track_;
  std::unique_ptr<Session> session_;
  bool started_ = false, ended_ = false;
  std::function<bool()> stopped_;
};

}  // namespace multipanda::commission
