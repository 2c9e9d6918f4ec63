#include "ros/adapter/controllets/loop_requests.hpp"

#include <algorithm>

#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {
namespace {

constexpr double kLoopTimeout = MultimodeController::kPatience;  // for the loop's answer [s]

}  // namespace

std::size_t LoopAnswer::first_refused() const {
  return static_cast<std::size_t>(
      std::find_if(verdicts.begin(), verdicts.end(), [](Verdict v) { return v != Verdict::accepted; }) -
      verdicts.begin());
}

void request_loop(const AdapterContext& run, const std::vector<Request>& requests,
                  std::function<void(const LoopAnswer&)> done) {
  LoopAnswer result;
  result.verdicts.assign(requests.size(), Verdict::timeout);
  if (!requests.empty()) result.answer.kind = requests.back().kind;
  std::uint64_t ticket = 0;
  const bool late = !run.executor->late(kLoopTimeout).empty();
  const Verdict posted =
      late ? Verdict::timeout : run.modes->post(requests, ticket, kLoopTimeout, run.executor->sent());
  if (posted != Verdict::accepted) {
    result.answer.verdict = posted;
    std::fill(result.verdicts.begin(), result.verdicts.end(), posted);
    return done(result);
  }
  const HostTime posted_at = host_now();
  MultimodeController* modes = run.modes;
  const std::uint64_t first = ticket - requests.size() + 1;
  run.executor->poll_until(
      [modes, ticket, first, posted_at, result = std::move(result), done = std::move(done)]() mutable {
        // The loop answers in order.
        Answer last;
        const bool answered = modes->poll(ticket, last);
        const double waited = seconds(host_now() - posted_at);
        if (!answered && waited <= kLoopTimeout) return false;
        result.answer.verdict = Verdict::timeout;
        if (!answered && !modes->withdraw(ticket)) {  // the loop has taken them: its answer follows
          if (waited <= kLoopTimeout + MultimodeController::kAnswerPatience) return false;
          result.answer.verdict = Verdict::pending;
          result.verdicts.assign(result.verdicts.size(), Verdict::pending);
        }
        if (answered) result.answer = last;
        for (std::size_t k = 0; k < result.verdicts.size(); ++k) {
          Answer answer;
          if (modes->poll(first + k, answer)) result.verdicts[k] = answer.verdict;
        }
        done(result);
        return true;
      });
}

}  // namespace multipanda::ros
