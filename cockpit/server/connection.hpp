#pragma once

#include <string>
#include <string_view>

#include "core/types/time.hpp"

namespace multipanda::cockpit {

// The bytes of one connection. Nothing waits: what does not fit into the socket waits here.
class Connection {
 public:
  explicit Connection(int file) : file_(file) {}
  ~Connection();
  Connection(const Connection&) = delete;

  int file() const { return file_; }
  // Takes what has come, at most `longest` unread bytes altogether. Returns whether something came.
  bool receive(std::size_t longest);
  std::string& received() { return in_; }  // not used yet
  void send(std::string_view bytes) {
    if (!broken_) out_ += bytes;
  }
  void flush();
  std::size_t unsent() const { return out_.size() - sent_; }
  // By the other side, or broken; everything that came before has been received.
  bool ended() const { return ended_; }

 private:
  int file_;
  std::string in_, out_;
  std::size_t sent_ = 0;                 // of out_
  bool ended_ = false, broken_ = false;  // nothing more can be received; be sent
};

// A socket that listens on 127.0.0.1; port 0: any free one. Returns it and its port. Throws
// std::runtime_error.
std::pair<int, std::uint16_t> listen_on_loopback(std::uint16_t port);

}  // namespace multipanda::cockpit
