#include "ros/rcl/context.hpp"

#include <atomic>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <rcl/domain_id.h>
#include <rcl/error_handling.h>
#include <rcl/init.h>
#include <rmw/qos_profiles.h>

#if __has_include(<rcl/version.h>)
#include <rcl/version.h>
#endif
#include <string_view>

#include "common/own_files.hpp"

namespace multipanda::ros {

namespace {

// Fast DDS 3 (Kilted) and older versions read the profile from different variables.
#if defined(RCL_VERSION_MAJOR) && RCL_VERSION_MAJOR < 10
constexpr const char* kProfileVariable = "FASTRTPS_DEFAULT_PROFILES_FILE";
#else
constexpr const char* kProfileVariable = "FASTDDS_DEFAULT_PROFILES_FILE";
#endif

std::atomic<bool> local{false};

bool is_set(const char* name) {
  const char* value = std::getenv(name);
  return value != nullptr && !std::string_view(value).empty();
}

// `name`: a profile in this folder, located with multipanda's own files.
bool use_profile(const char* name) {
  try {
    const std::filesystem::path path = share_folder() / "ros/rcl" / name;
    if (!std::filesystem::exists(path)) return false;
    setenv(kProfileVariable, path.c_str(), 1);
    return true;
  } catch (const std::exception&) {  // the library was moved away from its files
    return false;
  }
}

}  // namespace

bool keep_to_this_machine() {
  for (const char* name :
       {"FASTDDS_BUILTIN_TRANSPORTS", "FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE",
        "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER"}) {
    if (is_set(name)) return false;
  }
  local = true;
#if defined(RCL_VERSION_MAJOR) && RCL_VERSION_MAJOR < 6
  setenv("ROS_LOCALHOST_ONLY", "1", 1);  // Humble's rmw creates its own loopback transport
#else
  // Middlewares other than Fast DDS need LOCALHOST. For Fast DDS, SYSTEM_DEFAULT keeps rmw from changing the
  // profile; without the profile (a moved source tree) shared memory alone is equally closed.
  const std::string_view middleware = is_set("RMW_IMPLEMENTATION") ? std::getenv("RMW_IMPLEMENTATION") : "";
  const bool fast_dds = middleware.empty() || middleware.find("fastrtps") != std::string_view::npos;
  setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", fast_dds ? "SYSTEM_DEFAULT" : "LOCALHOST", 1);
  if (fast_dds && !use_profile("fastdds_loopback.xml")) setenv("FASTDDS_BUILTIN_TRANSPORTS", "SHM", 1);
#endif
  return true;
}

bool keeps_to_this_machine() { return local; }

bool publish_in_background() {
  constexpr const char* kMode = "RMW_FASTRTPS_PUBLICATION_MODE";
  if (is_set(kMode)) return false;
  setenv(kMode, "ASYNCHRONOUS", 1);
  return true;
}

bool ask_for_no_types() {
  for (const char* name : {"FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE"})
    if (is_set(name)) return false;
  return use_profile("fastdds_profile.xml");
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
  disregard(rcl_get_default_domain_id(&domain_));  // as read by rcl_init from ROS_DOMAIN_ID
  if (domain_ == RCL_DEFAULT_DOMAIN_ID) domain_ = 0;
}

Context::~Context() {
  disregard(rcl_shutdown(&context_));
  disregard(rcl_context_fini(&context_));
}

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

rmw_qos_profile_t Qos::profile() const {
  rmw_qos_profile_t profile = rmw_qos_profile_default;
  profile.history = RMW_QOS_POLICY_HISTORY_KEEP_LAST;
  profile.depth = depth;
  profile.reliability = reliability == Reliability::reliable ? RMW_QOS_POLICY_RELIABILITY_RELIABLE
                                                             : RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT;
  profile.durability =
      transient_local ? RMW_QOS_POLICY_DURABILITY_TRANSIENT_LOCAL : RMW_QOS_POLICY_DURABILITY_VOLATILE;
  return profile;
}

std::string Qos::text() const {
  std::string text = reliability == Reliability::reliable ? "reliable" : "best effort";
  text += ", newest " + std::to_string(depth);
  if (transient_local) text += ", kept for late subscribers";
  return text;
}

}  // namespace multipanda::ros
