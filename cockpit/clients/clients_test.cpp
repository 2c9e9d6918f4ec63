#include "cockpit/clients/clients.hpp"

#include <cstring>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "runtime/live_input/json_fields.hpp"

// Clients without a network and a run: the test is their connections and the source, and has the clock.
namespace multipanda::cockpit::clients_test {
namespace {

using nlohmann::json;

class TestClient final : public Hub::Client {
 public:
  explicit TestClient(ClientId id) : id_(id) {}
  ClientId id() const override { return id_; }
  void send(const json& message) override { messages.push_back(message); }
  void send_numbers(std::string_view bytes) override { numbers.emplace_back(bytes); }
  std::size_t unsent() const override { return waiting; }
  void close(CloseCode, std::string) override {}

  // The newest message with this key.
  json newest(const std::string& key) const {
    for (auto message = messages.rbegin(); message != messages.rend(); ++message) {
      if (message->contains(key)) return message->at(key);
    }
    return nullptr;
  }
  json answer(int id) const {
    for (const json& message : messages) {
      if (message.value("id", json()) == id && message.contains("ok")) return message;
    }
    return nullptr;
  }

  std::vector<json> messages;
  std::vector<std::string> numbers;
  std::size_t waiting = 0;

 private:
  ClientId id_;
};

class TestSource final : public Source {
 public:
  json hello() override { return {{"kind", "test"}}; }
  void update(HostTime) override {}
  std::uint64_t newest() const override { return states; }
  std::span<const double> state(HostTime) override {
    value = static_cast<double>(states);
    return {&value, 1};
  }
  json slow_state() override { return {{"states", states}}; }
  std::uint64_t list_version() const override { return version; }
  json list() override { return {{"version", version}}; }
  std::vector<json> events(std::uint64_t& from) override {
    std::vector<json> all;
    for (; from < event_count; ++from) all.push_back(from);
    return all;
  }
  Plot open_plot(const std::vector<std::string>& fields, std::uint64_t every) override {
    return {.fields = std::vector<std::size_t>(fields.size()), .every = every, .next = 0};
  }
  json columns(const Plot& plot) const override {
    json columns = json::array();
    for (std::size_t i = 0; i < plot.fields.size(); ++i) columns.push_back({"field", 7});
    return columns;
  }
  std::uint32_t rows(Plot& plot, std::string& out) override {
    if (plot.next == states) return 0;
    plot.next = states;
    out.assign(2 * 8 * 8, '\0');
    return 2;
  }
  std::vector<std::string> commands() const override {
    return {"stop", "resume", "switch", "reference", "wait"};
  }
  bool is_open(const std::string& command) const override { return command == "stop"; }
  bool moves(const json& request) const override {
    if (request.contains("malformed")) throw RequestRefused("malformed", "nobody can tell");
    return request.at("do") == "reference" || request.contains("moves");
  }
  std::variant<Reply, Later> ask(const json& request, HostTime) override {
    asked.push_back(request.at("do"));
    if (request.contains("refuse")) throw RequestRefused("out_of_bounds", "too far");
    if (request.at("do") == "wait" || request.contains("wait")) {
      return Later([this]() -> std::optional<Reply> {
        if (!answered) return {};
        return Reply{.answer = {{"ok", true}}, .numbers = {}};
      });
    }
    json answer = {{"ok", true}};
    if (request.contains("message")) answer["message"] = request["message"];
    return Reply{.answer = std::move(answer), .numbers = {}};
  }
  bool is_stopped() const override { return stopped; }
  std::string come_to_rest(bool hold) override {
    rests.push_back(hold);
    return unfinished;
  }

