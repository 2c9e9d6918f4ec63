#include "motion_generators/via_points/via_plan.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace multipanda {
namespace {

double duration_of(const auto& motion) {
  return std::visit([](const auto& m) { return m.duration(); }, motion);
}

std::size_t passed_by(const auto& motion, double t) {
  return std::visit(
      [t](const auto& m) {
        return static_cast<std::size_t>(
            std::count_if(m.knots().begin(), m.knots().end(), [t](double at) { return at <= t + 1e-9; }));
      },
      motion);
}

PoseSample resting(const Pose& X) { return {X, {}, {}}; }

JointSample resting(const JointVector& q) {
  return {q, JointVector::Zero(q.size()), JointVector::Zero(q.size())};
}

}  // namespace

JointMotionLimits UniformJointLimits::of(std::size_t joints) const {
  const auto n = static_cast<Eigen::Index>(joints);
  return {JointVector::Constant(n, velocity), JointVector::Constant(n, acceleration),
          JointVector::Constant(n, jerk)};
}

ViaRun::ViaRun(ViaPlan plan, const std::vector<SetPointChannel::Arm>& starts) : plan_(std::move(plan)) {
  if (starts.size() != plan_.tracks.size())
    throw std::invalid_argument("via points: expected one start per track");
  for (std::size_t i = 0; i < starts.size(); ++i) {
    const ViaTrack& track = plan_.tracks[i];
    try {
      if (track.quantity() == Quantity::joints) {
        legs_.push_back(
            {.motion = joint_via_motion(resting(starts[i].q), track.joints,
                                        plan_.joint_limits.of(static_cast<std::size_t>(starts[i].q.size())),
                                        plan_.scale)});
      } else {
        legs_.push_back({.motion = pose_via_motion(resting(starts[i].X_WE), track.poses, plan_.pose_limits,
                                                   plan_.scale)});
      }
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument("via points of arm '" + track.arm + "': " + error.what());
    }
  }
}

// A further pass through all via points, from the end of the last one.
ViaRun::Motion ViaRun::again(const ViaTrack& track, const Motion& before) const {
  if (const auto* joints = std::get_if<JointMotion>(&before)) {
    return joint_via_motion(resting(joints->sample(joints->duration()).position), track.joints,
                            plan_.joint_limits.of(joints->size()), plan_.scale);
  }
  const auto& pose = std::get<PoseMotion>(before);
  return pose_via_motion(resting(pose.sample(pose.duration()).X), track.poses, plan_.pose_limits,
                         plan_.scale);
}

void ViaRun::step(double dt) {
  time_ += dt;
  if (!plan_.repeat) return;
  for (std::size_t i = 0; i < legs_.size(); ++i) {
    Leg& leg = legs_[i];
    const double duration = duration_of(leg.motion);
    if (leg.braking || time_ < leg.begin + duration) continue;
    const std::size_t passed = leg.passed + passed_by(leg.motion, duration);
    Motion next = again(plan_.tracks[i], leg.motion);
    // With a single via point there is no further motion.
    if (duration_of(next) == 0) continue;
    leg = {.motion = std::move(next), .begin = leg.begin + duration, .passed = passed};
  }
}

void ViaRun::brake() {
  for (Leg& leg : legs_) {
    const double t = time_ - leg.begin;
    if (leg.braking || t >= duration_of(leg.motion)) continue;
    const std::size_t passed = leg.passed + passed_by(leg.motion, t);
    if (const auto* joints = std::get_if<JointMotion>(&leg.motion)) {
      leg.motion = joint_brake(joints->sample(t), plan_.joint_limits.of(joints->size()), plan_.scale);
    } else {
      leg.motion = pose_brake(std::get<PoseMotion>(leg.motion).sample(t), plan_.pose_limits, plan_.scale);
    }
    leg = {.motion = std::move(leg.motion), .begin = time_, .passed = passed, .braking = true};
  }
}

double ViaRun::duration() const {
  double longest = 0;
  for (const Leg& leg : legs_) longest = std::max(longest, duration_of(leg.motion));
  return longest;
}

bool ViaRun::finished() const { return !plan_.repeat && at_rest(); }

bool ViaRun::at_rest() const {
  return std::all_of(legs_.begin(), legs_.end(),
                     [this](const Leg& leg) { return time_ >= leg.begin + duration_of(leg.motion); });
}

std::size_t ViaRun::passed(std::size_t track) const {
  const Leg& leg = legs_[track];
  return leg.passed + (leg.braking ? 0 : passed_by(leg.motion, time_ - leg.begin));
}

std::vector<double> ViaRun::values(std::size_t track) const {
  const Leg& leg = legs_[track];
  const double t = time_ - leg.begin;
  if (const auto* joints = std::get_if<JointMotion>(&leg.motion)) {
    const JointVector q = joints->sample(t).position;
    return {q.begin(), q.end()};
  }
  const auto values = std::get<PoseMotion>(leg.motion).sample(t).X.values();
  return {values.begin(), values.end()};
}

std::vector<SetPointChannel::Arm> starts_in(SetPointChannel& channel, const ViaPlan& plan) {
  std::vector<std::string> names;
  for (const auto& track : plan.tracks) names.push_back(track.arm);
  return channel.arms(names);
}

PublishReport publish_via(ViaRun& run, SetPointChannel& channel, const PublishOptions& options) {
  struct To {
    std::size_t track;
    Vector3 offset;
    SetPointChannel::Stream stream;
  };
  std::vector<To> to;
  const auto& tracks = run.plan().tracks;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    for (const auto& each : tracks[i].publish)
      to.push_back({i, each.offset, channel.open(each.controllet, each.input, tracks[i].quantity())});
  }
  PublishReport report;
  publish({.per_period = to.size(),
           .step = [&](double dt) { run.step(dt); },
           .send =
               [&](std::int64_t now_ns) {
                 std::size_t unsent = 0;
                 for (const To& each : to) {
                   auto values = run.values(each.track);
                   if (tracks[each.track].quantity() == Quantity::pose) {
                     for (std::size_t k = 0; k < 3; ++k)
                       values[k] += each.offset[static_cast<Eigen::Index>(k)];
                   }
                   unsent += channel.send(each.stream, values, now_ns) ? 0 : 1;
                 }
                 return unsent;
               },
           .time = [&] { return run.time(); },
           .finished = [&] { return run.finished(); },
           .brake = [&] { run.brake(); },
           .at_rest = [&] { return run.at_rest(); }},
          options, report);
  for (std::size_t i = 0; i < tracks.size(); ++i) report.goals_reached.push_back(run.passed(i));
  return report;
}

}  // namespace multipanda
