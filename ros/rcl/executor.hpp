#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <list>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "core/types/gap_watch.hpp"

namespace multipanda::ros {

class Executor;

// An entity that receives messages. The classes of this folder derive from it.
class Incoming {
 public:
  virtual ~Incoming() = default;

 protected:
  explicit Incoming(Executor& executor) : executor_(executor) {}
  Incoming(const Incoming&) = delete;
  // begin() starts service; end() waits for a callback running in another thread; no callback follows.
  void begin();
  void end();
  // For rcl's set_on_new_..._callback: any thread of the middleware.
  static void arrived(const void* incoming, std::size_t count);
  // To be called for each message that is taken, with its times by the system's clock [ns], 0: not known.
  // Returns for how long it has waited [s].
  double note_times(std::int64_t sent_ns, std::int64_t received_ns);

 private:
  friend class Executor;
  // Takes one message and calls its callback; returns false if there was none. Executor's thread.
  virtual bool take() = 0;
  virtual std::string source() const = 0;  // name of the entity, for reports

  Executor& executor_;
  bool queued_ = false, attached_ = false;  // guarded by the executor
};

// One thread that runs all callbacks, one at a time. The middleware reports arrivals, so nothing is polled
// and an idle entity costs nothing. Each entity with messages gets kPerTurn of them before the next one's
// turn, so a flood on one topic does not starve the others.
//
// Functions posted before start() run after it, in order; none runs after stop(). An exception from a
// callback is counted and reported, and the executor continues.
class Executor {
 public:
  static constexpr std::size_t kPerTurn = 16;
  using Clock = std::chrono::steady_clock;

  Executor() = default;
  ~Executor();  // calls stop()
  Executor(const Executor&) = delete;

  void start();
  // Waits for the running callback; none follows. Drops posted functions that have not run. Not from a
  // callback. The executor can be started again.
  void stop();
  bool running() const { return running_.load(); }

  // Receives exceptions from callbacks, once per source (a topic, a service, "a timer", ...), on the
  // executor's thread. Call before start().
  using Failed = std::function<void(const std::string& source, const std::string& text)>;
  void on_failure(Failed failed) { failed_ = std::move(failed); }

  // Any thread.
  std::uint64_t failures() const { return failures_.load(std::memory_order_relaxed); }
  using TimerId = std::size_t;
  // Calls `function` each `period`, first one period from now. Missed periods are skipped.
  TimerId add_timer(std::chrono::nanoseconds period, std::function<void()> function);
  void remove_timer(TimerId id);  // waits if it runs in another thread
  // Runs the function once, soon, on the executor's thread.
  void post(std::function<void()> function);
  // Calls `done` on the executor's thread, first at once and then at least every 0.2 ms until it returns
  // true. For answers of the loop, which wake no thread.
  void poll_until(std::function<bool()> done);
  // Number of unfinished poll_until() functions.
  std::size_t polling() const;
  // Executor's thread. Why the current message must not act: it has waited for more than `patience_s`, or the
  // program has stalled (GapWatch). Empty: it may act.
  std::string late(double patience_s) const;
  // When that message was sent, at the latest; outside of a message's callback: now.
  HostTime sent() const { return sent_.ns != 0 ? sent_ : host_now(); }

 private:
  friend class Incoming;
  static constexpr std::chrono::nanoseconds kSlice = GapWatch::kSlice;
  struct Timer {
    TimerId id = 0;
    std::chrono::nanoseconds period{0};
    Clock::time_point next;
    std::function<void()> function;
  };
  void attach(Incoming& incoming);
  void detach(Incoming& incoming);
  void notify(Incoming& incoming);
  void run();
  void run_timers(std::unique_lock<std::mutex>& lock);
  void run_posted(std::unique_lock<std::mutex>& lock);
  void run_polls(std::unique_lock<std::mutex>& lock);
  void serve(std::unique_lock<std::mutex>& lock);
  // Runs the function; returns false, after a report, if it threw.
  bool guarded(const std::function<void()>& function, const Incoming* source, const char* kind);
  bool on_own_thread() const { return std::this_thread::get_id() == thread_id_.load(); }

  mutable std::mutex mutex_;
  std::condition_variable woken_, turned_;
  std::deque<Incoming*> ready_;
  std::list<Timer> timers_;
  std::deque<std::function<void()>> posted_;
  std::list<std::function<bool()>> polls_, new_polls_;
  Incoming* served_ = nullptr;  // the entity whose callback runs
  GapWatch gaps_;               // executor's thread, as the next one
  HostTime sent_;               // of the message that is served; 0: none
  TimerId timer_running_ = 0, timer_count_ = 0;
  std::size_t poll_count_ = 0;
  bool stop_ = false;
  Failed failed_;
  std::set<std::string> reported_;  // executor's thread
  std::atomic<std::uint64_t> failures_{0};
  std::atomic<bool> running_{false};
  std::atomic<std::thread::id> thread_id_{};
  std::thread thread_;
};

}  // namespace multipanda::ros
