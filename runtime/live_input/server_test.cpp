#include "runtime/live_input/server.hpp"

#include <atomic>
#include <list>
#include <map>
#include <optional>
#include <random>
#include <sys/socket.h>
#include <sys/un.h>
#include <thread>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "runtime/live_input/client.hpp"
#include "runtime/live_input/testing/live_fixture.hpp"

namespace multipanda::server_test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

// A client that sends and reads nothing by itself.
class Raw {
 public:
  explicit Raw(const std::filesystem::path& path) : line_(connect_to(path, SOCK_STREAM), 1 << 24) {}
  void send(const std::string& text) {
    std::size_t sent = 0;
    while (sent < text.size()) {
      const ssize_t n = ::send(line_.file(), text.data() + sent, text.size() - sent, MSG_NOSIGNAL);
      ASSERT_GT(n, 0);
      sent += static_cast<std::size_t>(n);
    }
  }
  void send_no_more() { ASSERT_EQ(shutdown(line_.file(), SHUT_WR), 0); }
  json next() {
    for (;;) {
      if (auto line = line_.next()) return json::parse(line->text);
      if (line_.input_ended()) return {};
      (void)line_.receive();
      std::this_thread::yield();
    }
  }

 private:
  LineConnection line_;
};

class ServerTest : public testing::Test {
 protected:
  ServerTest() : server_(folder_ / "fixture.sock", fixture_.run()) {}
  // What was sent before is with the loop, or refused.
  void settle() {
    LiveClient other(server_.path());
    EXPECT_EQ(other.ask({{"do", "list"}})["ok"], true);
    EXPECT_EQ(other.ask({{"do", "list"}})["ok"], true);
  }

  test::PrivateFolder folder_;
  test::LiveFixture fixture_;
  LiveServer server_;
};

TEST_F(ServerTest, AnswersByIdWhileTheLoopRuns) {
  const test::Stepping stepping(fixture_);
  LiveClient client(server_.path());
  const json answer = client.ask({{"do", "switch"}, {"activate", {"pose0"}}});
  EXPECT_EQ(answer["ok"], true) << answer;
  EXPECT_EQ(client.ask({{"do", "stop"}})["ok"], true);
  EXPECT_EQ(client.ask({{"do", "nonsense"}})["ok"], false);
}

// A request that the loop does not take delays no other client.
TEST_F(ServerTest, OneClientDoesNotWaitForAnother) {
  LiveClient waiting(server_.path()), quick(server_.path());
  waiting.tell({{"do", "switch"}, {"activate", {"pose0"}}, {"id", "w"}});  // nobody steps
  EXPECT_EQ(quick.ask({{"do", "list"}})["ok"], true);
  fixture_.steps(1);
  const json late = waiting.next(10);
  EXPECT_EQ(late["id"], "w");
}

TEST_F(ServerTest, AStalledRunIsReported) {
  LiveClient client(server_.path());
  const json answer = client.ask({{"do", "switch"}, {"activate", {"pose0"}}});
  EXPECT_EQ(answer["verdict"], "timeout");
  EXPECT_THAT(answer["reason"].get<std::string>(), HasSubstr("paused"));
}

TEST_F(ServerTest, ManyClientsAtOnce) {
  const test::Stepping stepping(fixture_);
  std::vector<std::jthread> threads;
  std::atomic<int> good{0};
  for (int n = 0; n < 8; ++n) {
    threads.emplace_back([&, n] {
      LiveClient client(server_.path());
      for (int k = 0; k < 25; ++k) {
        const json answer = client.ask({{"do", "parameter"},
                                        {"controllet", "pose0"},
                                        {"name", "translational_stiffness_n_per_m"},
                                        {"value", 100 + n}});
        if (answer.value("ok", false)) ++good;
      }
    });
  }
  threads.clear();
  EXPECT_EQ(good.load(), 200);
}

TEST_F(ServerTest, StreamsTheState) {
  const test::Stepping stepping(fixture_);
  LiveClient client(server_.path());
  EXPECT_EQ(client.ask({{"do", "subscribe"}, {"rate_hz", 1000}})["ok"], true);
  std::int64_t last = -1;
  for (int k = 0; k < 50; ++k) {
    const json line = client.next(10);
    ASSERT_TRUE(line.contains("state")) << line;
    EXPECT_GE(line["state"]["cycle"].get<std::int64_t>(), last);
    last = line["state"]["cycle"];
  }
  EXPECT_GT(last, 0);
  EXPECT_EQ(client.ask({{"do", "unsubscribe"}})["ok"], true);
}

// It asked for a thousand states per second and reads none.
TEST_F(ServerTest, AClientThatDoesNotReadIsDropped) {
  fixture_.steps(1);
  LiveClient lazy(server_.path()), other(server_.path());
  lazy.tell({{"do", "subscribe"}, {"rate_hz", 1000}});
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (server_.clients_dropped() == 0 && std::chrono::steady_clock::now() < deadline) {
    EXPECT_EQ(other.ask({{"do", "state"}})["ok"], true);
  }
  EXPECT_EQ(server_.clients_dropped(), 1u);
}

TEST_F(ServerTest, ManyRequestsInOnePieceAreAllAnswered) {
  LiveClient client(server_.path());
  for (int k = 0; k < 300; ++k) client.tell({{"do", "list"}, {"id", k}});
  for (int k = 0; k < 300; ++k) EXPECT_EQ(client.next(30)["id"], k);
}

