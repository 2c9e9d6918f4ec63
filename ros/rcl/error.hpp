#pragma once

#include <rcl/types.h>
#include <stdexcept>
#include <string>

namespace multipanda::ros {

// A failed call of rcl: the attempted operation and rcl's own message.
struct RclError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Throws RclError unless `result` is RCL_RET_OK; clears rcl's error state.
void check(rcl_ret_t result, const std::string& what);
// For cleanup code that cannot handle a failure: discards the error.
void disregard(rcl_ret_t result);
// Returns rcl's message for the newest error of this thread, and clears it.
std::string take_rcl_error();

}  // namespace multipanda::ros
