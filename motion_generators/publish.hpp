#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "motion_generators/circular_field/course.hpp"
#include "motion_generators/set_point_channel.hpp"

namespace multipanda {

// A destination for poses of hands, such as the inputs of a run. One thread.
class PoseSink {
 public:
  virtual ~PoseSink() = default;
  // Takes the newest desired pose of a hand, in the world. Must not wait. Returns false if the pose was not
  // delivered. `time_ns` is the publisher's steady clock.
  virtual bool publish(std::size_t hand, const Pose& X_W, std::int64_t time_ns) = 0;
};

struct PublishOptions {
  std::chrono::nanoseconds period = std::chrono::milliseconds(1);
  double seconds = 0;                       // 0: until every hand has reached its last goal
  const std::atomic<bool>* stop = nullptr;  // ends the course early
  double patience_s = 5;  // give up after this long without a delivery; a busy machine may need that long
};

// The result of a publication. Times are of this machine's steady clock.
struct PublishReport {
  std::string ended_by;       // "goals", "duration", "stopped", "no_receiver"
  std::uint64_t samples = 0;  // periods in which poses were published
  std::uint64_t unsent = 0;   // poses that were not delivered
  std::uint64_t missed = 0;   // periods without a pose because the process woke too late
  double elapsed_s = 0;       // duration of the publication
  double rate_hz = 0;         // samples per second
  double late_median_us = 0, late_p99_us = 0, late_worst_us = 0;  // lateness of the wake-ups
  double step_median_us = 0, step_worst_us = 0;                   // planning time of one period
  double clearance_m = 0;                                         // smallest gap in the plan
  double speed_m_per_s = 0;                                       // largest speed of a hand
  std::vector<std::size_t> goals_reached;                         // per hand
};

// A motion that is stepped by the clock and sends set-points. Callbacks run on the publishing thread.
struct Publication {
  std::size_t per_period = 1;           // set-points sent per period
  std::function<void(double dt)> step;  // plans the next period [s]
  std::function<std::size_t(std::int64_t)>
      send;                        // sends all at this time [ns]; returns how many were not delivered
  std::function<double()> time;    // planned time [s]
  std::function<bool()> finished;  // the motion has ended by itself
  std::function<void()> brake;     // bring the motion to rest
  std::function<bool()> at_rest;
};

// Steps the motion once per period of the wall clock and sends its set-points. A missed period is planned but
// not sent, so set-points keep up with the clock without bursts. At the end the motion brakes to rest, which
// is also sent. Fills in the timing and delivery fields of the report.
void publish(const Publication& publication, const PublishOptions& options, PublishReport& report);

// Publishes a course: every hand's pose goes to the sink.
PublishReport publish_course(circular_field::CourseRun& run, PoseSink& sink, const PublishOptions& options);

// Plans a course without a clock and without publishing, as fast as possible, for `seconds` (0: until the
// last goals, at most 600 s). Rate and lateness are zero.
PublishReport rehearse_course(circular_field::CourseRun& run, const PublishOptions& options);

// Publishes a course's poses to the inputs that it names.
class CourseSink final : public PoseSink {
 public:
  // Opens a stream for every destination of the course. Throws std::invalid_argument for a hand without a
  // destination, and the channel's exceptions. `channel` must outlive the sink.
  CourseSink(SetPointChannel& channel, const circular_field::Course& course);

  // Returns false only if no stream of the hand accepted the pose.
  bool publish(std::size_t hand, const Pose& X_W, std::int64_t time_ns) override;

 private:
  struct To {
    std::size_t hand;
    Vector3 offset;
    SetPointChannel::Stream stream;
  };
  SetPointChannel& channel_;
  std::vector<To> to_;
};

// Start poses of the hands of a course: at the arms that they name, otherwise their own start poses. Throws
// std::invalid_argument for an arm that the run does not have.
std::vector<Pose> starts_in(SetPointChannel& channel, const circular_field::Course& course);
// The same without a run. Throws std::invalid_argument for a hand without a start pose.
std::vector<Pose> starts_of(const circular_field::Course& course);

// The mean of one or more poses, in position and along the shortest rotation.
Pose midway(const std::vector<Pose>& poses);

}  // namespace multipanda
