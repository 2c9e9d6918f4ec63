#include "ros/rcl/error.hpp"

#include <rcl/error_handling.h>

namespace multipanda::ros {

std::string take_rcl_words() {
  std::string words = rcl_error_is_set() ? rcl_get_error_string().str : "no more is known";
  rcl_reset_error();
  return words;
}

void disregard(rcl_ret_t result) {
  if (result != RCL_RET_OK) rcl_reset_error();
}

void check(rcl_ret_t result, const std::string& what) {
  if (result == RCL_RET_OK) {
    rcl_reset_error();  // some calls succeed and leave the error of a try behind, which the next one shouts
                        // about
    return;
  }
  throw RclError(what + " failed (" + std::to_string(result) + "): " + take_rcl_words());
}

}  // namespace multipanda::ros
