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

#include "core/types/time.hpp"

namespace multipanda::fci {

class Port;

// The descriptors that the virtual arms' loop waits for, with their ports. One thread. Only add()
// may allocate.
class Poll {
 public:
  Poll();  // throws std::system_error
  ~Poll();
  Poll(const Poll&) = delete;
  Poll& operator=(const Poll&) = delete;

  // `events`: EPOLLIN, EPOLLOUT, level-triggered. Throws std::system_error.
  void add(int file, std::uint32_t events, Port& port);
  void change(int file, std::uint32_t events);
  void remove(int file);  // before the descriptor is closed

  // Waits at most `timeout_ms` (-1: forever) and passes ready descriptors to their ports.
  // Returns their count.
  int serve(int timeout_ms);

 private:
  int file_;
  std::vector<Port*> ports_;  // by descriptor; nullptr: none
};

// A part of the single-threaded loop of the virtual arms with descriptors: the control port of an arm, its
// gripper, the loop's timer. All calls come from the loop's thread and must not block.
class Port {
 public:
  virtual ~Port() = default;
  // Binds, listens, and puts its descriptors into `poll`, which outlives it. Throws std::runtime_error with
  // address, port and remedy.
  virtual void open(Poll& /*poll*/) {}
  // A descriptor of this port is ready; `events` as epoll has them.
  virtual void ready(int file, std::uint32_t events) = 0;
  // The world has advanced by one period of 1 ms; `period` counts them. No allocation.
  virtual void stepped(std::int64_t /*period*/) {}
};

// Sockets of the virtual arms: non-blocking, IPv4.

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
  // Sends one message in one piece, because programs expect a whole header at once. The stream is broken if
  // more than kMostUnsent bytes would wait.
  void send(std::span<const std::byte> message, std::span<const std::byte> rest = {});
  void flush();  // on EPOLLOUT
  bool all_sent() const { return sent_ == out_.size(); }
  // Whether the other end has closed.
  bool broken() const { return broken_; }
  bool peer_has_closed() const;  // checks without reading
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

// Accepts a waiting client from a listening socket; none: no client waits.
struct Accepted {
  Socket socket;
  sockaddr_in peer{};
};
std::optional<Accepted> accept_from(const Socket& listener);

// A time on the steady clock at which the loop wakes. One thread.
class WakeTimer : public Port {
 public:
  WakeTimer();  // throws std::system_error
  void open(Poll& poll) override;
  void ready(int file, std::uint32_t events) override;
  // Wakes at `at` or before. A past time wakes at once.
  void ensure(HostTime at) {
    if (!armed_ || at < at_) set(at);
  }

 private:
  void set(HostTime at);

  Socket file_;
  HostTime at_;
  bool armed_ = false;
};

// A wake-up from another thread.
class WakeWord : public Port {
 public:
  WakeWord();  // throws std::system_error
  void open(Poll& poll) override;
  void ready(int file, std::uint32_t events) override;
  void call() const;  // any thread

 private:
  Socket file_;
};

}  // namespace multipanda::fci
