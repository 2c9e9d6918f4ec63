#pragma once

#include <memory>
#include <optional>
#include <rosidl_runtime_c/message_type_support_struct.h>
#include <rosidl_runtime_c/service_type_support_struct.h>
#include <rosidl_typesupport_introspection_cpp/message_introspection.hpp>
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

}  // namespace multipanda::ros