  double value = 0;
  std::uint64_t states = 1, version = 1, event_count = 0;
  bool answered = false, stopped = false;
  std::vector<std::string> asked;
  std::vector<bool> rests;  // whether each was a hold
  std::string unfinished;
};

HostTime later(HostTime t, double s) { return {t.ns + static_cast<std::int64_t>(1e9 * s)}; }

class ClientsTest : public testing::Test {
 protected:
  ClientsTest() {
    clients_.show(source_);
    clients_.join(first_, 0);
    clients_.join(second_, 0);
  }
  json ask(TestClient& client, json request) {
    request["id"] = ++id_;
    take(client, request);
    return client.answer(id_);
  }
  void take(TestClient& client, const json& message) { clients_.take(client, message, host_now()); }
  // For so long the page hears nothing; their thread goes on.
  void pass(double s) {
    for (const HostTime start = host_now(); seconds(host_now() - start) < s; std::this_thread::yield())
      clients_.turn(host_now());
  }
  void take_control() { EXPECT_EQ(ask(first_, {{"do", "control"}, {"take", true}})["control"], "taken"); }

  std::shared_ptr<TestSource> source_ = std::make_shared<TestSource>();
  Clients clients_;
  TestClient first_{1}, second_{2};
  int id_ = 100;
};

TEST_F(ClientsTest, WatchersMayStopAndNothingElse) {
  EXPECT_EQ(ask(first_, {{"do", "switch"}})["verdict"], "no_control");
  EXPECT_EQ(ask(second_, {{"do", "stop"}})["ok"], true);
  take_control();
  EXPECT_EQ(ask(first_, {{"do", "switch"}})["ok"], true);
  EXPECT_EQ(ask(second_, {{"do", "switch"}})["verdict"], "no_control");
  EXPECT_EQ(ask(second_, {{"do", "stop"}})["ok"], true);
  EXPECT_EQ(source_->asked, (std::vector<std::string>{"stop", "switch", "stop"}));
}

TEST_F(ClientsTest, RefusesWhatItDoesNotKnow) {
  take_control();
  EXPECT_EQ(ask(first_, {{"do", "swich"}})["verdict"], "malformed");
  EXPECT_THAT(ask(first_, {{"do", "swich"}})["reason"], testing::HasSubstr("switch"));
  for (const json& wrong : {json(nullptr), json::array(), json(1), json{{"do", 1}}, json::object(),
                            json{{"id", {1}}, {"do", "switch"}}}) {
    const std::size_t before = first_.messages.size();
    take(first_, wrong);
    ASSERT_EQ(first_.messages.size(), before + 1) << wrong;
    EXPECT_EQ(first_.messages.back()["ok"], false);
    EXPECT_TRUE(first_.messages.back()["id"].is_null());
  }
  EXPECT_EQ(ask(first_, {{"do", "switch"}, {"refuse", true}})["verdict"], "out_of_bounds");
}

TEST_F(ClientsTest, RequestsWithoutAnIdAreAnsweredOnlyIfRefused) {
  take_control();
  const std::size_t before = first_.messages.size();
  take(first_, {{"do", "switch"}});
  take(first_, {{"do", "wait"}});
  source_->answered = true;
  (void)clients_.turn(host_now());
  const auto is_answer = [](const json& message) { return message.contains("ok"); };
  const auto news = first_.messages.begin() + static_cast<std::ptrdiff_t>(before);
  EXPECT_EQ(std::count_if(news, first_.messages.end(), is_answer), 0);
  take(first_, {{"do", "switch"}, {"refuse", true}});
  EXPECT_EQ(first_.messages.back()["verdict"], "out_of_bounds");
}

// It has no id, and something was wrong with it.
TEST_F(ClientsTest, AStopSaysWhatWasWrong) {
  const std::size_t before = first_.messages.size();
  take(first_, {{"do", "stop"}, {"message", "no arm 'lft': all arms are stopped"}});
  ASSERT_EQ(first_.messages.size(), before + 1);
  EXPECT_THAT(first_.messages.back().value("message", ""), testing::HasSubstr("lft"));
}

// Only what needs no hand on a button.
TEST_F(ClientsTest, ASwitchToHoldOutlastsItsPage) {
  EXPECT_TRUE(clients_.outlasts(R"({"do":"switch"})"));
  for (const char* text : {R"({"do":"switch","moves":1})", R"({"do":"switch","malformed":1})", "switch", "[]",
                           R"({"do":"wait"})", R"({"do":"reference"})"})
    EXPECT_FALSE(clients_.outlasts(text)) << text;
  clients_.show(nullptr);
  EXPECT_FALSE(clients_.outlasts(R"({"do":"switch"})"));
}

TEST_F(ClientsTest, MotionNeedsAHold) {
  take_control();
  EXPECT_EQ(ask(first_, {{"do", "reference"}})["verdict"], "not_held");
  take(second_, {{"beat", 1}});  // a watcher holds nothing
  EXPECT_EQ(ask(first_, {{"do", "reference"}})["verdict"], "not_held");
  // A beat lasts 200 ms, so with a busy computer between beat and request the pair is tried again.
  json answer;
  do {
    const HostTime before = host_now();
    take(first_, {{"beat", 1}});
    answer = ask(first_, {{"do", "reference"}});
    if (seconds(host_now() - before) < DeadMan::kTimeout) break;
  } while (true);
  EXPECT_EQ(answer["ok"], true);
  take(first_, {{"release", true}});
  EXPECT_EQ(source_->rests, std::vector<bool>{false});
  EXPECT_EQ(ask(first_, {{"do", "reference"}})["verdict"], "not_held");
}

// Whether a request moves is the source's to say, by all of the request.
TEST_F(ClientsTest, WhateverMovesNeedsAHold) {
  take_control();
  EXPECT_EQ(ask(first_, {{"do", "switch"}, {"moves", true}})["verdict"], "not_held");
  EXPECT_EQ(ask(first_, {{"do", "switch"}, {"malformed", true}})["verdict"], "malformed");
  EXPECT_TRUE(source_->asked.empty());
}

TEST_F(ClientsTest, TellsWhatEndedBecauseItWasLetGoTooEarly) {
  take_control();
  take(first_, {{"beat", 1}});
  source_->unfinished = "too early";
  take(first_, {{"release", true}});
  EXPECT_EQ(first_.newest("released")["cause"], "too early");
  EXPECT_TRUE(second_.newest("released").is_null());
}

TEST_F(ClientsTest, SilenceHolds) {
  take_control();
  const HostTime before = host_now();
  take(first_, {{"beat", 1}});
  const HostTime after = host_now();
  clients_.turn(later(before, DeadMan::kTimeout - 1e-3));
  EXPECT_TRUE(source_->rests.empty());
  EXPECT_EQ(first_.newest("control")["held"], true);
  clients_.turn(later(after, DeadMan::kTimeout + 1e-3));
  EXPECT_EQ(source_->rests, std::vector<bool>{true});
  EXPECT_THAT(first_.newest("released")["cause"].get<std::string>(), testing::HasSubstr("200 ms"));
  EXPECT_EQ(first_.newest("control")["held"], false);
  clients_.turn(later(after, 10));
  EXPECT_EQ(source_->rests.size(), 1u);
}

// The network stands still while somebody holds and lets go, and then delivers all of it at once.
TEST_F(ClientsTest, BeatsThatWereHeldUpDoNotCount) {
  take_control();
  ask(first_, {{"do", "subscribe"}, {"rate_hz", 100}});
  const auto held = [&] {
    take(first_, {{"beat", 1}});
    return first_.newest("control")["held"].get<bool>();
  };
  EXPECT_FALSE(held());  // it has seen nothing
  clients_.turn(host_now());
  take(first_, {{"seen", 1}});
  EXPECT_TRUE(held());
  ++source_->states;
  clients_.turn(later(host_now(), DeadMan::kTimeout + 1e-3));  // silence; the state after it is on its way
  EXPECT_EQ(source_->rests, std::vector<bool>{true});
  EXPECT_FALSE(held());
  take(first_, {{"seen", 2}});
  EXPECT_TRUE(held());
}

TEST_F(ClientsTest, APageMovesByNewStates) {
  take_control();
  ask(first_, {{"do", "subscribe"}, {"rate_hz", 100}});
  clients_.turn(later(host_now(), 0.02));
  take(first_, {{"seen", 1}});
  ++source_->states;
  pass(0.6);
  take(first_, {{"beat", 1}});
  EXPECT_EQ(first_.newest("control")["held"], false);
}

TEST_F(ClientsTest, RequestsThatWereHeldUpDoNotCount) {
  take_control();
  ask(first_, {{"do", "subscribe"}, {"rate_hz", 100}});
  clients_.turn(host_now());
  take(first_, {{"seen", 1}});
  EXPECT_EQ(ask(first_, {{"do", "switch"}})["ok"], true);
  pass(1.1);
  EXPECT_EQ(ask(first_, {{"do", "switch"}})["verdict"], "stale");
  EXPECT_EQ(ask(first_, {{"do", "stop"}})["ok"], true);
  take(first_, {{"seen", 4}});
  clients_.turn(host_now());
  take(first_, {{"seen", 5}});
  EXPECT_EQ(ask(first_, {{"do", "switch"}})["ok"], true);
}

// It stood still after the newest state was seen: the request is as old as that state.
TEST_F(ClientsTest, ARequestIsAsOldAsTheStateThatItsPageSaw) {
  take_control();
  ask(first_, {{"do", "subscribe"}, {"rate_hz", 100}});
  clients_.turn(host_now());
  take(first_, {{"seen", 1}});
  source_->states = 0;  // no newer one is sent
  pass(1.1);
  EXPECT_EQ(ask(first_, {{"do", "switch"}})["verdict"], "stale");
}

// Neither its number nor anything else is a reason to refuse it.
TEST_F(ClientsTest, AStopIsNeverRefused) {
  for (const json& stop :
       {json{{"do", "stop"}}, json{{"do", "stop"}, {"id", {1}}}, json{{"do", "stop"}, {"arm", 1}}}) {
    EXPECT_TRUE(clients_.is_urgent(stop.dump()));
    take(first_, stop);
  }
  EXPECT_EQ(source_->asked, (std::vector<std::string>{"stop", "stop", "stop"}));
  EXPECT_FALSE(clients_.is_urgent(R"({"do": "gripper", "action": "stop"})"));
  EXPECT_FALSE(clients_.is_urgent("stop"));
}

// The program stood still: what its socket had kept is not executed.
TEST_F(ClientsTest, AfterAGapOnlyAStopIsTaken) {
  take_control();
  std::this_thread::sleep_for(GapWatch::kLongest + std::chrono::milliseconds(50));
  EXPECT_EQ(ask(first_, {{"do", "switch"}})["verdict"], "timeout");
  EXPECT_EQ(ask(first_, {{"do", "subscribe"}})["ok"],
            true);  // a page asks once; without it, it would show nothing
  EXPECT_EQ(ask(first_, {{"do", "unsubscribe"}})["ok"], true);
  take(first_, {{"beat", 1}});
  EXPECT_NE(first_.newest("control")["held"], true);
  EXPECT_EQ(ask(first_, {{"do", "stop"}})["ok"], true);
  pass(0.3);
  EXPECT_EQ(ask(first_, {{"do", "switch"}})["ok"], true);
}

TEST_F(ClientsTest, AClosedPageHolds) {
  take_control();
  take(first_, {{"beat", 1}});
  clients_.leave(first_);
  EXPECT_EQ(source_->rests, std::vector<bool>{true});
  EXPECT_TRUE(second_.newest("control")["holder"].is_null());
  EXPECT_EQ(ask(second_, {{"do", "control"}, {"take", true}})["control"], "taken");
}

TEST_F(ClientsTest, HandOverHolds) {
  take_control();
  EXPECT_EQ(ask(second_, {{"do", "control"}, {"take", true}})["control"], "requested");
  EXPECT_EQ(first_.newest("control")["requests"], json::array({2}));
  EXPECT_EQ(ask(second_, {{"do", "control"}, {"give", 2}})["verdict"], "no_control");
  EXPECT_EQ(ask(first_, {{"do", "control"}, {"give", 3}})["ok"], false);
  take(first_, {{"beat", 1}});
  EXPECT_EQ(ask(first_, {{"do", "control"}, {"give", 2}})["ok"], true);
  EXPECT_EQ(source_->rests, std::vector<bool>{true});
  EXPECT_EQ(second_.newest("control")["mine"], true);
  EXPECT_FALSE(first_.newest("released").is_null());  // whose hold it was
  EXPECT_TRUE(second_.newest("released").is_null());
  EXPECT_EQ(ask(first_, {{"do", "switch"}})["verdict"], "no_control");
  take(first_, {{"beat", 2}});
  EXPECT_EQ(first_.newest("control")["held"], false);
}

TEST_F(ClientsTest, ARequestIsGrantedAfterSilenceOnly) {
  take_control();
  ask(second_, {{"do", "control"}, {"take", true}});
  EXPECT_EQ(ask(first_, {{"do", "control"}, {"keep", true}})["ok"], true);
  clients_.turn(later(host_now(), 11));
  EXPECT_EQ(first_.newest("control")["mine"], true);
  ask(second_, {{"do", "control"}, {"take", true}});
  clients_.turn(later(host_now(), 11));
  EXPECT_EQ(second_.newest("control")["mine"], true);
}

// Only the newest state is worth sending: nothing waits in a socket, and few are on their way.
TEST_F(ClientsTest, DropsStaleStates) {
  ask(first_, {{"do", "subscribe"}, {"rate_hz", 100}});
  HostTime now = host_now();
  const auto turns = [&](int count) {
    for (int i = 0; i < count; ++i) {
      now = later(now, 0.01);
      ++source_->states;
      clients_.turn(now);
    }
  };
  turns(20);
  ASSERT_EQ(first_.numbers.size(), 4u);
  take(first_, {{"seen", 2}});
  turns(20);
  ASSERT_EQ(first_.numbers.size(), 6u);
  double newest = 0;
  std::memcpy(&newest, first_.numbers.back().data() + 16, sizeof(newest));
  EXPECT_EQ(newest, 23);           // not the ones between 21 and it
  take(first_, {{"seen", 1000}});  // of a number that was never sent
  turns(5);
  EXPECT_EQ(first_.numbers.size(), 6u);
  take(first_, {{"seen", 6}});
  first_.waiting = 1;
  turns(5);
  EXPECT_EQ(first_.numbers.size(), 6u);
  first_.waiting = 0;
  turns(1);
  EXPECT_EQ(first_.numbers.size(), 7u);
  EXPECT_TRUE(second_.numbers.empty());
}

TEST_F(ClientsTest, TellsNews) {
  source_->event_count = 3;
  clients_.turn(host_now());
  EXPECT_EQ(first_.newest("events"), json::array({0, 1, 2}));
  source_->event_count = 4;
  ++source_->version;
  clients_.turn(host_now());
  EXPECT_EQ(second_.newest("events"), json::array({3}));
  EXPECT_EQ(second_.newest("list")["version"], 2);
}

TEST_F(ClientsTest, BoundsPlotsAndRequests) {
  EXPECT_EQ(ask(first_, {{"do", "plot"}, {"fields", std::vector<std::string>(9, "a")}})["ok"], true);
  EXPECT_EQ(ask(first_, {{"do", "plot"}, {"fields", std::vector<std::string>(10, "a")}})["ok"], false);
  EXPECT_EQ(ask(first_, {{"do", "plot"}, {"fields", std::vector<std::string>(10, "a")}, {"every", 2}})["ok"],
            true);
  EXPECT_EQ(ask(first_, {{"do", "plot"}, {"fields", {"a"}}, {"every", 0}})["ok"], false);
  EXPECT_EQ(ask(first_, {{"do", "subscribe"}, {"rate_hz", 1000}})["ok"], false);
  take_control();
  for (int i = 0; i < 64; ++i) EXPECT_TRUE(ask(first_, {{"do", "wait"}}).is_null());
  EXPECT_EQ(ask(first_, {{"do", "wait"}})["verdict"], "queue_full");
  EXPECT_EQ(ask(first_, {{"do", "stop"}})["ok"], true);  // always
  source_->answered = true;
  clients_.turn(host_now());
  EXPECT_EQ(first_.answer(id_ - 2)["ok"], true);
}

TEST_F(ClientsTest, AnotherRunBeginsAnew) {
  take_control();
  take(first_, {{"beat", 1}});
  clients_.show(nullptr, "over");
  EXPECT_EQ(source_->rests, std::vector<bool>{true});
  EXPECT_EQ(first_.newest("ended")["reason"], "over");
  EXPECT_EQ(ask(first_, {{"do", "stop"}})["ok"], false);
  const auto other = std::make_shared<TestSource>();
  clients_.show(other);
  EXPECT_EQ(first_.messages.back().contains("hello"), true);
  EXPECT_EQ(ask(second_, {{"do", "stop"}})["ok"], true);
  EXPECT_EQ(other->asked, std::vector<std::string>{"stop"});
}

// Its arms may have to be recovered before there is a state.
TEST_F(ClientsTest, ARunWithoutAFirstCycleTakesRequests) {
  take_control();
  ask(first_, {{"do", "subscribe"}, {"rate_hz", 100}});
  clients_.turn(host_now());
  take(first_, {{"seen", 1}});
  const auto other = std::make_shared<TestSource>();
  other->states = 0;
  clients_.show(other);
  pass(1.1);
  EXPECT_EQ(ask(first_, {{"do", "switch"}})["ok"], true);
  other->states = 1;
  pass(0.1);
  EXPECT_EQ(ask(first_, {{"do", "switch"}})["verdict"], "stale") << "nor did the page confirm its first one";
  take(first_, {{"seen", 2}});
  EXPECT_EQ(ask(first_, {{"do", "switch"}})["ok"], true);
}

TEST_F(ClientsTest, WhatIsNotAnsweredWhenTheRunEndsIsRefused) {
  take_control();
  EXPECT_TRUE(ask(first_, {{"do", "wait"}}).is_null());
  clients_.show(nullptr, "over");
  EXPECT_EQ(first_.answer(id_)["verdict"], "run_ended");
  EXPECT_EQ(first_.answer(id_)["reason"], "over");
}

// Runs one after the other, as an experiment has them.
class RunsInTurn : public ClientsTest {
 protected:
  RunsInTurn() {
    clients_.on_stop_between_runs([this] { ++owed_; });
    take_control();
  }
  void next_run() {
    clients_.show(nullptr);
    clients_.show(source_);
  }

