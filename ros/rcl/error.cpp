#include "ros/rcl/error.hpp"

#include <rcl/error_handling.h>

namespace multipanda::ros {

std::string take_rcl_error() {
  std::string text = rcl_error_is_set() ? rcl_get_error_string().str : "no further information";
  rcl_reset_error();
  return text;
}

void disregard(rcl_ret_t result) {
  if (result != RCL_RET_OK) rcl_reset_error();
}

void check(rcl_ret_t result, const std::string& what) {
  if (result == RCL_RET_OK) {
    // some successful calls leave an error behind, which the next call would print
    rcl_reset_error();
    return;
  }
  throw RclError(what + " failed (" + std::to_string(result) + "): " + take_rcl_error());
}

}  // namespace multipanda::ros
