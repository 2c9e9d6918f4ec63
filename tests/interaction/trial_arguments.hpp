#pragma once

#include <cstdint>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

// Arguments of the programs that print the trials' figures.
namespace multipanda {

// [TABLE ...] [trace=FILE] [repeats=NUMBER] [PARAMETER=NUMBER,NUMBER,...]; without a table, all tables.
struct TrialArguments {
  std::set<std::string> tables;
  std::vector<std::pair<std::string, std::vector<double>>> parameters;
  std::string trace;
  std::uint32_t repeats = 5;
  bool has(const std::string& table) const { return tables.empty() || tables.contains(table); }
};

inline TrialArguments parse_arguments(int argc, char** argv) {
  TrialArguments arguments;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const auto equals = argument.find('=');
    const std::string name = argument.substr(0, equals);
    if (equals == std::string::npos) {
      arguments.tables.insert(argument);
    } else if (name == "trace") {
      arguments.trace = argument.substr(equals + 1);
    } else if (name == "repeats") {
      arguments.repeats = static_cast<std::uint32_t>(std::stoul(argument.substr(equals + 1)));
    } else {
      std::stringstream rest(argument.substr(equals + 1));
      std::vector<double> values;
      for (std::string number; std::getline(rest, number, ',');) values.push_back(std::stod(number));
      arguments.parameters.emplace_back(name, values);
    }
  }
  return arguments;
}

}  // namespace multipanda
