#include "scene/mapping.hpp"

#include <algorithm>

#include "scene/names.hpp"

namespace multipanda {
namespace {

std::string inner(const Entry& entry, const std::string& key) {
  return entry.what().empty() ? key : entry.what() + ": " + key;
}

[[noreturn]] void refuse_key(const Entry& at_key, const std::string& key, const Section& section) {
  const std::vector<std::string> valid = section.keys();
  const std::vector<std::string> meant = same_quantity(key, valid);
  if (meant.empty())
    at_key.refuse("unknown key " + in_quotes(key) + name_hint(key, valid, "no key is allowed here"));
  std::string right;
  for (const auto& field : section.fields) {
    if (std::find(meant.begin(), meant.end(), field.key) == meant.end()) continue;
    right += (right.empty() ? "" : " or ") + std::string("'") + field.key + "'" +
             (field.unit.empty() ? "" : " [" + field.unit + "]");
  }
  const bool bare = split_unit(key).unit.empty();
  at_key.refuse("unknown key " + in_quotes(key) + (bare ? ": a key names its unit" : ": wrong unit") +
                "; write " + right);
}

bool names_its_items(const Section& section) {
  const std::vector<std::string> keys = section.keys();
  return std::find(keys.begin(), keys.end(), "name") != keys.end();
}

// `left: {...}` says the same as `- {name: left, ...}`: where no list of mappings can be written, as in ROS
// parameters. The name goes into the document's node, which no one else reads again by its name.
std::vector<Entry> items_by_name(const Entry& map) {
  std::vector<Entry> list;
  for (const auto& [name, value] : pairs_of(map)) {
    YAML::Node node = value.node();
    if (node.IsNull()) node = YAML::Node(YAML::NodeType::Map);
    if (!node.IsMap()) value.expected("a mapping");
    const Entry item(value.file(), node, value.place().line, value.what());
    if (!node["name"]) {
      node["name"] = name;
    } else if (!node["name"].IsScalar() || node["name"].Scalar() != name) {
      item.refuse("is called " + in_quotes(name) + " by its key; leave the key 'name' out");
    }
    list.push_back(item);
  }
  return list;
}

}  // namespace

std::vector<std::pair<std::string, Entry>> pairs_of(const Entry& entry) {
  if (!entry.node().IsMap()) entry.expected("a mapping (key: value)");
  std::vector<std::pair<std::string, Entry>> pairs;
  for (const auto& pair : entry.node()) {
    const Entry key(entry.file(), pair.first, entry.place().line, entry.what());
    if (!pair.first.IsScalar()) key.refuse("expected a key that is a word");
    const std::string& name = pair.first.Scalar();
    for (const auto& [other, value] : pairs) {
      if (other == name) {
        key.refuse("the key " + in_quotes(name) + " stands twice, first in line " +
                   std::to_string(value.place().line));
      }
    }
    pairs.emplace_back(name, Entry(entry.file(), pair.second, key.place().line, inner(entry, name)));
  }
  return pairs;
}

Mapping::Mapping(Entry entry, const Section& section) : self_(std::move(entry)), section_(&section) {
  if (!self_.node().IsMap()) {
    self_.expected("a mapping with the keys " + joined(section.keys()));
  }
  entries_ = pairs_of(self_);
  const std::vector<std::string> valid = section.keys();
  for (const auto& [key, value] : entries_) {
    if (std::find(valid.begin(), valid.end(), key) != valid.end()) continue;
    // The key stands in the line of its value or above it; the pair's first line is the key's.
    for (const auto& pair : self_.node()) {
      if (pair.first.Scalar() == key) {
        refuse_key(Entry(self_.file(), pair.first, self_.place().line, self_.what()), key, section);
      }
    }
  }
  for (const auto& field : section.fields) {
    if (field.required && !has(field.key)) {
      self_.refuse("the key '" + field.key + "' is missing; expected " + expectation(field));
    }
  }
}

const Field& Mapping::field(const std::string& key) const {
  const auto& fields = section_->fields;
  const auto it = std::find_if(fields.begin(), fields.end(), [&](const auto& f) { return f.key == key; });
  if (it == fields.end())
    throw std::logic_error("no field '" + key + "' in section '" + section_->name + "'");
  return *it;
}

bool Mapping::has(const std::string& key) const {
  (void)field(key);  // asking for a key that the tables do not have is a mistake of ours
  return std::any_of(entries_.begin(), entries_.end(), [&](const auto& e) { return e.first == key; });
}

std::vector<std::string> Mapping::present(const std::vector<std::string>& keys) const {
  std::vector<std::string> list;
  std::copy_if(keys.begin(), keys.end(), std::back_inserter(list), [&](const auto& key) { return has(key); });
  return list;
}

Entry Mapping::entry(const std::string& key) const {
  for (const auto& [name, value] : entries_) {
    if (name == key) return value;
  }
  const Field& absent = field(key);
  if (absent.fallback.empty()) throw std::logic_error("field '" + key + "' has no fallback");
  return {self_.file(), YAML::Load(absent.fallback), self_.place().line, inner(self_, key)};
}

std::vector<double> Mapping::numbers(const std::string& key) const { return numbers(key, field(key).count); }

Vector3 Mapping::vector3(const std::string& key) const {
  const auto v = numbers(key, 3);
  return {v[0], v[1], v[2]};
}

std::vector<Entry> Mapping::text_items(const std::string& key) const {
  if (!has(key) && field(key).fallback.empty()) return {};
  return entry(key).text_items(field(key));
}

std::vector<Entry> Mapping::items(const std::string& key) const {
  if (!has(key)) return {};
  const Entry list = entry(key);
  if (list.node().IsMap() && names_its_items(*field(key).section)) return items_by_name(list);
  if (!list.is_list()) list.expected(expectation(field(key)));
  return list.items();
}

Mapping Mapping::section(const std::string& key) const { return {entry(key), *field(key).section}; }

void Mapping::rename(std::string what) {
  self_ = self_.as(what);
  for (auto& [key, value] : entries_) value = value.as(what + ": " + key);
}

}  // namespace multipanda
