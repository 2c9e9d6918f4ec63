#pragma once

#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

// The declaration of one key of a configuration structure. Reading, checking, the reference page and the
// JSON Schema all follow from this declaration (archive.hpp).
namespace multipanda {

struct Section;

struct Key {
  enum class Kind {
    text,
    identifier,  // a letter, then letters, digits and _
    choice,      // one of `words`
    boolean,
    integer,
    number,
    numbers,   // a list; also one number for all (`one_for_all`), or one of `words`
    names,     // a list of strings, or one alone; or one of `words`
    section,   // a mapping with the keys of parts[0]
    sections,  // a list of those
    open       // a mapping with arbitrary keys
  };

  // The unit comes from the name: "position_m" is in m.
  explicit Key(std::string key_name, std::string meaning = "");

  Key& required() { return needed = true, *this; }
  Key& identifier() { return kind = Kind::identifier, *this; }
  Key& within(double low, double high) { return min = low, max = high, *this; }
  Key& at_least(double low) { return min = low, *this; }
  Key& at_most(double high) { return max = high, *this; }
  Key& above(double low) { return min = low, open_below = true, *this; }
  Key& in(std::string unit_text) { return unit = std::move(unit_text), *this; }
  Key& one_of(std::vector<std::string> choices) { return words = std::move(choices), *this; }
  Key& size(std::size_t n) { return count = n, *this; }
  Key& joints(std::size_t n) {
    return per_joint = true, count = n, *this;
  }  // for descriptions n does not matter
  Key& or_one() { return one_for_all = true, *this; }
  Key& no_default() { return optional = true, *this; }  // `doc` explains the default
  Key& or_text() { return text_alone = true, *this; }   // a section may be just a text
  // What the reference page shows as the default, in place of the variable's value.
  Key& otherwise(std::string text) { return fallback = std::move(text), *this; }
  // Name of an item of a list of sections in messages: "arm".
  Key& each(std::string item_name) { return item = std::move(item_name), *this; }
  // Values that an editor proposes; others are valid, too.
  Key& like(std::vector<std::string> examples) { return proposals = std::move(examples), *this; }
  // Joints may turn several times: only values too large for radians are refused as degrees.
  Key& any_turn() { return largest_angle = 20, *this; }

  std::string name, doc, unit, fallback, item;
  Kind kind = Kind::text;
  bool needed = false, per_joint = false, one_for_all = false, open_below = false, text_alone = false;
  bool optional = false;
  double min = -std::numeric_limits<double>::infinity(), max = std::numeric_limits<double>::infinity();
  double largest_angle = 2 * std::numbers::pi + 1e-9;  // of keys in rad
  std::size_t count = 0;                               // of `numbers`; 0: known when read
  std::vector<std::string> words, proposals;
  std::vector<std::shared_ptr<const Section>> parts;
};

struct Section {
  std::string name;  // heading of the reference page
  std::string doc;
  std::vector<Key> keys;

  std::vector<std::string> names() const;
  bool has(const std::string& name) const;
};

// "a list of 3 numbers [m], -100 to 100", "true or false", ...
std::string expectation(const Key& key);
// `section` and all sections below it, each once, in the order of the documentation.
std::vector<const Section*> all_sections(const Section& section);

}  // namespace multipanda
