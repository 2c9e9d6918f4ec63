#include "yaml_reader/archive.hpp"

#include <algorithm>

#include "common/text.hpp"

namespace multipanda {
namespace {

[[noreturn]] void refuse_key(const Node& key, const std::string& name, const Section& section) {
  const std::vector<std::string> valid = section.names(), meant = same_quantity(name, valid);
  const std::string message = "unknown key " + in_quotes(name);
  if (meant.empty()) key.refuse(message + name_hint(name, valid, "no key is allowed here"));
  std::string right;
  for (const auto& candidate : section.keys) {
    if (std::find(meant.begin(), meant.end(), candidate.name) == meant.end()) continue;
    right += (right.empty() ? "'" : " or '") + candidate.name + "'";
    if (!candidate.unit.empty()) right += " [" + candidate.unit + "]";
  }
  const bool bare = split_unit(name).unit.empty();
  key.refuse(message + (bare ? ": a key names its unit" : ": wrong unit") + "; write " + right);
}

}  // namespace

std::shared_ptr<const Section> Archive::described(const Visit& visit_section, bool deep) {
  Archive archive;
  archive.section_ = std::make_shared<Section>();
  archive.deep_ = deep;
  visit_section(archive);
  return archive.section_;
}

void Archive::fill(const Node& node, const std::optional<std::string>& name, const std::string& item,
                   const Visit& visit_section) try {
  const std::shared_ptr<const Section> section = described(visit_section, false);
  Archive archive;
  archive.self_ = node;
  archive.item_ = item;
  archive.collect();  // of several unknown keys, each is named
  if (!node.is_map() && !(name && node.is_null()))
    node.expected("a mapping with the keys " + joined(section->names()));
  if (node.is_map()) archive.entries_ = node.pairs();
  for (const auto& entry : archive.entries_) {
    const std::string& key = entry.first;
    if (!section->has(key)) archive.attempt([&] { refuse_key(node.key_of(key), key, *section); });
  }
  archive.settle();
  archive.collects_ = false;
  if (name) {
    if (archive.has("name") && !archive.at("name").is_word({*name}))
      archive.at("name").refuse("the key of this section names it " + in_quotes(*name) + "; remove 'name'");
    if (!archive.has("name")) archive.entries_.emplace_back("name", node.text_here(*name));
  }
  for (const auto& key : section->keys) {
    if (key.needed && !archive.has(key.name))
      node.refuse("the key '" + key.name + "' is missing; expected " + expectation(key));
  }
  try {
    visit_section(archive);
  } catch (const ConfigError&) {
    archive.settle();  // what is wrong now may follow from what was found before
    throw;
  }
  archive.settle();
} catch (const YAML::Exception& error) {
  // A gap in this program's checks, reported as an error of the file.
  throw ConfigError({node.file(), std::max(node.place().line, error.mark.line + 1)}, error.msg);
}

void Archive::attempt(const std::function<void()>& work) {
  try {
    work();
  } catch (const ConfigError& error) {
    if (!collects_) throw;
    errors_.push_back(error);
  }
}

void Archive::settle() const {
  if (errors_.empty()) return;
  if (errors_.size() == 1) throw ConfigError(errors_.front());
  const SourcePlace& first = errors_.front().place();
  const std::string line = first.line > 0 ? ":" + std::to_string(first.line) : "";
  std::string text = std::string(errors_.front().what()).substr(first.file.size() + line.size() + 2);
  for (std::size_t k = 1; k < errors_.size(); ++k) text.append("\n").append(errors_[k].what());
  throw ConfigError(first, text);
}

void Archive::about(std::string name, std::string doc) {
  if (reading()) return;
  section_->name = std::move(name);
  section_->doc = std::move(doc);
}

bool Archive::has(const std::string& key) const {
  return std::any_of(entries_.begin(), entries_.end(), [&](const auto& entry) { return entry.first == key; });
}

std::vector<std::string> Archive::present(const std::vector<std::string>& keys) const {
  std::vector<std::string> list;
  std::copy_if(keys.begin(), keys.end(), std::back_inserter(list), [&](const auto& key) { return has(key); });
  return list;
}

Node Archive::at(const std::string& key) const {
  const std::string what = self_->what().empty() ? key : self_->what() + ": " + key;
  for (const auto& [name, value] : entries_) {
    if (name == key) return value.called(what);
  }
  return self_->called(what);
}

std::optional<Node> Archive::enter(Key& key, const std::string& default_text) {
  if (reading()) return has(key.name) ? std::optional<Node>(at(key.name)) : std::nullopt;
  if (!key.needed && !key.optional && key.fallback.empty()) key.fallback = default_text;
  section_->keys.push_back(key);
  return std::nullopt;
}

void Archive::operator()(Key key, std::string& value) {
  if (!key.words.empty()) key.kind = Key::Kind::choice;
  const std::optional<Node> node = enter(key, value);
  if (!node) return;
  value = node->text(key);
  if (key.name == "name" && !item_.empty()) self_ = self_->called(item_ + " " + in_quotes(value));
}

void Archive::operator()(Key key, bool& value) {
  key.kind = Key::Kind::boolean;
  if (const auto node = enter(key, value ? "true" : "false")) value = node->boolean(key);
}

void Archive::operator()(Key key, double& value) {
  if (key.kind != Key::Kind::integer) key.kind = Key::Kind::number;
  if (const auto node = enter(key, number_text(value))) value = node->number(key);
}

void Archive::operator()(Key key, std::vector<double>& values) {
  key.kind = Key::Kind::numbers;
  const std::optional<Node> node = enter(key, values.empty() ? "" : list_text(values));
  if (node && !node->is_word(key.words)) values = node->numbers(key);
}

void Archive::operator()(Key key, std::vector<std::string>& values) {
  for (const auto& name : names(std::move(key))) values.push_back(name.yaml().Scalar());
}

std::size_t Archive::choice(Key key, std::size_t index) {
  std::string word = key.words.at(index);
  const std::vector<std::string> words = key.words;
  (*this)(std::move(key), word);
  return static_cast<std::size_t>(std::find(words.begin(), words.end(), word) - words.begin());
}

std::vector<Node> Archive::names(Key key) {
  key.kind = Key::Kind::names;
  const std::optional<Node> node = enter(key, "");
  return node ? node->names(key) : std::vector<Node>{};
}

std::optional<Node> Archive::open(Key key) {
  key.kind = Key::Kind::open;
  return enter(key, "");
}

void Archive::part(Key key, const Visit& visit_part) {
  key.kind = Key::Kind::section;
  if (!reading() && deep_) key.parts.push_back(described(visit_part, true));
  const std::optional<Node> node = enter(key, "");
  if (node && !(key.text_alone && node->is_scalar())) attempt([&] { fill(*node, {}, "", visit_part); });
}

void Archive::items(Key key, const Visit& visit_item) {
  key.kind = Key::Kind::sections;
  if (!reading() && deep_) key.parts.push_back(described(visit_item, true));
  const std::optional<Node> node = enter(key, "");
  if (!node) return;
  const std::string item =
      (self_->what().empty() ? "" : self_->what() + ": ") + (key.item.empty() ? key.name : key.item);
  if (node->is_map() && described(visit_item, false)->has("name")) {
    for (const auto& named : node->pairs()) {
      const std::string what = item + " " + in_quotes(named.first);
      attempt([&] { fill(named.second.called(what), named.first, item, visit_item); });
    }
    return;
  }
  if (!node->is_list()) node->expected(expectation(key));
  std::size_t number = 0;
  for (const auto& value : node->items())
    attempt([&] { fill(value.called(item + " " + std::to_string(++number)), {}, item, visit_item); });
}

}  // namespace multipanda
