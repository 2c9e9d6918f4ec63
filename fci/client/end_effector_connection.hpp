#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <netinet/in.h>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "fci/client/end_effector.hpp"
#include "fci/client/state_intake.hpp"
#include "fci/client/tcp_channel.hpp"

namespace multipanda::fci {

// The protocol of a gripper or vacuum gripper.
class EndEffectorProtocol {
 public:
  virtual ~EndEffectorProtocol() = default;
  virtual bool is_vacuum() const = 0;
  virtual std::uint16_t version() const = 0;
  // A whole message with this number, header included. 0: a request for the other kind of gripper. `why` gets
  // the reason if the request is invalid.
  virtual std::size_t encode(const GripperRequest& request, std::uint32_t command_id, std::span<std::byte> to,
                             std::string& why) const = 0;
  // Timeout of the request [s].
  virtual double patience_s(const GripperRequest& request) const = 0;
  // message_id and state of a datagram; 0: invalid.
  virtual std::uint32_t decode_state(std::span<const std::byte> datagram,
                                     multipanda::GripperState& state) const = 0;
};

// The connection of one gripper: its thread sends requests, matches replies in any order, and reads the
// states. A stop is sent at once.
//
// Widths to follow: the protocol has whole motions only, so the newest width is sent as a move when none runs
// and the last one was at least 2 mm away; what ends a closing move early is grasped. In silence a move that
// runs is replaced by one to the present width: a stop would switch the motor off. It is stopped all
// the same if that width is not known, as is a grasp that holds nothing yet. Nothing follows without states.
//
// connect(), request() from any thread; state() from the loop.
class EndEffectorConnection final : public EndEffector {
 public:
  // `who`: for messages, "the gripper of arm left". `address`: IPv4 or host name.
  EndEffectorConnection(std::string who, std::string address, std::uint16_t port,
                        std::unique_ptr<EndEffectorProtocol> protocol);
  ~EndEffectorConnection() override;

  // Throws ConnectionError. Pending requests of the old connection are answered as lost.
  void connect() override;
  bool is_vacuum() const override { return protocol_->is_vacuum(); }
  std::future<RequestAnswer> request(const GripperRequest& request) override;
  multipanda::GripperState state() const noexcept override;

  // Number of the newest state; 0: none yet.
  std::uint32_t state_number() const { return number_.load(std::memory_order_acquire); }

 private:
  struct Request {
    std::vector<std::byte> message;
    std::uint32_t command_id = 0;
    HostTime give_up{};
    std::promise<RequestAnswer> answer;
    bool follows = false;  // belongs to the widths that are followed
    bool grasps = false;   // of these: what ended a move
  };
  std::string begin(const GripperRequest& request, Request entry);
  void follow();
  void hold();
  bool is_stale() const;  // its states do not arrive
  void run();
  void disconnect(const std::string& why);
  void read_states();
  void answer_requests();

  std::string who_, address_;
  std::uint16_t port_;
  std::unique_ptr<EndEffectorProtocol> protocol_;
  TcpChannel channel_;
  int udp_ = -1, wake_ = -1;

  std::mutex mutex_;  // protects the following members and, while connected_, channel_
  std::vector<Request> running_;
  std::optional<GripperFollow> following_;
  HostTime follow_until_{};
  double sent_width_ = 0;  // of the last move to a followed width [m]
  bool blocked_ = false;   // that move ended before its width
  std::string failed_;     // why a followed width failed; empty: it did not, or the reason was given
  bool connected_ = false;
  std::atomic<bool> ending_{false};
  std::thread thread_;

  DatagramOrder order_;  // of the states; the connection's thread
  // The last reported values. Separate atomics: the loop must not wait, and mixed values are harmless.
  std::atomic<std::uint32_t> number_{0};
  std::atomic<std::int64_t> state_ns_{0};  // host time of the newest state; 0: none yet
  std::atomic<double> width_{0}, max_width_{0};
  std::atomic<bool> present_{false}, grasped_{false}, moving_{false};
};

}  // namespace multipanda::fci
