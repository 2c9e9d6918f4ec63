#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <limits>
#include <memory>
#include <mutex>
#include <span>
#include <string>

#include "core/reference/harmonic.hpp"
#include "core/reference/target.hpp"
#include "core/rt/triple_buffer.hpp"
#include "core/trajectory/quintic.hpp"
#include "core/types/codes.hpp"
#include "core/types/joint_range.hpp"
#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// Position and motion of a slow stream of poses or joints, estimated from its samples. Samples that arrive
// unevenly look like a series that shakes, so the estimate has a memory: a fading-memory filter of second
// degree (Morrison, "Introduction to Sequential Smoothing and Prediction", 1969). It forgets all but the last
// three samples while such three predict the next one, and remembers longer the worse they do. A sample
// counts at the time of its arrival. Lost samples need no special care: they are gaps in time.
class Series {
 public:
  using Values = QuinticSegment::Values;

  // A new series begins at a sample, at rest. `greatest_*`: speeds by which errors of prediction are judged,
  // [m/s] and [rad/s]; for joints the first [rad/s].
  void begin(const Target& sample, bool pose, double greatest_speed, double greatest_angular_speed);
  // The next sample, dt > 0 later; `period_s` of the stream. Samples with times of their own are not uneven.
  void add(const Target& sample, double dt, double period_s, bool timed = false);
  // The estimate `ahead` seconds after the newest sample. A pose's rotation is given about R_0.
  QuinticSegment::Sample at(double ahead, const Matrix3& R_0) const;
  // How unevenly the samples arrive, as a time [s].
  double unevenness() const { return unevenness_; }

 private:
  struct Filter {
    QuinticSegment::Sample now;  // at the newest sample; a pose's rotation is about R
    Matrix3 R = Matrix3::Identity();
  };

  double share(const Values& v) const;  // of the greatest speeds
  Values error(const Filter& filter, const Target& sample) const;
  void move(Filter& filter, const Values& by) const;
  Values predict(Filter& filter, double dt) const;  // returns the distance
  void correct(Filter& filter, const Values& error, double past, double dt) const;

  bool pose_ = false;
  std::size_t size_ = 0;  // coordinates
  double greatest_ = 1, greatest_angular_ = 1;
  Filter smooth_, last_three_;    // with and without memory
  Values mean_{};                 // velocity between the last two samples
  double error_ = 0, speed_ = 0;  // filtered shares
  double unevenness_ = 0;
};

// Declares one input of a controllet.
struct InputSpec {
  std::string name;  // "pose"; unique in the controllet
  Quantity quantity = Quantity::pose;
  std::size_t arm = 0;  // index of the arm, among the controllet's arms, that gives joint count and start
  std::string frame = "world";  // frame of the values, which adapters check and transform
  std::string doc;
  double timeout_s = 0.1;  // a stream without samples for longer is lost
  double max_speed = 0.5;  // speed limit of the set-point: [m/s], [rad/s] for joints, [unit/s] for others
  double max_angular_speed = 1.0;  // speed limit of a pose's rotation [rad/s]
  bool common = false;             // a pose with which the hands of all arms turn, each about itself
};

// "input 'pose' carries a pose: expected position_m [m] with ...", where other keys were found.
std::string carries_text(const InputSpec& input);

// Takes targets from any thread and gives the loop a reference that is continuous in position, velocity and
// acceleration, whatever arrives. Every set-point passes through it. A distant target is approached within
// the speed limit of the input, a close one in at least 0.1 s. Goals also keep to 4 m/s^2, 8 rad/s^2 or, for
// joints, 5 rad/s^2 (or the acceleration at their arrival, if higher), so that a goal nearby or one that
// reverses the last one causes no torque spike. A goal that arrives during a strong acceleration may briefly
// exceed the speed limit by up to a third, because continuity has priority. Goals end at rest. A motion
// begins at the current set-point and ends at rest; a motion above the speed limit is refused. A stream is
// followed with a delay of one of its periods: each sample is approached with the velocity (and, below 200
// Hz, the acceleration) estimated from the series, so that a smooth series gives a smooth motion. Late
// samples and two lost ones in a row (at 10 Hz: one) are bridged. If the stream stops, the reference brakes
// to rest and becomes stale. Samples of a chunk are taken one period early, so that the set-point is there in
// time, without lag.
//
// A reference whose hand cannot follow waits: see resist(). A joint reference is slowed down where the hand,
// or what a prismatic joint moves, would be faster than its bound: see bound_hand_speed(). Both scale the
// time of the segment by a pace p from 0 to 1, x_d(t) = x(s) with ds/dt = p, so that dx_d = p x', ddx_d = p^2
// x'' + dp/dt x' (time scaling: Dahl and Nielsen, "Torque-limited path following by online trajectory time
// scaling", 1990).
//
// Poses: the position is a quintic per axis; the rotation is R(t) = exp(r(t)) R_0 with a quintic r(t) from 0
// to log(R_goal R_0^T), so it takes the shortest rotation and its velocity is continuous at the start.
class Reference {
 public:
  // Targets for joints outside of `range` are refused; without sizes: none is.
  Reference(InputSpec spec, std::size_t joint_count, JointRange range = {});

