#pragma once

#include <cstdint>
#include <initializer_list>
#include <span>
#include <string>
#include <vector>

#include "ros/adapter/compat/message_type.hpp"

namespace multipanda::ros {

// A quantity in messages of a type known by name: `count` numbers in one array field, or in as many fields of
// one number each. Places and types are resolved here, once; any type of number is converted. write() and
// read() allocate only where a sequence of the message grows.
class Numbers {
 public:
  // Throws std::invalid_argument with what was found and what was expected: a field, numbers, a size.
  Numbers(const MessageType& type, const std::vector<std::string>& paths, std::size_t count);

  std::size_t count() const { return count_; }
  const std::string& name() const { return name_; }  // "a/msg/B.q"
  void write(void* message, std::span<const double> values) const;
  // Throws std::invalid_argument if a sequence has another size.
  void read(const void* message, std::span<double> values) const;
  std::vector<double> read(const void* message) const;

 private:
  std::string name_;
  std::size_t count_;
  std::vector<MessageType::Place> places_;
};

// Paths of the parts of a field.
std::vector<std::string> parts(const std::string& path, std::initializer_list<const char*> names);
// Of a pose, in the order of Target.
std::vector<std::string> pose_parts(const std::string& path);

// A string field, and a sequence of strings.
class Text {
 public:
  Text(const MessageType& type, const std::string& path);  // throws std::invalid_argument
  void write(void* message, const std::string& text) const;
  std::string read(const void* message) const;

 private:
  std::size_t offset_;
};

class Texts {
 public:
  Texts(const MessageType& type, const std::string& path);  // throws std::invalid_argument
  void write(void* message, const std::vector<std::string>& texts) const;
  std::vector<std::string> read(const void* message) const;

 private:
  MessageType::Place place_;
};

// A sequence of messages.
class Parts {
 public:
  Parts(const MessageType& type, const std::string& path);  // throws std::invalid_argument
  MessageType type() const { return type_of_elements(*place_.field); }
  std::size_t size(const void* message) const;
  void resize(void* message, std::size_t size) const;
  const void* at(const void* message, std::size_t i) const;
  void* at(void* message, std::size_t i) const;

 private:
  MessageType::Place place_;
};

}  // namespace multipanda::ros