TEST_F(ServerTest, OfAClosedClientAStopIsExecutedAndNothingElse) {
  {
    Raw gone(server_.path());
    gone.send(R"({"do":"switch","activate":["pose0"]})"
              "\n"
              R"({"do":"stop","arms":["arm1"]})");
  }
  settle();
  fixture_.steps(2);
  EXPECT_EQ(fixture_.loop.modes().stopped(), ArmSet::of(1));
  // Nor what the loop had not taken yet.
  {
    Raw gone(server_.path());
    gone.send(R"({"do":"switch","activate":["pose0"]})"
              "\n");
    settle();
  }
  settle();
  fixture_.steps(2);
  EXPECT_EQ(fixture_.loop.modes().owner(0), fixture_.loop.find("arm0_hold"));
}

// The loop had not taken it when its client closed.
TEST_F(ServerTest, ASwitchToHoldThatWaitsForTheLoopIsExecuted) {
  LiveClient other(server_.path());
  other.tell({{"do", "switch"}, {"activate", {"pose0"}}});
  settle();
  fixture_.steps(1);
  ASSERT_EQ(fixture_.loop.modes().owner(0), fixture_.loop.find("pose0"));
  {
    Raw gone(server_.path());
    gone.send(R"({"do":"switch","deactivate":["pose0"]})"
              "\n");
    settle();
  }
  settle();
  fixture_.steps(2);
  EXPECT_EQ(fixture_.loop.modes().owner(0), fixture_.loop.find("arm0_hold"));
}

// If it dies or stands still, the arms of what it leads are held, and not if it leaves in order.
TEST_F(ServerTest, WhatAClientLeadsEndsWithIt) {
  const test::Stepping stepping(fixture_);
  LiveClient other(server_.path());
  const auto leads = [&] { return fixture_.loop.modes().owner(0) == fixture_.loop.find("pose0"); };
  const std::string lead = R"({"do":"lead","controllets":["pose0","none"],"silence_s":0.3,"id":1})"
                           "\n";
  for (const std::string way : {"closes", "is silent", "leaves in order", "dies behind a flood"}) {
    ASSERT_EQ(other.ask({{"do", "switch"}, {"activate", {"pose0", "pose1"}}})["ok"], true);
    std::optional<Raw> client(server_.path());
    if (way == "dies behind a flood") {  // its lead has not had its turn
      std::string flood;
      ASSERT_TRUE(leads());
      for (int i = 0; i < 500; ++i)
        flood += R"({"do":"list","id":3})"
                 "\n";
      client->send(flood + lead);
      client.reset();
      for (const HostTime begun = host_now(); leads() && seconds(host_now() - begun) < 5;)
        std::this_thread::yield();
      EXPECT_FALSE(leads()) << way;
      continue;
    }
    client->send(lead);
    ASSERT_EQ(client->next()["ok"], true);
    for (const HostTime begun = host_now(); seconds(host_now() - begun) < 0.6; std::this_thread::yield()) {
      client->send(lead);
      ASSERT_EQ(client->next()["ok"], true);
    }
    ASSERT_TRUE(leads()) << way;
    const HostTime now = host_now();
    if (way == "leaves in order") {
      client->send(R"({"do":"lead","controllets":[],"id":2})"
                   "\n");
      ASSERT_EQ(client->next()["ok"], true);
    }
    if (way != "is silent") client.reset();
    if (way == "leaves in order") {
      settle();
      EXPECT_EQ(
          other.ask(
              {{"do", "parameter"}, {"controllet", "pose0"}, {"name", "damping_ratio"}, {"value", 1}})["ok"],
          true);
      EXPECT_TRUE(leads());
    } else {
      while (leads()) std::this_thread::yield();
      EXPECT_EQ(seconds(host_now() - now) > 0.25, way == "is silent");
      if (client) EXPECT_TRUE(client->next().is_null()) << "it is told by the end of its connection";
    }
    EXPECT_EQ(fixture_.loop.modes().owner(1), fixture_.loop.find("pose1"));
  }
  EXPECT_EQ(other.ask({{"do", "lead"}, {"silence_s", 0.1}})["verdict"], "malformed");
}

// A script leaks connections; the last ones even have requests, subscriptions, channels.
TEST_F(ServerTest, AFullServerTakesAStop) {
  std::list<Raw> leaked;
  for (std::size_t k = 0; k < 3 * LiveServer::kMaxClients; ++k) {
    leaked.emplace_back(server_.path());
    if (k >= LiveServer::kMaxClients)
      leaked.back().send(k % 2 == 0 ? R"({"do":"subscribe"})"
                                      "\n"
                                    : R"({"do":"stream","controllet":"pose0","input":"pose"})"
                                      "\n");
    if (k % 8 == 0) settle();  // clients of its own, which are let in as well
    Raw fresh(server_.path());
    fresh.send(R"({"do":"stop","id":1})"
               "\n");
    settle();
    fixture_.steps(1);
    ASSERT_EQ(fixture_.loop.modes().stopped(), ArmSet::all(2)) << k;
    EXPECT_EQ(fresh.next()["ok"], true);
    fresh.send(R"({"do":"resume","id":2})"
               "\n");
    settle();
    fixture_.steps(1);
    ASSERT_EQ(fresh.next()["ok"], true) << k;
  }
  EXPECT_EQ(leaked.front().next()["verdict"], "too_many_clients");  // and why is the last that it hears
}

