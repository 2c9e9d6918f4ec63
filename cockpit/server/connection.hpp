#pragma once

#include <string>
#include <string_view>

namespace multipanda::cockpit {

// The bytes of one connection. Non-blocking: data that do not fit into the socket wait here.
class Connection {
 public:
  explicit Connection(int file) : file_(file) {}
  ~Connection();
  Connection(const Connection&) = delete;

  int file() const { return file_; }
  // Reads received data, at most `longest` unread bytes in total. Returns whether there were any.
  bool receive(std::size_t longest);
  std::string& received() { return in_; }  // not yet processed
  void send(std::string_view bytes) {
    if (!broken_) out_ += bytes;
  }
  void flush();
  std::size_t unsent() const { return out_.size() - sent_; }
  // By the other side, or broken; everything received before is available.
  bool ended() const { return ended_; }

 private:
  int file_;
  std::string in_, out_;
  std::size_t sent_ = 0;                 // of out_
  bool ended_ = false, broken_ = false;  // nothing more can be received; be sent
};

}  // namespace multipanda::cockpit
