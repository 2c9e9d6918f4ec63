#include "fci/server/sockets.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdexcept>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/timerfd.h>
#include <system_error>
#include <unistd.h>

namespace multipanda::fci {
namespace {

void control(int poll, int what, int file, std::uint32_t events) {
  epoll_event event{};
  event.events = events;
  event.data.fd = file;
  if (epoll_ctl(poll, what, file, &event) != 0)
    throw std::system_error(errno, std::system_category(), "epoll");
}

const sockaddr* generic(const sockaddr_in& address) { return reinterpret_cast<const sockaddr*>(&address); }

void set(int file, int level, int option, int value) {
  ::setsockopt(file, level, option, &value, sizeof(value));
}

Socket new_socket(int type) {
  Socket socket(::socket(AF_INET, type | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!socket) throw std::system_error(errno, std::system_category(), "no new socket");
  return socket;
}

std::string cure(int error) {
  switch (error) {
    case EADDRINUSE:
      return "another program listens there: end it or choose another address with --bind";
    case EADDRNOTAVAIL:
      return "no network interface of this computer has that address: choose one of 127.0.0.1, 127.0.0.2, "
             "... or of 'ip address'";
    case EACCES:
      return "ports below 1024 are reserved: choose a higher one";
    default:
      return "choose another address with --bind";
  }
}

Socket checked(int file, const char* what) {
  if (file < 0) throw std::system_error(errno, std::system_category(), what);
  return Socket(file);
}

void empty(int file) {
  std::uint64_t count = 0;
  [[maybe_unused]] const auto size = ::read(file, &count, sizeof(count));
}

}  // namespace

Poll::Poll() : file_(epoll_create1(EPOLL_CLOEXEC)) {
  if (file_ < 0) throw std::system_error(errno, std::system_category(), "epoll");
}

Poll::~Poll() { ::close(file_); }

void Poll::add(int file, std::uint32_t events, Port& port) {
  const auto i = static_cast<std::size_t>(file);
  if (i >= ports_.size()) ports_.resize(i + 1, nullptr);
  control(file_, EPOLL_CTL_ADD, file, events);
  ports_[i] = &port;
}

void Poll::change(int file, std::uint32_t events) { control(file_, EPOLL_CTL_MOD, file, events); }

void Poll::remove(int file) {
  ports_[static_cast<std::size_t>(file)] = nullptr;
  epoll_ctl(file_, EPOLL_CTL_DEL, file, nullptr);
}

int Poll::serve(int timeout_ms) {
  std::array<epoll_event, 32> events;
  const int count = epoll_wait(file_, events.data(), static_cast<int>(events.size()), timeout_ms);
  for (int i = 0; i < count; ++i) {
    // An earlier port of the same round may have closed this descriptor.
    const auto& event = events[static_cast<std::size_t>(i)];
    Port* port = ports_[static_cast<std::size_t>(event.data.fd)];
    if (port != nullptr) port->ready(event.data.fd, event.events);
  }
  return count < 0 ? 0 : count;
}

Socket& Socket::operator=(Socket&& other) noexcept {
  if (this != &other) {
    close();
    file_ = std::exchange(other.file_, -1);
  }
  return *this;
}

void Socket::close() {
  if (file_ >= 0) ::close(std::exchange(file_, -1));
}

sockaddr_in ipv4(const std::string& address, std::uint16_t port) {
  sockaddr_in result{};
  result.sin_family = AF_INET;
  result.sin_port = htons(port);
  if (inet_pton(AF_INET, address.c_str(), &result.sin_addr) != 1) {
    throw std::invalid_argument("'" + address +
                                "' is not a valid IPv4 address; expected four numbers, such as 127.0.0.1");
  }
  return result;
}

bool is_loopback(const std::string& address) {
  return (ntohl(ipv4(address, 0).sin_addr.s_addr) >> 24) == 127;
}

Socket listen_on(const std::string& address, std::uint16_t port, std::string_view what) {
  const sockaddr_in place = ipv4(address, port);
  Socket socket = new_socket(SOCK_STREAM);
  set(socket.file(), SOL_SOCKET, SO_REUSEADDR, 1);  // connections of an earlier server may still linger
  if (::bind(socket.file(), generic(place), sizeof(place)) != 0 || ::listen(socket.file(), 64) != 0) {
    const int error = errno;
    throw std::runtime_error(std::string(what) + " cannot listen on " + address + ":" + std::to_string(port) +
                             ": " + std::strerror(error) + "; " + cure(error));
  }
  return socket;
}

std::uint16_t port_of(const Socket& socket) {
  sockaddr_in place{};
  socklen_t size = sizeof(place);
  ::getsockname(socket.file(), reinterpret_cast<sockaddr*>(&place), &size);
  return ntohs(place.sin_port);
}

Socket udp_between(const std::string& address, const sockaddr_in& peer) {
  const sockaddr_in here = ipv4(address, 0);
  Socket socket = new_socket(SOCK_DGRAM);
  if (::bind(socket.file(), generic(here), sizeof(here)) != 0 ||
      ::connect(socket.file(), generic(peer), sizeof(peer)) != 0) {
    throw std::system_error(errno, std::system_category(), "UDP from " + address);
  }
  set(socket.file(), SOL_SOCKET, SO_TIMESTAMPNS, 1);
  return socket;
}

std::ptrdiff_t receive_stamped(const Socket& socket, std::span<std::byte> into, std::int64_t* stamp_ns) {
  if (stamp_ns == nullptr) return ::recv(socket.file(), into.data(), into.size(), 0);
  iovec place{.iov_base = into.data(), .iov_len = into.size()};
  alignas(cmsghdr) std::array<std::byte, 128> control;
  msghdr message{};
  message.msg_iov = &place;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  const auto size = ::recvmsg(socket.file(), &message, 0);
  if (size < 0) return size;
  for (cmsghdr* part = CMSG_FIRSTHDR(&message); part != nullptr; part = CMSG_NXTHDR(&message, part)) {
    if (part->cmsg_level != SOL_SOCKET || part->cmsg_type != SCM_TIMESTAMPNS) continue;
    timespec stamp{};
    std::memcpy(&stamp, CMSG_DATA(part), sizeof(stamp));
    *stamp_ns = stamp.tv_sec * 1'000'000'000 + stamp.tv_nsec;
  }
  return size;
}

std::int64_t stamp_clock_ns() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  return now.tv_sec * 1'000'000'000 + now.tv_nsec;
}

TcpStream::TcpStream(Socket socket, const sockaddr_in& peer, Poll& poll, Port& port)
    : socket_(std::move(socket)), peer_(peer), poll_(poll), port_(port) {
  const int file = socket_.file();
  set(file, IPPROTO_TCP, TCP_NODELAY, 1);
  // Detects a lost client computer within about 4 s, as libfranka detects a lost arm.
  set(file, SOL_SOCKET, SO_KEEPALIVE, 1);
  set(file, IPPROTO_TCP, TCP_KEEPIDLE, 1);
  set(file, IPPROTO_TCP, TCP_KEEPINTVL, 1);
  set(file, IPPROTO_TCP, TCP_KEEPCNT, 3);
  set(file, IPPROTO_TCP, TCP_USER_TIMEOUT, 4000);
  out_.reserve(4096);
  poll_.add(file, EPOLLIN, port);
}

TcpStream::~TcpStream() {
  if (watched_) poll_.remove(socket_.file());
}

std::size_t TcpStream::receive(std::span<std::byte> into) {
  const auto count = ::recv(socket_.file(), into.data(), into.size(), 0);
  if (count > 0) return static_cast<std::size_t>(count);
  if (count == 0 || (errno != EAGAIN && errno != EINTR)) broken_ = true;
  return 0;
}

void TcpStream::send(std::span<const std::byte> message, std::span<const std::byte> rest) {
  if (broken_) return;
  if (out_.size() - sent_ + message.size() + rest.size() > kMostUnsent) {
    broken_ = true;
    return;
  }
  if (sent_ == out_.size()) {
    out_.clear();
    sent_ = 0;
  }
  out_.insert(out_.end(), message.begin(), message.end());
  out_.insert(out_.end(), rest.begin(), rest.end());
  flush();
}

void TcpStream::flush() {
  while (!broken_ && sent_ < out_.size()) {
    const auto count = ::send(socket_.file(), out_.data() + sent_, out_.size() - sent_, MSG_NOSIGNAL);
    if (count > 0) {
      sent_ += static_cast<std::size_t>(count);
    } else if (errno == EAGAIN) {
      break;
    } else if (errno != EINTR) {
      broken_ = true;
    }
  }
  const bool waits = !broken_ && sent_ < out_.size();
  if (watched_ && waits != watches_room_) {
    poll_.change(socket_.file(), waits ? EPOLLIN | EPOLLOUT : EPOLLIN);
    watches_room_ = waits;
  }
}

bool TcpStream::peer_has_closed() const {
  pollfd look{.fd = socket_.file(), .events = POLLRDHUP, .revents = 0};
  return ::poll(&look, 1, 0) > 0;
}

void TcpStream::watch(bool on) {
  if (on == watched_) return;
  watched_ = on;
  watches_room_ = false;
  if (on) {
    poll_.add(socket_.file(), EPOLLIN, port_);
    flush();
  } else {
    poll_.remove(socket_.file());
  }
}

std::optional<Accepted> accept_from(const Socket& listener) {
  Accepted result;
  socklen_t size = sizeof(result.peer);
  result.socket = Socket(::accept4(listener.file(), reinterpret_cast<sockaddr*>(&result.peer), &size,
                                   SOCK_NONBLOCK | SOCK_CLOEXEC));
  if (!result.socket) return std::nullopt;
  return result;
}

WakeTimer::WakeTimer()
    : file_(checked(timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC), "timer")) {}

void WakeTimer::open(Poll& poll) { poll.add(file_.file(), EPOLLIN, *this); }

void WakeTimer::ready(int file, std::uint32_t) {
  empty(file);
  armed_ = false;
}

void WakeTimer::set(HostTime at) {
  at_ = at;
  armed_ = true;
  const std::int64_t ns = std::max<std::int64_t>(at.ns, 1);  // zero would disable it
  itimerspec spec{};
  spec.it_value.tv_sec = ns / 1'000'000'000;
  spec.it_value.tv_nsec = ns % 1'000'000'000;
  timerfd_settime(file_.file(), TFD_TIMER_ABSTIME, &spec, nullptr);
}

WakeWord::WakeWord() : file_(checked(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC), "event")) {}

void WakeWord::open(Poll& poll) { poll.add(file_.file(), EPOLLIN, *this); }

void WakeWord::ready(int file, std::uint32_t) { empty(file); }

void WakeWord::call() const {
  const std::uint64_t one = 1;
  [[maybe_unused]] const auto size = ::write(file_.file(), &one, sizeof(one));
}

}  // namespace multipanda::fci
