#include "cockpit/server/hub.hpp"

#include <atomic>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <list>
#include <random>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cockpit/server/testing/page.hpp"

namespace multipanda::cockpit::hub_test {
namespace {

using nlohmann::json;
using test::Opcode;
using test::Page;
using testing::HasSubstr;

const std::string kStop = R"({"do":"stop"})";
bool is_stop(const json& message) { return message.is_object() && message.value("do", json()) == "stop"; }

// Answers every message with itself; "flood" with many numbers, "close" by closing.
class Echo final : public Hub::Handler {
 public:
  void join(Hub::Client& client, const json& id) override {
    ++joined;
    client.send({{"id", id}, {"hello", client.id()}});
  }
  bool is_urgent(const std::string& message) const override {
    ++came;
    return is_stop(json::parse(message));
  }
  void take(Hub::Client& client, const json& message, HostTime when) override {
    arrived = when.ns;
    if (is_stop(message)) came_before_stop = came - 1, ++stops;
    if (message == "freeze") {  // and say more than waits for a server
      kill(server, SIGSTOP);
      for (int i = 0; i < 70; ++i) client.send_numbers(std::string(1'000'000, 'x'));
      return;
    }
    if (message == "flood") {
      for (int i = 0; i < 64; ++i) client.send_numbers(std::string(100'000, 'x'));
      return;
    }
    client.send({{"echo", message}});
  }
  void leave(Hub::Client&) override { ++left; }
  std::chrono::nanoseconds turn(HostTime) override { return std::chrono::milliseconds(10); }

  std::atomic<int> joined{0}, left{0}, stops{0}, came_before_stop{0};
  mutable std::atomic<int> came{0};
  std::atomic<pid_t> server{-1};
  std::atomic<std::int64_t> arrived{-1};
};

class HubTest : public testing::Test {
 protected:
  static HubLimits small() {
    HubLimits limits;
    limits.connections = 8;
    limits.message = 2000;
    limits.messages_per_s = 1e-3;
    limits.burst = 100;
    limits.unsent = 1'000'000;
    return limits;
  }
  void SetUp() override {
    std::filesystem::create_directories(files_);
    std::ofstream(files_ / "index.html") << "<p>page</p>";
    std::ofstream(files_ / "app.js") << "1";
    std::ofstream(files_ / ".secret.txt") << "no";
  }
  std::unique_ptr<Hub> hub(HubLimits limits = {}) { return hub(limits, files_); }
  std::unique_ptr<Hub> hub(HubLimits limits, const std::filesystem::path& page) {
    auto made = std::make_unique<Hub>(
        Hub::Options{.port = 0, .or_any = false, .page = page, .limits = limits}, echo_);
    token_ = made->token();
    return made;
  }
  static std::string host(const Hub& hub) { return "127.0.0.1:" + std::to_string(hub.port()); }

  const std::filesystem::path files_ =
      std::filesystem::path(testing::TempDir()) / ("hub_test_page_" + std::to_string(getpid()));
  std::string token_;
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
  for (const char* path : {"/../secret", "/.secret.txt", "/app.js/", "//app.js"})
    EXPECT_EQ(Page(server->port()).status_of(Page::request(path, host(*server))), 404) << path;
  EXPECT_EQ(Page(server->port()).status_of(Page::request("/app.js", host(*server))), 200);
}

TEST_F(HubTest, SaysThatThereIsNoPage) {
  const auto server = hub({}, files_ / "none");
  EXPECT_FALSE(server->has_page());
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
                                   std::string(R"({"do": "list", "token": ")") + token_ + "\"}",
                                   R"({"do": "hello", "token": ")" + token_.substr(1) + "\"}",
                                   R"({"do": "hello", "token": ")" + token_ + "0\"}",
                                   std::string(R"({"do": "hello", "token": 1})"), std::string("[]")}) {
    Page page(server->port());
    ASSERT_EQ(page.status_of(Page::upgrade(own, "http://" + own)), 101);
    page.say(first);
    EXPECT_EQ(page.close_code(), 4401) << first;
  }
  EXPECT_EQ(echo_.joined, 0);
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), token_));
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
  const auto server = hub(small());
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), token_));
  for (int i = 0; i < 150; ++i) page.say("1");  // a hundred at once are allowed
  EXPECT_EQ(page.close_code(), 1008);
  Page other(server->port());
  ASSERT_TRUE(other.open(server->port(), token_));
  other.say(std::string(2001, ' '));
  EXPECT_EQ(other.close_code(), 1009);
  Page binary(server->port());
  ASSERT_TRUE(binary.open(server->port(), token_));
  binary.send(test::client_frame(Opcode::binary, "x"));
  EXPECT_EQ(binary.close_code(), 1003);
}

