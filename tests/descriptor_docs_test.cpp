// The parameter tables in docs/controllets and docs/features against the descriptors: a default or a bound
// that one of both states otherwise is found.
#include <algorithm>
#include <fstream>
#include <map>
#include <optional>
#include <regex>
#include <sstream>

#include <gtest/gtest.h>

#include "core/modes/registry.hpp"

namespace multipanda {
namespace {

// A row "| `name` | default | bounds | ... |" of a page.
struct Row {
  std::string initial, bounds;
};
using Page = std::map<std::string, Row>;

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size()) {
    text.replace(at, from.size(), to);
  }
  return text;
}

Page page(const std::string& file) {
  std::ifstream in(std::string(MULTIPANDA_DOCS) + "/" + file);
  EXPECT_TRUE(in) << file;
  Page rows;
  bool parameters = false;
  for (std::string line; std::getline(in, line);) {
    parameters = line.starts_with("|") && (parameters || line.starts_with("| parameter "));
    std::smatch cell;
    if (!parameters || !std::regex_match(line, cell, std::regex(R"(\| `(\w+)` \| ([^|]*) \| ([^|]*)\|.*)"))) {
      continue;
    }
    const auto plain = [](const std::string& text) { return replaced(text, "−", "-"); };
    rows[cell[1]] = {plain(cell[2]), plain(cell[3])};
  }
  return rows;
}

std::vector<double> numbers(const std::string& text) {
  std::istringstream in(text);
  std::vector<double> found;
  for (double number; in >> number;) found.push_back(number);
  return found;
}

// "lo … hi" or "±hi", and after a comma what else bounds the value.
std::optional<std::pair<double, double>> bounds(const std::string& text) {
  std::smatch found;
  if (std::regex_search(text, found, std::regex("^±([0-9.]+)"))) {
    const double most = std::stod(found[1]);
    return std::pair{-most, most};
  }
  if (std::regex_search(text, found, std::regex("^(-?[0-9.]+) … (-?[0-9.]+)"))) {
    return std::pair{std::stod(found[1]), std::stod(found[2])};
  }
  return {};
}

std::vector<std::string> names(const std::string& text) {
  std::vector<std::string> found;
  const std::regex name(R"(\w+)");
  for (std::sregex_iterator i(text.begin(), text.end(), name), end; i != end; ++i) found.push_back(i->str());
  return found;
}

void expect_equal(const ParameterSpec& spec, const Row& row) {
  if (spec.choices.size() == 2 && spec.choices[0] == "false") {
    EXPECT_EQ(row.initial, spec.initial[0] != 0 ? "true" : "false");
    return;
  }
  if (!spec.choices.empty()) {
    EXPECT_EQ(names(row.initial), std::vector{spec.choices.at(static_cast<std::size_t>(spec.initial[0]))});
    EXPECT_EQ(names(row.bounds), spec.choices);
    EXPECT_EQ(spec.max, static_cast<double>(spec.choices.size() - 1));
    EXPECT_EQ(spec.min, 0);
    return;
  }
  std::vector<double> documented = numbers(row.initial), initial = spec.initial;
  const std::size_t size = std::max(documented.size(), initial.size());
  ASSERT_FALSE(documented.empty()) << row.initial;
  documented.resize(size, documented.back());  // beyond the numbers that are stated: the last of them
  if (initial.size() == 1) initial.resize(size, initial[0]);
  EXPECT_EQ(documented, initial);
  const auto limits = bounds(row.bounds);
  ASSERT_TRUE(limits) << "bounds '" << row.bounds << "' are neither 'lo … hi' nor '±hi'";
  EXPECT_EQ(limits->first, spec.min);
  EXPECT_EQ(limits->second, spec.max);
}

// `shared`: pages whose rows hold unless the type's own page has one.
void expect_documented(const ControlletDescriptor& type, const std::string& folder,
                       const std::vector<std::string>& shared) {
  const Page own = page(folder + "/" + type.type + ".md");
  Page rows = own;
  for (const std::string& name : shared) rows.merge(page("controllets/" + name + ".md"));
  std::vector<std::string> known;
  for (const ParameterSpec& spec : type.parameters) {
    SCOPED_TRACE(type.type + ", " + spec.name);
    known.push_back(spec.name);
    const auto row = rows.find(spec.name);
    if (row == rows.end()) {
      ADD_FAILURE() << "no page has a row for it";
    } else {
      expect_equal(spec, row->second);
    }
  }
  for (const auto& [name, row] : own) {
    EXPECT_NE(std::find(known.begin(), known.end(), name), known.end())
        << type.type << " has no parameter '" << name << "', which its page lists";
  }
}

TEST(DescriptorDocs, StateTheDefaultsAndBoundsOfEveryParameter) {
  const Registry registry = Registry::with_builtins();
  std::size_t types = 0;
  for (const ControlletType& type : registry.controllets()) {
    std::vector<std::string> shared;
    if (type.descriptor.type.ends_with("ufic")) shared = {"force"};
    if (type.descriptor.type != "joint_impedance" && type.descriptor.type != "joint_follower" &&
        type.descriptor.type != "hold" && type.descriptor.type != "gravity_compensation") {
      shared.push_back("cartesian_impedance");
    }
    if (type.descriptor.type == "coupled_ufic") shared.push_back("ufic");
    expect_documented(type.descriptor, "controllets", shared);
    ++types;
  }
  for (const FeatureType& type : registry.features()) {
    expect_documented(type.descriptor, "features", {});
    ++types;
  }
  EXPECT_EQ(types, 17u);
}

}  // namespace
}  // namespace multipanda