// Between its connection and its stop, which a busy computer may delay, others have filled the server.
TEST_F(ServerTest, AStopCountsFromAClientThatMadeRoom) {
  Raw slow(server_.path());
  settle();
  std::list<Raw> leaked;
  for (std::size_t k = 0; k < 2 * LiveServer::kMaxClients; ++k) leaked.emplace_back(server_.path());
  settle();
  slow.send(R"({"do":"stop","id":1})"
            "\n");
  settle();
  fixture_.steps(1);
  EXPECT_EQ(fixture_.loop.modes().stopped(), ArmSet::all(2));
  EXPECT_EQ(slow.next()["ok"], true);
  EXPECT_EQ(slow.next()["verdict"], "too_many_clients");
}

// The clients that hold a connection only go first, the one that was silent for longest before the others.
TEST_F(ServerTest, AFullServerKeepsItsBusyClients) {
  LiveClient busy(server_.path());
  ASSERT_EQ(busy.ask({{"do", "subscribe"}, {"rate_hz", 0.1}})["ok"], true);
  std::list<Raw> idle;
  for (std::size_t k = 0; k < LiveServer::kMaxClients + 20; ++k) idle.emplace_back(server_.path());
  EXPECT_EQ(busy.ask({{"do", "list"}})["ok"], true);
}

// It publishes without reading: its refusals fill every buffer, and its own stop gets through.
TEST_F(ServerTest, AClientThatDoesNotReadStops) {
  fixture_.steps(1);
  Raw lazy(server_.path());
  const std::string sample =
      R"({"do":"reference","controllet":"pose0","input":"pose","position_m":[0.4,0,0.5],"quaternion_wxyz":[0,1,0,0],"stream":true)";
  constexpr int kSamples = 3000;
  for (int k = 0; k < kSamples; ++k) lazy.send(sample + "}\n");
  for (int k = 0; k < kSamples; ++k) lazy.send(sample + ",\"id\":" + std::to_string(k) + "}\n");
  lazy.send(R"({"do":"switch","activate":["pose0"],"id":"switch"})"
            "\n"
            R"({"do":"stop","id":"stop"})"
            "\n");
  settle();
  fixture_.steps(1);
  EXPECT_EQ(fixture_.loop.modes().stopped(), ArmSet::all(2));
  // Answered when it reads; the refusals of samples without an id are one line.
  std::map<std::string, int> answers;
  for (json answer; !answers.contains("\"stop\"");) {
    answer = lazy.next();
    ++answers[answer["id"].dump()];
  }
  EXPECT_LT(answers["null"], kSamples / 10);  // also how many were dropped, for each time that it had to
}

// What waits for its client to read is as old as any other request.
TEST_F(ServerTest, WhatWaitedForItsClientToReadIsNotExecuted) {
  const test::Stepping stepping(fixture_);
  Raw lazy(server_.path());
  for (int k = 0; k < 300; ++k)
    lazy.send(R"({"do":"list"})"
              "\n");
  lazy.send(R"({"do":"switch","activate":["pose0"],"id":"switch"})"
            "\n");
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  json answer = lazy.next();
  while (answer["id"] != "switch") answer = lazy.next();
  EXPECT_EQ(answer["verdict"], "timeout");
  EXPECT_EQ(fixture_.loop.modes().owner(0), fixture_.loop.find("arm0_hold"));
}

// Clients flood the server with requests that take long; a stop overtakes them, those of its own client, too.
TEST_F(ServerTest, AStopOvertakesAFlood) {
  std::list<Raw> flood;
  std::string requests;
  for (int k = 0; k < 400; ++k)
    requests += R"({"do":"list"})"
                "\n";
  for (int k = 0; k < 20; ++k) flood.emplace_back(server_.path()).send(requests);
  flood.back().send(R"({"do":"stop"})"
                    "\n");
  while (fixture_.loop.modes().stopped().empty()) fixture_.steps(1);
  for (Raw& client : flood) EXPECT_EQ(client.next()["ok"], true);
}

// Asked for in one piece, the stop is the last word.
TEST_F(ServerTest, AResumeBeforeAStopDoesNotEndIt) {
  Raw client(server_.path());
  client.send(R"({"do":"stop","id":1})"
              "\n");
  settle();
  fixture_.steps(1);
  ASSERT_EQ(client.next()["ok"], true);
  client.send(R"({"do":"resume","id":2})"
              "\n"
              R"({"do":"stop","id":3})"
              "\n");
  settle();
  fixture_.steps(2);
  settle();
  fixture_.steps(2);
  EXPECT_EQ(fixture_.loop.modes().stopped(), ArmSet::all(2));
}

