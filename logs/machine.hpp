#pragma once

#include <map>
#include <string>

namespace multipanda {

// What a measurement should be read with: "version", "compiler", "cpu", "cores", "kernel". No names of people
// or hosts.
std::map<std::string, std::string> machine_info();

// Now, on the wall clock, as in ISO 8601 with the offset from UTC: "2025-01-31T12:00:00+0100".
std::string wall_time_now();

}  // namespace multipanda
