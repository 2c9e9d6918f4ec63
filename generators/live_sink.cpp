#include "generators/live_sink.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <stdexcept>
#include <thread>

#include "models/checked_yaml.hpp"

namespace multipanda {
namespace {

using circular_field::Course;
using nlohmann::json;

// A target's values: x y z qw qx qy qz.
std::array<double, 7> values_of(const Pose& X, const Vector3& offset) {
  const Vector3 p = X.position + offset;
  const Quaternion q = X.quaternion();
  return {p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()};
}

Pose pose_in(const json& arm) {
  const auto p = arm.at("position_m").get<std::vector<double>>();
  const auto q = arm.at("quaternion_wxyz").get<std::vector<double>>();
  return Pose::from({p.at(0), p.at(1), p.at(2)}, Quaternion(q.at(0), q.at(1), q.at(2), q.at(3)));
}

// The arms' state, once the loop has had its first cycle.
json arms_of(LiveClient& client) {
  for (int tries = 0; tries < 100; ++tries) {
    json arms = client.ask({{"do", "state"}}).at("state").at("arms");
    if (!arms.empty()) return arms;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  throw std::runtime_error("the run has not had its first cycle yet");
}

}  // namespace

LiveSink::LiveSink(LiveClient& client, const Course& course) : client_(client) {
  for (std::size_t i = 0; i < course.hands.size(); ++i) {
    const auto& hand = course.hands[i];
    if (hand.publish.empty()) {
      throw std::invalid_argument("course '" + course.name + "': hand '" + hand.spec.name +
                                  "' has nowhere to go to: name a controllet and an input under 'publish'");
    }
    for (const auto& to : hand.publish)
      streams_.push_back({i, to, client.open_stream(to.controllet, to.input, "world")});
  }
  newest_.resize(course.hands.size());
}

bool LiveSink::publish(std::size_t hand, const Pose& X_W, std::int64_t time_ns) {
  newest_[hand] = X_W;
  bool sent = false;
  for (auto& stream : streams_) {
    if (stream.hand == hand && stream.packets.send(values_of(X_W, stream.to.offset), time_ns)) sent = true;
  }
  return sent;
}

void LiveSink::rest() {
  // A packet that is still under way would begin the stream anew behind the goal.
  json before, now = channels();
  do {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    before = std::move(now);
    now = channels();
  } while (now != before);
  for (const auto& stream : streams_) {
    const auto v = values_of(newest_[stream.hand], stream.to.offset);
    (void)client_.ask({{"do", "reference"},
                       {"controllet", stream.to.controllet},
                       {"input", stream.to.input},
                       {"position_m", {v[0], v[1], v[2]}},
                       {"quaternion_wxyz", {v[3], v[4], v[5], v[6]}}});
  }
}

json LiveSink::channels() {
  const json answer = client_.ask({{"do", "channels"}});
  json list = json::array();
  for (const auto& entry : answer.at("channels")) {
    for (const auto& stream : streams_) {
      if (entry.at("channel") == stream.packets.channel()) list.push_back(entry);
    }
  }
  return list;
}

std::vector<Pose> starts_in(LiveClient& client, const Course& course) {
  const json arms = arms_of(client);
  std::vector<std::string> names;
  for (const auto& arm : arms) names.push_back(arm.at("arm").get<std::string>());
  std::vector<Pose> starts;
  for (const auto& hand : course.hands) {
    std::vector<Pose> poses;
    for (const auto& name : hand.start_at) {
      const auto found = std::find(names.begin(), names.end(), name);
      if (found == names.end()) {
        throw std::invalid_argument("course '" + course.name + "': the run has no arm '" + name + "'." +
                                    suggestion(name, names));
      }
      poses.push_back(pose_in(arms[static_cast<std::size_t>(found - names.begin())]));
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
                                  "' starts where an arm of a run is; without a run it needs 'start'");
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
