#include "yaml_reader/key.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "common/text.hpp"

namespace multipanda {
namespace {

constexpr std::array<std::pair<std::string_view, const char*>, 24> kUnitTexts{{{"m", "m"},
                                                                               {"m_per_s", "m/s"},
                                                                               {"m_per_s2", "m/s^2"},
                                                                               {"m_per_s3", "m/s^3"},
                                                                               {"rad", "rad"},
                                                                               {"rad_per_s", "rad/s"},
                                                                               {"rad_per_s2", "rad/s^2"},
                                                                               {"rad_per_s3", "rad/s^3"},
                                                                               {"s", "s"},
                                                                               {"per_s", "1/s"},
                                                                               {"hz", "Hz"},
                                                                               {"kg", "kg"},
                                                                               {"kg_m2", "kg m^2"},
                                                                               {"n", "N"},
                                                                               {"nm", "N m"},
                                                                               {"nm_per_s", "N m/s"},
                                                                               {"n_per_s", "N/s"},
                                                                               {"n_per_m", "N/m"},
                                                                               {"nm_per_rad", "N m/rad"},
                                                                               {"n_s_per_m", "N s/m"},
                                                                               {"ns_per_m", "N s/m"},
                                                                               {"nm_s_per_rad", "N m s/rad"},
                                                                               {"nms_per_rad", "N m s/rad"},
                                                                               {"s_per_rad", "s/rad"}}};

std::string kind_text(const Key& key) {
  switch (key.kind) {
    case Key::Kind::text:
      return "a string";
    case Key::Kind::identifier:
      return "a name (a letter, then letters, digits or _)";
    case Key::Kind::choice:
      return in_quotes(key.words);
    case Key::Kind::boolean:
      return "true or false";
    case Key::Kind::integer:
      return "a whole number";
    case Key::Kind::number:
      return "a number";
    case Key::Kind::numbers: {
      const std::string one = key.one_for_all ? "a number, or " : "";
      if (key.count > 0) return one + "a list of " + std::to_string(key.count) + " numbers";
      return one + "a list of numbers" + (key.per_joint ? ", one per joint" : "");
    }
    case Key::Kind::names:
      return "a list of names";
    case Key::Kind::section:
    case Key::Kind::open:
      return "a mapping (key: value)";
    case Key::Kind::sections:
      return "a list of mappings (key: value)";
  }
  return "";
}

void collect(const Section& section, std::vector<const Section*>& all) {
  const auto same = [&](const Section* other) { return other->name == section.name; };
  if (std::any_of(all.begin(), all.end(), same)) return;
  all.push_back(&section);
  for (const auto& key : section.keys) {
    for (const auto& part : key.parts) collect(*part, all);
  }
}

}  // namespace

Key::Key(std::string key_name, std::string meaning) : name(std::move(key_name)), doc(std::move(meaning)) {
  const std::string_view suffix = split_unit(name).unit;
  const auto text = std::find_if(kUnitTexts.begin(), kUnitTexts.end(),
                                 [&](const auto& candidate) { return candidate.first == suffix; });
  if (text != kUnitTexts.end()) unit = text->second;
}

std::vector<std::string> Section::names() const {
  std::vector<std::string> list;
  for (const auto& key : keys) list.push_back(key.name);
  return list;
}

bool Section::has(const std::string& key_name) const {
  return std::any_of(keys.begin(), keys.end(), [&](const Key& key) { return key.name == key_name; });
}

std::string expectation(const Key& key) {
  const bool numeric = key.kind == Key::Kind::number || key.kind == Key::Kind::numbers;
  std::string text = kind_text(key);
  if (numeric && !key.unit.empty()) text += " [" + key.unit + "]";
  if (const std::string bounds = bounds_text(key.min, key.max, key.open_below); !bounds.empty())
    text += ", " + bounds;
  if (!key.words.empty() && key.kind != Key::Kind::choice) text += ", or " + in_quotes(key.words);
  return text;
}

std::vector<const Section*> all_sections(const Section& section) {
  std::vector<const Section*> all;
  collect(section, all);
  return all;
}

}  // namespace multipanda
