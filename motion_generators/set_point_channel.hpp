#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/reference/target.hpp"
#include "core/types/joints.hpp"
#include "runtime/live_input/client.hpp"

namespace multipanda {

// The channel from a generator to a run: its live-input socket (LiveInputChannel) or ROS topics. One thread.
// Members throw std::invalid_argument if the run refuses a request (no such arm, controllet or input) and
// std::runtime_error if the run does not answer.
class SetPointChannel {
 public:
  struct Arm {
    Pose X_WE;
    JointVector q;  // (n x 1) [rad]
  };
  using Stream = std::size_t;  // numbered from 0

  virtual ~SetPointChannel() = default;
  // The current state of these arms.
  virtual std::vector<Arm> arms(const std::vector<std::string>& names) = 0;
  // Opens a stream of set-points to an input. Poses are in the world.
  virtual Stream open(const std::string& controllet, const std::string& input, Quantity quantity) = 0;
  // Sends the newest set-point, values as in a Target. Never waits or throws. Returns false if it
  // was not delivered.
  virtual bool send(Stream stream, std::span<const double> values, std::int64_t time_ns) = 0;
  // Sends each stream's newest set-point as a goal, so that the end of the stream is not taken for a lost
  // publisher. Skips inputs whose controllet is not active.
  virtual void rest() = 0;
  // One object per stream, in order, with the delivery counts that this channel knows.
  virtual nlohmann::json channels() = 0;
};

// Sends set-points to a running scene by packets over its live-input socket.
class LiveInputChannel final : public SetPointChannel {
 public:
  explicit LiveInputChannel(const std::filesystem::path& socket);

  std::vector<Arm> arms(const std::vector<std::string>& names) override;
  Stream open(const std::string& controllet, const std::string& input, Quantity quantity) override;
  bool send(Stream stream, std::span<const double> values, std::int64_t time_ns) override;
  void rest() override;
  // The run's counts for each stream: received, lost, refused, ... (docs/live_input.md).
  nlohmann::json channels() override;

 private:
  struct Open {
    std::string controllet, input;
    Quantity quantity;
    ReferenceStream packets;
    std::vector<double> newest;
  };
  LiveClient client_;
  std::vector<Open> streams_;
};

// The run on ROS 2 and the name of this node.
struct TopicArguments {
  std::string node = "/multipanda";  // node of the run, with its namespace
  std::string own_node = "multipanda_generator";
  std::vector<std::string> remaps;  // "a:=b"
};

// Sends set-points to a run's inputs by topics (`multipanda run SCENE --ros`). Its own node publishes
// <node>/<controllet>/<input> and, in rest(), .../goal. Loads the ROS module of this build. Throws
// std::runtime_error if there is no module, or if no such run answers within 15 s.
std::unique_ptr<SetPointChannel> make_topic_link(const TopicArguments& arguments);

}  // namespace multipanda
