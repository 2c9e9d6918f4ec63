#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "fci/client/connection_error.hpp"
#include "fci/wire/commands.hpp"

namespace multipanda::fci {

std::string in_seconds(double duration_s);  // "1.5 s", for messages

// Requests and replies over one TCP connection: each request has a number, its reply repeats it, and replies
// may come in any order; some requests get two. Every wait has a timeout. One thread at a time; off the loop.
// Failures throw ConnectionError, whose text begins with `who`; a fatal one closes the channel.
class TcpChannel {
 public:
  TcpChannel(HeaderKind kind, std::string who) : kind_(kind), who_(std::move(who)) {}
  ~TcpChannel() { close(); }
  TcpChannel(const TcpChannel&) = delete;
  TcpChannel& operator=(const TcpChannel&) = delete;

  // `address`: IPv4 or a host name. Numbers of requests begin at 0 again.
  void connect(const std::string& address, std::uint16_t port, double timeout_s);
  void close() noexcept;
  bool is_open() const { return file_ >= 0; }
  int file() const { return file_; }  // for poll(); -1: closed
  // Address of the other end, in network byte order.
  std::uint32_t peer_address() const { return peer_address_; }

  // The number that the next request must carry.
  std::uint32_t next_id() const { return next_id_; }
  // A whole message with that number, header included.
  void send(std::span<const std::byte> message, double timeout_s);

  struct Reply {
    std::uint32_t command = 0, command_id = 0;
    std::vector<std::byte> payload;
  };
  // The oldest reply with this number. Waits for it.
  Reply wait(std::uint32_t command_id, double timeout_s, const char* what);
  // The same without waiting; none: not yet received.
  std::optional<Reply> take(std::uint32_t command_id);
  // A reply with this number that is yet to come is of no interest: it is dropped when it arrives.
  void forget(std::uint32_t command_id);
  // Reads what has arrived without waiting. Throws if the other end closed.
  void read_available();

 private:
  [[noreturn]] void fail(ConnectionError::Kind kind, const std::string& text);
  void parse();
  bool wait_for(short events, double timeout_s) const;

  // Upper bound of a message (a model library has some megabytes).
  static constexpr std::uint32_t kMaxMessage = 64u << 20u;
  static constexpr std::size_t kMaxReplies = 256;    // unclaimed replies
  static constexpr std::size_t kMaxForgotten = 256;  // replies that may never come

  HeaderKind kind_;
  std::string who_;
  int file_ = -1;
  std::uint32_t peer_address_ = 0;
  std::uint32_t next_id_ = 0;
  std::vector<std::byte> buffer_;
  std::deque<Reply> replies_;
  std::deque<std::uint32_t> forgotten_;  // numbers of replies to drop
};

}  // namespace multipanda::fci
