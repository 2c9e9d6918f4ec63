#pragma once

#include <string>

namespace multipanda {

// Whether only virtual arms can be at this address: it is a number of the loopback net, 127.x.y.z, or
// "localhost". A name may lead anywhere, whatever it begins with.
bool is_on_this_computer(const std::string& address);

}  // namespace multipanda
