#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <netinet/in.h>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/types/gap_watch.hpp"
#include "fci/wire/commands.hpp"

namespace multipanda::fci {

// A failed call to an arm or gripper. The text names the arm, the cause and the remedy; `kind` is
// for programs.
class ConnectionError : public std::runtime_error {
 public:
  enum class Kind {
    unreachable,  // no connection could be established
    lost,         // the connection is lost; reconnect
    timeout,      // no answer in time; the connection was closed, because a late answer could be mistaken for
                  // another
    protocol,     // invalid bytes for this version; the connection was closed
    incompatible,  // protocol version not supported
    refused,       // the arm refused
    aborted        // a motion did not end as commanded
  };

  ConnectionError(Kind kind, const std::string& text) : std::runtime_error(text), kind_(kind) {}
  Kind kind() const { return kind_; }
  // The connection is unusable from now on.
  bool is_fatal() const { return kind_ != Kind::refused && kind_ != Kind::aborted; }

 private:
  Kind kind_;
};

// Throws ConnectionError, whose text begins with `who`.
in_addr resolve(const std::string& address, const std::string& who);

std::string in_seconds(double duration_s);  // "1.5 s", for messages

// Requests and replies over one TCP connection: each request has a number, its reply repeats it, and replies
// may arrive in any order; some requests get two. Every wait has a timeout. One thread at a time; off the
// loop. Failures throw ConnectionError, whose text begins with `who`; a fatal one closes the channel.
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
  // The oldest reply with this number; waits for it.
  Reply wait(std::uint32_t command_id, double timeout_s, const char* what);
  // The same without waiting; none: not yet received.
  std::optional<Reply> take(std::uint32_t command_id);
  // Drops a future reply with this number when it arrives.
  void forget(std::uint32_t command_id);
  // Reads received data without waiting. Throws if the other end has closed.
  void read_available();
  // Detects gaps of the thread that waits here. It checks before and after every other wait, and restarts
  // after steps that may take long in themselves.
  GapWatch& gaps() const { return gaps_; }

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
  mutable GapWatch gaps_;
  std::vector<std::byte> buffer_;
  std::deque<Reply> replies_;
  std::deque<std::uint32_t> forgotten_;  // numbers of replies to drop
};

}  // namespace multipanda::fci
