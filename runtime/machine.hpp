#pragma once

#include <map>
#include <string>

namespace multipanda {

// What a log says about where it was made: versions of multipanda, its libraries and compiler; processor,
// cores, kernel. No host name, no user name.
std::map<std::string, std::string> describe_machine();

}  // namespace multipanda
