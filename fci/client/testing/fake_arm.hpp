#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <netinet/in.h>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "fci/wire/requests.hpp"
#include "fci/wire/state_layout.hpp"

namespace multipanda::fci {

// For tests: the other end of one arm's connection, without an arm. It answers as configured, stores the
// requests, and publishes a state on request of the test, or every millisecond.
class FakeArm {
 public:
  explicit FakeArm(int version, std::string address = "127.0.0.1");
  ~FakeArm();
  FakeArm(const FakeArm&) = delete;

  std::uint16_t port() const { return port_; }
  const std::string& address() const { return address_; }

  // --- script, before or while it is used ---
  void answer(Command command, Status status);  // instead of success
  void withhold(Command command);               // no answer at all
  void release(Command command);                // the answer to the last that was withheld, and to later ones
  void hang_up_on(int first, int count);        // `count` connections after the next `first` ones
  void report_ends_late();                      // of motions: after the answer to the next request
  void answer_in_pairs();                       // every second request is answered before its predecessor
  void change(const std::function<void(RobotState&)>& change);
  void set_model(std::string urdf);
  void set_automatic(bool on);  // states every millisecond; on from the start
  void end_motion(Status status, RobotMode mode, std::size_t error = kErrorCount);  // with a state if manual
  void send_bytes(const std::vector<std::byte>& bytes);                             // on the TCP connection
  void hang_up();

  // --- what it received ---
  struct Asked {
    Command command{};
    std::uint32_t command_id = 0;
    std::vector<std::byte> payload;
  };
  std::vector<Asked> asked() const;
  template <class Request>
  Request last() const {
    const auto all = asked();
    for (auto it = all.rbegin(); it != all.rend(); ++it) {
      Request request;
      if (it->command == Request::kCommand &&
          decode_request(*dialect_, it->payload, request) == WireResult::ok) {
        return request;
      }
    }
    throw std::runtime_error("no such request came");
  }

  // --- UDP, by the test ---
  std::uint64_t publish(std::uint64_t skip = 0);  // one state; its number. `skip`: numbers left out
  void publish_number(std::uint64_t id);          // out of order, or twice
  std::vector<std::byte> state_with(std::uint64_t id) const;  // for send_datagram()
  void send_datagram(const std::vector<std::byte>& datagram, const char* from_address);
  std::optional<RobotCommand> command(double timeout_s = 20);  // the next that came
  std::size_t commands_waiting();                              // without waiting

 private:
  void run();
  void serve(const MessageHeader& header, std::span<const std::byte> payload);
  void reply(Command command, std::uint32_t id, Status status, std::span<const std::byte> more = {});
  void write(const std::vector<std::byte>& bytes);
  void publish_locked(std::uint64_t id);
  void accept_client();
  void drop_client();

  const Dialect* dialect_;
  std::string address_;
  std::uint16_t port_ = 0;
  int listen_ = -1, client_ = -1, udp_ = -1;

  mutable std::mutex mutex_;
  RobotState state_;
  std::uint64_t id_ = 1000;
  sockaddr_in to_{};
  std::map<Command, Status> answers_;
  std::set<Command> withheld_;
  int skip_ = 0, closing_ = 0;
  bool ends_late_ = false;
  std::vector<std::uint32_t> late_ends_;
  bool in_pairs_ = false, automatic_ = true, ending_ = false;
  std::vector<std::byte> held_back_;
  std::string model_;
  std::vector<Asked> asked_;
  std::vector<std::byte> inbox_;
  std::optional<std::uint32_t> motion_id_;
  std::thread thread_;
};

}  // namespace multipanda::fci
