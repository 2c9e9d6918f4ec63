#pragma once

#include <cstdint>
#include <set>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "core/controllets/statement.hpp"

// What the trials of one arm and of two share: words of the command line, and where an output stands.
namespace multipanda {

// [table ...] [trace=FILE] [repeats=NUMBER] [parameter=number,number,...]. Without tables all are wanted.
struct Given {
  std::set<std::string> tables;
  std::vector<std::pair<std::string, std::vector<double>>> parameters;
  std::string trace;
  std::uint32_t repeats = 5;
  bool wants(const std::string& table) const { return tables.empty() || tables.contains(table); }
};

inline Given read_words(int count, char** words) {
  Given given;
  for (int i = 1; i < count; ++i) {
    const std::string word = words[i];
    const auto equals = word.find('=');
    const std::string name = word.substr(0, equals);
    if (equals == std::string::npos) {
      given.tables.insert(word);
    } else if (name == "trace") {
      given.trace = word.substr(equals + 1);
    } else if (name == "repeats") {
      given.repeats = static_cast<std::uint32_t>(std::stoul(word.substr(equals + 1)));
    } else {
      std::stringstream rest(word.substr(equals + 1));
      std::vector<double> values;
      for (std::string number; std::getline(rest, number, ',');) values.push_back(std::stod(number));
      given.parameters.emplace_back(name, values);
    }
  }
  return given;
}

// The first number of an output among those of an instance. Throws std::invalid_argument if there is none.
inline std::size_t output_column(std::span<const OutputSpec> outputs, const std::string& name) {
  std::size_t at = 0;
  for (const auto& spec : outputs) {
    if (spec.name == name) return at;
    at += spec.size;
  }
  throw std::invalid_argument("no output " + name);
}

}  // namespace multipanda
