#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "yaml_reader/key.hpp"

namespace multipanda {

// The lists of one page. Items that an earlier list contains are not repeated: a sentence names them and
// links that list.
class PageLists {
 public:
  // `title`: the heading above the list; items: subject, as code, and the rest of the line.
  std::string list(const std::string& title, const std::vector<std::pair<std::string, std::string>>& items);

 private:
  std::map<std::pair<std::string, std::string>, std::string> titles_;  // by item
};

// Markdown: a heading and a list of keys for `section` and each section below it.
std::string reference_lists(const Section& section);
// " (value; absent)": allowed values and default of an item; one of both may be empty.
std::string in_brackets(const std::string& value, const std::string& absent);
// `text`, or an empty string.
std::string code_text(const std::string& text);

// JSON Schema (draft 7) of files whose top is `section`, for completion and checks in editors. It contains
// keys, types, bounds and defaults; only the program checks conditions on several values.
nlohmann::ordered_json json_schema(const Section& section, const std::string& title);

}  // namespace multipanda