  const InputSpec& spec() const { return spec_; }
  std::size_t size() const { return size_; }

  // --- any thread except the loop's; callers wait for each other, never for the loop ---
  // accepted, wrong_size, not_finite or out_of_bounds (a number above kGreatest, a joint outside of its
  // range, a quaternion far from unit length, a duration or period above a day; a motion that is too fast,
  // has above a million cycles, or whose ramp is longer than the motion).
  Verdict check(const Target& target) const { return inspect(target, nullptr); }
  // The finding of check() as text; empty: none, or one that only motions can have.
  std::string refusal(const Target& target) const;
  // Far beyond any arm's positions, speeds and forces [m, m/s, rad/s, N, N m].
  static constexpr double kGreatest = 1000;
  Verdict post(Target target);
  // Times must increase, with gaps of at most the input's timeout. A chunk replaces all samples that are not
  // due yet. It is discarded by any newer target, by start() and by carry(). `id`: of the chunk, if accepted.
  Verdict check(const Chunk& chunk) const;
  Verdict post(Chunk chunk, std::uint64_t& id);
  // Remaining samples of this chunk, unless a newer one has replaced it.
  void discard(std::uint64_t chunk);
  // Number of samples of chunks that were overdue when the loop received them: not used.
  std::uint64_t late() const { return inbox_->late.load(std::memory_order_relaxed); }

  // --- loop thread ---
  void start(const Pose& X_measured);  // starts here, at rest; discards older targets
  void start(const JointVector& measured);
  void start_constant(double value);  // twist, wrench, scalar: usually 0
  // A checked target from within the loop. It is planned at the next advance(): of several in one step, only
  // the newest, so that many senders cannot make a cycle longer.
  void set(const Target& target);
  // The frame that follows this pose was redefined: it is now X away from the old one, X_new = X_old X. Moves
  // the set-point, its goal and its velocity along, so that the arm does not move.
  void carry(const Pose& X);
  // For references owned by a law.
  void limit_speed(double max_speed) { spec_.max_speed = max_speed; }
  // Takes newly arrived targets and advances by dt. `now_s` is the time of the loop.
  void advance(double dt, double now_s);
  // Before advance(): the greatest speed of the hand and of every carriage (carriage_speed()), and the hand's
  // Jacobian (6 x n, joints) where the arm is now.
  void bound_hand_speed(double greatest, const Jacobian& J);
  // Likewise for a second hand that these joints move: that of an arm which stands on this one.
  void bound_carried_speed(const Jacobian& J);
  // The same for a pose that carries hands `lever` away from it [m]: |v| + |omega| lever.
  void bound_hand_speed(double greatest, double lever);
  // The same for points that move with a hand, `from_hand` [m] from its origin: of joints in world axes,
  // within its bound; of a pose in its own axes, within `greatest` or the speed of its position. `farthest`:
  // of all hands, at least that of these.
  using Points = std::array<Vector3, 4>;
  void bound_points(double greatest, std::span<const Vector3> from_hand, double farthest);
  // After advance(), once per hand: the pull to this set-point (a wrench in world axes, or joint torques), as
  // shares of the bound. From kWaitsFrom on the set-point slows down, at 1 it waits, where it would move
  // along the pull and so load it more. It goes on when the hand follows. Targets that arrive meanwhile are
  // approached then.
  void resist(const Vector6& pull, double force_share, double moment_share);
  void resist(const JointVector& pull, double share);
  // After advance(): in the next tick at most this share of its pace. A stream's samples keep theirs.
  void slow(double share) { slowed_ = std::min(slowed_, share); }
  double pace() const { return pace_; }
  bool stale() const { return stale_; }  // a stream stopped
  bool streaming() const { return streaming_; }
  std::uint64_t planned() const { return planned_; }  // targets for which a motion was planned

  const Pose& pose() const { return X_d_; }
  const Twist& twist() const { return V_d_; }  // pose: its velocity, world axes
  const Twist& acceleration() const { return A_d_; }
  const JointVector& joints() const { return q_d_; }  // joints: position, velocity, acceleration
  const JointVector& joint_velocity() const { return dq_d_; }
  const JointVector& joint_acceleration() const { return ddq_d_; }
  Vector6 vector() const;  // twist, wrench
  double scalar() const { return now_.position[0]; }
  double scalar_rate() const { return now_.velocity[0]; }

  // For the log: values in the order of Target, and their rates (pose: 3 linear + 3 angular).
  void record(double* values, double* rates) const;

 private:
  // Duration of braking after a stream stops, and minimum duration of a goal.
  static constexpr double kBrakingTime = 0.1;  // [s]

  // Id of the newest sample of a stream while its frame was redefined: no sample continues it.
  static constexpr std::uint64_t kOfAnotherFrame = std::numeric_limits<std::uint64_t>::max();

  static constexpr double kWaitsFrom = 0.8;  // share of the allowed pull

  struct Resistance {  // of one hand
    QuinticSegment::Values pull{};
    double force_share = 0, moment_share = 0;
  };