// The server's thread stands still, as it does with its program. What was asked meanwhile is not executed.
TEST_F(ServerTest, AfterAGapOnlyAStopIsExecuted) {
  class Standing final : public Backend {
   public:
    explicit Standing(Backend& backend) : backend_(backend) {}
    std::size_t arm_count() const override { return backend_.arm_count(); }
    Capabilities capabilities(ArmIndex arm) const override { return backend_.capabilities(arm); }
    ArmSet wait() override { return {}; }
    LoopTime now() const override { return {}; }
    void read(ArmSet, std::span<ArmState>) override {}
    void write(ArmSet, std::span<const ArmCommand>) override {}
    std::optional<ConnectionStatistics> connection(ArmIndex) const override {
      if (stand.exchange(false))
        std::this_thread::sleep_for(GapWatch::kLongest + std::chrono::milliseconds(200));
      return std::nullopt;
    }
    std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return {}; }
    mutable std::atomic<bool> stand{false};

   private:
    Backend& backend_;
  } standing(fixture_.loop.world);
  LiveInputContext run = fixture_.run();
  run.backend = &standing;
  const LiveServer server(folder_ / "standing.sock", run);
  fixture_.steps(1);
  LiveClient watcher(server.path());
  Raw asking(server.path());
  ASSERT_EQ(watcher.ask({{"do", "list"}})["ok"], true);
  standing.stand = true;
  watcher.tell({{"do", "state"}, {"id", "state"}});
  while (standing.stand) std::this_thread::yield();
  asking.send(R"({"do":"switch","activate":["pose0"],"id":1})"
              "\n"
              R"({"do":"stop","arms":["arm1"],"id":2})"
              "\n");
  const json refused = asking.next();
  EXPECT_EQ(refused["id"], 1);
  EXPECT_EQ(refused["verdict"], "timeout");
  EXPECT_THAT(refused["reason"].get<std::string>(), HasSubstr("stalled"));
  fixture_.steps(2);
  EXPECT_EQ(asking.next()["stopped"], json::array({"arm1"}));
  EXPECT_EQ(fixture_.loop.modes().owner(0), fixture_.loop.find("arm0_hold"));
  json later;
  do {
    later = watcher.ask({{"do", "parameter"}, {"controllet", "pose0"}, {"name", "none"}, {"value", 1}});
  } while (later["verdict"] == "timeout");
  EXPECT_EQ(later["verdict"], "unknown_parameter");
}

// As slow as the test says, from the first call on: the server stands still between two steps of one turn.
std::atomic<int> pauses_left{0};
std::atomic<bool> first_pause_over{false};
double pausing_clock() {
  const int left = pauses_left.load();
  if (left > 0) --pauses_left;
  while (left == 4 && !first_pause_over) std::this_thread::yield();
  if (left == 2) std::this_thread::sleep_for(GapWatch::kLongest + std::chrono::milliseconds(200));
  return realtime_s();
}

TEST_F(ServerTest, AGapWithinATurnCountsToo) {
  const LiveServer server(folder_ / "pausing.sock", fixture_.run(), pausing_clock);
  const test::Stepping stepping(fixture_);
  LiveClient owner(server.path());
  ReferenceStream first = owner.open_stream("joint0", "joints"),
                  second = owner.open_stream("joint0", "joints");
  const JointVector q = fixture_.loop.models[0]->q_home();
  Raw asking(server.path());
  for (ReferenceStream* stream : {&first, &second}) {
    ASSERT_TRUE(stream->send({q.data(), 7}));
    while (owner.ask({{"do", "channels"}})["channels"][stream == &first ? 0 : 1]["received"] != 1) {
    }
  }
  asking.send("{\"do\":\"list\"}\n");
  ASSERT_EQ(asking.next()["ok"], true);
  // One turn waits with the first packet, until the request and the second one are there. The next turn reads
  // the request, then stands still with the second packet.
  first_pause_over = false;
  pauses_left = 4;
  ASSERT_TRUE(first.send({q.data(), 7}));
  while (pauses_left == 4) std::this_thread::yield();
  asking.send("{\"do\":\"switch\",\"activate\":[\"pose0\"],\"id\":1}\n");
  ASSERT_TRUE(second.send({q.data(), 7}));
  first_pause_over = true;
  const json answer = asking.next();
  EXPECT_EQ(answer["verdict"], "timeout") << answer;
  EXPECT_THAT(answer["reason"].get<std::string>(), HasSubstr("stalled"));
}

// The server stands still, for less than a gap, while somebody asks and gives up. A client that only sends
// nothing more waits for its answer; a stop counts in any case.
TEST_F(ServerTest, WhoHangsUpWhileTheServerStandsLeavesNothingThatActs) {
  const LiveServer server(folder_ / "standing.sock", fixture_.run(), pausing_clock);
  const test::Stepping stepping(fixture_);
  LiveClient owner(server.path());
  ReferenceStream stream = owner.open_stream("joint0", "joints");
  const JointVector q = fixture_.loop.models[0]->q_home();
  std::optional<Raw> asker;
  const auto ask_meanwhile = [&](const std::string& text, bool known, bool gives_up) {
    if (known) {
      asker.emplace(server.path());
      asker->send("{\"do\":\"list\"}\n");
      ASSERT_EQ(asker->next()["ok"], true);
    }
    first_pause_over = false;
    pauses_left = 4;
    ASSERT_TRUE(stream.send({q.data(), 7}));
    while (pauses_left == 4) std::this_thread::yield();
    if (!known) asker.emplace(server.path());
    asker->send(text + "\n");
    if (gives_up) {
      asker.reset();
    } else {
      asker->send_no_more();
    }
    pauses_left = 0;
    first_pause_over = true;
    for (int k = 0; k < 3; ++k) ASSERT_EQ(owner.ask({{"do", "list"}})["ok"], true);
  };
  const auto pose = [&] { return fixture_.loop.modes().owner(0) == fixture_.loop.find("pose0"); };
  const std::string start = R"({"do":"switch","activate":["pose0"]})";
  for (const bool known : {false, true}) {
    ask_meanwhile(start, known, true);
    (void)owner.ask(
        {{"do", "parameter"}, {"controllet", "pose1"}, {"name", "damping_ratio"}, {"value", 0.7}});
    EXPECT_FALSE(pose()) << known;
    ask_meanwhile(R"({"do":"stop","arms":["arm0"]})", known, true);
    while (!fixture_.loop.modes().stopped().contains(ArmIndex{0})) std::this_thread::yield();
    ASSERT_EQ(owner.ask({{"do", "resume"}})["ok"], true);
    ask_meanwhile(start, known, false);
    EXPECT_EQ(asker->next()["ok"], true) << known;
    EXPECT_TRUE(pose()) << known;
    // What only holds counts, and nothing before or after it.
    ask_meanwhile(R"({"do":"switch","activate":["joint0"]})"
                  "\n"
                  R"({"do":"switch","deactivate":["pose0"]})"
                  "\n"
                  R"({"do":"switch","activate":["pose1"]})",
                  known, true);
    (void)owner.ask(
        {{"do", "parameter"}, {"controllet", "pose1"}, {"name", "damping_ratio"}, {"value", 0.7}});
    EXPECT_EQ(fixture_.loop.modes().owner(0), fixture_.loop.find("arm0_hold")) << known;
    EXPECT_EQ(fixture_.loop.modes().owner(1), fixture_.loop.find("arm1_hold")) << known;
  }
}

