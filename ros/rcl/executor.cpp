#include "ros/rcl/executor.hpp"

#include <algorithm>
#include <chrono>

#include "ros/rcl/context.hpp"

namespace multipanda::ros {

namespace {
constexpr auto kPollEvery = std::chrono::microseconds(100);
}

void Incoming::begin() { executor_.attach(*this); }
void Incoming::end() { executor_.detach(*this); }

void Incoming::arrived(const void* incoming, std::size_t /*count*/) {
  auto* self = const_cast<Incoming*>(static_cast<const Incoming*>(incoming));
  self->executor_.notify(*self);
}

// The system's clock may have been set since. That of another machine is not compared with ours.
double Incoming::note_times(std::int64_t sent_ns, std::int64_t received_ns) {
  using namespace std::chrono;
  const std::int64_t since_ns = keeps_to_this_machine() && sent_ns > 0 ? sent_ns : received_ns;
  const std::int64_t now = duration_cast<nanoseconds>(system_clock::now().time_since_epoch()).count();
  const std::int64_t waited_ns = since_ns <= 0 ? 0 : std::max<std::int64_t>(0, now - since_ns);
  executor_.sent_ = host_now() + nanoseconds(-waited_ns);
  return seconds(nanoseconds(waited_ns));
}

Executor::~Executor() { stop(); }

std::string Executor::late(double patience_s) const {
  if (gaps_.settles()) return kStalled;
  if (seconds(host_now() - sent()) <= patience_s) return {};
  return "it waited on this overloaded computer for longer than its sender waits: send it again";
}

void Executor::start() {
  if (running_.exchange(true)) return;
  stop_ = false;
  thread_ = std::thread([this] {
    thread_id_.store(std::this_thread::get_id());
    run();
    thread_id_.store(std::thread::id{});
  });
}

void Executor::stop() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
    woken_.notify_all();
  }
  if (thread_.joinable()) thread_.join();
  running_.store(false);
  // Destroyed outside the lock: these functions may own entities with destructors.
  std::deque<std::function<void()>> posted;
  std::list<std::function<bool()>> polls, new_polls;
  const std::lock_guard lock(mutex_);
  posted.swap(posted_);
  polls.swap(polls_);
  new_polls.swap(new_polls_);
  poll_count_ = 0;
}

Executor::TimerId Executor::add_timer(std::chrono::nanoseconds period, std::function<void()> function) {
  const std::lock_guard lock(mutex_);
  timers_.push_back({++timer_count_, period, Clock::now() + period, std::move(function)});
  woken_.notify_all();
  return timer_count_;
}

void Executor::remove_timer(TimerId id) {
  std::list<Timer> removed;  // destroyed outside the lock
  std::unique_lock lock(mutex_);
  if (!on_own_thread()) turned_.wait(lock, [&] { return timer_running_ != id; });
  for (auto each = timers_.begin(); each != timers_.end(); ++each) {
    if (each->id != id) continue;
    // A timer that removes itself is still running; it is destroyed after it returns.
    if (timer_running_ == id)
      each->id = 0;
    else
      removed.splice(removed.begin(), timers_, each);
    break;
  }
  lock.unlock();
}

void Executor::post(std::function<void()> function) {
  const std::lock_guard lock(mutex_);
  posted_.push_back(std::move(function));
  woken_.notify_all();
}

void Executor::poll_until(std::function<bool()> done) {
  const std::lock_guard lock(mutex_);
  new_polls_.push_back(std::move(done));
  ++poll_count_;
  woken_.notify_all();
}

std::size_t Executor::polling() const {
  const std::lock_guard lock(mutex_);
  return poll_count_;
}

void Executor::attach(Incoming& incoming) {
  const std::lock_guard lock(mutex_);
  incoming.attached_ = true;
}

void Executor::detach(Incoming& incoming) {
  std::unique_lock lock(mutex_);
  incoming.attached_ = false;
  std::erase(ready_, &incoming);
  if (!on_own_thread()) turned_.wait(lock, [&] { return served_ != &incoming; });
  if (served_ == &incoming) served_ = nullptr;  // the entity was destroyed by its own callback: see serve()
}

