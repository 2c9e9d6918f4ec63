#include "ros/rcl/context.hpp"

#include <cstdlib>
#include <filesystem>
#include <rcl/domain_id.h>
#include <rcl/init.h>
#if __has_include(<rcl/version.h>)
#include <rcl/version.h>
#endif
#include <string_view>
#include <system_error>

#include "ros/rcl/error.hpp"

namespace multipanda::ros {

bool keep_to_this_machine() {
  for (const char* name :
       {"FASTDDS_BUILTIN_TRANSPORTS", "FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE",
        "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER"}) {
    const char* value = std::getenv(name);
    if (value != nullptr && !std::string_view(value).empty()) return false;
  }
  // Shared memory is then the only transport, and SYSTEM_DEFAULT keeps rmw from adding sockets for a range.
  // Other middlewares than Fast DDS need LOCALHOST.
  const char* middleware = std::getenv("RMW_IMPLEMENTATION");
  const bool fast_dds = middleware == nullptr || std::string_view(middleware).empty() ||
                        std::string_view(middleware).find("fastrtps") != std::string_view::npos;
  setenv("FASTDDS_BUILTIN_TRANSPORTS", "SHM", 1);
  setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", fast_dds ? "SYSTEM_DEFAULT" : "LOCALHOST", 1);
#if defined(RCL_VERSION_MAJOR) && RCL_VERSION_MAJOR < 6
  setenv("ROS_LOCALHOST_ONLY", "1", 1);  // Humble knows neither variable
#endif
  return true;
}

bool publish_in_background() {
  constexpr const char* kMode = "RMW_FASTRTPS_PUBLICATION_MODE";
  const char* value = std::getenv(kMode);
  if (value != nullptr && !std::string_view(value).empty()) return false;
  setenv(kMode, "ASYNCHRONOUS", 1);
  return true;
}

bool ask_for_no_types() {
  for (const char* name : {"FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE"}) {
    const char* value = std::getenv(name);
    if (value != nullptr && !std::string_view(value).empty()) return false;
  }
  std::error_code ignored;
  if (!std::filesystem::exists(MULTIPANDA_FASTDDS_PROFILE, ignored)) return false;
  setenv("FASTDDS_DEFAULT_PROFILES_FILE", MULTIPANDA_FASTDDS_PROFILE, 1);
  return true;
}

Context::Context(std::vector<std::string> arguments) : context_(rcl_get_zero_initialized_context()) {
  keep_to_this_machine();
  publish_in_background();
  ask_for_no_types();
  arguments.insert(arguments.begin(), "multipanda");  // the program's name, as in argv
  std::vector<const char*> argv;
  for (const auto& argument : arguments) argv.push_back(argument.c_str());

  rcl_init_options_t options = rcl_get_zero_initialized_init_options();
  check(rcl_init_options_init(&options, rcl_get_default_allocator()), "preparing ROS");
  const rcl_ret_t result = rcl_init(static_cast<int>(argv.size()), argv.data(), &options, &context_);
  const std::string why = result == RCL_RET_OK ? "" : take_rcl_error();
  disregard(rcl_init_options_fini(&options));
  if (result != RCL_RET_OK) throw RclError("starting ROS failed (" + std::to_string(result) + "): " + why);
  disregard(rcl_get_default_domain_id(&domain_));  // as rcl_init read it from ROS_DOMAIN_ID
  if (domain_ == RCL_DEFAULT_DOMAIN_ID) domain_ = 0;
}

Context::~Context() {
  disregard(rcl_shutdown(&context_));
  disregard(rcl_context_fini(&context_));
}

}  // namespace multipanda::ros
