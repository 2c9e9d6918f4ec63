#pragma once

#include <functional>
#include <vector>

#include "core/modes/request.hpp"
#include "ros/adapter/part.hpp"

namespace multipanda::ros {

// What the loop made of a batch of requests.
struct LoopAnswer {
  Answer answer;                  // to the last one; timeout: without times
  std::vector<Verdict> verdicts;  // one per request
  // The first one that was not accepted, else the number of requests.
  std::size_t first_refused() const;
};

// Posts the requests for one cycle and calls `done` on the executor's thread, at once if they are refused off
// the loop (all with the verdict of the first wrong one), else when the loop has answered, or after 1 s
// without an answer. Executor's thread; never waits.
void ask_loop(const AdapterWorld& world, const std::vector<Request>& requests,
              std::function<void(const LoopAnswer&)> done);

}  // namespace multipanda::ros
