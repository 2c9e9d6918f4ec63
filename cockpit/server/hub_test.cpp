#include "cockpit/server/hub.hpp"

#include <atomic>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cockpit/server/testing/page.hpp"
#include "cockpit/server/token.hpp"

namespace multipanda::cockpit::hub_test {
namespace {

using nlohmann::json;
using test::Page;
using testing::HasSubstr;

// Answers every message with itself; "flood" with many numbers, "close" by closing.
class Echo final : public Hub::Handler {
 public:
  void join(Hub::Client& client, const json& id) override {
    ++joined;
    client.send({{"id", id}, {"hello", client.id()}});
  }
  void take(Hub::Client& client, const json& message) override {
    if (message == "flood") {
      for (int i = 0; i < 64; ++i) client.send_numbers(std::string(100'000, 'x'));
      return;
    }
    client.send({{"echo", message}});
  }
  void leave(Hub::Client&) override { ++left; }
  std::chrono::nanoseconds turn(HostTime) override { return std::chrono::milliseconds(10); }

  std::atomic<int> joined{0}, left{0};
};

class HubTest : public testing::Test {
 protected:
  static HubLimits quick() {
    HubLimits limits;
    limits.first_s = 0.3;
    limits.ping_s = 0.1;
    limits.silent_s = 0.6;
    limits.connections = 8;
    limits.clients = 3;
    limits.message = 2000;
    limits.messages_per_s = 1e-3;
    limits.burst = 100;
    limits.unsent = 1'000'000;
    return limits;
  }
  static PageFiles files() {
    return {{"/", {"text/html; charset=utf-8", "<p>page</p>"}}, {"/app.js", {"text/javascript", "1"}}};
  }
  std::unique_ptr<Hub> hub(HubLimits limits = {}, PageFiles page = files()) {
    return std::make_unique<Hub>(std::uint16_t{0}, kToken, std::move(page), echo_, limits);
  }
  static std::string host(const Hub& hub) { return "127.0.0.1:" + std::to_string(hub.port()); }

  const std::string kToken = "0123456789abcdef0123456789abcdef";
  Echo echo_;
};

TEST_F(HubTest, ServesThePageWithItsHeaders) {
  const auto server = hub();
  Page page(server->port());
  page.send(Page::request("/", host(*server)));
  const std::string head = page.until("\r\n\r\n");
  EXPECT_THAT(head, HasSubstr("200 OK"));
  EXPECT_THAT(head, HasSubstr("frame-ancestors 'none'"));
  page.until("<p>page</p>");
  EXPECT_EQ(page.status_of(Page::request("/../secret", host(*server))), 404);
  EXPECT_EQ(Page(server->port()).status_of(Page::request("/app.js", host(*server))), 200);
}

TEST_F(HubTest, SaysThatThereIsNoPage) {
  const auto server = hub({}, {});
  Page page(server->port());
  page.send(Page::request("/", host(*server), "Connection: close\r\n"));
  const std::string answer = page.rest();
  EXPECT_THAT(answer, HasSubstr("404 Not Found"));
  EXPECT_THAT(answer, HasSubstr("no cockpit page"));
}

// A name of a foreign site that resolves to this computer: its page has the foreign name in Host.
TEST_F(HubTest, RefusesForeignHostsAndOrigins) {
  const auto server = hub();
  const std::string own = host(*server);
  const auto status = [&](const std::string& bytes) {
    Page page(server->port());
    return page.status_of(bytes);
  };
  EXPECT_EQ(status(Page::request("/", "evil.example:" + std::to_string(server->port()))), 403);
  EXPECT_EQ(status(Page::upgrade("evil.example", "http://evil.example")), 403);
  EXPECT_EQ(status(Page::upgrade(own, "http://evil.example")), 403);
  EXPECT_EQ(status(Page::upgrade(own, "https://" + own)), 403);
  EXPECT_EQ(status(Page::upgrade(own, "null")), 403);
  EXPECT_EQ(status(Page::upgrade(own, "")), 403);
  EXPECT_EQ(status(Page::request("/", own, "Origin: http://evil.example\r\n")), 403);
  EXPECT_EQ(status("GET / HTTP/1.1\r\n\r\n"), 403);
  EXPECT_EQ(status(Page::upgrade(own, "http://" + own)), 101);
  EXPECT_EQ(status(Page::upgrade("localhost:1", "http://localhost:1")), 101);  // through ssh -L
  EXPECT_EQ(echo_.joined, 0);
}

TEST_F(HubTest, TheTokenComesFirst) {
  const auto server = hub();
  const std::string own = host(*server);
  for (const std::string& first : {std::string("nonsense"), std::string(R"({"do": "hello"})"),
                                   std::string(R"({"do": "list", "token": ")") + kToken + "\"}",
                                   R"({"do": "hello", "token": ")" + kToken.substr(1) + "\"}",
                                   R"({"do": "hello", "token": ")" + kToken + "0\"}",
                                   std::string(R"({"do": "hello", "token": 1})"), std::string("[]")}) {
    Page page(server->port());
    ASSERT_EQ(page.status_of(Page::upgrade(own, "http://" + own)), 101);
    page.say(first);
    EXPECT_EQ(page.close_code(), 4401) << first;
  }
  EXPECT_EQ(echo_.joined, 0);
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), kToken));
  EXPECT_THAT(page.frame()->data, HasSubstr("\"hello\""));
  page.say(R"([1, "a"])");
  EXPECT_EQ(json::parse(page.frame()->data), (json{{"echo", {1, "a"}}}));
  EXPECT_EQ(echo_.joined, 1);
}

