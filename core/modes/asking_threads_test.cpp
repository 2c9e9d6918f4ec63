#include <array>
#include <atomic>
#include <thread>

#include <gtest/gtest.h>

#include "core/testing/four_arms.hpp"
#include "core/testing/test_laws.hpp"

// Threads that ask a loop in motion for switches. ThreadSanitizer builds this file.
namespace multipanda::asking_threads_test {
namespace {

using test::Draw;
using test::four_arms;
using test::TestLoop;
using Kind = Request::Kind;

TEST(Switching, AskGivesTheFirstRefusalOfABatch) {
  TestLoop loop(4, four_arms(), test::test_registry());
  loop.step();
  std::atomic<bool> done{false};
  Answer answer;
  std::thread asker([&] {
    const std::array<Request, 2> batch{Request{.activate = loop.set({"refuser"})},
                                       Request{.kind = Kind::resume}};
    answer = loop.modes().ask(batch, 9);  // less than the patience for answers
    done = true;
  });
  for (int k = 0; k < 1000; ++k) std::this_thread::yield();  // it waits
  while (!done) loop.step();
  asker.join();
  EXPECT_EQ(answer.verdict, Verdict::start_refused);
  EXPECT_EQ(answer.kind, Kind::switch_controllets) << "not the answer of what was refused along with it";
}

TEST(Switching, AThousandRandomRequestsFromManyThreads) {
  constexpr int kThreads = 4, kEach = 250;
  TestLoop loop(4, four_arms(), test::test_registry());
  loop.modes().activate_at_start(loop.set({"s0"}));
  loop.step();
  std::atomic<int> running{kThreads}, accepted{0}, refused{0}, disordered{0};
  std::vector<std::thread> askers;
  for (int t = 0; t < kThreads; ++t) {
    askers.emplace_back([&, t] {
      Draw draw(static_cast<std::uint32_t>(100 + t));
      std::uint64_t last_cycle = 0;
      for (int k = 0; k < kEach; ++k) {
        Request request;
        // Anything but the kept one and its arm's hold: instance 4 is "s0".
        const InstanceSet mask = 0b1'1111'1110'1110;
        const auto bits = [&] { return (InstanceSet{1} << draw.index(13)) & mask; };
        request.activate = bits() | (draw.coin() ? bits() : 0);
        request.deactivate = bits();
        if (draw.index(25) == 0) loop.modes().stop(ArmSet::of(1 + draw.index(3)));
        if (draw.index(8) == 0) request = {.kind = Kind::resume, .arms = ArmSet::of(1 + draw.index(3))};
        const Answer answer = loop.modes().ask(request, 120);
        if (answer.accepted()) {
          ++accepted;
          if (answer.cycle < last_cycle || answer.taken < answer.received ||
              answer.first_torque < answer.taken) {
            ++disordered;
          }
          last_cycle = answer.cycle;
        } else {
          ++refused;
          if (answer.verdict == Verdict::timeout || answer.verdict == Verdict::pending) ++disordered;
        }
      }
      --running;
    });
  }
  std::string fault;
  std::uint64_t lost_owner = 0;
  while (running > 0) {
    loop.step();
    if (fault.empty()) fault = loop.ownership_fault();
    lost_owner += loop.modes().owner(0) == loop.find("s0") ? 0 : 1;
  }
  for (auto& asker : askers) asker.join();
  EXPECT_EQ(fault, "");
  EXPECT_EQ(lost_owner, 0u);
  EXPECT_EQ(disordered, 0);
  EXPECT_EQ(accepted + refused, kThreads * kEach);
  EXPECT_GT(accepted, 100);
  EXPECT_GT(refused, 50);
}

}  // namespace
}  // namespace multipanda::asking_threads_test