// A resume that is on its way while another client stops the arms again.
TEST_F(ServerTest, AResumeNamesTheStopThatItsAskerHasSeen) {
  const test::Stepping stepping(fixture_);
  LiveClient one(server_.path()), other(server_.path());
  ASSERT_EQ(one.ask({{"do", "stop"}})["ok"], true);
  const json seen = one.ask({{"do", "state"}})["state"]["stops"];
  ASSERT_EQ(other.ask({{"do", "stop"}})["ok"], true);  // of arms that are stopped: at once
  while (one.ask({{"do", "state"}})["state"]["stops"] == seen) {
  }
  const json refused = one.ask({{"do", "resume"}, {"stops", seen}});
  EXPECT_EQ(refused["verdict"], "arm_stopped") << refused;
  EXPECT_THAT(refused["reason"].get<std::string>(), HasSubstr("stopped again"));
  EXPECT_EQ(fixture_.loop.modes().stopped(), ArmSet::all(2));
  for (const json& wrong : {json("all"), json(-1), json(1.5), json(4294967295u)})
    EXPECT_EQ(one.ask({{"do", "resume"}, {"stops", wrong}})["verdict"], "malformed") << wrong;
  const json now = one.ask({{"do", "state"}})["state"]["stops"];
  EXPECT_EQ(now.get<int>(), seen.get<int>() + 1);
  EXPECT_EQ(one.ask({{"do", "resume"}, {"stops", now}})["ok"], true);
  EXPECT_TRUE(fixture_.loop.modes().stopped().empty());
}

// A NaN of Python's json, a name in another encoding, a comma too many, an end that was lost, a list.
TEST_F(ServerTest, AStopThatIsNoJsonStops) {
  for (const char* text :
       {R"({"do":"stop","time":NaN})", "{\"do\":\"stop\",\"arms\":[\"\xe4rm\"]}", R"({"id":1,"do":"stop",})",
        R"({"id":1,"do":"stop")", R"([{"do":"stop"}])", R"("stop")", "{'do': 'Stop'}",
        "{\u201cdo\u201d: \u201cstop\u201d}", "do: stop", "STOP!"}) {
    Raw client(server_.path());
    client.send(text + std::string("\n"));
    settle();
    fixture_.steps(1);
    EXPECT_EQ(fixture_.loop.modes().stopped(), ArmSet::all(2)) << text;
    const json answer = client.next();
    EXPECT_EQ(answer["ok"], true) << text;
    EXPECT_THAT(answer.value("message", ""), HasSubstr("not a JSON object")) << text;
    client.send("{\"do\":\"resume\"}\n");
    settle();
    fixture_.steps(1);
    ASSERT_EQ(client.next()["ok"], true);
  }
}

// A run that is frozen, or too busy to accept, is asked again until the patience is over.
TEST(StopRun, WaitsForAPlaceBeforeTheRun) {
  const test::PrivateFolder folder;
  sockaddr_un address{.sun_family = AF_UNIX, .sun_path = {}};
  const std::filesystem::path path = folder / "full.sock";
  path.native().copy(address.sun_path, sizeof(address.sun_path) - 1);
  const auto* place = reinterpret_cast<const sockaddr*>(&address);
  const int listener = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  ASSERT_EQ(bind(listener, place, sizeof(address)), 0);
  ASSERT_EQ(listen(listener, 0), 0);
  std::list<LineConnection> others;
  for (int result = 0; result == 0;) {
    const int file = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    others.emplace_back(file, 1024);
    result = connect(file, place, sizeof(address));
  }
  // It is found without waiting for it, so that the runs beside it are stopped at once.
  const HostTime before = host_now();
  EXPECT_EQ(running_sockets(path.parent_path()), std::vector{path});
  EXPECT_LT(seconds(host_now() - before), 1);  // connect() would wait for 2 s
  json answer;
  std::thread asker([&] { answer = stop_run(path, {}, 60); });
  std::this_thread::sleep_for(std::chrono::milliseconds(2200));  // connect() waits for 2 s
  bool stopped = false;
  for (std::list<LineConnection> clients; !stopped; std::this_thread::yield()) {
    if (const int file = accept4(listener, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC); file >= 0)
      clients.emplace_back(file, 1024);
    for (LineConnection& client : clients) {
      (void)client.receive();
      const auto line = client.next();
      if (!line) continue;
      EXPECT_TRUE(is_stop(json::parse(line->text))) << line->text;
      client.send(R"({"id":1,"ok":true})");
      client.flush();
      stopped = true;
    }
  }
  asker.join();
  close(listener);
  EXPECT_EQ(answer["ok"], true);
  EXPECT_THROW((void)stop_run(folder / "nobody.sock", {}, 60), std::runtime_error);
}

