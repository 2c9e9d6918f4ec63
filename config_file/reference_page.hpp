#pragma once

#include <string>

#include "config_file/key.hpp"

namespace multipanda {

// Markdown: a heading and a table of keys for `section` and each section below it.
std::string reference_tables(const Section& section);
// Text for a cell of a table: "|" escaped, never empty.
std::string table_cell(const std::string& text);
// `text`, or nothing.
std::string code_text(const std::string& text);

}  // namespace multipanda
