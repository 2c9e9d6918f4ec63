#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace multipanda {

// A request that is refused before it reaches the loop: a code and a human-readable reason.
struct RequestRefused : std::runtime_error {
  RequestRefused(std::string code_, const std::string& reason)
      : std::runtime_error(reason), code(std::move(code_)) {}
  std::string code;  // "malformed", or the name of a Verdict
};

// Typed access to a JSON object. Every fault throws RequestRefused with a reason.
class JsonFields {
 public:
  // `what` is the prefix of the messages, such as "switch". `object` must outlive this.
  JsonFields(const nlohmann::json& object, std::string what);

  // Refuses keys that are not in `keys`; the message has the nearest valid key.
  void allow(const std::vector<std::string>& keys) const;
  bool has(const std::string& key) const { return object_.contains(key); }
  std::string text(const std::string& key) const;
  std::vector<std::string> texts(const std::string& key) const;  // a list or a single string; empty if absent
  double number(const std::string& key) const;
  double number(const std::string& key, double fallback) const;
  std::vector<double> numbers(const std::string& key, std::size_t count) const;
  std::vector<double> numbers(const std::string& key) const;  // any number of them; or a single one
  bool boolean(const std::string& key, bool fallback) const;
  JsonFields section(const std::string& key) const;
  const nlohmann::json& at(const std::string& key) const;  // refuses if absent
  const nlohmann::json& object() const { return object_; }
  const std::string& what() const { return what_; }

  [[noreturn]] void refuse(const std::string& reason) const;
  [[noreturn]] void expected(const std::string& key, const std::string& expectation) const;

 private:
  std::vector<double> numbers(const std::string& key, const std::string& expectation) const;

  const nlohmann::json& object_;
  std::string what_;
};

// Whether a request is a stop, even with other errors in it.
bool is_stop(const nlohmann::json& request);

// Keys of a request, with those that every request may have.
std::vector<std::string> with_common(std::vector<std::string> keys);

// One line. Never throws, not even for invalid UTF-8.
std::string to_line(const nlohmann::json& json);

}  // namespace multipanda
