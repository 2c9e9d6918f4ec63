#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "logs/mcap_reader.hpp"

namespace multipanda {

// One field of a message as plain values, for tables and arrays: nested messages become fields "outer_inner";
// points, vectors, quaternions (x y z w) become one field of 3 or 4 numbers; times become seconds; lists of
// texts become one text, a JSON array.
struct FlatField {
  std::string name;
  std::variant<std::vector<double>, std::vector<std::int64_t>, std::string> values;
  bool list = false;  // a sequence, whatever its present length
};

// The message's fields in the order of its definition. Nothing when the message is of a type not known here;
// throws std::runtime_error when it is of a known type but of another definition (a log of another version),
// or damaged.
std::optional<std::vector<FlatField>> flatten(const mcap::Schema& schema, mcap::Bytes cdr);

}  // namespace multipanda
