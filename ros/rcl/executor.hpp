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

namespace multipanda::ros {

class Executor;

// Something that messages come in for. Made and given up by the entities below.
class Incoming {
 public:
  virtual ~Incoming() = default;

 protected:
  explicit Incoming(Executor& executor) : executor_(executor) {}
  Incoming(const Incoming&) = delete;
  // Begin and end of being served; end() waits for a callback that runs (in another thread), and none comes
  // after.
  void begin();
  void end();
  // For rcl's set_on_new_..._callback: any thread of the middleware.
  static void arrived(const void* incoming, std::size_t count);

 private:
  friend class Executor;
  // Takes one message and calls its callback; false: nothing was there. Executor's thread.
  virtual bool take() = 0;
  virtual std::string source() const = 0;  // what it is, for reports

  Executor& executor_;
  bool queued_ = false, attached_ = false;  // guarded by the executor
};

// One thread on which all callbacks run, one at a time. The middleware says what arrived, so nothing is
// polled and an idle entity costs nothing. Each entity with messages gets kPerTurn of them, then the next one
// has its turn: a storm on one topic does not starve the others.
//
// What was posted before start() runs after it, in order; nothing runs after stop(). An exception that leaves
// a callback ends nothing: it is counted and reported, and the next one is served.
class Executor {
 public:
  static constexpr std::size_t kPerTurn = 16;
  using Clock = std::chrono::steady_clock;

  Executor() = default;
  ~Executor();  // stops
  Executor(const Executor&) = delete;

  void start();
  // Waits for the callback that runs; then none comes. Not from a callback. What was posted and did not run
  // is dropped. Can be started again.
  void stop();
  bool running() const { return running_.load(); }

  // Told of exceptions that left callbacks, once per source (a topic, a service, "a timer", ...), on the
  // executor's thread. Before start().
  using Failed = std::function<void(const std::string& source, const std::string& text)>;
  void on_failure(Failed failed) { failed_ = std::move(failed); }

  // --- any thread ---
  std::uint64_t failures() const { return failures_.load(std::memory_order_relaxed); }
  using TimerId = std::size_t;
  // Calls `function` each `period`, first one period from now; missed turns are not made up for.
  TimerId add_timer(std::chrono::nanoseconds period, std::function<void()> function);
  void remove_timer(TimerId id);  // waits for it, if it runs (in another thread)
  // Once, soon, on the executor's thread.
  void post(std::function<void()> function);
  // Calls `done` on the executor's thread at once and then at least every 0.2 ms until it returns true: for
  // answers of the loop, which comes without waking anybody.
  void poll_until(std::function<bool()> done);
  // Functions of poll_until() that are not done.
  std::size_t polling() const;

 private:
  friend class Incoming;
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
  // Runs it; false, and reported, if it threw.
  bool guarded(const std::function<void()>& function, const Incoming* source, const char* kind);
  bool on_own_thread() const { return std::this_thread::get_id() == thread_id_.load(); }

  mutable std::mutex mutex_;
  std::condition_variable woken_, turned_;
  std::deque<Incoming*> ready_;
  std::list<Timer> timers_;
  std::deque<std::function<void()>> posted_;
  std::list<std::function<bool()>> polls_, new_polls_;
  Incoming* served_ = nullptr;  // its callback runs
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
