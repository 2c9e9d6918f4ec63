#include "runtime/live_input/server.hpp"

#include <atomic>
#include <random>
#include <sys/socket.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "runtime/live_input/client.hpp"
#include "runtime/live_input/testing/live_fixture.hpp"

namespace multipanda::server_test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

class ServerTest : public testing::Test {
 protected:
  ServerTest() : server_(folder_ / "fixture.sock", fixture_.run()) {}

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

TEST_F(ServerTest, RequestsOfAClosedClientAreStillExecuted) {
  const int file = connect_to(server_.path(), SOCK_STREAM);
  ASSERT_GE(file, 0);
  const std::string text = R"({"do":"stop"})";  // not even the end of the line
  ASSERT_EQ(send(file, text.data(), text.size(), 0), static_cast<ssize_t>(text.size()));
  close(file);
  LiveClient other(server_.path());
  EXPECT_EQ(other.ask({{"do", "list"}})["ok"], true);  // served after it
  fixture_.steps(1);
  EXPECT_EQ(fixture_.loop.modes().stopped(), ArmSet::all(2));
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
