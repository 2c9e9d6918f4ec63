#include <random>

#include <gtest/gtest.h>

#include "cockpit/wire/http.hpp"
#include "cockpit/wire/testing/client_frames.hpp"
#include "cockpit/wire/websocket.hpp"

// Hostile bytes: nothing crashes, nothing grows beyond its bound, and the way in which bytes arrive does not
// matter. Runs under the address and undefined-behavior sanitizers as the other tests do.
namespace multipanda::cockpit::fuzz_test {
namespace {

constexpr int kRounds = 20'000;
constexpr std::size_t kLongest = 200;

using Random = std::mt19937_64;

std::size_t below(Random& random, std::size_t bound) {
  return std::uniform_int_distribution<std::size_t>(0, bound - 1)(random);
}

// Changes, removes, repeats and inserts bytes.
std::string mutated(std::string bytes, Random& random) {
  for (std::size_t n = below(random, 6); n > 0 && !bytes.empty(); --n) {
    const std::size_t at = below(random, bytes.size());
    switch (below(random, 5)) {
      case 0:
        bytes[at] = static_cast<char>(below(random, 256));
        break;
      case 1:
        bytes.erase(at, 1 + below(random, 8));
        break;
      case 2:
        bytes.insert(at, bytes.substr(at, 1 + below(random, 16)));
        break;
      case 3:
        bytes.insert(at, 1, static_cast<char>(below(random, 256)));
        break;
      default:
        bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(random, 8)));
    }
  }
  return bytes;
}

// Feeds `bytes` in random pieces; what came out, as text.
template <class Feed>
std::string in_pieces(const std::string& bytes, Random& random, const Feed& feed) {
  std::string out, waiting;
  for (std::size_t at = 0; at < bytes.size();) {
    const std::size_t size = 1 + below(random, 40);
    waiting += bytes.substr(at, size);
    at += size;
    if (!feed(waiting, out)) break;
  }
  return out;
}

std::string read_http(const std::string& bytes, Random& random) {
  HttpReader reader;
  return in_pieces(bytes, random, [&](std::string& waiting, std::string& out) {
    for (;;) {
      const auto result = reader.take(waiting);
      if (result == HttpReader::Result::incomplete) return true;
      if (result == HttpReader::Result::refused) {
        EXPECT_GE(reader.status(), 400);
        EXPECT_FALSE(reader.reason().empty());
        out += std::to_string(reader.status());
        return false;
      }
      const HttpRequest& request = reader.request();
      EXPECT_LE(request.fields.size(), HttpReader::kMostFields);
      EXPECT_EQ(request.path.front(), '/');
      for (const auto& [name, value] : request.fields) {
        EXPECT_EQ((name + value).find_first_of(std::string_view("\r\n\0", 3)), std::string::npos);
        out += name + "=" + value + ";";
      }
    }
  });
}

std::string read_frames(const std::string& bytes, Random& random) {
  WebSocketReader reader(kLongest);
  return in_pieces(bytes, random, [&](std::string& waiting, std::string& out) {
    while (auto message = reader.take(waiting)) {
      EXPECT_LE(message->data.size(), kLongest);
      EXPECT_TRUE(message->opcode != Opcode::text || is_utf8(message->data));
      out += std::to_string(static_cast<int>(message->opcode)) + ":" + message->data + ";";
      if (message->opcode == Opcode::close) return false;
    }
    EXPECT_LT(waiting.size(), kLongest + 64) << "a frame is refused before all of it has come";
    if (!reader.fault()) return true;
    EXPECT_FALSE(reader.fault()->reason.empty());
    out += std::to_string(static_cast<int>(reader.fault()->code));
    return false;
  });
}

TEST(HttpFuzz, MutatedRequests) {
  Random random(1);
  const std::string request =
      "GET /ws HTTP/1.1\r\nHost: localhost:8080\r\nOrigin: http://localhost:8080\r\nUpgrade: websocket\r\n"
      "Connection: keep-alive, Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: "
      "dGhlIHNhbXBsZSBub25jZQ==\r\n\r\nGET / HTTP/1.1\r\n\r\n";
  int whole = 0;
  for (int round = 0; round < kRounds; ++round) {
    const std::string bytes = mutated(request, random);
    const std::string once = read_http(bytes, random);
    EXPECT_EQ(read_http(bytes, random), once) << round;
    whole += once.find("sec-websocket-key=") != std::string::npos ? 1 : 0;
  }
  EXPECT_GT(whole, kRounds / 10);  // the mutations leave some requests readable
}

TEST(HttpFuzz, RandomBytes) {
  Random random(2);
  for (int round = 0; round < kRounds / 10; ++round) {
    std::string bytes(below(random, 2 * HttpReader::kLongest), '\0');
    for (char& byte : bytes) byte = "GET /:\r\n\r\nHost\0\xff "[below(random, 18)];
    const std::string once = read_http(bytes, random);
    EXPECT_EQ(read_http(bytes, random), once) << round;
  }
}

TEST(WebSocketFuzz, MutatedFrames) {
  Random random(3);
  int whole = 0;
  for (int round = 0; round < kRounds; ++round) {
    std::string frames;
    for (std::size_t n = 1 + below(random, 5); n > 0; --n) {
      static constexpr std::array<Opcode, 6> kOpcodes{Opcode::text,  Opcode::binary, Opcode::continuation,
                                                      Opcode::close, Opcode::ping,   Opcode::pong};
      frames += test::client_frame(kOpcodes[below(random, kOpcodes.size())],
                                   std::string(below(random, kLongest), 'a'), below(random, 4) != 0);
    }
    const std::string bytes = mutated(frames, random);
    const std::string once = read_frames(bytes, random);
    EXPECT_EQ(read_frames(bytes, random), once) << round;
    whole += once.find(":a") != std::string::npos ? 1 : 0;
  }
  EXPECT_GT(whole, kRounds / 10);
}

TEST(WebSocketFuzz, RandomBytes) {
  Random random(4);
  for (int round = 0; round < kRounds; ++round) {
    std::string bytes(below(random, 600), '\0');
    for (char& byte : bytes) byte = static_cast<char>(below(random, 256));
    const std::string once = read_frames(bytes, random);
    EXPECT_EQ(read_frames(bytes, random), once) << round;
  }
}

}  // namespace
}  // namespace multipanda::cockpit::fuzz_test
