#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "logs/mcap_reader.hpp"

namespace multipanda {

// One field of a message as plain values, for tables and arrays. Nested messages become fields "outer_inner".
// Points, vectors and quaternions (x y z w) become one field of 3 or 4 numbers, times become seconds, and
// lists of strings become one string, a JSON array.
struct FlatField {
  std::string name;
  std::variant<std::vector<double>, std::vector<std::int64_t>, std::string> values;
  bool list = false;               // a sequence of any length
  std::string unit;                // as in a column's name: "rad_per_s"; empty: none
  std::vector<std::string> parts;  // names of the numbers of a point, vector or quaternion: x y z
};

// The message's fields in the order of its definition; nothing for an unknown message type.
// Throws std::runtime_error for a damaged message, and for a known type with another definition
// (a log of another version).
std::optional<std::vector<FlatField>> flatten(const mcap::Schema& schema, mcap::Bytes cdr);

}  // namespace multipanda
