#pragma once

#include <vector>

#include "motion_generators/publish.hpp"
#include "motion_generators/set_point_channel.hpp"

namespace multipanda {

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
