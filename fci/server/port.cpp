#include "fci/server/port.hpp"

#include <array>
#include <cerrno>
#include <sys/epoll.h>
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
    // A port may have closed this descriptor while an earlier one of the same round was served.
    const auto& event = events[static_cast<std::size_t>(i)];
    Port* port = ports_[static_cast<std::size_t>(event.data.fd)];
    if (port != nullptr) port->ready(event.data.fd, event.events);
  }
  return count < 0 ? 0 : count;
}

}  // namespace multipanda::fci