  int owed_ = 0;
};

TEST_F(RunsInTurn, AStopBetweenTwoIsOwed) {
  clients_.show(nullptr);
  EXPECT_EQ(owed_, 0);
  EXPECT_EQ(ask(second_, {{"do", "stop"}})["no_further_run"], true);  // a watcher
  EXPECT_EQ(owed_, 1);
  EXPECT_EQ(ask(first_, {{"do", "switch"}})["ok"], false);
  take(second_, {{"do", "stop"}});  // without an id
  EXPECT_EQ(owed_, 2);
}

TEST_F(RunsInTurn, AStopThatItsRunDidNotAnswerIsOwed) {
  EXPECT_TRUE(ask(second_, {{"do", "stop"}, {"wait", true}}).is_null());
  clients_.show(nullptr);
  EXPECT_EQ(second_.answer(id_)["no_further_run"], true);
  EXPECT_GE(owed_, 1);
}

TEST_F(RunsInTurn, AStopThatNobodyResumesOutlastsItsRun) {
  EXPECT_EQ(ask(second_, {{"do", "stop"}})["ok"], true);
  EXPECT_EQ(owed_, 0);  // somebody may still resume it
  clients_.show(nullptr);
  EXPECT_EQ(owed_, 1);
}

TEST_F(RunsInTurn, AStopThatIsResumedEndsNothing) {
  ask(second_, {{"do", "stop"}});
  ask(first_, {{"do", "resume"}});
  next_run();
  EXPECT_EQ(owed_, 0);
  ask(second_, {{"do", "stop"}});
  source_->stopped = true;  // of another arm
  ask(first_, {{"do", "resume"}});
  next_run();
  EXPECT_EQ(owed_, 1);
}

TEST_F(RunsInTurn, AResumeDoesNotEndTheStopThatCameAfterIt) {
  ask(second_, {{"do", "stop"}});
  ask(first_, {{"do", "resume"}, {"wait", true}});
  ask(second_, {{"do", "stop"}});
  source_->answered = true;
  clients_.turn(host_now());
  EXPECT_EQ(first_.answer(id_ - 1)["ok"], true);
  next_run();
  EXPECT_EQ(owed_, 1);
}

}  // namespace
}  // namespace multipanda::cockpit::clients_test