// Another computer's clock counts from another time; its requests are as old as they are.
TEST_F(ServerTest, AnswersTellTheClock) {
  LiveClient client(server_.path());
  const HostTime before = host_now();
  const json answer = client.ask({{"do", "list"}});
  EXPECT_GE(answer["now_ns"].get<std::int64_t>(), before.ns);
  EXPECT_LE(answer["now_ns"].get<std::int64_t>(), host_now().ns);
}

TEST_F(ServerTest, LinesThatAreTooLongAreRefusedAndDiscarded) {
  const int file = connect_to(server_.path(), SOCK_STREAM);
  LineConnection line(file, 1 << 20);
  line.send(std::string(200000, 'x'));
  line.send(R"({"do":"state","id":7})");
  std::vector<json> answers;
  while (answers.size() < 2) {
    line.flush();
    line.receive();
    while (auto got = line.next()) answers.push_back(json::parse(got->text));
    ASSERT_FALSE(line.broken());
  }
  EXPECT_EQ(answers[0]["verdict"], "malformed");
  EXPECT_THAT(answers[0]["reason"].get<std::string>(), HasSubstr("65536"));
  EXPECT_EQ(answers[1]["id"], 7);
}

// Requests with random damage: every line is answered, nothing crashes, and the arms keep their owners.
TEST_F(ServerTest, DamagedRequestsAreAnsweredAndHarmless) {
  const test::Stepping stepping(fixture_);
  const std::vector<std::string> good{
      R"({"do":"switch","activate":["pose0","pose1"],"only":true})",
      R"({"do":"reference","controllet":"pose0","input":"pose","position_m":[0.4,0,0.5],"quaternion_wxyz":[0,1,0,0],"stream":true})",
      R"({"do":"parameter","controllet":"pose0","name":"translational_stiffness_n_per_m","value":[1e300,2,3]})",
      R"({"do":"feature","controllet":"both","name":"joint_limits","on":false})",
      R"({"do":"subscribe","rate_hz":1e-999})",
      R"({"do":"stream","controllet":"both","input":"left_pose","frame":"arm1_base"})",
      R"({"do":"set_load","arm":"arm0","mass_kg":1,"com_m":[0,0,0],"inertia_kg_m2":{"xx":1,"yy":1,"zz":1}})",
      // No resume among them: it might lift the observer's stop at once.
      R"({"do":"list"})", R"([[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[{"do":1}]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]])"};
  std::mt19937 random(20240);
  LiveClient observer(server_.path());
  for (int round = 0; round < 20; ++round) {
    const int file = connect_to(server_.path(), SOCK_STREAM);
    ASSERT_GE(file, 0);
    LineConnection line(file, 1 << 20);
    for (int k = 0; k < 50; ++k) {
      std::string text = good[random() % good.size()];
      for (std::size_t n = random() % 4; n > 0; --n) {
        const std::size_t at = random() % text.size();
        switch (random() % 3) {
          case 0:
            text[at] = static_cast<char>(random() % 256);
            break;
          case 1:
            text.erase(at, 1 + random() % 8);
            break;
          default:
            text.insert(at, text.substr(random() % text.size(), random() % 16));
        }
        if (text.empty()) text.push_back('?');
      }
      std::replace(text.begin(), text.end(), '\n', ' ');
      line.send(text);
    }
    line.flush();
    if (round % 2 == 0) continue;  // leaves at once
    line.send(R"({"do":"unsubscribe","id":"end"})");
    bool ended = false;
    while (!ended && !line.input_ended() && !line.broken()) {
      line.flush();
      line.receive();
      while (auto got = line.next()) ended = ended || json::parse(got->text).value("id", json()) == "end";
    }
    EXPECT_TRUE(ended);
  }
  EXPECT_EQ(observer.ask({{"do", "state"}})["ok"], true);
  EXPECT_EQ(observer.ask({{"do", "stop"}})["ok"], true);
}

