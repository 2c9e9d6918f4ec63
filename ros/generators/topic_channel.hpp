#pragma once

#include <condition_variable>
#include <diagnostic_msgs/msg/diagnostic_array.hpp>
#include <future>
#include <geometry_msgs/msg/pose_stamped.hpp>
#include <map>
#include <memory>
#include <multipanda_msgs/msg/robot_state.hpp>
#include <multipanda_msgs/srv/list_arms.hpp>
#include <multipanda_msgs/srv/list_controllets.hpp>
#include <mutex>
#include <sensor_msgs/msg/joint_state.hpp>
#include <string>
#include <vector>

#include "motion_generators/set_point_channel.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// Sends set-points to a run's inputs by topics. Queries the run's controllets and inputs, so that a wrong
// name is refused with a list of the valid ones.
class TopicChannel final : public SetPointChannel {
 public:
  // Throws std::runtime_error if no run of this name answers.
  explicit TopicChannel(const TopicArguments& arguments);
  ~TopicChannel() override;

  std::vector<Arm> arms(const std::vector<std::string>& names) override;
  Stream open(const std::string& controllet, const std::string& input, Quantity quantity) override;
  bool send(Stream stream, std::span<const double> values, std::int64_t time_ns) override;
  void rest() override;
  // Returns the number of samples sent, and from the run's /diagnostics the numbers received and refused
  // since then, with the last reason.
  nlohmann::json channels() override;

 private:
  using ListArms = multipanda_msgs::srv::ListArms;
  using ListControllets = multipanda_msgs::srv::ListControllets;
  using PoseStamped = geometry_msgs::msg::PoseStamped;
  using JointState = sensor_msgs::msg::JointState;
  using RobotState = multipanda_msgs::msg::RobotState;
  using DiagnosticArray = diagnostic_msgs::msg::DiagnosticArray;

  struct Counts {
    std::uint64_t received = 0, refused = 0;
    std::string reason;
  };
  struct Open {
    std::string controllet, input, topic;
    Quantity quantity;
    // One of the pair is used, depending on the quantity.
    std::unique_ptr<Publisher<PoseStamped>> pose, pose_goal;
    std::unique_ptr<Publisher<JointState>> joints, joints_goal;
    PoseStamped pose_message;
    JointState joints_message;
    std::uint64_t sent = 0;
    bool has_subscriber = true;  // there is a subscriber
    Counts before;               // counts of the input when it was opened
  };

  template <class S>
  typename S::Response ask(Client<S>& client, const std::string& what);
  template <class M>
  void make(Open& open, std::unique_ptr<Publisher<M>>& stream, std::unique_ptr<Publisher<M>>& goal);
  void take(const DiagnosticArray& message);
  Counts counts_of(const Open& open);  // with mutex_ held

  std::string run_, name_space_;  // "/multipanda"; "" or "/cell"
  Context context_;
  Node node_;
  Executor executor_;
  Client<ListArms> list_arms_;
  Client<ListControllets> list_controllets_;
  std::unique_ptr<ListControllets::Response> controllets_;
  std::vector<std::unique_ptr<Open>> streams_;

  std::mutex mutex_;
  std::condition_variable arrived_;
  std::map<std::string, Counts> counts_;  // "dual/common_pose"; guarded by mutex_
  std::uint64_t diagnostics_ = 0;         // number of messages so far; guarded by mutex_
  Subscription<DiagnosticArray> diagnostics_in_;
};

}  // namespace multipanda::ros
