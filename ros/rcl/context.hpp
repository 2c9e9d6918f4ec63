#pragma once

#include <memory>
#include <rcl/context.h>
#include <rcl/types.h>
#include <rmw/types.h>
#include <stdexcept>
#include <string>
#include <vector>

namespace multipanda::ros {

// By default ROS 2 opens sockets on every network. This function makes the default stay on this machine and
// be visible to every ROS 2 program on it: it names the profile fastdds_loopback.xml (for another middleware
// than Fast DDS: ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST; on Humble ROS_LOCALHOST_ONLY=1). It does nothing if
// the environment has one of FASTDDS_BUILTIN_TRANSPORTS, FASTDDS_DEFAULT_PROFILES_FILE,
// FASTRTPS_DEFAULT_PROFILES_FILE, ROS_AUTOMATIC_DISCOVERY_RANGE, ROS_LOCALHOST_ONLY, ROS_STATIC_PEERS,
// ROS_DISCOVERY_SERVER. Returns whether it set variables. Call before other threads read the environment.
bool keep_to_this_machine();
// Whether it did, so that all messages are stamped by this machine's clock.
bool keeps_to_this_machine();

// Makes the middleware send on its own thread, unless RMW_FASTRTPS_PUBLICATION_MODE is set. A stopped process
// (Ctrl-Z) can hold a lock of the shared memory that it reads; writers were seen to block on it for up to two
// seconds. Returns whether it set the variable.
bool publish_in_background();

// Disables Fast DDS' look-up of types at other participants, which ROS 2 does not need; programs that ended
// during a look-up were seen to crash (short-lived nodes next to a busy run). If no profile is set, it names
// one without the look-up (fastdds_profile.xml); fastdds_loopback.xml disables it, too. Returns whether it
// set the variable. Call after keep_to_this_machine(), which respects that variable.
bool ask_for_no_types();

// The ROS context of one program (rcl_init to rcl_shutdown). Outlives every entity made with it.
class Context {
 public:
  // Applies the three functions above. `arguments`: as on a command line without the program's name, for
  // example {"--ros-args", "-r", "a:=b"}. Throws RclError.
  explicit Context(std::vector<std::string> arguments = {});
  ~Context();
  Context(const Context&) = delete;

  rcl_context_t* handle() { return &context_; }
  std::size_t domain() const { return domain_; }

 private:
  rcl_context_t context_;
  std::size_t domain_ = 0;
};

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

// Depth of the queues of services: further requests and responses displace the oldest ones. The ROS default
// is ten.
inline constexpr std::size_t kServiceDepth = 200;

// Quality of service of a topic. The newest `depth` messages are kept; older ones are replaced, so that no
// writer waits for a reader.
struct Qos {
  enum class Reliability { best_effort, reliable };
  Reliability reliability = Reliability::best_effort;
  std::size_t depth = 5;
  bool transient_local = false;  // late subscribers get the newest messages

  static Qos sensor(std::size_t depth = 5) { return {Reliability::best_effort, depth, false}; }
  static Qos reliable(std::size_t depth = 10) { return {Reliability::reliable, depth, false}; }
  static Qos latched(std::size_t depth = 1) { return {Reliability::reliable, depth, true}; }

  rmw_qos_profile_t profile() const;
  std::string text() const;  // "reliable, newest 10, kept for late subscribers"
};

}  // namespace multipanda::ros
