#pragma once

#include <memory>
#include <rcl/context.h>
#include <string>
#include <vector>

namespace multipanda::ros {

// Without any word about it in the environment, ROS 2 opens sockets on every network. Here the default stays
// on this machine: unless one of FASTDDS_BUILTIN_TRANSPORTS, FASTDDS_DEFAULT_PROFILES_FILE,
// FASTRTPS_DEFAULT_PROFILES_FILE, ROS_AUTOMATIC_DISCOVERY_RANGE, ROS_LOCALHOST_ONLY, ROS_STATIC_PEERS,
// ROS_DISCOVERY_SERVER is set, sets FASTDDS_BUILTIN_TRANSPORTS=SHM and
// ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT (LOCALHOST for another middleware than Fast DDS). True where
// it did. Changes the environment: before other threads read it.
bool keep_to_this_machine();

// A process that is stopped (Ctrl-Z) can hold a lock of the shared memory it reads from, and holds up for up
// to two seconds who writes to it: seen. So the middleware sends on a thread of its own, unless
// RMW_FASTRTPS_PUBLICATION_MODE says otherwise. True where it was not set.
bool publish_in_background();

// Fast DDS looks up types at other participants, which ROS 2 does not need, and a program that ends meanwhile
// may crash in it: seen on short-lived nodes beside a busy run. So FASTDDS_DEFAULT_PROFILES_FILE names a
// profile without that (fastdds_profile.xml), unless it or FASTRTPS_DEFAULT_PROFILES_FILE is set. True where
// it was not set. After keep_to_this_machine(), which takes that variable for the user's word.
bool ask_for_no_types();

// ROS as one program uses it (rcl_init to rcl_shutdown). Outlives all that is made of it.
class Context {
 public:
  // Keeps to this machine, publishes in the background and asks for no types, unless the environment says
  // otherwise. `arguments` as on a command line, without the program's name: {"--ros-args", "-r", "a:=b"}.
  // Throws RclError.
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
