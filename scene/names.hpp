#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

// Help with mistyped names and keys in wrong units, for messages.
namespace multipanda {

// Insertions, deletions, replacements and swaps of neighbours that lead from a to b.
std::size_t edit_distance(std::string_view a, std::string_view b);

// The candidate nearest to `name`, or "" if none is near enough to be meant.
std::string nearest_name(std::string_view name, const std::vector<std::string>& candidates);

// "; did you mean 'x'?" or "; valid: a, b, c" (or "; there are none").
std::string name_hint(std::string_view name, const std::vector<std::string>& candidates, const char* none);

// A key split into its quantity and the unit that it carries: "position_m" is {"position", "m"}.
struct UnitKey {
  std::string_view quantity, unit;  // unit empty: none recognised
};
UnitKey split_unit(std::string_view key);

// Valid keys for the same quantity as `key` that carry another unit: what "position_mm" or "position" meant.
std::vector<std::string> same_quantity(std::string_view key, const std::vector<std::string>& candidates);

// "a, b, c"
std::string joined(const std::vector<std::string>& names, const char* between = ", ");

}  // namespace multipanda
