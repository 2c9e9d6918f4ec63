#pragma once

#include <string>
#include <vector>

#include "generators/publish.hpp"
#include "runtime/live_input/client.hpp"

namespace multipanda {

// Publishes to inputs of a running scene's controllets, by packets over its live-input socket.
class LiveSink final : public PoseSink {
 public:
  // Opens a stream for every destination of the course. Throws std::invalid_argument for a hand without any,
  // or with the run's refusal (no such controllet or input); std::runtime_error if the run does not answer.
  // `client` must outlive the sink: streams end with its connection.
  LiveSink(LiveClient& client, const circular_field::Course& course);

  // False only if none of the hand's streams had room.
  bool publish(std::size_t hand, const Pose& X_W, std::int64_t time_ns) override;

  // Makes each stream's newest pose a goal, so that an input that falls silent has not lost its publisher.
  // Destinations whose controllet does not run are left out.
  void rest();
  // What the run says of each stream: received, lost, refused, ... as docs/live_input.md has it.
  nlohmann::json channels();

 private:
  struct Stream {
    std::size_t hand;
    circular_field::Destination to;
    ReferenceStream packets;
  };
  LiveClient& client_;
  std::vector<Stream> streams_;
  std::vector<Pose> newest_;  // per hand
};

// Where the hands of a course begin: at the arms that they name, else at their own start pose. Throws
// std::invalid_argument for an arm that the run does not have.
std::vector<Pose> starts_in(LiveClient& client, const circular_field::Course& course);
// Without a run. Throws std::invalid_argument for a hand without a start pose.
std::vector<Pose> starts_of(const circular_field::Course& course);

// Half way between poses, in position and along the shortest rotation. At least one.
Pose midway(const std::vector<Pose>& poses);

}  // namespace multipanda
