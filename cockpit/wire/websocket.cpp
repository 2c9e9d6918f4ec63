#include "cockpit/wire/websocket.hpp"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "cockpit/wire/sha1.hpp"

namespace multipanda::cockpit {
namespace {

constexpr std::size_t kLongestControl = 125;  // of a control frame (RFC 6455, section 5.5)
constexpr std::size_t kMaskBytes = 4;
constexpr std::size_t kMostFrames = 1024;  // waiting in one buffer: more is a flood of empty frames

std::uint64_t big_endian(std::string_view bytes) {
  std::uint64_t value = 0;
  for (const char byte : bytes) value = value << 8 | static_cast<std::uint8_t>(byte);
  return value;
}

std::string to_big_endian(std::uint64_t value, int bytes) {
  std::string out;
  for (int shift = 8 * (bytes - 1); shift >= 0; shift -= 8) out += static_cast<char>(value >> shift & 0xff);
  return out;
}

// 16 bytes in base64: 22 digits and "==".
bool is_key(const std::string& key) {
  constexpr std::size_t kDigits = 22;
  const auto is_digit = [](char c) {
    return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '+' || c == '/';
  };
  return key.size() == kDigits + 2 && key.ends_with("==") &&
         std::all_of(key.begin(), key.begin() + kDigits, is_digit);
}

bool is_known(Opcode opcode) {
  return opcode <= Opcode::binary || (opcode >= Opcode::close && opcode <= Opcode::pong);
}

// Codes that a peer may send (RFC 6455, section 7.4).
bool is_close_code(std::uint64_t code) {
  return (code >= 1000 && code <= 1014 && code != 1004 && code != 1005 && code != 1006) ||
         (code >= 3000 && code <= 4999);
}

}  // namespace

std::string accept_key(const std::string& key) {
  return base64(sha1(key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"));
}

Handshake shake_hands(const HttpRequest& request) {
  if (request.method != "GET") return {405, "a WebSocket begins with GET", ""};
  if (!has_word(request.field("upgrade"), "websocket") || !has_word(request.field("connection"), "upgrade"))
    return {426, "this path is a WebSocket", ""};
  if (request.field("sec-websocket-version") != "13") return {426, "WebSocket version 13 is spoken here", ""};
  if (!is_key(request.field("sec-websocket-key")))
    return {400, "Sec-WebSocket-Key is not 16 bytes in base64", ""};
  return {101, "",
          fmt::format("HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                      "Sec-WebSocket-Accept: {}\r\n\r\n",
                      accept_key(request.field("sec-websocket-key")))};
}

std::string frame_head(Opcode opcode, std::size_t size) {
  std::string head{static_cast<char>(0x80 | static_cast<int>(opcode))};
  if (size <= kLongestControl) return head + static_cast<char>(size);
  if (size <= 0xffff) return head + static_cast<char>(126) + to_big_endian(size, 2);
  return head + static_cast<char>(127) + to_big_endian(size, 8);
}

std::string close_frame(CloseCode code, std::string_view reason) {
  std::string data = to_big_endian(static_cast<std::uint16_t>(code), 2);
  data += reason.substr(0, kLongestControl - 2);
  while (!is_utf8(std::string_view(data).substr(2))) data.pop_back();  // a character that was cut
  return frame_head(Opcode::close, data.size()) + data;
}

// RFC 3629: shortest form, no surrogates, up to U+10FFFF.
bool is_utf8(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<std::uint8_t>(text[i]); };
  for (std::size_t i = 0; i < text.size();) {
    const std::uint8_t first = byte(i);
    std::size_t more = 0;
    std::uint8_t low = 0x80, high = 0xbf;  // of the second byte
    if (first < 0x80) {
      ++i;
      continue;
    }
    if (first >= 0xc2 && first <= 0xdf) {
      more = 1;
    } else if (first >= 0xe0 && first <= 0xef) {
      more = 2;
      if (first == 0xe0) low = 0xa0;
      if (first == 0xed) high = 0x9f;
    } else if (first >= 0xf0 && first <= 0xf4) {
      more = 3;
      if (first == 0xf0) low = 0x90;
      if (first == 0xf4) high = 0x8f;
    } else {
      return false;
    }
    if (i + more >= text.size()) return false;
    if (byte(i + 1) < low || byte(i + 1) > high) return false;
    for (std::size_t k = 2; k <= more; ++k) {
      if ((byte(i + k) & 0xc0) != 0x80) return false;
    }
    i += more + 1;
  }
  return true;
}

std::optional<WebSocketReader::Message> WebSocketReader::fail(CloseCode code, std::string reason) {
  fault_ = {code, std::move(reason)};
  return {};
}

std::optional<WebSocketReader::Message> WebSocketReader::take(std::string& bytes) {
  for (std::size_t frames = 0; !fault_; ++frames) {
    if (frames > kMostFrames) return fail(CloseCode::policy, "too many fragments");
    if (bytes.size() < 2) return {};
    const auto first = static_cast<std::uint8_t>(bytes[0]), second = static_cast<std::uint8_t>(bytes[1]);
    const bool last = (first & 0x80) != 0;
    const auto opcode = static_cast<Opcode>(first & 0x0f);
    if ((first & 0x70) != 0) return fail(CloseCode::protocol_error, "reserved bits are set");
    if (!is_known(opcode)) return fail(CloseCode::protocol_error, "unknown opcode");
    if ((second & 0x80) == 0) return fail(CloseCode::protocol_error, "a client's frames are masked");
    const std::size_t short_size = second & 0x7f;
    const bool control = opcode >= Opcode::close;
    if (control && (!last || short_size > kLongestControl))
      return fail(CloseCode::protocol_error, "a control frame is whole and at most 125 bytes long");
    const std::size_t size_bytes = short_size == 127 ? 8 : short_size == 126 ? 2 : 0;
    const std::size_t head = 2 + size_bytes + kMaskBytes;
    if (bytes.size() < 2 + size_bytes) return {};
    const std::uint64_t size =
        size_bytes == 0 ? short_size : big_endian(std::string_view(bytes).substr(2, size_bytes));
    if ((size_bytes == 2 && size <= kLongestControl) || (size_bytes == 8 && size <= 0xffff))
      return fail(CloseCode::protocol_error, "the length is not in its shortest form");
    const std::size_t before = control || !begun_ ? 0 : begun_->data.size();
    if (size > longest_ || before + size > longest_)
      return fail(CloseCode::too_long, fmt::format("a message has at most {} bytes", longest_));
    if (bytes.size() < head + size) return {};
    if (!control && (opcode == Opcode::continuation) != begun_.has_value())
      return fail(CloseCode::protocol_error,
                  begun_ ? "a message begins inside another one" : "no message to continue");
    std::string data = bytes.substr(head, size);
    for (std::size_t i = 0; i < data.size(); ++i)
      data[i] = static_cast<char>(data[i] ^ bytes[head - kMaskBytes + i % kMaskBytes]);
    bytes.erase(0, head + size);
    if (control) return take_whole({opcode, std::move(data)});
    if (!begun_) begun_ = Message{opcode, {}};
    begun_->data += data;
    if (!last) continue;
    Message whole = std::move(*begun_);
    begun_.reset();
    return take_whole(std::move(whole));
  }
  return {};
}

std::optional<WebSocketReader::Message> WebSocketReader::take_whole(Message message) {
  if (message.opcode == Opcode::text && !is_utf8(message.data))
    return fail(CloseCode::not_utf8, "a text message is UTF-8");
  if (message.opcode == Opcode::close && !message.data.empty()) {
    if (message.data.size() < 2 || !is_close_code(big_endian(message.data.substr(0, 2))))
      return fail(CloseCode::protocol_error, "invalid close code");
    if (!is_utf8(std::string_view(message.data).substr(2)))
      return fail(CloseCode::not_utf8, "the reason of a close is UTF-8");
  }
  return message;
}

}  // namespace multipanda::cockpit
