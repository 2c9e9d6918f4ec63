#include "motion_generators/publish.hpp"

#include <algorithm>
#include <stdexcept>

#include "core/rt/cycle_histogram.hpp"
#include "core/rt/pacer.hpp"

namespace multipanda {
namespace {

using circular_field::CourseRun;

constexpr double kLongestBrake = 1;        // [s]
constexpr double kLongestRehearsal = 600;  // [s]

double us(std::int64_t ns) { return 1e-3 * static_cast<double>(ns); }

// Plans one period and updates the report.
void plan(CourseRun& run, double dt, PublishReport& report) {
  run.step(dt);
  report.clearance_m = std::min(report.clearance_m, run.clearance());
  for (std::size_t i = 0; i < run.planner().hand_count(); ++i) {
    report.speed_m_per_s = std::max(report.speed_m_per_s, run.planner().hand(i).velocity.norm());
  }
}

// The reason to end; empty to continue.
std::string ending(double time, bool finished, const PublishOptions& options) {
  if (options.stop != nullptr && options.stop->load()) return "stopped";
  if (options.seconds > 0 && time >= options.seconds - 0.5 * seconds(options.period)) return "duration";
  if (options.seconds == 0 && finished) return "goals";
  return "";
}

void count_goals(const CourseRun& run, PublishReport& report) {
  for (std::size_t i = 0; i < run.planner().hand_count(); ++i)
    report.goals_reached.push_back(run.goals_reached(i));
}

}  // namespace

void publish(const Publication& what, const PublishOptions& options, PublishReport& report) {
  const double dt = seconds(options.period);
  CycleHistogram late, step;
  double brake_since = 0;
  std::uint64_t unsent_in_a_row = 0;
  Pacer pacer(options.period);
  pacer.start();
  const HostTime begin = host_now();
  for (;;) {
    const std::uint64_t missed_before = pacer.overruns();
    pacer.wait();
    late.add(pacer.lateness().count());
    const HostTime woke = host_now();
    for (std::uint64_t k = missed_before; k <= pacer.overruns(); ++k) what.step(dt);
    step.add((host_now() - woke).count());
    const std::size_t unsent = what.send(woke.ns);
    report.unsent += unsent;
    unsent_in_a_row = unsent < what.per_period ? 0 : unsent_in_a_row + 1;
    ++report.samples;
    if (static_cast<double>(unsent_in_a_row) * dt > options.patience_s) {
      report.ended_by = "no_receiver";
      break;
    }
    if (report.ended_by.empty()) {
      report.ended_by = ending(what.time(), what.finished(), options);
      if (report.ended_by.empty()) continue;
      what.brake();
      brake_since = what.time();
    }
    if (what.at_rest() || what.time() - brake_since > kLongestBrake) break;
  }
  report.missed = pacer.overruns();
  report.elapsed_s = seconds(host_now() - begin);
  report.rate_hz = static_cast<double>(report.samples) / report.elapsed_s;
  report.late_median_us = us(late.percentile(0.5));
  report.late_p99_us = us(late.percentile(0.99));
  report.late_worst_us = us(late.max());
  report.step_median_us = us(step.percentile(0.5));
  report.step_worst_us = us(step.max());
}

PublishReport publish_course(CourseRun& run, PoseSink& sink, const PublishOptions& options) {
  PublishReport report;
  report.clearance_m = run.clearance();
  const std::size_t hands = run.planner().hand_count();
  publish({.per_period = hands,
           .step = [&](double dt) { plan(run, dt, report); },
           .send =
               [&](std::int64_t now_ns) {
                 std::size_t unsent = 0;
                 for (std::size_t i = 0; i < hands; ++i)
                   unsent += sink.publish(i, run.planner().hand(i).X_W, now_ns) ? 0 : 1;
                 return unsent;
               },
           .time = [&] { return run.time(); },
           .finished = [&] { return run.finished(); },
           .brake = [&] { run.brake(); },
           .at_rest = [&] { return run.at_rest(); }},
          options, report);
  count_goals(run, report);
  return report;
}

PublishReport rehearse_course(CourseRun& run, const PublishOptions& options) {
  PublishReport report;
  report.clearance_m = run.clearance();
  const double dt = seconds(options.period);
  CycleHistogram step;
  const HostTime begin = host_now();
  while (report.ended_by.empty()) {
    const HostTime before = host_now();
    plan(run, dt, report);
    step.add((host_now() - before).count());
    ++report.samples;
    report.ended_by = ending(run.time(), run.finished(), options);
    if (report.ended_by.empty() && run.time() >= kLongestRehearsal) report.ended_by = "duration";
  }
  report.elapsed_s = seconds(host_now() - begin);
  report.step_median_us = us(step.percentile(0.5));
  report.step_worst_us = us(step.max());
  count_goals(run, report);
  return report;
}

using circular_field::Course;

CourseSink::CourseSink(SetPointChannel& channel, const Course& course) : channel_(channel) {
  for (std::size_t i = 0; i < course.hands.size(); ++i) {
    const auto& hand = course.hands[i];
    if (hand.publish.empty()) {
      throw std::invalid_argument("course '" + course.name + "': hand '" + hand.spec.name +
                                  "' has no destination; name a controllet and an input under 'publish'");
    }
    for (const auto& to : hand.publish)
      to_.push_back({i, to.offset, channel.open(to.controllet, to.input, Quantity::pose)});
  }
}

bool CourseSink::publish(std::size_t hand, const Pose& X_W, std::int64_t time_ns) {
  bool sent = false;
  for (const auto& to : to_) {
    if (to.hand != hand) continue;
    const auto values = Pose{X_W.rotation, X_W.position + to.offset}.values();
    if (channel_.send(to.stream, values, time_ns)) sent = true;
  }
  return sent;
}

std::vector<Pose> starts_in(SetPointChannel& channel, const Course& course) {
  std::vector<Pose> starts;
  for (const auto& hand : course.hands) {
    std::vector<Pose> poses;
    try {
      for (const auto& arm : channel.arms(hand.start_at)) poses.push_back(arm.X_WE);
    } catch (const std::invalid_argument& refusal) {
      throw std::invalid_argument("course '" + course.name + "': " + refusal.what());
    }
    if (poses.empty()) poses.push_back(hand.start.value());
    starts.push_back(midway(poses));
  }
  return starts;
}

std::vector<Pose> starts_of(const Course& course) {
  std::vector<Pose> starts;
  for (const auto& hand : course.hands) {
    if (!hand.start) {
      throw std::invalid_argument("course '" + course.name + "': hand '" + hand.spec.name +
                                  "' starts at an arm of a run; without a run it needs 'start'");
    }
    starts.push_back(*hand.start);
  }
  return starts;
}

Pose midway(const std::vector<Pose>& poses) {
  Pose mean = poses.at(0);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const double share = 1.0 / static_cast<double>(i + 1);
    mean.position += share * (poses[i].position - mean.position);
    mean.rotation =
        exp_rotation(share * log_rotation(poses[i].rotation * mean.rotation.transpose())) * mean.rotation;
  }
  return mean;
}

}  // namespace multipanda
