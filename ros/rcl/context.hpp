#pragma once

#include <memory>
#include <rcl/context.h>
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

}  // namespace multipanda::ros
