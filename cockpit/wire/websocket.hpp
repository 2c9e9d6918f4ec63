#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "cockpit/wire/http.hpp"

// The server's side of RFC 6455: text and binary messages, fragments, ping, pong and close; no extensions and
// no subprotocols.
namespace multipanda::cockpit {

enum class Opcode : std::uint8_t { continuation = 0, text = 1, binary = 2, close = 8, ping = 9, pong = 10 };

// Why a connection ends (RFC 6455, section 7.4.1); from 4000 on the cockpit's own.
enum class CloseCode : std::uint16_t {
  normal = 1000,
  going_away = 1001,
  protocol_error = 1002,
  unsupported = 1003,
  not_utf8 = 1007,
  policy = 1008,
  too_long = 1009,
  wrong_token = 4401
};

// Sec-WebSocket-Accept for a Sec-WebSocket-Key.
std::string accept_key(const std::string& key);

// Why this request cannot become a WebSocket, or the answer that makes it one. Host and Origin are the
// caller's to check.
struct Handshake {
  int status = 101;
  std::string reason;  // of a refusal
  std::string answer;  // with status 101
};
Handshake shake_hands(const HttpRequest& request);

// One frame as a server sends it: whole and unmasked.
std::string frame_head(Opcode opcode, std::size_t size);
std::string close_frame(CloseCode code, std::string_view reason);

bool is_utf8(std::string_view text);

// Reads a client's frames from bytes as they arrive, and joins fragments.
class WebSocketReader {
 public:
  struct Message {
    Opcode opcode = Opcode::text;  // text, binary, close, ping or pong
    std::string data;
  };
  struct Fault {
    CloseCode code = CloseCode::protocol_error;
    std::string reason;
  };

  // `longest`: bytes of a message.
  explicit WebSocketReader(std::size_t longest) : longest_(longest) {}
  void set_longest(std::size_t longest) { longest_ = longest; }

  // Takes the next message from the begin of `bytes`; none: more bytes are needed, or there is a fault.
  // After a fault or a close nothing more may be read.
  std::optional<Message> take(std::string& bytes);
  const std::optional<Fault>& fault() const { return fault_; }

 private:
  std::optional<Message> fail(CloseCode code, std::string reason);
  std::optional<Message> take_whole(Message message);

  std::size_t longest_;
  std::optional<Message> begun_;  // fragments so far
  std::optional<Fault> fault_;
};

}  // namespace multipanda::cockpit
