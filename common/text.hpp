#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

// Pieces of messages, and numbers as text.
namespace multipanda {

// Strips spaces, tabs and newlines at both ends.
std::string_view trimmed(std::string_view text);
// "a, b, c"
std::string joined(const std::vector<std::string>& names, const char* between = ", ");

// A quoted name; control characters become spaces, a long name is truncated.
std::string in_quotes(const std::string& name);
// "'a', 'b' or 'c'"
std::string in_quotes(const std::vector<std::string>& names);
// The shortest decimal that reads back as the same number.
std::string number_text(double value);
// "[0, 0.5, 1]"
std::string list_text(const std::vector<double>& values);
// "0 to 87", "at least 0.001", "above 0" (`open_below`), or "" without bounds.
std::string bounds_text(double min, double max, bool open_below = false);

// The number in a string, finite or not: a decimal, or a multiple of pi as "pi", "-pi/2", "3*pi/4".
// False if there is none.
bool read_number(const std::string& text, double& value);

// Hints for mistyped names and for keys with other units, for messages.

// Number of insertions, deletions, replacements and swaps of neighbors between a and b.
std::size_t edit_distance(std::string_view a, std::string_view b);

// The candidate nearest to `name`, or "" if none is near enough.
std::string nearest_name(std::string_view name, const std::vector<std::string>& candidates);

// "; did you mean 'x'?" or "; valid: a, b, c"; without candidates `none` ("; there are none").
std::string name_hint(std::string_view name, const std::vector<std::string>& candidates, const char* none);

// "'pose0' has no input 'poze'; did you mean 'pose'?"
std::string has_no(const std::string& owner, const char* kind, const std::string& name,
                   const std::vector<std::string>& candidates);

// The names of objects with a member `name`.
std::vector<std::string> names_in(const auto& items) {
  std::vector<std::string> names;
  for (const auto& item : items) names.push_back(item.name);
  return names;
}

// A key split into quantity and unit: "position_m" is {"position", "m"}.
struct UnitKey {
  std::string_view quantity, unit;  // unit is empty if none is recognized
};
UnitKey split_unit(std::string_view key);

// Valid keys for the same quantity as `key` with another unit, such as "position_m" for "position_mm".
std::vector<std::string> same_quantity(std::string_view key, const std::vector<std::string>& candidates);

}  // namespace multipanda
