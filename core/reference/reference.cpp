#include "core/reference/reference.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "core/types/spatial.hpp"

namespace multipanda {
namespace {

constexpr double kLongest = 86400;  // [s] of a goal, or a motion's period
constexpr double kMostCycles = 1e6;
constexpr double kMaxStreamPeriod = 0.2;  // [s]; a longer gap ends a stream ...
constexpr double kMaxStreamGap = 3.5;     // ... unless it has fewer periods: lost samples

Harmonic harmonic_of(const Target& target) {
  Harmonic motion{.period_s = target.period_s,
                  .cycles = target.cycles,
                  .ramp_s = std::max(target.ramp_s, Harmonic::kShortestRamp)};
  std::copy_n(target.values.begin(), target.size, motion.rise.begin());
  std::copy_n(target.sine.begin(), target.size, motion.sine.begin());
  motion.harmonic_count = target.harmonic_count;
  std::copy_n(target.harmonics.begin(), target.harmonic_count, motion.harmonics.begin());
  return motion;
}

}  // namespace

std::string carries_text(const InputSpec& input) {
  return "input '" + input.name + "' carries a " + std::string(to_string(input.quantity)) + ": expected " +
         keys_of(input.quantity).expected;
}

Reference::Reference(InputSpec spec, std::size_t joint_count, JointRange range)
    : spec_(std::move(spec)),
      size_(value_count(spec_.quantity, joint_count)),
      range_(std::move(range)),
      inbox_(std::make_unique<Inbox>()) {
  if (!(spec_.timeout_s > 0 && spec_.max_speed > 0 && spec_.max_angular_speed > 0)) {
    throw std::invalid_argument("input '" + spec_.name + "': timeout and speed limits must be above zero");
  }
  const auto n = static_cast<Eigen::Index>(joint_count);
  q_d_ = dq_d_ = ddq_d_ = JointVector::Zero(n);
}

std::string Reference::refusal(const Target& target) const {
  std::string why;
  (void)inspect(target, &why);
  return why;
}

// `why`: set to the reason; nullptr in the loop.
Verdict Reference::inspect(const Target& target, std::string* why) const {
  const auto refused = [why](Verdict verdict, auto... format) {
    std::array<char, 128> text{};
    if (why != nullptr) std::snprintf(text.data(), text.size(), format...);
    if (why != nullptr) *why = text.data();
    return verdict;
  };
  if (target.delivery == Delivery::motion) return check_motion(target);
  if (target.size != size_)
    return refused(Verdict::wrong_size, "expected %zu number%s, found %u", size_, size_ == 1 ? "" : "s",
                   unsigned{target.size});
  for (std::size_t i = 0; i < size_; ++i) {
    const double value = target.values[i];
    if (!std::isfinite(value))
      return refused(Verdict::not_finite, "number %zu of %zu is not finite", i + 1, size_);
    if (std::abs(value) > kGreatest)
      return refused(Verdict::out_of_bounds, "number %zu of %zu is %.6g; expected at most %g, in SI units",
                     i + 1, size_, value, kGreatest);
  }
  if (!(target.duration_s >= 0 && target.duration_s <= kLongest)) {
    const bool finite = std::isfinite(target.duration_s);
    return refused(finite ? Verdict::out_of_bounds : Verdict::not_finite,
                   "the duration is %g s; expected 0 to %g s", target.duration_s, kLongest);
  }
  if (spec_.quantity == Quantity::pose) {
    const auto& v = target.values;
    const double norm = std::sqrt(v[3] * v[3] + v[4] * v[4] + v[5] * v[5] + v[6] * v[6]);
    if (std::abs(norm - 1.0) > 1e-2)
      return refused(Verdict::out_of_bounds,
                     "the quaternion's length is %.6g; expected a unit quaternion, w first", norm);
  }
  if (spec_.quantity == Quantity::joints && range_.min.size() > 0) {
    const std::span q(target.values.data(), size_);
    if (range_.first_outside(q) == size_) return Verdict::accepted;
    if (why != nullptr) *why = range_.refusal(q);
    return Verdict::out_of_bounds;
  }
  return Verdict::accepted;
}

Verdict Reference::check_motion(const Target& target) const {
  const std::size_t size = spec_.quantity == Quantity::pose ? 3 : size_;
  if (target.size != size) return Verdict::wrong_size;
  for (const double value : {target.period_s, target.cycles, target.ramp_s}) {
    if (!std::isfinite(value)) return Verdict::not_finite;
  }
  for (std::size_t i = 0; i < size; ++i) {
    if (!std::isfinite(target.values[i]) || !std::isfinite(target.sine[i])) return Verdict::not_finite;
  }
  if (target.harmonic_count > kMaxHarmonics) return Verdict::wrong_size;
  for (std::size_t k = 0; k < target.harmonic_count; ++k) {
    for (std::size_t i = 0; i < size; ++i) {
      if (!std::isfinite(target.harmonics[k].sine[i]) || !std::isfinite(target.harmonics[k].rise[i])) {
        return Verdict::not_finite;
      }
    }
  }
  if (!(target.period_s > 0 && target.cycles > 0 && target.ramp_s >= 0)) return Verdict::out_of_bounds;
  if (target.period_s > kLongest || target.cycles > kMostCycles) return Verdict::out_of_bounds;
  const auto too_large = [size](const auto&... parts) {
    const auto any = [size](const auto& part) {
      return std::any_of(part.begin(), part.begin() + static_cast<std::ptrdiff_t>(size),
                         [](double value) { return std::abs(value) > kGreatest; });
    };
    return (any(parts) || ...);
  };
  if (too_large(target.values, target.sine)) return Verdict::out_of_bounds;
  for (std::size_t k = 0; k < target.harmonic_count; ++k) {
    if (too_large(target.harmonics[k].sine, target.harmonics[k].rise)) return Verdict::out_of_bounds;
  }
  const Harmonic motion = harmonic_of(target);
  if (motion.ramp_s > motion.period_s * motion.cycles) return Verdict::out_of_bounds;
  if (spec_.quantity == Quantity::pose) {
    return motion.top_speed(0, 3) > spec_.max_speed ? Verdict::out_of_bounds : Verdict::accepted;
  }
  for (std::size_t i = 0; i < size; ++i) {
    if (motion.top_speed(i, 1) > spec_.max_speed) return Verdict::out_of_bounds;
  }
  return Verdict::accepted;
}

Verdict Reference::post(Target target) {
  const Verdict verdict = check(target);
  if (verdict != Verdict::accepted) return verdict;
  const std::lock_guard lock(inbox_->posters);
  target.id = ++inbox_->posted;
  inbox_->targets.write(target);
  return Verdict::accepted;
}

void Reference::start(const Pose& X_measured) {
  forget_posted();
  now_ = {};
  for (int i = 0; i < 3; ++i) now_.position[static_cast<std::size_t>(i)] = X_measured.position[i];
  R_0_ = X_measured.rotation;
  segment_.plan(coordinates(), now_, now_.position, 0);
  publish_sample();
}

void Reference::start(const JointVector& measured) {
  forget_posted();
  now_ = {};
  std::copy(measured.data(), measured.data() + measured.size(), now_.position.begin());
  segment_.plan(size_, now_, now_.position, 0);
  publish_sample();
}

void Reference::start_constant(double value) {
  forget_posted();
  now_ = {};
  std::fill_n(now_.position.begin(), size_, value);
  segment_.plan(size_, now_, now_.position, 0);
  publish_sample();
}

void Reference::forget_posted() {
  inbox_->targets.take();
  inbox_->chunks.take();
  forget_chunk();
  t_ = 0;
  streaming_ = stale_ = moving_end_ = in_motion_ = is_pending_ = waiting_ = false;
  braking_s_ = 0;
  pace_ = slowed_ = 1;
  pace_rate_ = 0;
  resisting_count_ = 0;
  period_s_ = 0;
  last_.id = 0;
}

void Reference::set(const Target& target) {
  forget_chunk();
  streaming_ = stale_ = false;
  pending_ = target;
  is_pending_ = true;
}

void Reference::plan_pending() {
  is_pending_ = false;
  ++planned_;
  if (pending_.delivery == Delivery::motion) {
    waiting_ = false;
    begin_motion(pending_);
  } else if (!waits_for(pending_)) {
    plan_goal(pending_);
  }
}

void Reference::advance(double dt, double now_s) {
  const bool posted = inbox_->targets.take();
  if (is_pending_ && !posted) plan_pending();
  is_pending_ = false;
  take_chunk(now_s);
  if (posted) take(inbox_->targets.value(), now_s);
  take_due(now_s);
  if (waiting_ && !streaming_) braking_s_ -= dt;
  if (waiting_ && !streaming_ && braking_s_ <= 0 && !must_wait(waiting_for_, kWaitsFrom)) {
    waiting_ = false;
    ++planned_;
    plan_goal(waiting_for_);
  }
  if (streaming_ && now_s - last_arrival_s_ > spec_.timeout_s) stale_ = true;
  if (moving_end_ && t_ + dt > segment_.duration()) plan_brake();
  update_pace(dt);
  t_ += pace_ * dt;
  segment_.evaluate(t_, now_);
  if (in_motion_) {
    t_motion_ += pace_ * dt;
    motion_.add(t_motion_, coordinates(), now_);
    if (t_motion_ >= motion_.duration() && t_ >= segment_.duration()) end_motion();
  }
  apply_pace();
  publish_sample();
}

void Reference::take(const Target& target, double now_s) {
  const double elapsed = now_s - last_arrival_s_;
  const bool newer = timed_ ? last_.id != kOfAnotherFrame : target.id > last_.id;
  const bool continues = streaming_ && !stale_ && target.delivery == Delivery::stream && newer;
  streaming_ = target.delivery == Delivery::stream;
  stale_ = false;
  last_arrival_s_ = now_s;
  ++planned_;
  if (target.delivery == Delivery::motion) {
    waiting_ = false;
    begin_motion(target);
  } else if (waits_for(target)) {
    period_s_ = 0;
  } else if (continues && elapsed > 0 && elapsed < std::max(kMaxStreamPeriod, kMaxStreamGap * period_s_)) {
    plan_stream(target, timed_ ? 1 : target.id - last_.id, elapsed);
  } else {
    period_s_ = 0;
    plan_goal(target);
  }
  last_ = target;
}

// Restarts the segment of a pose at the current orientation, where the rotation vector is 0 and its rate is
// the angular velocity.
void Reference::rebase() {
  braking_s_ = 0;
  t_ = 0;
  pace_ = 1;  // now_ holds the velocity and acceleration of the set-point, which the new segment continues
  pace_rate_ = 0;
  in_motion_ = false;
  if (spec_.quantity != Quantity::pose) return;
  R_0_ = X_d_.quaternion()
             .normalized()
             .toRotationMatrix();  // avoids accumulated rounding over millions of samples
  for (std::size_t i = 0; i < 3; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    now_.position[3 + i] = 0;
    now_.velocity[3 + i] = V_d_.vector[3 + k];
    now_.acceleration[3 + i] = A_d_.vector[3 + k];
  }
}

// For a segment that ends at rest. Forces and numbers accelerate no mass, so a noisy stream of them can
// leave a huge second derivative, which would carry the segment far beyond both of its ends.
void Reference::rebase_to_rest() {
  rebase();
  if (spec_.quantity != Quantity::pose && spec_.quantity != Quantity::joints) now_.acceleration = {};
}

// The current motion brakes; the new motion is added to it.
void Reference::begin_motion(const Target& target) {
  plan_brake();
  motion_ = harmonic_of(target);
  in_motion_ = true;
  t_motion_ = 0;
}

void Reference::end_motion() {
  now_.velocity = now_.acceleration = {};
  in_motion_ = false;
  t_ = 0;
  pace_ = 1;
  pace_rate_ = 0;
  segment_.plan(coordinates(), now_, now_.position, 0);
}

void Reference::pose_of(const QuinticSegment::Sample& sample, Pose& X, Twist& V, Twist& A) const {
  const auto& [position, velocity, acceleration] = sample;
  const Vector3 r = rotation_of(position), dr = rotation_of(velocity), ddr = rotation_of(acceleration);
  const Matrix3 J = left_jacobian(r);
  X.position = {position[0], position[1], position[2]};
  X.rotation = exp_rotation(r) * R_0_;
  V.linear() = Vector3(velocity[0], velocity[1], velocity[2]);
  V.angular() = J * dr;
  A.linear() = Vector3(acceleration[0], acceleration[1], acceleration[2]);
  A.angular() = J * ddr + left_jacobian_rate(r, dr);
}

void Reference::publish_sample() {
  switch (spec_.quantity) {
    case Quantity::pose:
      pose_of(now_, X_d_, V_d_, A_d_);
      break;
    case Quantity::joints:
      for (Eigen::Index i = 0; i < q_d_.size(); ++i) {
        const auto k = static_cast<std::size_t>(i);
        q_d_[i] = now_.position[k];
        dq_d_[i] = now_.velocity[k];
        ddq_d_[i] = now_.acceleration[k];
      }
      break;
    case Quantity::twist:
    case Quantity::wrench:
    case Quantity::scalar:
      break;  // read directly from now_
  }
}

Vector6 Reference::vector() const { return Eigen::Map<const Vector6>(now_.position.data()); }

void Reference::record(double* values, double* rates) const {
  if (spec_.quantity == Quantity::pose) {
    std::ranges::copy(X_d_.values(), values);
    std::copy_n(V_d_.vector.data(), 6, rates);
    rates[6] = 0;
    return;
  }
  std::copy_n(now_.position.begin(), size_, values);
  std::copy_n(now_.velocity.begin(), size_, rates);
}

}  // namespace multipanda
