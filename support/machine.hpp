#pragma once

#include <map>
#include <string>

namespace multipanda {

// Where a measurement was made: versions of multipanda, its libraries and the compiler; processor, cores,
// kernel, machine. It contains no host name and no user name.
std::map<std::string, std::string> describe_machine();

}  // namespace multipanda
