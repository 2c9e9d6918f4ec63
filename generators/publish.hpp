#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "generators/circular_field/course.hpp"

namespace multipanda {

// Where poses of hands go: inputs of a run, a list. One thread.
class PoseSink {
 public:
  virtual ~PoseSink() = default;
  // The newest desired pose of a hand, world. Must not wait. False: it did not get through; the next one is
  // newer anyway. `time_ns`: the publisher's steady clock.
  virtual bool publish(std::size_t hand, const Pose& X_W, std::int64_t time_ns) = 0;
};

struct PublishOptions {
  std::chrono::nanoseconds period = std::chrono::milliseconds(1);
  double seconds = 0;                       // 0: until every hand is at its last goal
  const std::atomic<bool>* stop = nullptr;  // ends the course early
  double patience_s = 5;  // with a sink that takes nothing: a busy machine may be that long at it
};

// What became of a publication. Times on this machine's steady clock.
struct PublishReport {
  std::string ended_by;       // "goals", "duration", "stopped", "nobody_listens"
  std::uint64_t samples = 0;  // periods in which poses were published
  std::uint64_t unsent = 0;   // poses that did not get through
  std::uint64_t missed = 0;   // periods without a pose, since the process woke too late
  double elapsed_s = 0;       // of publication
  double rate_hz = 0;         // samples per second
  double late_median_us = 0, late_p99_us = 0, late_worst_us = 0;  // of the wake-ups, behind the grid
  double step_median_us = 0, step_worst_us = 0;                   // planning of one period
  double clearance_m = 0;                                         // smallest gap of the plan
  double speed_m_per_s = 0;                                       // largest of a hand
  std::vector<std::size_t> goals_reached;                         // per hand
};

// Something that is stepped by the clock and sends set-points. Callbacks run on the publishing thread.
struct Publication {
  std::size_t per_period = 1;                     // set-points that every period sends
  std::function<void(double dt)> step;            // plans the next period [s]
  std::function<std::size_t(std::int64_t)> send;  // all of them; how many did not get through. Steady clock
  std::function<double()> time;                   // that was planned [s]
  std::function<bool()> finished;                 // by itself
  std::function<void()> brake;                    // from now on it comes to rest
  std::function<bool()> at_rest;
};

// Steps it once per period of the wall clock and sends. A period that was missed is planned, but not sent:
// set-points keep up with the clock and none comes in a burst. At the end it brakes to a rest, which is sent,
// too. Fills in what the clock and the sending tell.
void publish(const Publication& publication, const PublishOptions& options, PublishReport& report);

// The same with a course: every hand's pose, to a sink.
PublishReport publish_course(circular_field::CourseRun& run, PoseSink& sink, const PublishOptions& options);

// The same without a clock: plans `seconds` (0: until the last goals, at most 600 s) as fast as it can and
// publishes to nobody. Rate and lateness are zero.
PublishReport rehearse_course(circular_field::CourseRun& run, const PublishOptions& options);

}  // namespace multipanda
