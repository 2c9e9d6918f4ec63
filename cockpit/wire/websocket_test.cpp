#include "cockpit/wire/websocket.hpp"

#include <gtest/gtest.h>

#include "cockpit/wire/testing/client_frames.hpp"

namespace multipanda::cockpit::websocket_test {
namespace {

using test::client_frame;

constexpr std::size_t kLongest = 70'000;

// The code of the fault, or 0.
int fault_of(std::string bytes, std::size_t longest = kLongest) {
  WebSocketReader reader(longest);
  while (reader.take(bytes)) {
  }
  return reader.fault() ? static_cast<int>(reader.fault()->code) : 0;
}

HttpRequest handshake() {
  HttpRequest request;
  request.method = "GET";
  request.path = "/ws";
  request.fields = {{"upgrade", "websocket"},
                    {"connection", "keep-alive, Upgrade"},
                    {"sec-websocket-version", "13"},
                    {"sec-websocket-key", "dGhlIHNhbXBsZSBub25jZQ=="}};
  return request;
}

// The example of RFC 6455, section 1.3.
TEST(Handshake, AnswersAsTheStandardDoes) {
  const Handshake hands = shake_hands(handshake());
  EXPECT_EQ(hands.status, 101);
  EXPECT_NE(hands.answer.find("Sec-WebSocket-Accept: s3pPLMBiTxaQ9kYGzzhZRbK+xOo=\r\n"), std::string::npos);
}

TEST(Handshake, RefusesAnythingElse) {
  const auto status_with = [](const std::string& field, const std::string& value) {
    HttpRequest request = handshake();
    request.fields[field] = value;
    return shake_hands(request).status;
  };
  EXPECT_EQ(status_with("upgrade", "h2c"), 426);
  EXPECT_EQ(status_with("connection", "keep-alive"), 426);
  EXPECT_EQ(status_with("sec-websocket-version", "8"), 426);
  EXPECT_EQ(status_with("sec-websocket-key", ""), 400);
  EXPECT_EQ(status_with("sec-websocket-key", "dGhlIHNhbXBsZSBub25jZQ=\r"), 400);
  HttpRequest head = handshake();
  head.method = "HEAD";
  EXPECT_EQ(shake_hands(head).status, 405);
}

// The examples of RFC 6455, section 5.7.
TEST(WebSocketReader, ReadsTheStandardsExamples) {
  WebSocketReader reader(kLongest);
  std::string bytes = "\x81\x85\x37\xfa\x21\x3d\x7f\x9f\x4d\x51\x58";
  const auto message = reader.take(bytes);
  ASSERT_TRUE(message);
  EXPECT_EQ(message->opcode, Opcode::text);
  EXPECT_EQ(message->data, "Hello");
  EXPECT_TRUE(bytes.empty());
  EXPECT_EQ(frame_head(Opcode::text, 5) + "Hello", "\x81\x05Hello");
  EXPECT_EQ(frame_head(Opcode::binary, 256), std::string("\x82\x7e\x01\x00", 4));
  EXPECT_EQ(frame_head(Opcode::binary, 65536), std::string("\x82\x7f\x00\x00\x00\x00\x00\x01\x00\x00", 10));
}

TEST(WebSocketReader, ReadsEveryLengthInAnyPieces) {
  for (const std::size_t size : {0u, 1u, 125u, 126u, 127u, 65535u, 65536u, 70'000u}) {
    std::string data(size, '\0');
    for (std::size_t i = 0; i < size; ++i) data[i] = static_cast<char>('a' + i % 26);
    const std::string whole = client_frame(Opcode::binary, data);
    WebSocketReader reader(kLongest);
    std::string bytes;
    std::optional<WebSocketReader::Message> message;
    const std::size_t step = std::max<std::size_t>(1, whole.size() / 97);
    for (std::size_t at = 0; at < whole.size(); at += step) {
      ASSERT_FALSE(message) << size;
      bytes += whole.substr(at, step);
      message = reader.take(bytes);
    }
    ASSERT_TRUE(message) << size;
    EXPECT_EQ(message->data, data);
  }
}

// Control frames may come between fragments (RFC 6455, section 5.4).
TEST(WebSocketReader, JoinsFragmentsAroundAPing) {
  WebSocketReader reader(kLongest);
  std::string bytes = client_frame(Opcode::text, "gr\xc3", false) + client_frame(Opcode::ping, "?") +
                      client_frame(Opcode::continuation, "", false) +
                      client_frame(Opcode::continuation, "\xbc\xc3\x9f");
  const auto ping = reader.take(bytes);
  ASSERT_TRUE(ping);
  EXPECT_EQ(ping->opcode, Opcode::ping);
  const auto text = reader.take(bytes);
  ASSERT_TRUE(text);
  EXPECT_EQ(text->opcode, Opcode::text);
  EXPECT_EQ(text->data, "gr\xc3\xbc\xc3\x9f");
}

TEST(WebSocketReader, RefusesWhatTheStandardForbids) {
  EXPECT_EQ(fault_of(client_frame(Opcode::text, "ok")), 0);
  EXPECT_EQ(fault_of("\x81\x05Hello"), 1002);  // not masked
  std::string reserved = client_frame(Opcode::text, "x");
  reserved[0] = static_cast<char>(reserved[0] | 0x40);
  EXPECT_EQ(fault_of(reserved), 1002);
  EXPECT_EQ(fault_of(client_frame(static_cast<Opcode>(3), "x")), 1002);
  EXPECT_EQ(fault_of(client_frame(static_cast<Opcode>(11), "x")), 1002);
  EXPECT_EQ(fault_of(client_frame(Opcode::ping, std::string(126, 'x'))), 1002);
  EXPECT_EQ(fault_of(client_frame(Opcode::ping, "x", false)), 1002);
  EXPECT_EQ(fault_of(client_frame(Opcode::continuation, "x")), 1002);
  EXPECT_EQ(fault_of(client_frame(Opcode::text, "x", false) + client_frame(Opcode::text, "y")), 1002);
  EXPECT_EQ(fault_of(client_frame(Opcode::text, "\xff")), 1007);
  EXPECT_EQ(fault_of(std::string("\x81\xfe\x00\x01", 4) + "mask!"), 1002);             // 1 byte in two
  EXPECT_EQ(fault_of(client_frame(Opcode::close, std::string("\x03\xed", 2))), 1002);  // 1005
  EXPECT_EQ(fault_of(client_frame(Opcode::close, "x")), 1002);
  EXPECT_EQ(fault_of(client_frame(Opcode::close, std::string("\x03\xe8\xff", 3))), 1007);
}

// The length is refused before anybody waits for the bytes.
TEST(WebSocketReader, BoundsMessages) {
  EXPECT_EQ(fault_of(client_frame(Opcode::text, std::string(100, 'x')), 100), 0);
  EXPECT_EQ(fault_of(client_frame(Opcode::text, std::string(101, 'x')).substr(0, 2), 100), 1009);
  EXPECT_EQ(fault_of(client_frame(Opcode::text, std::string(60, 'x'), false) +
                         client_frame(Opcode::continuation, std::string(41, 'x')),
                     100),
            1009);
  EXPECT_EQ(fault_of(std::string("\x81\xff\xff\xff\xff\xff\xff\xff\xff\xff", 10)), 1009);
  std::string empty;
  for (int i = 0; i < 2000; ++i)
    empty += client_frame(i == 0 ? Opcode::text : Opcode::continuation, "", false);
  EXPECT_EQ(fault_of(empty), 1008);
}

TEST(Close, SaysWhyWithinAControlFrame) {
  std::string frame = close_frame(CloseCode::policy, "too many");
  EXPECT_EQ(frame, std::string("\x88\x0a\x03\xf0too many", 12));
  frame = close_frame(CloseCode::policy, std::string(122, 'x') + "\xc3\xbc");
  EXPECT_EQ(frame.size(), 2u + 124u);  // the cut character is left out
}

TEST(Utf8, AsTheStandardDefinesIt) {
  for (const char* good : {"", "abc", "\xc2\x80", "\xdf\xbf", "\xe0\xa0\x80", "\xed\x9f\xbf", "\xef\xbf\xbf",
                           "\xf0\x90\x80\x80", "\xf4\x8f\xbf\xbf"})
    EXPECT_TRUE(is_utf8(good)) << good;
  for (const char* bad :
       {"\x80", "\xc0\x80", "\xc1\xbf", "\xc2", "\xe0\x9f\xbf", "\xed\xa0\x80", "\xe2\x82",
        "\xf0\x8f\xbf\xbf", "\xf4\x90\x80\x80", "\xf5\x80\x80\x80", "\xff", "a\xe2\x28\xa1"})
    EXPECT_FALSE(is_utf8(bad));
}

}  // namespace
}  // namespace multipanda::cockpit::websocket_test