void Executor::notify(Incoming& incoming) {
  const std::lock_guard lock(mutex_);
  if (!incoming.attached_ || incoming.queued_) return;
  incoming.queued_ = true;
  ready_.push_back(&incoming);
  woken_.notify_all();
}

void Executor::run() {
  std::unique_lock lock(mutex_);
  while (!stop_) {
    (void)gaps_.look();
    run_timers(lock);
    run_posted(lock);
    run_polls(lock);
    serve(lock);
    if (stop_ || !ready_.empty() || !posted_.empty() || !new_polls_.empty()) continue;
    auto until = Clock::now() + kSlice;
    for (const Timer& timer : timers_) until = std::min(until, timer.next);
    if (!polls_.empty()) until = std::min(until, Clock::now() + kPollEvery);
    woken_.wait_until(lock, until);
  }
}

bool Executor::guarded(const std::function<void()>& function, const Incoming* source, const char* kind) {
  std::string what;
  try {
    function();
    return true;
  } catch (const std::exception& error) {
    what = error.what();
  } catch (...) {
    what = "an exception of unknown type";
  }
  failures_.fetch_add(1, std::memory_order_relaxed);
  const std::string name = source != nullptr ? source->source() : kind;
  if (reported_.insert(name).second && failed_) failed_(name, what);
  return false;
}

void Executor::run_timers(std::unique_lock<std::mutex>& lock) {
  const auto now = Clock::now();
  for (auto timer = timers_.begin(); timer != timers_.end() && !stop_;) {
    if (timer->next <= now) {
      // Skips missed periods.
      timer->next = std::max(timer->next + timer->period, now);
      timer_running_ = timer->id;
      lock.unlock();
      guarded(timer->function, nullptr, "a timer");
      lock.lock();
      timer_running_ = 0;
      turned_.notify_all();
    }
    timer = timer->id == 0 ? timers_.erase(timer) : std::next(timer);
  }
}

void Executor::run_posted(std::unique_lock<std::mutex>& lock) {
  for (std::size_t count = posted_.size(); count > 0 && !posted_.empty() && !stop_; --count) {
    auto function = std::move(posted_.front());
    posted_.pop_front();
    lock.unlock();
    guarded(function, nullptr, "a posted function");
    function = nullptr;
    lock.lock();
  }
}

void Executor::run_polls(std::unique_lock<std::mutex>& lock) {
  polls_.splice(polls_.end(), new_polls_);
  // Only this thread touches polls_, so walking the list needs no lock.
  if (polls_.empty()) return;
  lock.unlock();
  std::size_t done = 0;
  for (auto poll = polls_.begin(); poll != polls_.end();) {
    bool over = true;  // also on an exception
    guarded([&] { over = (*poll)(); }, nullptr, "a function of poll_until()");
    if (over) {
      poll = polls_.erase(poll);
      ++done;
    } else {
      ++poll;
    }
  }
  lock.lock();
  poll_count_ -= done;
}

// Serves every entity that has messages when this turn starts, with at most kPerTurn messages each.
void Executor::serve(std::unique_lock<std::mutex>& lock) {
  for (std::size_t count = ready_.size(); count > 0 && !ready_.empty() && !stop_; --count) {
    Incoming* incoming = ready_.front();
    ready_.pop_front();
    // Cleared before taking messages, so that later arrivals queue the entity again.
    incoming->queued_ = false;
    served_ = incoming;
    bool more = true;
    for (std::size_t taken = 0; more && taken < kPerTurn && served_ == incoming && !stop_; ++taken) {
      lock.unlock();
      (void)gaps_.look();
      // A callback that throws has taken its message; there may be more.
      guarded([&] { more = incoming->take(); }, incoming, "");
      sent_ = {};
      lock.lock();
    }
    // A callback may have destroyed its own entity, which must not be touched afterwards.
    if (served_ == incoming && more && incoming->attached_ && !incoming->queued_) {
      incoming->queued_ = true;
      ready_.push_back(incoming);
    }
    served_ = nullptr;
    turned_.notify_all();
  }
}

}  // namespace multipanda::ros
