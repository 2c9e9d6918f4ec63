#include "ros/adapter/compat/numbers.hpp"

#include <cmath>
#include <limits>
#include <rosidl_typesupport_introspection_cpp/field_types.hpp>
#include <stdexcept>
#include <type_traits>

#include <fmt/format.h>

namespace multipanda::ros {
namespace {

using namespace rosidl_typesupport_introspection_cpp;

// Calls f with a value of the field's type; returns false if the field is not a number.
template <class F>
bool with_type(std::uint8_t type, F f) {
#define MULTIPANDA_WITH(id, T, name) \
  case id:                           \
    return f(T()), true;
  switch (type) {
    MULTIPANDA_NUMBER_TYPES(MULTIPANDA_WITH)
#undef MULTIPANDA_WITH
    default:
      return false;
  }
}

template <class T>
T converted(double value) {
  if constexpr (std::is_floating_point_v<T>) {
    return static_cast<T>(value);
  } else if constexpr (std::is_same_v<T, bool>) {
    return value != 0;
  } else {
    if (!std::isfinite(value)) return 0;
    const double least = static_cast<double>(std::numeric_limits<T>::min());
    if (value <= least) return std::numeric_limits<T>::min();
    if (value >= static_cast<double>(std::numeric_limits<T>::max())) return std::numeric_limits<T>::max();
    return static_cast<T>(std::llround(value));
  }
}

void* moved(void* message, std::size_t offset) { return static_cast<char*>(message) + offset; }
const void* moved(const void* message, std::size_t offset) {
  return static_cast<const char*>(message) + offset;
}

bool is_fixed(const FieldOf& field) { return field.array_size_ != 0 && !field.is_upper_bound_; }

MessageType::Place sequence(const MessageType& type, const std::string& path, std::uint8_t of,
                            const char* what) {
  const MessageType::Place place = type.need(path);
  const FieldOf& field = *place.field;
  // Bounded types are refused: later texts might not fit.
  if (field.type_id_ == of && field.is_array_ && field.array_size_ == 0 && field.string_upper_bound_ == 0)
    return place;
  throw std::invalid_argument(fmt::format("{}.{}: found {}, expected a sequence of {} without bounds",
                                          type.name(), path, text_of(field), what));
}

}  // namespace

Numbers::Numbers(const MessageType& type, const std::vector<std::string>& paths, std::size_t count)
    : name_(type.name() + "." + paths.front()), count_(count) {
  const std::size_t each = paths.size() == 1 ? count : 1;
  for (const auto& path : paths) {
    const MessageType::Place place = type.need(path);
    const FieldOf& field = *place.field;
    const bool number = with_type(field.type_id_, [](auto) {});
    const bool fits = !field.is_array_        ? each == 1
                      : is_fixed(field)       ? field.array_size_ == each
                      : field.is_upper_bound_ ? field.array_size_ >= each
                                              : true;
    if (!number || !fits) {
      throw std::invalid_argument(fmt::format("{}.{}: found {}, expected {}", type.name(), path,
                                              text_of(field),
                                              each == 1 ? "a number" : fmt::format("{} numbers", each)));
    }
    places_.push_back(place);
  }
  if (each * paths.size() != count)
    throw std::invalid_argument(fmt::format("{}: {} fields for {} numbers", name_, paths.size(), count));
}

void Numbers::write(void* message, std::span<const double> values) const {
  std::size_t k = 0;
  for (const auto& [field, offset] : places_) {
    void* at = moved(message, offset);
    const std::size_t each = places_.size() == 1 ? count_ : 1;
    if (field->is_array_ && !is_fixed(*field) && field->size_function(at) != each)
      field->resize_function(at, each);
    with_type(field->type_id_, [&, &field = field](auto zero) {
      using T = decltype(zero);
      if (!field->is_array_) {
        *static_cast<T*>(at) = converted<T>(values[k++]);
        return;
      }
      for (std::size_t i = 0; i < each; ++i) {
        const T value = converted<T>(values[k++]);
        field->assign_function(at, i, &value);
      }
    });
  }
}

void Numbers::read(const void* message, std::span<double> values) const {
  std::size_t k = 0;
  for (const auto& [field, offset] : places_) {
    const void* at = moved(message, offset);
    const std::size_t each = places_.size() == 1 ? count_ : 1;
    if (field->is_array_) {
      if (const std::size_t found = field->size_function(at); found != each)
        throw std::invalid_argument(fmt::format("{}: found {} numbers, expected {}", name_, found, each));
    }
    with_type(field->type_id_, [&, &field = field](auto zero) {
      using T = decltype(zero);
      if (!field->is_array_) {
        values[k++] = static_cast<double>(*static_cast<const T*>(at));
        return;
      }
      for (std::size_t i = 0; i < each; ++i) {
        T value{};
        field->fetch_function(at, i, &value);
        values[k++] = static_cast<double>(value);
      }
    });
  }
}

std::vector<double> Numbers::read(const void* message) const {
  std::vector<double> values(count_);
  read(message, values);
  return values;
}

std::vector<std::string> parts(const std::string& path, std::initializer_list<const char*> names) {
  std::vector<std::string> paths;
  for (const char* name : names) paths.push_back(path + "." + name);
  return paths;
}

std::vector<std::string> pose_parts(const std::string& path) {
  return parts(path, {"position.x", "position.y", "position.z", "orientation.w", "orientation.x",
                      "orientation.y", "orientation.z"});
}

Text::Text(const MessageType& type, const std::string& path) {
  const MessageType::Place place = type.need(path);
  if (place.field->type_id_ != ROS_TYPE_STRING || place.field->is_array_ ||
      place.field->string_upper_bound_ != 0) {
    throw std::invalid_argument(fmt::format("{}.{}: found {}, expected a string without a bound", type.name(),
                                            path, text_of(*place.field)));
  }
  offset_ = place.offset;
}

void Text::write(void* message, const std::string& text) const {
  *static_cast<std::string*>(moved(message, offset_)) = text;
}

std::string Text::read(const void* message) const {
  return *static_cast<const std::string*>(moved(message, offset_));
}

Texts::Texts(const MessageType& type, const std::string& path)
    : place_(sequence(type, path, ROS_TYPE_STRING, "strings")) {}

void Texts::write(void* message, const std::vector<std::string>& texts) const {
  void* at = moved(message, place_.offset);
  place_.field->resize_function(at, texts.size());
  for (std::size_t i = 0; i < texts.size(); ++i)
    *static_cast<std::string*>(place_.field->get_function(at, i)) = texts[i];
}

std::vector<std::string> Texts::read(const void* message) const {
  const void* at = moved(message, place_.offset);
  std::vector<std::string> texts(place_.field->size_function(at));
  for (std::size_t i = 0; i < texts.size(); ++i)
    texts[i] = *static_cast<const std::string*>(place_.field->get_const_function(at, i));
  return texts;
}

Parts::Parts(const MessageType& type, const std::string& path)
    : place_(sequence(type, path, ROS_TYPE_MESSAGE, "messages")) {}

std::size_t Parts::size(const void* message) const {
  return place_.field->size_function(moved(message, place_.offset));
}

void Parts::resize(void* message, std::size_t size) const {
  place_.field->resize_function(moved(message, place_.offset), size);
}

const void* Parts::at(const void* message, std::size_t i) const {
  return place_.field->get_const_function(moved(message, place_.offset), i);
}

void* Parts::at(void* message, std::size_t i) const {
  return place_.field->get_function(moved(message, place_.offset), i);
}

}  // namespace multipanda::ros