TEST_F(HubTest, AFirstMessageIsShort) {
  const auto server = hub();
  const std::string own = host(*server);
  Page page(server->port());
  ASSERT_EQ(page.status_of(Page::upgrade(own, "http://" + own)), 101);
  page.say(std::string(2000, ' '));
  EXPECT_EQ(page.close_code(), 1009);
}

TEST_F(HubTest, BoundsMessagesAndTheirRate) {
  const auto server = hub(quick());
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), kToken));
  for (int i = 0; i < 150; ++i) page.say("1");  // a hundred at once are allowed
  EXPECT_EQ(page.close_code(), 1008);
  Page other(server->port());
  ASSERT_TRUE(other.open(server->port(), kToken));
  other.say(std::string(2001, ' '));
  EXPECT_EQ(other.close_code(), 1009);
  Page binary(server->port());
  ASSERT_TRUE(binary.open(server->port(), kToken));
  binary.send(test::client_frame(Opcode::binary, "x"));
  EXPECT_EQ(binary.close_code(), 1003);
}

TEST_F(HubTest, AnswersPingsAndCloses) {
  const auto server = hub();
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), kToken));
  page.frame();
  page.send(test::client_frame(Opcode::ping, "are you there"));
  const auto pong = page.frame();
  EXPECT_EQ(pong->opcode, 10);
  EXPECT_EQ(pong->data, "are you there");
  page.send(test::client_frame(Opcode::close, std::string("\x03\xe8", 2)));
  EXPECT_EQ(page.close_code(), 1000);
  EXPECT_FALSE(page.frame());
}

// A client that says nothing is asked, then closed; a browser answers by itself.
TEST_F(HubTest, EndsSilentClients) {
  const auto server = hub(quick());
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), kToken));
  page.frame();
  EXPECT_EQ(page.frame()->opcode, 9);
  EXPECT_EQ(page.close_code(), 1008);
  Page mute(server->port());  // never asks for anything
  EXPECT_EQ(mute.rest(), "");
  Page slow(server->port());
  slow.send("GET / HT");
  EXPECT_EQ(slow.rest(), "");
  while (echo_.left < 1) std::this_thread::yield();
}

TEST_F(HubTest, EndsClientsThatDoNotRead) {
  HubLimits limits = quick();
  limits.silent_s = 60;
  const auto server = hub(limits);
  Page page(server->port(), 4096), other(server->port());
  ASSERT_TRUE(page.open(server->port(), kToken));
  ASSERT_TRUE(other.open(server->port(), kToken));
  page.say("\"flood\"");
  while (echo_.left < 1) std::this_thread::yield();
  other.frame();
  other.say("1");
  EXPECT_EQ(other.message(), R"({"echo":1})");
}

