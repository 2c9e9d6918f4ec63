#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <netinet/in.h>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "fci/client/end_effector.hpp"
#include "fci/client/tcp_channel.hpp"

namespace multipanda::fci {

// What differs between a gripper's and a vacuum gripper's connection.
class EndEffectorProtocol {
 public:
  virtual ~EndEffectorProtocol() = default;
  virtual bool is_vacuum() const = 0;
  virtual std::uint16_t version() const = 0;
  // A whole message with this number, header included. 0: not a request of this kind; a text in `why`: one
  // that cannot be meant.
  virtual std::size_t encode(const ArmRequest& request, std::uint32_t command_id, std::span<std::byte> to,
                             std::string& why) const = 0;
  // The longest that it may take [s].
  virtual double patience_s(const ArmRequest& request) const = 0;
  // message_id and state of a datagram; 0: it is none.
  virtual std::uint32_t decode_state(std::span<const std::byte> datagram,
                                     multipanda::GripperState& state) const = 0;
};

// The connection of one gripper: its thread sends requests, matches replies to them in whatever order they
// come, and reads the states. A stop goes out at once, whatever runs.
//
// connect(), request() from any thread; state() from the loop.
class EndEffectorLink final : public EndEffector {
 public:
  // `who`: for messages, "the gripper of arm left". `address`: IPv4 or host name.
  EndEffectorLink(std::string who, std::string address, std::uint16_t port,
                  std::unique_ptr<EndEffectorProtocol> protocol);
  ~EndEffectorLink() override;

  // Throws LinkError. Requests that run on the old connection are answered as lost.
  void connect() override;
  bool is_vacuum() const override { return protocol_->is_vacuum(); }
  std::future<ArmAnswer> request(const ArmRequest& request) override;
  multipanda::GripperState state() const noexcept override;

  // Number of the newest state; 0: none yet.
  std::uint32_t state_number() const { return number_.load(std::memory_order_acquire); }

 private:
  struct Request {
    std::vector<std::byte> message;
    std::uint32_t command_id = 0;
    HostTime give_up{};
    std::promise<ArmAnswer> answer;
  };
  void run();
  void disconnect(const std::string& why);
  void read_states();
  void answer_requests();

  std::string who_, address_;
  std::uint16_t port_;
  std::unique_ptr<EndEffectorProtocol> protocol_;
  TcpChannel channel_;
  int udp_ = -1, wake_ = -1;

  std::mutex mutex_;  // of what follows, and of channel_
  std::vector<Request> running_;
  bool connected_ = false;
  std::atomic<bool> ending_{false};
  std::thread thread_;

  // As last reported; single words, since the loop may not wait and half-new figures do no harm.
  std::atomic<std::uint32_t> number_{0};
  std::atomic<double> width_{0}, max_width_{0};
  std::atomic<bool> present_{false}, grasped_{false}, moving_{false};
};

}  // namespace multipanda::fci