TEST_F(ServerTest, PacketsReachTheirInputInOrder) {
  LiveClient client(server_.path());
  client.tell({{"do", "switch"}, {"activate", {"joint0"}}, {"id", 0}});
  ASSERT_EQ(client.ask({{"do", "list"}})["ok"], true);  // by now the switch is with the loop
  fixture_.steps(1);
  ASSERT_EQ(client.next(10)["ok"], true);
  ReferenceStream stream = client.open_stream("joint0", "joints");
  const JointVector q = fixture_.loop.models[0]->q_home();
  constexpr std::size_t kPackets = 500;
  for (std::size_t k = 1; k <= kPackets; ++k) {  // one per cycle
    ASSERT_TRUE(stream.send({q.data(), 7}, static_cast<std::int64_t>(k)));
    const json channels = client.ask({{"do", "channels"}});
    ASSERT_EQ(channels["channels"][0]["received"], k);
    fixture_.steps(1);
  }
  const json channel = client.ask({{"do", "channels"}})["channels"][0];
  EXPECT_EQ(channel["lost"], 0);
  EXPECT_EQ(channel["refused"], 0);
  EXPECT_EQ(channel["client_time_ns"], kPackets);
  EXPECT_EQ(fixture_.loop.modes().owner(0), fixture_.loop.find("joint0"));
  fixture_.steps(150);
  EXPECT_EQ(fixture_.loop.modes().owner(0), fixture_.loop.find("arm0_hold"));
  // The publisher is informed once that its packets are no longer accepted.
  for (int k = 0; k < 3; ++k) ASSERT_TRUE(stream.send({q.data(), 7}));
  ASSERT_EQ(client.ask({{"do", "channels"}})["channels"][0]["refused"], 3);
  const json news = client.next(10);
  EXPECT_EQ(news["channel"], stream.channel());
  EXPECT_EQ(news["stream"]["verdict"], "not_active");
  EXPECT_EQ(client.ask({{"do", "stream_end"}, {"channel", stream.channel()}})["ok"], true);
  ASSERT_TRUE(stream.send({q.data(), 7}));
  EXPECT_EQ(client.ask({{"do", "channels"}})["unreadable"], 1);
}

// An overloaded computer: the server gets to the packets 0.3 s after they were sent.
std::atomic<double> lateness_s = 0;
double late_clock() { return realtime_s() + lateness_s; }

TEST_F(ServerTest, PacketsThatWaitedTooLongAreCountedAndMoveNothing) {
  lateness_s = 0;
  LiveServer server(folder_ / "late.sock", fixture_.run(), late_clock);
  LiveClient client(server.path());
  client.tell({{"do", "switch"}, {"activate", {"joint0"}}, {"id", 0}});
  ASSERT_EQ(client.ask({{"do", "list"}})["ok"], true);  // by now the switch is with the loop
  fixture_.steps(1);
  ASSERT_EQ(client.next(10)["ok"], true);
  ReferenceStream stream = client.open_stream("joint0", "joints");
  JointVector q = fixture_.loop.models[0]->q_home();
  ASSERT_TRUE(stream.send({q.data(), 7}));  // by its answer the server knows the connection
  json channel = client.ask({{"do", "channels"}})["channels"][0];
  ASSERT_EQ(channel["received"], 1);
  lateness_s = 0.3;
  q[3] -= 0.3;
  for (int k = 0; k < 5; ++k) ASSERT_TRUE(stream.send({q.data(), 7}));
  channel = client.ask({{"do", "channels"}})["channels"][0];
  EXPECT_EQ(channel["received"], 6);
  EXPECT_EQ(channel["expired"], 5);
  EXPECT_EQ(channel["verdict"], "timeout");
  fixture_.steps(150);
  EXPECT_EQ(fixture_.loop.modes().owner(0), fixture_.loop.find("arm0_hold"));
  EXPECT_NEAR(fixture_.loop.world.position(0)[3], fixture_.loop.models[0]->q_home()[3], 1e-3);
}

// Samples of joint 4 that go down by 0.1 rad within 1 s, from `begin_s` on; every 50 ms.
Chunk downwards(const JointVector& q_start, double begin_s) {
  Chunk chunk;
  chunk.size = 7;
  chunk.count = 20;
  for (std::size_t k = 0; k < chunk.count; ++k) {
    const double share = static_cast<double>(k + 1) / chunk.count;
    chunk.times_s[k] = begin_s + share;
    std::copy(q_start.begin(), q_start.end(), chunk.values[k].begin());
    chunk.values[k][3] -= 0.1 * share * share;
  }
  return chunk;
}

class ChunkServerTest : public ServerTest {
 protected:
  ChunkServerTest() {
    client_.tell({{"do", "switch"}, {"activate", {"joint0"}}, {"id", 0}});
    EXPECT_EQ(client_.ask({{"do", "list"}})["ok"], true);  // by now the switch is with the loop
    fixture_.steps(1);
    EXPECT_EQ(client_.next(10)["ok"], true);
  }
  double now_s() const {
    LatestState::Snapshot snapshot;
    fixture_.latest.copy(snapshot);
    return snapshot.t.seconds();
  }
  double set_point() {
    MultimodeController& modes = fixture_.loop.modes();
    return modes.instance(modes.find("joint0")).inputs()[0].joints()[3];
  }
  json counts() { return client_.ask({{"do", "channels"}})["channels"][0]; }

  LiveClient client_{server_.path()};
  const JointVector q_ = fixture_.loop.models[0]->q_home();
};

TEST_F(ChunkServerTest, IsFollowedInTimeAndEndsInHold) {
  ReferenceStream stream = client_.open_stream("joint0", "joints");
  const double begin = now_s();
  ASSERT_TRUE(stream.send(downwards(q_, begin)));
  EXPECT_EQ(counts()["verdict"], "accepted");
  fixture_.steps(900);
  EXPECT_NEAR(set_point(), q_[3] - 0.1 * 0.81, 1e-3);
  EXPECT_EQ(fixture_.loop.modes().owner(0), fixture_.loop.find("joint0"));
  fixture_.steps(250);
  EXPECT_EQ(fixture_.loop.modes().owner(0), fixture_.loop.find("arm0_hold"));
  ASSERT_TRUE(stream.send(downwards(q_, now_s())));
  EXPECT_EQ(counts()["verdict"], "not_active");
}

