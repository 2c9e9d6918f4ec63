#pragma once

#include <cstddef>
#include <cstdint>
#include <netinet/in.h>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "fci/server/port.hpp"

// Sockets of the virtual arms: non-blocking, IPv4.
namespace multipanda::fci {

// Owns a descriptor; -1: none.
class Socket {
 public:
  explicit Socket(int file = -1) : file_(file) {}
  Socket(Socket&& other) noexcept : file_(std::exchange(other.file_, -1)) {}
  Socket& operator=(Socket&& other) noexcept;
  ~Socket() { close(); }

  int file() const { return file_; }
  explicit operator bool() const { return file_ >= 0; }
  void close();

 private:
  int file_;
};

// "127.0.0.1" -> an address with this port. Throws std::invalid_argument.
sockaddr_in ipv4(const std::string& address, std::uint16_t port);
bool is_loopback(const std::string& address);

// A listening TCP socket. `what`: "arm left", for messages. Throws std::runtime_error with address, port,
// reason and remedy.
Socket listen_on(const std::string& address, std::uint16_t port, std::string_view what);
// The actual port; it differs from the requested one if that was 0.
std::uint16_t port_of(const Socket& socket);

// A UDP socket on `address`, a free port, connected to `peer`: datagrams of others never arrive.
Socket udp_between(const std::string& address, const sockaddr_in& peer);

// Receives the next datagram of a socket from udp_between(). Returns its size, or -1 if there is none.
// `stamp_ns`, if not nullptr, gets the arrival time on the clock of stamp_clock_ns().
std::ptrdiff_t receive_stamped(const Socket& socket, std::span<std::byte> into, std::int64_t* stamp_ns);
std::int64_t stamp_clock_ns();

// One client's TCP connection. Data that cannot be sent at once is kept, within a bound, and sent by
// the loop later.
class TcpStream {
 public:
  // `port` gets the events; the socket is in `poll` as long as this lives.
  TcpStream(Socket socket, const sockaddr_in& peer, Poll& poll, Port& port);
  ~TcpStream();
  TcpStream(const TcpStream&) = delete;
  TcpStream& operator=(const TcpStream&) = delete;

  int file() const { return socket_.file(); }
  const sockaddr_in& peer() const { return peer_; }

  // Bytes received, at most `into`; 0: nothing available, or the end (broken()).
  std::size_t receive(std::span<std::byte> into);
  // Sends one message in one piece, because programs need a whole header at once. The stream is broken if
  // more than kMostUnsent bytes would wait.
  void send(std::span<const std::byte> message, std::span<const std::byte> rest = {});
  void flush();  // on EPOLLOUT
  bool all_sent() const { return sent_ == out_.size(); }
  // Whether the other end is gone.
  bool broken() const { return broken_; }
  bool peer_has_closed() const;  // looks without reading
  void watch(bool on);           // whether the loop waits for data of this client
  static constexpr std::size_t kMostUnsent = 4u << 20;

 private:
  Socket socket_;
  sockaddr_in peer_;
  Poll& poll_;
  Port& port_;
  bool watched_ = true;
  std::vector<std::byte> out_;
  std::size_t sent_ = 0;
  bool broken_ = false, watches_room_ = false;
};

// Takes a waiting client from a listening socket; none: no client waits.
struct Accepted {
  Socket socket;
  sockaddr_in peer{};
};
std::optional<Accepted> accept_from(const Socket& listener);

}  // namespace multipanda::fci
