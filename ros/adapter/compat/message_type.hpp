#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <memory>
#include <optional>
#include <rosidl_runtime_c/message_type_support_struct.h>
#include <rosidl_runtime_c/service_type_support_struct.h>
#include <rosidl_typesupport_introspection_cpp/message_introspection.hpp>
#include <span>
#include <string>
#include <vector>

namespace multipanda::ros {

// Message types known to the program by name only: their fields are found by introspection. Types come from
// packages that CMake found at build time (cmake/ros_compat.cmake), so that no library of another ROS 2 is
// ever loaded.

// One field, or one element of it; `at` is its place in a message.
using FieldOf = rosidl_typesupport_introspection_cpp::MessageMember;

// The kinds of numbers in messages: the constant of introspection, the type in C++, the name in .msg files.
#define MULTIPANDA_NUMBER_TYPES(X)            \
  X(ROS_TYPE_FLOAT, float, "float32")         \
  X(ROS_TYPE_DOUBLE, double, "float64")       \
  X(ROS_TYPE_BOOLEAN, bool, "bool")           \
  X(ROS_TYPE_UINT8, std::uint8_t, "uint8")    \
  X(ROS_TYPE_INT8, std::int8_t, "int8")       \
  X(ROS_TYPE_UINT16, std::uint16_t, "uint16") \
  X(ROS_TYPE_INT16, std::int16_t, "int16")    \
  X(ROS_TYPE_UINT32, std::uint32_t, "uint32") \
  X(ROS_TYPE_INT32, std::int32_t, "int32")    \
  X(ROS_TYPE_UINT64, std::uint64_t, "uint64") \
  X(ROS_TYPE_INT64, std::int64_t, "int64")

class MessageType {
 public:
  // Throws std::invalid_argument if the package or the type is missing. `name`: "FrankaState".
  static MessageType find(const std::string& package, const std::string& name);
  // The type of a part of another message.
  MessageType(std::string name, const rosidl_typesupport_introspection_cpp::MessageMembers* members,
              const rosidl_message_type_support_t* type_support = nullptr)
      : name_(std::move(name)), members_(members), type_support_(type_support) {}

  const std::string& name() const { return name_; }                                    // "a/msg/B"
  const rosidl_message_type_support_t* type_support() const { return type_support_; }  // for rcl
  const rosidl_typesupport_introspection_cpp::MessageMembers& members() const { return *members_; }
  std::shared_ptr<void> make() const;  // a message with the defaults of its type

  // A field by its path, "o_t_ee.pose.position": its offset from the start of the message. No element of an
  // array can be named. Returns nothing if there is none.
  struct Place {
    const FieldOf* field;
    std::size_t offset;
  };
  std::optional<Place> place(const std::string& path) const;
  // The same; throws std::invalid_argument that lists the fields of the type.
  Place need(const std::string& path) const;
  // Paths of all fields that are not messages themselves, and of arrays of messages.
  std::vector<std::string> paths() const;

 private:
  std::string name_;
  const rosidl_typesupport_introspection_cpp::MessageMembers* members_;
  const rosidl_message_type_support_t* type_support_;
};

// The type of a field that is a message or an array of messages.
MessageType type_of_elements(const FieldOf& field);
// "float64[7]", "string", "geometry_msgs/msg/Pose[]"
std::string text_of(const FieldOf& field);

struct ServiceType {
  // Throws std::invalid_argument as MessageType::find does.
  static ServiceType find(const std::string& package, const std::string& name);
  std::string name;  // "a/srv/B"
  const rosidl_service_type_support_t* type_support;
  MessageType request, response;
};

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
// The parts of a pose, in the order of Target.
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

// A table "their field -> our quantity" for messages that are sent. `Source`: where the quantities come from.
template <class Source>
struct FieldRule {
  std::vector<std::string> paths;  // one field of `count` numbers, or `count` fields of one
  std::size_t count = 1;
  std::function<void(const Source&, std::span<double>)> values;  // fills `count` numbers
  bool needed = false;  // a type without the field is refused; otherwise the rule is left out
};

// Fills messages of one type by a table. Fields that the table does not name keep the defaults of their type.
// One thread at a time.
template <class Source>
class FieldMap {
 public:
  // Throws std::invalid_argument for a type without a needed field, or with one of another kind or size.
  FieldMap(const MessageType& type, const std::vector<FieldRule<Source>>& rules) {
    std::vector<std::string> known;
    for (const auto& rule : rules) {
      const bool all = std::all_of(rule.paths.begin(), rule.paths.end(),
                                   [&](const auto& path) { return type.place(path).has_value(); });
      if (!all && !rule.needed) continue;
      entries_.push_back({Numbers(type, rule.paths, rule.count), rule.values});
      known.insert(known.end(), rule.paths.begin(), rule.paths.end());
      values_.resize(std::max(values_.size(), rule.count));
    }
    for (const auto& path : type.paths()) {
      if (std::find(known.begin(), known.end(), path) == known.end()) unknown_.push_back(path);
    }
  }

  void fill(const Source& source, void* message) {
    for (const auto& entry : entries_) {
      const std::span<double> values(values_.data(), entry.numbers.count());
      entry.values(source, values);
      entry.numbers.write(message, values);
    }
  }

  // Paths of the fields that no rule fills.
  const std::vector<std::string>& unknown() const { return unknown_; }

 private:
  struct Entry {
    Numbers numbers;
    std::function<void(const Source&, std::span<double>)> values;
  };
  std::vector<Entry> entries_;
  std::vector<double> values_;
  std::vector<std::string> unknown_;
};

}  // namespace multipanda::ros
