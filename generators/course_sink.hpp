#pragma once

#include <vector>

#include "generators/publish.hpp"
#include "generators/set_point_link.hpp"

namespace multipanda {

// Publishes a course's poses to the inputs that it names.
class CourseSink final : public PoseSink {
 public:
  // Opens a stream for every destination of the course. Throws std::invalid_argument for a hand without any,
  // and what the link throws. `link` must outlive the sink.
  CourseSink(SetPointLink& link, const circular_field::Course& course);

  // False only if none of the hand's streams took it.
  bool publish(std::size_t hand, const Pose& X_W, std::int64_t time_ns) override;

 private:
  struct To {
    std::size_t hand;
    Vector3 offset;
    SetPointLink::Stream stream;
  };
  SetPointLink& link_;
  std::vector<To> to_;
};

// Where the hands of a course begin: at the arms that they name, else at their own start pose. Throws
// std::invalid_argument for an arm that the run does not have.
std::vector<Pose> starts_in(SetPointLink& link, const circular_field::Course& course);
// Without a run. Throws std::invalid_argument for a hand without a start pose.
std::vector<Pose> starts_of(const circular_field::Course& course);

// Half way between poses, in position and along the shortest rotation. At least one.
Pose midway(const std::vector<Pose>& poses);

}  // namespace multipanda
