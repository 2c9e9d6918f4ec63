#pragma once

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

}  // namespace multipanda
