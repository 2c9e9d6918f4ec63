#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <dlfcn.h>
#include <future>
#include <numeric>
#include <pthread.h>
#include <random>
#include <sys/mman.h>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "core/rt/cycle_histogram.hpp"
#include "core/rt/pacer.hpp"
#include "core/rt/spsc_ring.hpp"
#include "core/rt/thread_setup.hpp"
#include "core/rt/triple_buffer.hpp"

namespace multipanda::rt_test {

namespace {

// A value that shows if it was torn.
struct Whole {
  std::array<std::uint64_t, 40> words{};
  static Whole of(std::uint64_t n) {
    Whole whole;
    whole.words.fill(n);
    return whole;
  }
  bool intact() const {
    for (const auto w : words) {
      if (w != words[0]) return false;
    }
    return true;
  }
};

TEST(TripleBuffer, ReturnsTheNewestOnce) {
  TripleBuffer<int> buffer(7);
  EXPECT_EQ(buffer.value(), 7);
  EXPECT_FALSE(buffer.take());
  buffer.write(1);
  buffer.write(2);
  EXPECT_EQ(buffer.value(), 7);
  EXPECT_TRUE(buffer.take());
  EXPECT_EQ(buffer.value(), 2);
  EXPECT_FALSE(buffer.take());
  EXPECT_EQ(buffer.value(), 2);
}

TEST(TripleBuffer, TwoThreadsNeverSeeTornOrOldValues) {
  constexpr std::uint64_t kCount = 200'000;
  TripleBuffer<Whole> buffer;
  std::thread writer([&] {
    for (std::uint64_t n = 1; n <= kCount; ++n) buffer.write(Whole::of(n));
  });
  std::uint64_t last = 0, torn = 0, backwards = 0;
  while (last < kCount) {
    if (!buffer.take()) {
      std::this_thread::yield();
      continue;
    }
    torn += buffer.value().intact() ? 0 : 1;
    backwards += buffer.value().words[0] <= last ? 1 : 0;
    last = buffer.value().words[0];
  }
  writer.join();
  EXPECT_EQ(torn, 0u);
  EXPECT_EQ(backwards, 0u);
}

TEST(SpscRing, IsAQueueOfItsCapacity) {
  SpscRing<int> ring(3);
  EXPECT_EQ(ring.front(), nullptr);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(ring.push(i));
  EXPECT_FALSE(ring.push(3));
  EXPECT_EQ(ring.back(), nullptr);
  EXPECT_EQ(ring.size(), 3u);
  for (int round = 0; round < 10; ++round) {
    EXPECT_EQ(*ring.front(), round);
    ring.pop();
    EXPECT_TRUE(ring.push(round + 3));
    EXPECT_EQ(ring.size(), 3u);
  }
}

TEST(SpscRing, TwoThreadsLoseNothing) {
  constexpr std::uint64_t kCount = 200'000;
  SpscRing<Whole> ring(17);
  std::thread producer([&] {
    for (std::uint64_t n = 1; n <= kCount;) {
      if (ring.push(Whole::of(n))) {
        ++n;
      } else {
        std::this_thread::yield();
      }
    }
  });
  std::uint64_t wrong = 0;
  for (std::uint64_t n = 1; n <= kCount;) {
    const Whole* whole = ring.front();
    if (whole == nullptr) {
      std::this_thread::yield();
      continue;
    }
    wrong += whole->intact() && whole->words[0] == n ? 0 : 1;
    ring.pop();
    ++n;
  }
  producer.join();
  EXPECT_EQ(wrong, 0u);
  EXPECT_EQ(ring.size(), 0u);
}

TEST(Pacer, LatenessDoesNotAddUp) {
  Pacer pacer;
  pacer.start_at({0});
  for (std::int64_t k = 1; k <= 1000; ++k) {
    EXPECT_EQ(pacer.advance().ns, k * 1'000'000);
    pacer.woke_at({k * 1'000'000 + 300'000});
    EXPECT_EQ(pacer.lateness().count(), 300'000);
  }
  EXPECT_EQ(pacer.overruns(), 0u);
}

TEST(Pacer, MissedGridPointsAreCountedAndSkipped) {
  Pacer pacer;
  pacer.start_at({0});
  pacer.advance();             // released at 1 ms
  pacer.woke_at({4'200'000});  // woke at 4.2 ms: 2, 3 and 4 were missed
  EXPECT_EQ(pacer.overruns(), 3u);
  EXPECT_EQ(pacer.advance().ns, 5'000'000);
  pacer.woke_at({5'000'000});
  EXPECT_EQ(pacer.overruns(), 3u);
  pacer.advance();             // 6 ms
  pacer.woke_at({7'000'000});  // exactly one period late: 7 was missed, or a burst would follow
  EXPECT_EQ(pacer.overruns(), 4u);
  EXPECT_EQ(pacer.advance().ns, 8'000'000);
}

TEST(Pacer, NeverReleasesEarly) {
  Pacer pacer(std::chrono::microseconds(200));
  pacer.start();
  HostTime before = host_now();
  for (int i = 0; i < 5; ++i) {
    pacer.wait();
    EXPECT_GE(pacer.lateness().count(), 0);
  }
  EXPECT_GE((host_now() - before).count(), 900'000);  // five grid points, less the time before the first
}

TEST(ThreadSetup, EveryStepIsAnsweredWithAReasonIfNotDone) {
  std::vector<SetupStep> steps;
  std::thread thread(
      [&] { steps = set_up_thread({.lock_memory = false, .fifo_priority = 80, .cpu = 100'000}); });
  thread.join();
  ASSERT_EQ(steps.size(), 2u);
  for (const auto& step : steps) EXPECT_TRUE(step.done || !step.reason.empty()) << step.what;
  EXPECT_FALSE(steps[0].done);  // there is no core 100,000
  EXPECT_NE(steps[0].what.find("100000"), std::string::npos);
}

// Of another thread's stack only what it uses is in memory; what was allocated is, as a whole.
TEST(ThreadSetup, TheMemoryLockLeavesTheStacksOfOtherThreads) {
  if (dlsym(RTLD_DEFAULT, "__asan_init") != nullptr || dlsym(RTLD_DEFAULT, "__tsan_init") != nullptr)
    GTEST_SKIP() << "a sanitizer replaces mlockall and locks nothing";
  constexpr std::size_t kBytes = 1 << 20, kPage = 4096;
  const auto present = [](void* begin) {
    std::array<unsigned char, kBytes / kPage> pages{};
    EXPECT_EQ(mincore(begin, kBytes, pages.data()), 0);
    return std::accumulate(pages.begin(), pages.end(), 0);
  };
  void* const allocated = mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(allocated, MAP_FAILED);
  std::promise<void*> its_stack;
  std::promise<void> end;
  std::thread other([&] {
    pthread_attr_t attributes;
    void* begin = nullptr;
    std::size_t size = 0;
    if (pthread_getattr_np(pthread_self(), &attributes) == 0) {
      (void)pthread_attr_getstack(&attributes, &begin, &size);
      (void)pthread_attr_destroy(&attributes);
    }
    its_stack.set_value(begin);
    end.get_future().wait();
  });
  void* const stack = its_stack.get_future().get();
  const auto steps = set_up_thread({.fifo_priority = {}, .cpu = {}});
  const int of_stack = present(stack), of_allocated = present(allocated);
  end.set_value();
  other.join();
  munlockall();
  munmap(allocated, kBytes);
  if (!steps.at(0).done) GTEST_SKIP() << steps.at(0).reason;
  EXPECT_EQ(of_stack, 0);  // the lowest of its 8 MB
  EXPECT_EQ(of_allocated, kBytes / kPage);
}

}  // namespace

namespace {

TEST(CycleHistogram, IsEmptyAtFirst) {
  const CycleHistogram histogram;
  EXPECT_EQ(histogram.count(), 0u);
  EXPECT_EQ(histogram.percentile(0.5), 0);
}

TEST(CycleHistogram, SmallDurationsAreExact) {
  CycleHistogram histogram;
  for (int ns = 1; ns <= 100; ++ns) histogram.add(ns);
  EXPECT_EQ(histogram.percentile(0.5), 50);
  EXPECT_EQ(histogram.percentile(0.99), 99);
  EXPECT_EQ(histogram.percentile(1.0), 100);
}

// Against sorting: durations over six decades, each percentile within one step (1/128) above the true one.
TEST(CycleHistogram, PercentilesAgreeWithSorting) {
  std::mt19937 random(20);
  std::uniform_real_distribution<double> decade(2, 8);
  std::vector<std::int64_t> all(20'001);
  CycleHistogram histogram;
  for (auto& ns : all) {
    ns = static_cast<std::int64_t>(std::pow(10.0, decade(random)));
    histogram.add(ns);
  }
  std::sort(all.begin(), all.end());
  for (const double share : {0.001, 0.1, 0.5, 0.9, 0.99, 0.999, 1.0}) {
    const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(all.size())));
    const auto truth = static_cast<double>(all[rank - 1]);
    const auto answer = static_cast<double>(histogram.percentile(share));
    EXPECT_GE(answer, truth) << share;
    EXPECT_LE(answer, truth * (1 + 1.0 / 128) + 1) << share;
  }
  EXPECT_EQ(histogram.max(), all.back());
}

TEST(CycleHistogram, AcceptsValuesOutOfRange) {
  CycleHistogram histogram;
  histogram.add(-5);
  histogram.add(60'000'000'000);  // a minute
  EXPECT_EQ(histogram.percentile(0.5), 0);
  EXPECT_EQ(histogram.max(), 60'000'000'000);
  EXPECT_LE(histogram.percentile(1.0), 60'000'000'000);
}

}  // namespace

}  // namespace multipanda::rt_test
