#include "motion_generators/course_sink.hpp"

#include <stdexcept>

namespace multipanda {

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
    const auto values = values_of({X_W.rotation, X_W.position + to.offset});
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
