#include "motion_generators/set_point_channel.hpp"

#include <algorithm>
#include <chrono>
#include <stdexcept>
#include <thread>

#include "common/text.hpp"

namespace multipanda {
namespace {

using nlohmann::json;

SetPointChannel::Arm arm_in(const json& state) {
  const auto p = state.at("position_m").get<std::vector<double>>();
  const auto r = state.at("quaternion_wxyz").get<std::vector<double>>();
  const auto q = state.at("q_rad").get<std::vector<double>>();
  return {Pose::from({p.at(0), p.at(1), p.at(2)}, Quaternion(r.at(0), r.at(1), r.at(2), r.at(3))),
          JointVector::Map(q.data(), static_cast<Eigen::Index>(q.size()))};
}

// The arms' state. Waits for the loop's first cycle.
json state_of(LiveClient& client) {
  for (int tries = 0; tries < 100; ++tries) {
    json arms = client.ask({{"do", "state"}}).at("state").at("arms");
    if (!arms.empty()) return arms;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  throw std::runtime_error("the run has not completed its first cycle within 2 s");
}

}  // namespace

LiveInputChannel::LiveInputChannel(const std::filesystem::path& socket) : client_(socket) {}

std::vector<SetPointChannel::Arm> LiveInputChannel::arms(const std::vector<std::string>& names) {
  const json state = state_of(client_);
  std::vector<std::string> known;
  for (const auto& arm : state) known.push_back(arm.at("arm").get<std::string>());
  std::vector<Arm> list;
  for (const auto& name : names) {
    const auto found = std::find(known.begin(), known.end(), name);
    if (found == known.end())
      throw std::invalid_argument("the run has no arm '" + name + "'" +
                                  name_hint(name, known, "there are none"));
    list.push_back(arm_in(state[static_cast<std::size_t>(found - known.begin())]));
  }
  return list;
}

SetPointChannel::Stream LiveInputChannel::open(const std::string& controllet, const std::string& input,
                                               Quantity quantity) {
  const std::string frame = quantity == Quantity::pose ? "world" : "";
  streams_.push_back({controllet, input, quantity, client_.open_stream(controllet, input, frame), {}});
  return streams_.size() - 1;
}

bool LiveInputChannel::send(Stream stream, std::span<const double> values, std::int64_t time_ns) {
  Open& open = streams_[stream];
  open.newest.assign(values.begin(), values.end());
  return open.packets.send(values, time_ns);
}

void LiveInputChannel::rest() {
  // A packet that arrived after the goal would restart the stream, so wait until none is in flight.
  json before, now = channels();
  do {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    before = std::move(now);
    now = channels();
  } while (now != before);
  for (const auto& stream : streams_) {
    const auto& v = stream.newest;
    if (v.empty()) continue;
    json request{{"do", "reference"}, {"controllet", stream.controllet}, {"input", stream.input}};
    if (stream.quantity == Quantity::pose) {
      request.update({{"position_m", {v[0], v[1], v[2]}}, {"quaternion_wxyz", {v[3], v[4], v[5], v[6]}}});
    } else {
      request["q_rad"] = v;
    }
    (void)client_.ask(request);
  }
}

json LiveInputChannel::channels() {
  const json answer = client_.ask({{"do", "channels"}});
  json list = json::array();
  for (const auto& entry : answer.at("channels")) {
    for (const auto& stream : streams_) {
      if (entry.at("channel") == stream.packets.channel()) list.push_back(entry);
    }
  }
  return list;
}

}  // namespace multipanda
