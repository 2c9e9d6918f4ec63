#pragma once

#include <limits>
#include <string>
#include <vector>

// How the keys of a scene file are described: tables that reading, checking and the documentation share, so
// that none of them can say something else than the others.
namespace multipanda {

enum class FieldKind {
  text,        // any text
  identifier,  // a name: a letter, then letters, digits and _
  choice,      // one of Field::choices
  boolean,     // true, false
  integer,
  number,
  numbers,   // a list of them; or a word of Field::choices
  texts,     // a list of texts, or one alone; or a word of Field::choices
  section,   // a mapping with the keys of Field::section
  sections,  // a list of those
  open       // a mapping whose keys come from a controllet's statement
};

struct Section;

struct Field {
  static constexpr std::size_t kPerJoint = 0;
  static constexpr std::size_t kByQuantity = 1000;  // as many as the input's quantity has

  std::string key;
  FieldKind kind = FieldKind::text;
  std::string unit = "";
  std::string fallback = "";  // what holds where the key is absent, as YAML; empty: see doc
  bool required = false;
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  std::size_t count = 1;  // of `numbers`; or kPerJoint, kByQuantity
  std::vector<std::string> choices = {};
  const Section* section = nullptr;
  std::string doc;
};

struct Section {
  std::string name;  // heading of the documentation
  std::string doc;
  std::vector<Field> fields;

  std::vector<std::string> keys() const;
};

// "0 to 87", "at least 0.001", or "" without bounds.
std::string bounds_text(double min, double max);
// "3 numbers [m]", "true or false", ...
std::string expectation(const Field& field);
// The shortest decimal that reads back as the same number.
std::string number_text(double value);

}  // namespace multipanda
