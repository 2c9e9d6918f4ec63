#pragma once

#include <map>
#include <string>

namespace multipanda {

// Machine of a measurement: versions of multipanda, its libraries and the compiler; processor, cores, kernel,
// architecture. It contains no host name and no user name.
std::map<std::string, std::string> describe_machine();

// Whether this address can only be a virtual arm: a number of the loopback net, 127.x.y.z, or "localhost".
// Other names may refer to any computer.
bool is_on_this_computer(const std::string& address);

}  // namespace multipanda
