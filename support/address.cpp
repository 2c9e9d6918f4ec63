#include "support/address.hpp"

#include <arpa/inet.h>
#include <cstdint>

namespace multipanda {

bool is_on_this_computer(const std::string& address) {
  in_addr parsed{};
  constexpr std::uint32_t kLoopbackNet = 127;
  return address == "localhost" ||
         (inet_pton(AF_INET, address.c_str(), &parsed) == 1 && ntohl(parsed.s_addr) >> 24 == kLoopbackNet);
}

}  // namespace multipanda