TEST_F(HubTest, AnswersPingsAndCloses) {
  const auto server = hub();
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), token_));
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
  HubLimits limits;
  limits.ping_s = 0.1;
  limits.silent_s = 0.6;
  auto server = hub(limits);
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), token_));
  page.frame();
  EXPECT_EQ(page.frame()->opcode, 9);
  EXPECT_EQ(page.close_code(), 1011);  // no answer to a ping
  while (echo_.left < 1) std::this_thread::yield();
  limits = {};
  limits.first_s = 0.3;
  server = hub(limits);
  Page mute(server->port());  // never asks for anything
  Page slow(server->port());
  slow.send("GET / HT");
  EXPECT_EQ(mute.rest(), "");
  EXPECT_EQ(slow.rest(), "");
}

TEST_F(HubTest, EndsClientsThatDoNotRead) {
  const auto server = hub(small());
  Page page(server->port(), 4096), other(server->port());
  ASSERT_TRUE(page.open(server->port(), token_));
  ASSERT_TRUE(other.open(server->port(), token_));
  page.say("\"flood\"");
  while (echo_.left < 1) std::this_thread::yield();
  other.frame();
  other.say("1");
  EXPECT_EQ(other.message(), R"({"echo":1})");
}

// Pages that nobody closed keep nobody out: the one that was silent for longest makes room.
TEST_F(HubTest, AFullHubTakesAnotherPage) {
  const HubLimits limits = small();
  const auto server = hub(limits);
  std::list<Page> pages;
  for (std::size_t i = 0; i < limits.connections; ++i) {
    pages.emplace_back(server->port());
    ASSERT_TRUE(pages.back().open(server->port(), token_));
    ASSERT_TRUE(pages.back().frame());
  }
  pages.front().say("1");
  EXPECT_EQ(pages.front().message(), R"({"echo":1})");
  Page more(server->port());
  ASSERT_TRUE(more.open(server->port(), token_));
  ASSERT_TRUE(more.frame());
  more.say(kStop);
  EXPECT_EQ(more.message(), R"({"echo":{"do":"stop"}})");
  EXPECT_EQ(std::next(pages.begin())->close_code(), 1008);
  pages.front().say("2");
  EXPECT_EQ(pages.front().message(), R"({"echo":2})");
}

TEST_F(HubTest, AStopCountsFromAPageThatMadeRoom) {
  HubLimits limits;
  limits.connections = 1;
  const auto server = hub(limits);
  Page page(server->port()), more(server->port());
  ASSERT_TRUE(page.open(server->port(), token_));
  ASSERT_TRUE(page.frame());
  ASSERT_TRUE(more.open(server->port(), token_));
  ASSERT_TRUE(more.frame());
  page.say("1");
  page.say(kStop);
  EXPECT_EQ(page.message(), R"({"echo":{"do":"stop"}})");
  EXPECT_EQ(page.close_code(), 1008);
}

// What one page sends is read a little at a time. The server stands until all is there.
TEST_F(HubTest, AFloodKeepsNoStopOfAnotherPageWaiting) {
  constexpr int kFlood = 7000;
  HubLimits limits;
  limits.burst = limits.messages_per_s = 1e9;
  limits.waiting = 64u << 20;
  const auto server = hub(limits);
  Page flood(server->port()), other(server->port());
  for (Page* page : {&flood, &other}) {
    ASSERT_TRUE(page->open(server->port(), token_));
    ASSERT_TRUE(page->frame());
  }
  std::string all;
  for (int i = 0; i < kFlood; ++i) all += test::client_frame(Opcode::text, "1");
  ASSERT_EQ(kill(server->server(), SIGSTOP), 0);
  flood.send(all);
  other.say(kStop);
  ASSERT_EQ(kill(server->server(), SIGCONT), 0);
  while (echo_.stops < 1) std::this_thread::yield();
  EXPECT_LT(echo_.came_before_stop, kFlood / 3);
}