// A chunk with one sample out of bounds is refused as a whole, and ends the one before it.
TEST_F(ChunkServerTest, ARefusedOneMovesNothingAndDiscardsTheOneBefore) {
  for (const int wrong : {0, 1, 2, 3}) {
    ReferenceStream stream = client_.open_stream("joint0", "joints");
    client_.tell({{"do", "switch"}, {"activate", {"joint0"}}, {"id", 1}});
    ASSERT_EQ(client_.ask({{"do", "list"}})["ok"], true);
    fixture_.steps(1);
    ASSERT_TRUE(stream.send(downwards(q_, now_s())));
    ASSERT_EQ(counts()["refused"], 0);
    fixture_.steps(300);
    const double before = set_point();
    Chunk bad = downwards(q_, now_s());
    if (wrong == 0) bad.values[19][3] = 3;  // beyond the joint's limit
    if (wrong == 1) bad.values[19][3] = std::nan("");
    if (wrong == 2) bad.times_s[19] = bad.times_s[18];
    if (wrong == 3) {
      for (double& time : bad.times_s) time += 10;  // too far ahead
    }
    ASSERT_TRUE(stream.send(bad));
    EXPECT_EQ(counts()["refused"], 1);
    fixture_.steps(60);
    EXPECT_LT(std::abs(set_point() - before), 0.02);
    fixture_.steps(140);
    EXPECT_EQ(fixture_.loop.modes().owner(0), fixture_.loop.find("arm0_hold")) << wrong;
    ASSERT_EQ(client_.ask({{"do", "stream_end"}, {"channel", stream.channel()}})["ok"], true);
  }
}

// Whatever ends the sender's right to command discards what it has queued, even if the law starts again.
TEST_F(ChunkServerTest, EndsWithAStopWithItsChannelWithItsClientAndWithItsSocket) {
  for (const int way : {0, 1, 2, 3}) {
    auto owner = std::make_unique<LiveClient>(server_.path());
    auto publisher = std::make_unique<ReferenceStream>(owner->open_stream("joint0", "joints"));
    ReferenceStream& stream = *publisher;
    client_.tell({{"do", "switch"}, {"activate", {"joint0"}}, {"id", 1}});
    ASSERT_EQ(client_.ask({{"do", "list"}})["ok"], true);
    fixture_.steps(1);
    ASSERT_TRUE(stream.send(downwards(q_, now_s())));
    ASSERT_EQ(counts()["verdict"], "accepted");
    fixture_.steps(200);
    MultimodeController& modes = fixture_.loop.modes();
    if (way == 0) {
      modes.stop(ArmSet::of(0));
      fixture_.steps(1);
      Request resume{.kind = Request::Kind::resume};
      resume.arms = ArmSet::of(0);
      Request start{.kind = Request::Kind::switch_controllets};
      start.activate = bit(fixture_.loop.find("joint0"));
      for (const Request& request : {resume, start}) {
        std::uint64_t ticket = 0;
        ASSERT_EQ(modes.post(std::span(&request, 1), ticket), Verdict::accepted);
        fixture_.steps(1);
      }
      ASSERT_EQ(modes.owner(0), fixture_.loop.find("joint0"));
    } else if (way == 1) {
      ASSERT_EQ(owner->ask({{"do", "stream_end"}, {"channel", stream.channel()}})["ok"], true);
    } else if (way == 2) {
      owner.reset();
      while (!client_.ask({{"do", "channels"}})["channels"].empty()) {
      }
    } else {
      publisher.reset();
      // The server reads its socket in this turn, and looks at it before the next answer.
      ASSERT_EQ(client_.ask({{"do", "channels"}})["channels"].size(), 1u);
      ASSERT_EQ(client_.ask({{"do", "channels"}})["channels"].size(), 1u);
    }
    const double before = set_point();
    fixture_.steps(700);
    EXPECT_LT(std::abs(set_point() - before), 0.01) << way;
    EXPECT_EQ(modes.owner(0), fixture_.loop.find(way == 0 ? "joint0" : "arm0_hold")) << way;
  }
}

TEST_F(ServerTest, AChannelEndsWithItsOwner) {
  LiveClient observer(server_.path());
  {
    LiveClient owner(server_.path());
    (void)owner.open_stream("joint0", "joints");
    EXPECT_EQ(observer.ask({{"do", "channels"}})["channels"].size(), 1u);
  }
  (void)observer.ask(
      {{"do", "channels"}});  // the owner's end is seen in this turn of the server at the latest
  EXPECT_EQ(observer.ask({{"do", "channels"}})["channels"].size(), 0u);
}

TEST_F(ServerTest, TheSocketIsRefusedWhileItsOwnerLives) {
  EXPECT_THROW(LiveServer(server_.path(), fixture_.run()), SocketTaken);
  EXPECT_NO_THROW(LiveClient{server_.path()});
}

TEST(LiveClientTest, WithoutARunItSaysWhatToDo) {
  try {
    LiveClient client("/nowhere/at/all.sock");
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("multipanda run"));
  }
}

}  // namespace
}  // namespace multipanda::server_test