  void take(const Target& target, double now_s);
  void take_chunk(double now_s);
  void take_due(double now_s);
  void forget_chunk() { next_ = queued_ = 0; }
  bool must_wait(const Target& target, double from_share) const;
  bool waits_for(const Target& target);
  void add_resistance(const Resistance& hand);
  double largest_share() const;
  double share_along(const QuinticSegment::Values& velocity) const;
  double hand_speed(const QuinticSegment::Values& velocity) const;
  double hand_bound() const;
  double points_share(const QuinticSegment::Sample& sample) const;
  double desired_pace() const;
  void update_pace(double dt);
  void apply_pace();
  void plan_pending();
  void plan_goal(const Target& target);
  void plan_stream(const Target& target, std::uint64_t steps, double elapsed_s);
  void plan_slow_stream(const Target& target);
  double speed_excess(const QuinticSegment::Sample& sample) const;
  void plan_to_rest_or_brake(const Target& target);
  bool too_fast() const;
  void plan_brake();
  void begin_motion(const Target& target);
  void end_motion();
  Verdict inspect(const Target& target, std::string* why) const;
  Verdict check_motion(const Target& target) const;
  // The pose, velocity and acceleration of a sample in the coordinates of the segment.
  void pose_of(const QuinticSegment::Sample& sample, Pose& X, Twist& V, Twist& A) const;
  struct Magnitude {  // of a pose: position and rotation; otherwise `linear` is that of the largest
                      // coordinate
    double linear = 0, angular = 0;
  };
  static Vector3 rotation_of(const QuinticSegment::Values& pose) { return {pose[3], pose[4], pose[5]}; }
  Magnitude goal_acceleration() const;
  Magnitude magnitude(const QuinticSegment::Values& v) const;
  double plan_rest(const QuinticSegment::Values& goal, double duration_s, const Magnitude& acceleration);
  double acceleration_excess(std::size_t samples, const Magnitude& allowed) const;
  double peak_excess(std::size_t samples) const;
  struct Aim {  // end of a segment, in the coordinates of the segment
    QuinticSegment::Values goal{}, velocity{};
    Magnitude distance;     // from the current set-point
    double shortest_s = 0;  // duration that the speed limits require
  };
  Aim aim_at(const Target& target) const;
  Aim aim_past(const Target& target, const Aim& sample, double span, double ahead) const;
  bool gentle(std::size_t samples, const QuinticSegment::Values& own = {}) const;
  std::size_t coordinates() const { return spec_.quantity == Quantity::pose ? 6 : size_; }
  void rebase();
  void rebase_to_rest();
  void forget_posted();
  void publish_sample();

  InputSpec spec_;
  std::size_t size_;
  JointRange range_;

  struct Inbox {
    std::mutex posters;        // never taken by the loop
    std::uint64_t posted = 0;  // guarded by posters
    std::uint64_t chunk = 0;   // newest, guarded by posters
    TripleBuffer<Target> targets;
    TripleBuffer<Chunk> chunks;
    std::atomic<std::uint64_t> late{0};
  };
  std::unique_ptr<Inbox> inbox_;

  std::size_t next_ = 0, queued_ = 0;  // samples of the newest chunk: the next one and their number
  QuinticSegment segment_;
  QuinticSegment::Sample now_;         // pose: position and rotation vector about R_0_
  double t_ = 0;                       // time in the segment [s]
  Matrix3 R_0_ = Matrix3::Identity();  // orientation at the segment's start
  bool streaming_ = false, stale_ = false;
  double last_arrival_s_ = 0;
  double period_s_ = 0;  // of the stream, filtered; 0: unknown
  Series series_;        // of a slow stream
  bool timed_ = false;   // the sample being taken has its own time
  Target last_;          // newest target of a stream
  Target pending_;       // newest target of this step
  bool is_pending_ = false;
  std::uint64_t planned_ = 0;
  bool moving_end_ = false;  // the segment ends with nonzero velocity
  double braking_s_ = 0;     // remaining braking before a stream's next sample or a goal is planned
  Harmonic motion_;          // added to the segment while it lasts
  bool in_motion_ = false;
  double t_motion_ = 0;  // time in the motion [s]

  double pace_ = 1, pace_rate_ = 0;         // p, dp/dt [1/s]
  double slowed_ = 1;                       // of the next tick
  QuinticSegment::Values path_velocity_{};  // x'
  double greatest_hand_speed_ = std::numeric_limits<double>::infinity();
  Jacobian J_hand_;     // joints only
  Jacobian J_carried_;  // joints that move a second hand
  double lever_ = 0;    // poses only [m]
  double greatest_of_points_ = std::numeric_limits<double>::infinity();
  Points points_{};
  std::size_t point_count_ = 0;
  double farthest_ = 0;
  std::array<Resistance, 2> resisting_{};  // hands, since the last advance(); a third replaces the weaker
  std::size_t resisting_count_ = 0;
  Target waiting_for_;  // a target that arrived while the hand could not follow, or whose way a brake begins
  bool waiting_ = false;

  Pose X_d_;
  Twist V_d_, A_d_;
  JointVector q_d_, dq_d_, ddq_d_;
};

}  // namespace multipanda
