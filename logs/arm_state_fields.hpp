#pragma once

#include <algorithm>
#include <tuple>
#include <vector>

#include "core/record/record_fields.hpp"

// Maps between the quantities of an arm (core/state/arm_sample.hpp) and messages about it, of logs and ROS:
// each quantity names its field of the message.
namespace multipanda {

// Sets a field to a quantity of an arm of `joints` joints. An array is empty, or zeros where it has a fixed
// place, unless the quantity is known. Vectors keep their memory.
template <class Field, class T>
void set_field(Field& out, const T& value, std::size_t joints, bool known) {
  if constexpr (std::is_arithmetic_v<T>) {
    out = value;
  } else if constexpr (std::is_same_v<T, PoseArray>) {
    out = {};
    if (!known) return;
    const auto v = pose_of(value).values();
    out.position.x = v[0], out.position.y = v[1], out.position.z = v[2];
    out.orientation.w = v[3], out.orientation.x = v[4], out.orientation.y = v[5], out.orientation.z = v[6];
  } else if constexpr (std::is_same_v<T, WrenchArray>) {
    const WrenchArray v = known ? value : WrenchArray{};
    out.force.x = v[0], out.force.y = v[1], out.force.z = v[2];
    out.torque.x = v[3], out.torque.y = v[4], out.torque.z = v[5];
  } else {
    with_numbers(known ? value : T{}, known ? joints : 0, [&](auto numbers) {
      if constexpr (requires { out.assign(numbers.begin(), numbers.end()); }) {
        out.assign(numbers.begin(), numbers.end());
      } else {
        std::copy(numbers.begin(), numbers.end(), out.begin());
      }
    });
  }
}

#define MULTIPANDA_SET(type, member, name, message, known, doc) \
  if constexpr (requires { out.message; }) set_field(out.message, sample.member, joints, sample.known);

// Sets what an arm of `joints` joints measured and reported in one cycle.
template <class Message>
void set_measured(Message& out, const ArmSample& sample, std::size_t joints) {
  MULTIPANDA_MEASURED_FIELDS(MULTIPANDA_SET)
  MULTIPANDA_REPORTED_FIELDS(MULTIPANDA_SET)
}

// Sets the loop's decisions for the arm and the commands sent to it.
template <class Message>
void set_commanded(Message& out, const ArmSample& sample, std::size_t joints) {
  MULTIPANDA_COMMANDED_FIELDS(MULTIPANDA_SET)
}

#undef MULTIPANDA_SET

// The numbers of a field of a message; none: the arm does not report it.
template <class Field>
std::vector<double> numbers_of(const Field& field) {
  if constexpr (std::is_arithmetic_v<Field>) {
    return {static_cast<double>(field)};
  } else if constexpr (requires { field.orientation; }) {
    const auto& [p, q] = std::tie(field.position, field.orientation);
    return {p.x, p.y, p.z, q.w, q.x, q.y, q.z};
  } else if constexpr (requires { field.torque; }) {
    const auto& [f, m] = std::tie(field.force, field.torque);
    return {f.x, f.y, f.z, m.x, m.y, m.z};
  } else {
    return {field.begin(), field.end()};
  }
}

// Calls take(name, numbers) for each quantity that a message holds and the arm reports.
template <class Message>
void for_each_number(const Message& message, auto&& take) {
#define MULTIPANDA_TAKE(type, member, name, field, known, doc)   \
  if constexpr (requires { message.field; }) {                   \
    if constexpr (requires { message.known; }) {                 \
      if (message.known) take(#name, numbers_of(message.field)); \
    } else {                                                     \
      take(#name, numbers_of(message.field));                    \
    }                                                            \
  }
  MULTIPANDA_ARM_FIELDS(MULTIPANDA_TAKE)
#undef MULTIPANDA_TAKE
}

}  // namespace multipanda
