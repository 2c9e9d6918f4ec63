#pragma once

#include <functional>
#include <vector>

#include "core/modes/request.hpp"
#include "ros/adapter/adapter_part.hpp"

namespace multipanda::ros {

// The loop's answer to a batch of requests.
struct LoopAnswer {
  Answer answer;                  // to the last request; after a timeout without times
  std::vector<Verdict> verdicts;  // one per request
  // Index of the first refused request; the number of requests if there is none.
  std::size_t first_refused() const;
};

// Posts the requests for one cycle and calls `done` on the executor's thread: at once if a request is invalid
// (all get the verdict of the first invalid one), otherwise when the loop has answered, or after 1 s without
// an answer: they are then withdrawn and will not be executed. Executor's thread; never waits.
void request_loop(const AdapterContext& run, const std::vector<Request>& requests,
                  std::function<void(const LoopAnswer&)> done);

}  // namespace multipanda::ros
