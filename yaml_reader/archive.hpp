#pragma once

#include <array>
#include <concepts>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "yaml_reader/node.hpp"

// A configuration structure declares its keys once, in a function
//
//   void visit(Archive& archive, Mine& mine, Context&... context) {
//     archive.about("Mine", "What this section is.");
//     archive(Key("length_m", "Length of it.").within(0, 2), mine.length);
//     if (!archive.reading()) return;
//     if (...) archive.at("length_m").refuse("...");  // checks that need more than one key
//   }
//
// read() fills a structure by it, describe() makes the tables of the reference page and of the JSON Schema
// from it: what a variable holds before it is read is its default.
namespace multipanda {

class Archive {
 public:
  using Visit = std::function<void(Archive&)>;

  void about(std::string name, std::string doc = "");
  bool reading() const { return section_ == nullptr; }

  // Contents of the file. An absent key has the place of its section.
  bool has(const std::string& key) const;
  std::vector<std::string> present(const std::vector<std::string>& keys) const;
  Node at(const std::string& key) const;
  const Node& self() const { return *self_; }

  // From here on, errors in different sections and items of this one are reported together. What depends on
  // them comes after settle(), which throws what was found.
  void collect() { collects_ = true; }
  bool sound() const { return errors_.empty(); }  // nothing was found yet
  void settle() const;

  void operator()(Key key, std::string& value);  // also an identifier, or one of the key's choices
  void operator()(Key key, bool& value);
  void operator()(Key key, double& value);
  void operator()(Key key, std::vector<double>& values);
  void operator()(Key key, std::vector<std::string>& values);
  template <std::unsigned_integral T>
  requires(!std::same_as<T, bool>) void operator()(Key key, T& value) {
    key.kind = Key::Kind::integer;
    auto number = static_cast<double>(value);
    (*this)(std::move(key), number);
    value = static_cast<T>(number);
  }
  template <typename E>
  requires std::is_enum_v<E>
  void operator()(Key key, E& value) {  // choices in the order of the enumeration
    value = static_cast<E>(choice(std::move(key), static_cast<std::size_t>(value)));
  }
  template <int Rows, int Options, int MaxRows>
  void operator()(Key key, Eigen::Matrix<double, Rows, 1, Options, MaxRows, 1>& value) {
    std::vector<double> values(value.begin(), value.end());
    if (Rows != Eigen::Dynamic) key.count = static_cast<std::size_t>(Rows);
    (*this)(std::move(key), values);
    if (reading()) value = Eigen::Map<const Eigen::VectorXd>(values.data(), std::ssize(values));
  }
  template <std::size_t Size>
  void operator()(Key key, std::array<double, Size>& value) {
    std::vector<double> values(value.begin(), value.end());
    (*this)(std::move(key.size(Size)), values);
    std::copy(values.begin(), values.end(), value.begin());
  }
  template <typename T>
  void operator()(Key key, std::optional<T>& value) {
    optionally(std::move(key), value, [&](const Key& same, T& inner) { (*this)(same, inner); });
  }

  // Nested structures, by their visit functions or by a closure that both describes and reads.
  void part(Key key, const Visit& visit_part);
  template <typename T, typename... Context>
  void section(Key key, T& value, Context&... context) {
    part(std::move(key), [&](Archive& archive) { visit(archive, value, context...); });
  }
  template <typename T, typename... Context>
  void section(Key key, std::optional<T>& value, Context&... context) {
    optionally(std::move(key), value, [&](const Key& same, T& inner) { section(same, inner, context...); });
  }
  // A list of structures. Those with the key `name` may also be written as a mapping of names.
  void items(Key key, const Visit& visit_item);
  template <typename T, typename... Context>
  void list(Key key, std::vector<T>& values, Context&... context) {
    items(std::move(key), [&](Archive& archive) {
      T value{};
      visit(archive, value, context...);
      if (archive.reading()) values.push_back(std::move(value));
    });
  }
  // Values whose places the caller needs. Absent, or while describing: none.
  std::vector<Node> names(Key key);
  std::optional<Node> open(Key key);

  // The keys that `visit` declares for a T, including all nested sections.
  template <typename T, typename... Context>
  static std::shared_ptr<const Section> describe(Context&... context) {
    T scratch{};
    return described([&](Archive& archive) { visit(archive, scratch, context...); }, true);
  }
  static std::shared_ptr<const Section> described(const Visit& visit_section, bool deep);
  template <typename T, typename... Context>
  static void read(const Node& node, T& value, Context&... context) {
    read(node, Visit([&](Archive& archive) { visit(archive, value, context...); }));
  }
  static void read(const Node& node, const Visit& visit_section) { fill(node, {}, "", visit_section); }

 private:
  template <typename T, typename Work>
  void optionally(Key key, std::optional<T>& value, const Work& work) {
    key.optional = true;
    T inner = value ? *value : T{};
    if constexpr (requires { inner.setZero(); }) {
      if (!value) inner.setZero();
    }
    work(key, inner);
    if (reading() && has(key.name)) value = std::move(inner);
  }
  static void fill(const Node& node, const std::optional<std::string>& name, const std::string& item,
                   const Visit& visit_section);
  void attempt(const std::function<void()>& work);  // keeps an error while errors are collected
  std::size_t choice(Key key, std::size_t index);
  std::optional<Node> enter(Key& key, const std::string& default_text);

  // Describing
  std::shared_ptr<Section> section_;
  bool deep_ = false;  // sections below, too
  // Reading
  std::optional<Node> self_;
  std::vector<std::pair<std::string, Node>> entries_;
  std::string item_;  // name of the kind of a list item
  bool collects_ = false;
  std::vector<ConfigError> errors_;
};

}  // namespace multipanda