TEST_F(HubTest, BoundsClients) {
  const auto server = hub(quick());
  std::list<Page> pages;
  for (std::size_t i = 0; i < quick().clients; ++i) {
    pages.emplace_back(server->port());
    ASSERT_TRUE(pages.back().open(server->port(), kToken));
    ASSERT_TRUE(pages.back().frame());
  }
  Page more(server->port());
  ASSERT_TRUE(more.open(server->port(), kToken));
  EXPECT_EQ(more.close_code(), 1008);
}

// Connections that say nothing make room for new ones; clients with the token stay.
TEST_F(HubTest, AThousandConnectionsLockNobodyOut) {
  const auto server = hub();
  Page client(server->port());
  ASSERT_TRUE(client.open(server->port(), kToken));
  client.frame();
  std::list<Page> idle;
  for (int i = 0; i < 1000; ++i) {
    idle.emplace_back(server->port());
    ASSERT_TRUE(idle.back().connected()) << i;
  }
  client.say("1");
  EXPECT_EQ(client.message(), R"({"echo":1})");
  Page late(server->port());
  ASSERT_TRUE(late.open(server->port(), kToken));
  EXPECT_THAT(late.message(), HasSubstr("hello"));
  EXPECT_GE(server->refused(), 900u);
}

// A watcher presses Stop and closes the page: what it said counts, although nothing reaches it any more.
TEST(Connection, TakesTheLastWordsOfWhoIsGone) {
  int ends[2];
  ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM, 0, ends), 0);
  Connection connection(ends[0]);
  ASSERT_EQ(write(ends[1], "stop", 4), 4);
  close(ends[1]);
  connection.send("news");
  connection.flush();
  EXPECT_FALSE(connection.ended());
  EXPECT_EQ(connection.unsent(), 0u);
  EXPECT_TRUE(connection.receive(100));
  EXPECT_EQ(connection.received(), "stop");
  EXPECT_TRUE(connection.ended());
}

// Takes 2 ms for a message.
class Slow final : public Hub::Handler {
 public:
  void join(Hub::Client&, const json&) override {}
  void take(Hub::Client&, const json&) override {
    const HostTime begun = host_now();
    while (seconds(host_now() - begun) < 2e-3) {
    }
    ++taken_, ++in_turn_;
  }
  void leave(Hub::Client&) override { left = true; }
  std::chrono::nanoseconds turn(HostTime) override {
    most = std::max(most.load(), std::exchange(in_turn_, 0));
    total = taken_;
    return std::chrono::seconds(1);
  }

  std::atomic<int> most{0}, total{0};
  std::atomic<bool> left{false};

 private:
  int taken_ = 0, in_turn_ = 0;
};

// The handler's turn ends holds that are silent, so the messages of a busy client must not keep it waiting.
// All are taken in the end, also those of a client that is gone.
TEST_F(HubTest, ABusyClientHasItsShareOfATurn) {
  Slow handler;
  const Hub server(0, kToken, {}, handler);
  {
    Page page(server.port());
    ASSERT_TRUE(page.open(server.port(), kToken));
    std::string all;
    for (int i = 0; i < 100; ++i) all += test::client_frame(Opcode::text, "1");
    page.send(all);
  }
  while (!handler.left) std::this_thread::yield();
  EXPECT_LE(handler.most, 4);  // 5 ms for each client
  EXPECT_EQ(handler.total, 100);
}

TEST_F(HubTest, SaysThatItEnds) {
  auto server = hub();
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), kToken));
  page.frame();
  server.reset();
  EXPECT_EQ(page.close_code(), 1001);
}

TEST_F(HubTest, RefusesATakenPort) {
  const auto server = hub();
  EXPECT_THROW(Hub(server->port(), kToken, {}, echo_), std::runtime_error);
}

TEST(Token, AreDifferentAndCompared) {
  const std::string token = make_token();
  EXPECT_EQ(token.size(), 32u);
  EXPECT_NE(token, make_token());
  EXPECT_TRUE(same_token(token, token));
  EXPECT_FALSE(same_token("", token));
  EXPECT_FALSE(same_token(token + "0", token));
  EXPECT_FALSE(same_token(token.substr(0, 31), token));
  EXPECT_FALSE(same_token(std::string(32, '0'), token));
}

}  // namespace
}  // namespace multipanda::cockpit::hub_test