// Beyond its limits, and while its connection closes, a page still stops.
TEST_F(HubTest, AStopCountsBeyondTheLimits) {
  const auto server = hub(small());
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), token_));
  std::string all;
  for (int i = 0; i < 500; ++i) all += test::client_frame(Opcode::text, "1");
  page.send(all + test::client_frame(Opcode::text, kStop));
  EXPECT_EQ(page.close_code(), 1008);
  while (echo_.stops < 1) std::this_thread::yield();
}

// A NaN of Python's json, a comma too many, an end that was lost, a list, bytes in place of a text, half a
// character, a number that is too large for a double.
TEST_F(HubTest, WhateverSaysStopIsOne) {
  const auto server = hub();
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), token_));
  page.frame();
  const auto heard = [&] { return json::parse(page.message())["echo"]; };
  const std::string large = R"({"do":"stop","id":1)" + std::string(400, '0') + "}";
  for (const char* text : {large.c_str(), R"({"do":"stop","id":"\ud800"})", R"({"do":"stop","time":NaN})",
                           R"({"id":1,"do":"stop",})", R"({"id":1,"do":"stop")", R"([{"do":"stop"}])",
                           R"("stop")", "{'do': 'Stop'}", "STOP!"}) {
    page.say(text);
    const json message = heard();
    EXPECT_TRUE(is_stop(message)) << text;
    EXPECT_TRUE(message.contains("this message, which is not a JSON object")) << text;
  }
  page.say(R"({"do":" Stop ","id":1})");
  EXPECT_EQ(heard(), (json{{"do", "stop"}, {"id", 1}}));
  for (const char* text : {"nonstop", "[\"stopped\"]", "one_stop"}) {
    page.say(text);
    EXPECT_FALSE(is_stop(heard())) << text;
  }
  const int before = echo_.stops;
  page.send(test::client_frame(Opcode::binary, "stop"));
  EXPECT_EQ(page.close_code(), 1003);
  EXPECT_EQ(echo_.stops, before + 1);
}

// Connections that say nothing make room for new ones; clients with the token stay.
TEST_F(HubTest, AThousandConnectionsLockNobodyOut) {
  const auto server = hub();
  Page client(server->port());
  ASSERT_TRUE(client.open(server->port(), token_));
  client.frame();
  std::list<Page> idle;
  for (int i = 0; i < 1000; ++i) {
    idle.emplace_back(server->port());
    ASSERT_TRUE(idle.back().connected()) << i;
  }
  client.say("1");
  EXPECT_EQ(client.message(), R"({"echo":1})");
  Page late(server->port());
  ASSERT_TRUE(late.open(server->port(), token_));
  EXPECT_THAT(late.message(), HasSubstr("hello"));
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
  bool is_urgent(const std::string& message) const override { return message == kStop; }
  void take(Hub::Client&, const json& message, HostTime) override {
    if (is_stop(message)) stopped_after = taken_;
    if (message == "hold") ++held;
    const HostTime begun = host_now();
    while (seconds(host_now() - begun) < 2e-3) {
    }
    ++taken_, ++in_turn_;
  }
  bool outlasts(const std::string& message) override { return message == "\"hold\""; }
  void leave(Hub::Client&) override { left = true; }
  std::chrono::nanoseconds turn(HostTime) override {
    most = std::max(most.load(), std::exchange(in_turn_, 0));
    total = taken_;
    return std::chrono::seconds(1);
  }

  std::atomic<int> most{0}, total{0}, stopped_after{-1}, held{0};
  std::atomic<bool> left{false};

 private:
  int taken_ = 0, in_turn_ = 0;
};

// The handler's turn ends holds that are silent, so the messages of a busy client must not keep it waiting.
// Its own stop overtakes them, and of what is left of a client that is gone, only what outlasts it is taken.
TEST_F(HubTest, ABusyClientHasItsShareOfATurn) {
  Slow handler;
  const Hub server({.port = 0, .or_any = false, .page = {}, .limits = {}}, handler);
  token_ = server.token();
  {
    Page page(server.port());
    ASSERT_TRUE(page.open(server.port(), token_));
    std::string all;
    for (int i = 0; i < 100; ++i) all += test::client_frame(Opcode::text, "1");
    page.send(all);
    while (handler.total < 100) std::this_thread::yield();
    page.send(all + test::client_frame(Opcode::text, kStop) + test::client_frame(Opcode::text, "\"hold\""));
    while (handler.stopped_after < 0) std::this_thread::yield();
  }
  while (!handler.left) std::this_thread::yield();
  EXPECT_LE(handler.most, 2);  // 1 ms for each client
  EXPECT_LT(handler.stopped_after, 110);
  EXPECT_LT(handler.total, 190);
  EXPECT_EQ(handler.held, 1);
}

