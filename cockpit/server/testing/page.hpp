#pragma once

#include <arpa/inet.h>
#include <array>
#include <cstdint>
#include <netinet/in.h>
#include <optional>
#include <poll.h>
#include <string>
#include <string_view>
#include <sys/socket.h>
#include <unistd.h>

namespace multipanda::cockpit::test {

enum class Opcode : std::uint8_t { text = 1, binary = 2, close = 8, ping = 9, pong = 10 };

// A frame as a browser sends it: whole and masked (RFC 6455, section 5.2).
inline std::string client_frame(Opcode opcode, std::string_view data) {
  constexpr std::array<char, 4> kMask{'\x5a', '\x13', '\x00', '\x7f'};
  std::string frame{static_cast<char>(0x80 | static_cast<int>(opcode))};
  if (data.size() < 126) {
    frame += static_cast<char>(0x80 | data.size());
  } else {
    frame +=
        {static_cast<char>(0x80 | 126), static_cast<char>(data.size() >> 8), static_cast<char>(data.size())};
  }
  frame.append(kMask.data(), kMask.size());
  for (std::size_t i = 0; i < data.size(); ++i) frame += static_cast<char>(data[i] ^ kMask[i % 4]);
  return frame;
}

// A client on a real socket. It waits until something comes or the connection ends; only a hang lasts as
// long as kPatience allows.
class Page {
 public:
  static constexpr int kPatience = 60'000;  // [ms]

  explicit Page(std::uint16_t port, int receive_buffer = 0) : file_(socket(AF_INET, SOCK_STREAM, 0)) {
    if (receive_buffer > 0) setsockopt(file_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof(receive_buffer));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ = connect(file_, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0;
  }
  ~Page() { close(file_); }
  Page(const Page&) = delete;

  bool connected() const { return connected_; }
  void send(std::string_view bytes) {
    while (!bytes.empty()) {
      const ssize_t n = ::send(file_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (n <= 0) return;
      bytes.remove_prefix(static_cast<std::size_t>(n));
    }
  }
  // Whether anything more can come.
  bool receive() {
    pollfd wait{file_, POLLIN, 0};
    if (poll(&wait, 1, kPatience) <= 0) return false;
    char block[65536];
    const ssize_t n = recv(file_, block, sizeof(block), 0);
    if (n <= 0) return false;
    received_.append(block, static_cast<std::size_t>(n));
    return true;
  }
  // Everything until the connection ends.
  std::string rest() {
    while (receive()) {
    }
    return std::exchange(received_, {});
  }
  // Until this text has come; then it and what is before it.
  std::string until(std::string_view text) {
    std::size_t at;
    while ((at = received_.find(text)) == std::string::npos) {
      if (!receive()) return std::exchange(received_, {});
    }
    std::string found = received_.substr(0, at + text.size());
    received_.erase(0, at + text.size());
    return found;
  }

  // --- HTTP ---
  static std::string request(const std::string& path, const std::string& host, const std::string& more = "") {
    return "GET " + path + " HTTP/1.1\r\nHost: " + host + "\r\n" + more + "\r\n";
  }
  int status_of(const std::string& bytes) {
    send(bytes);
    const std::string head = until("\r\n\r\n");
    return head.size() > 12 ? std::stoi(head.substr(9, 3)) : 0;
  }

  // --- WebSocket ---
  static std::string upgrade(const std::string& host, const std::string& origin) {
    return request("/ws", host,
                   (origin.empty() ? "" : "Origin: " + origin + "\r\n") +
                       "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                       "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n");
  }
  bool open(std::uint16_t port, const std::string& token) {
    const std::string host = "127.0.0.1:" + std::to_string(port);
    if (status_of(upgrade(host, "http://" + host)) != 101) return false;
    say(R"({"do": "hello", "id": 0, "token": ")" + token + "\"}");
    return true;
  }
  void say(std::string_view text) { send(client_frame(Opcode::text, text)); }
  struct Frame {
    int opcode = 0;
    std::string data;
    // The code of a close.
    int code() const {
      return data.size() < 2 ? 0
                             : static_cast<std::uint8_t>(data[0]) << 8 | static_cast<std::uint8_t>(data[1]);
    }
  };
  // The next frame; none: the connection has ended.
  std::optional<Frame> frame() {
    const auto byte = [&](std::size_t i) { return static_cast<std::uint8_t>(received_[i]); };
    const auto need = [&](std::size_t count) {
      while (received_.size() < count) {
        if (!receive()) return false;
      }
      return true;
    };
    if (!need(2)) return {};
    std::size_t size = byte(1), head = 2;
    if (size > 125) {
      head = size == 126 ? 4 : 10;
      if (!need(head)) return {};
      size = 0;
      for (std::size_t i = 2; i < head; ++i) size = size << 8 | byte(i);
    }
    if (!need(head + size)) return {};
    Frame frame{byte(0) & 0x0f, received_.substr(head, size)};
    received_.erase(0, head + size);
    return frame;
  }
  // The data of the next message, without pings; empty: the connection has ended.
  std::string message() {
    auto got = frame();
    while (got && got->opcode == 9) got = frame();
    return got && got->opcode != 8 ? got->data : std::string();
  }
  // The code with which the connection is closed.
  int close_code() {
    while (auto got = frame()) {
      if (got->opcode == 8) return got->code();
    }
    return 0;
  }

 private:
  int file_;
  bool connected_ = false;
  std::string received_;
};

}  // namespace multipanda::cockpit::test
