#include <atomic>
#include <sys/mman.h>
#include <thread>

#include <gtest/gtest.h>

#include "cockpit/cockpit.hpp"
#include "cockpit/server/testing/page.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "scene/load.hpp"

// A whole run that pages watch and command, over sockets: all threads of a program with a cockpit.
namespace multipanda::cockpit::watched_run_test {
namespace {

using nlohmann::json;
using test::Page;

constexpr int kWatchers = 4;
constexpr std::uint64_t kFirst = 20;  // the first cycles may allocate

struct Address {
  explicit Address(const std::string& text)
      : port(static_cast<std::uint16_t>(std::stoi(text.substr(text.rfind(':') + 1)))),
        token(text.substr(text.find('#') + 1)) {}
  std::uint16_t port;
  std::string token;
};

// Takes 60 states a second and every cycle's joints, until the connection ends.
void watch(const Address& address, std::atomic<int>& frames) {
  Page page(address.port);
  ASSERT_TRUE(page.open(address.port, address.token));
  page.say(R"({"do": "subscribe", "id": 1, "rate_hz": 60})");
  page.say(R"({"do": "plot", "id": 2, "fields": ["arm/q_rad"]})");
  while (page.frame()) ++frames;
}

// Takes the control, moves the hand, changes a parameter, switches, and lets the connection end.
void command(const Address& address, std::atomic<int>& accepted) {
  Page page(address.port);
  ASSERT_TRUE(page.open(address.port, address.token));
  const auto ask = [&](json request) {
    request["id"] = 7;
    page.say(request.dump());
    for (;;) {
      const std::string text = page.message();
      if (text.empty()) return;
      const json answer = json::parse(text, nullptr, false);
      if (!answer.is_object() || answer.value("id", 0) != 7) continue;  // numbers and news
      accepted += answer.value("ok", false);
      return;
    }
  };
  ask({{"do", "control"}, {"take", true}});
  for (int k = 0; k < 30; ++k) {
    page.say(R"({"beat": 1})");
    const json X = {0.4, 0.0, 0.45 + 0.001 * k};
    ask({{"do", "reference"},
         {"controllet", "cartesian"},
         {"input", "pose"},
         {"position_m", X},
         {"quaternion_wxyz", {0, 1, 0, 0}},
         {"stream", true}});
  }
  const json stiffness = {{"do", "parameter"},
                          {"controllet", "cartesian"},
                          {"name", "translational_stiffness_n_per_m"},
                          {"value", 500}};
  ask(stiffness);
  page.say(R"({"beat": 1})");
  ask({{"do", "switch"}, {"activate", {"joint"}}});
  page.say(R"({"release": true})");
}

struct Counted {
  LoopGuardCounts all;
  std::uint64_t cycles = 0;
};

// A run of `seconds` with pages, and what its loop did that it must not do.
Counted run_with_pages(double seconds, std::atomic<int>& frames, std::atomic<int>& accepted) {
  OpenedScene opened = open_scene("one_arm");
  opened.scene.timeline.clear();
  Counted counted;
  bool armed = false;
  SessionOptions options{.paced = true, .duration_s = seconds};
  options.share_records = true;
  // Until the next call: a whole cycle, and what the session does around it.
  options.on_loop = [&](const Tick& tick, const Backend&) {
    if (armed) {
      const LoopGuardCounts counts = LoopGuard::disarm();
      counted.all.heap_calls += counts.heap_calls;
      counted.all.lock_calls += counts.lock_calls;
      counted.all.page_faults += counts.page_faults;
      ++counted.cycles;
    }
    armed = kLoopGuardWorks && tick.cycle > kFirst;
    if (armed) LoopGuard::arm();
  };
  auto cockpit = std::make_unique<Cockpit>(std::uint16_t{0});
  const Address address(cockpit->address());
  Session session(std::move(opened.scene), opened.registry, std::move(options));
  std::vector<std::jthread> pages;
  {
    const ShownRun shown(*cockpit, session);
    session.start();
    for (int i = 0; i < kWatchers; ++i) pages.emplace_back([&] { watch(address, frames); });
    pages.emplace_back([&] { command(address, accepted); });
    while (!session.wait_for_end(1)) {
    }
  }
  cockpit.reset();
  pages.clear();
  session.finish();
  return counted;
}

TEST(WatchedRun, ItsLoopMakesNoHeapCallAndTakesNoLock) {
  const bool locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
  std::atomic<int> frames{0}, accepted{0};
  const Counted counted = run_with_pages(3, frames, accepted);
  munlockall();
  EXPECT_EQ(counted.all.heap_calls, 0u);
  EXPECT_EQ(counted.all.lock_calls, 0u);
  EXPECT_TRUE(!locked || counted.all.page_faults == 0u) << counted.all.page_faults;
  if (kLoopGuardWorks) {
    EXPECT_GT(counted.cycles, 2000u);
  }
  EXPECT_GT(frames, kWatchers * 30);
  EXPECT_GT(accepted, 10);
}

}  // namespace
}  // namespace multipanda::cockpit::watched_run_test