TEST_F(HubTest, SaysThatItEnds) {
  auto server = hub();
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), token_));
  page.frame();
  server.reset();
  EXPECT_EQ(page.close_code(), 1001);
}

TEST_F(HubTest, RefusesATakenPort) {
  const auto server = hub();
  const auto again = [&](bool or_any) {
    return Hub({.port = server->port(), .or_any = or_any, .page = {}, .limits = {}}, echo_).port();
  };
  EXPECT_THROW((void)again(false), std::runtime_error);
  EXPECT_NE(again(true), server->port());
}

TEST_F(HubTest, TokensAreDifferent) {
  const auto one = hub();
  const std::string token = token_;
  EXPECT_EQ(token.size(), 32u);
  const auto other = hub();
  EXPECT_NE(token, token_);
}

// Whatever comes in place of HTTP, of a WebSocket or of JSON: others are served as before.
TEST_F(HubTest, NonsenseHarmsNobodyElse) {
  const auto server = hub();
  Page client(server->port());
  ASSERT_TRUE(client.open(server->port(), token_));
  client.frame();
  std::mt19937 random(7);
  const auto nonsense = [&](std::size_t size) {
    std::string bytes(size, ' ');
    for (char& byte : bytes) byte = static_cast<char>(random());
    return bytes;
  };
  for (int i = 0; i < 50; ++i) {
    Page(server->port()).send(nonsense(1 + random() % 3000));
    Page upgraded(server->port());
    ASSERT_EQ(upgraded.status_of(Page::upgrade(host(*server), "http://" + host(*server))), 101);
    upgraded.send(nonsense(1 + random() % 3000));
  }
  for (const std::string& text : {std::string(20'000, '['), std::string("NaN"), std::string("{\"a\": 1e999}"),
                                  std::string("\"\\ud800\""), std::string(5'000, '9'), std::string("{")}) {
    client.say(text);
    EXPECT_EQ(client.message(), R"({"echo":null})") << text.substr(0, 20);
  }
  client.say("1");
  EXPECT_EQ(client.message(), R"({"echo":1})");
  EXPECT_EQ(echo_.joined, 1);
}

// The handler hears of everybody's end, and the run goes on.
TEST_F(HubTest, APageServerThatEndsEndsItsClients) {
  const auto server = hub();
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), token_));
  page.frame();
  ASSERT_EQ(kill(server->server(), SIGKILL), 0);
  while (echo_.left < 1) std::this_thread::yield();
}

// A server that hangs has lost its clients: once it goes on, their Stop would reach nobody.
TEST_F(HubTest, APageServerThatHangsEnds) {
  HubLimits limits;
  limits.unsent = 1u << 30;
  const auto server = hub(limits);
  echo_.server = server->server();
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), token_));
  page.say("\"freeze\"");
  while (echo_.left < 1) std::this_thread::yield();
  const pid_t hung = server->server();
  (void)kill(hung, SIGCONT);
  for (int k = 0; k < 1000 && kill(hung, 0) == 0; ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_NE(kill(hung, 0), 0);
}

// What waited while the page server stood still may be of somebody who has given up: it comes without a time.
TEST_F(HubTest, WhatWaitedInAFrozenPageServerIsLate) {
  const auto server = hub();
  Page page(server->port());
  ASSERT_TRUE(page.open(server->port(), token_));
  page.frame();
  page.say("1");
  page.message();
  EXPECT_GT(echo_.arrived.load(), 0);
  ASSERT_EQ(kill(server->server(), SIGSTOP), 0);
  page.say("2");
  std::this_thread::sleep_for(std::chrono::milliseconds(800));
  EXPECT_GT(echo_.arrived.load(), 0);
  ASSERT_EQ(kill(server->server(), SIGCONT), 0);
  page.message();
  EXPECT_EQ(echo_.arrived, 0);
  while (echo_.arrived == 0) {  // until it has settled, within the rate that a client may have
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    page.say("3");
    ASSERT_NE(page.message(), "");
  }
}

}  // namespace
}  // namespace multipanda::cockpit::hub_test
