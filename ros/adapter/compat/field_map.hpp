#pragma once

#include <algorithm>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "ros/adapter/compat/numbers.hpp"

namespace multipanda::ros {

// A table "their field -> our quantity" for messages that are sent. `Source`: where the quantities come from.
template <class Source>
struct FieldRule {
  std::vector<std::string> paths;  // one field of `count` numbers, or `count` fields of one
  std::size_t count = 1;
  std::function<void(const Source&, std::span<double>)> values;  // fills `count` numbers
  bool needed = false;  // a type without the field is refused; otherwise the rule is left out
};

// Fills messages of one type by a table. Fields that the table does not name keep the defaults of their type.
// One thread at a time.
template <class Source>
class FieldMap {
 public:
  // Throws std::invalid_argument for a type without a needed field, or with one of another kind or size.
  FieldMap(const MessageType& type, const std::vector<FieldRule<Source>>& rules) {
    std::vector<std::string> known;
    for (const auto& rule : rules) {
      const bool all = std::all_of(rule.paths.begin(), rule.paths.end(),
                                   [&](const auto& path) { return type.place(path).has_value(); });
      if (!all && !rule.needed) continue;
      entries_.push_back({Numbers(type, rule.paths, rule.count), rule.values});
      known.insert(known.end(), rule.paths.begin(), rule.paths.end());
      values_.resize(std::max(values_.size(), rule.count));
    }
    for (const auto& path : type.paths()) {
      if (std::find(known.begin(), known.end(), path) == known.end()) unknown_.push_back(path);
    }
  }

  void fill(const Source& source, void* message) {
    for (const auto& entry : entries_) {
      const std::span<double> values(values_.data(), entry.numbers.count());
      entry.values(source, values);
      entry.numbers.write(message, values);
    }
  }

  // Paths of the fields that no rule fills.
  const std::vector<std::string>& unknown() const { return unknown_; }

 private:
  struct Entry {
    Numbers numbers;
    std::function<void(const Source&, std::span<double>)> values;
  };
  std::vector<Entry> entries_;
  std::vector<double> values_;
  std::vector<std::string> unknown_;
};

}  // namespace multipanda::ros
