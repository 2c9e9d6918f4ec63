#pragma once

#include <rcl/types.h>
#include <stdexcept>
#include <string>

namespace multipanda::ros {

// A call of rcl failed: what was tried, and rcl's own words.
struct RclError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Throws RclError unless `result` is RCL_RET_OK; clears rcl's error state.
void check(rcl_ret_t result, const std::string& what);
// For clean-up, where nothing can be done about a failure any more: forgets it.
void disregard(rcl_ret_t result);
// rcl's words for the newest error of this thread, and clears them.
std::string take_rcl_words();

}  // namespace multipanda::ros
