#include "ros/adapter/compat/message_type.hpp"

#include <cmath>
#include <dlfcn.h>
#include <limits>
#include <new>
#include <rosidl_typesupport_introspection_cpp/field_types.hpp>
#include <rosidl_typesupport_introspection_cpp/service_introspection.hpp>
#include <stdexcept>
#include <type_traits>

#include <fmt/format.h>

#include "common/text.hpp"

namespace multipanda::ros {

namespace {

using rosidl_typesupport_introspection_cpp::MessageMembers;
using rosidl_typesupport_introspection_cpp::ServiceMembers;

// A symbol of a package's library that was loaded at program start; nothing is loaded here. The library stays
// loaded: types point into it, and another part of the process may have loaded it with local symbols.
void* symbol(const std::string& package, const std::string& type_support, const std::string& name) {
  const std::string library = "lib" + package + "__rosidl_" + type_support + ".so";
  void* handle = dlopen(library.c_str(), RTLD_NOW | RTLD_NOLOAD | RTLD_NODELETE);
  if (handle == nullptr) {
    throw std::invalid_argument(
        fmt::format("the message package '{}' was not found when multipanda was built: build multipanda in a "
                    "shell where this package is set up, or leave out 'compat' in the scene's 'ros'",
                    package));
  }
  void* found = dlsym(handle, name.c_str());
  dlclose(handle);
  return found;
}

template <class TypeSupport>
const TypeSupport* handle_of(const std::string& package, const std::string& folder, const std::string& name,
                             const std::string& type_support) {
  const char* kind = folder == "srv" ? "service" : "message";
  using Get = const TypeSupport* (*)();
  const auto get =
      reinterpret_cast<Get>(symbol(package, type_support,
                                   fmt::format("rosidl_{}__get_{}_type_support_handle__{}__{}__{}",
                                               type_support, kind, package, folder, name)));
  if (get == nullptr) {
    throw std::invalid_argument(fmt::format(
        "the message package '{}' has no type '{}/{}': use the version of it that docs/multipanda_compat.md "
        "names",
        package, folder, name));
  }
  return get();
}

constexpr const char* kForRcl = "typesupport_cpp";
constexpr const char* kForFields = "typesupport_introspection_cpp";

std::string full_name(const MessageMembers& members) {
  std::string name;
  for (const char* c = members.message_namespace_; *c != 0; ++c) {
    if (*c != ':') name += *c;
    if (c[0] == ':' && c[1] == ':') name += '/';
  }
  return name + "/" + members.message_name_;
}

std::string type_name(const FieldOf& field) {
  using namespace rosidl_typesupport_introspection_cpp;
#define MULTIPANDA_NAMED(id, type, name) \
  case id:                               \
    return name;
  switch (field.type_id_) {
    MULTIPANDA_NUMBER_TYPES(MULTIPANDA_NAMED)
#undef MULTIPANDA_NAMED
    case ROS_TYPE_STRING:
      return field.string_upper_bound_ == 0 ? "string" : fmt::format("string<={}", field.string_upper_bound_);
    case ROS_TYPE_MESSAGE:
      return type_of_elements(field).name();
    default:
      return "of another type";
  }
}

void add_paths(const MessageMembers& members, const std::string& before, std::vector<std::string>& paths) {
  for (std::uint32_t i = 0; i < members.member_count_; ++i) {
    const FieldOf& field = members.members_[i];
    const std::string path = before + field.name_;
    if (field.type_id_ == rosidl_typesupport_introspection_cpp::ROS_TYPE_MESSAGE && !field.is_array_) {
      add_paths(type_of_elements(field).members(), path + ".", paths);
    } else if (path != "structure_needs_at_least_one_member") {  // member of an empty message
      paths.push_back(path);
    }
  }
}

}  // namespace

MessageType type_of_elements(const FieldOf& field) {
  const auto* members = static_cast<const MessageMembers*>(field.members_->data);
  return {full_name(*members), members};
}

std::string text_of(const FieldOf& field) {
  std::string text = type_name(field);
  if (!field.is_array_) return text;
  if (field.array_size_ == 0) return text + "[]";
  return fmt::format("{}[{}{}]", text, field.is_upper_bound_ ? "<=" : "", field.array_size_);
}

MessageType MessageType::find(const std::string& package, const std::string& name) {
  const auto* fields = handle_of<rosidl_message_type_support_t>(package, "msg", name, kForFields);
  return {package + "/msg/" + name, static_cast<const MessageMembers*>(fields->data),
          handle_of<rosidl_message_type_support_t>(package, "msg", name, kForRcl)};
}

ServiceType ServiceType::find(const std::string& package, const std::string& name) {
  const auto* fields = handle_of<rosidl_service_type_support_t>(package, "srv", name, kForFields);
  const auto* members = static_cast<const ServiceMembers*>(fields->data);
  const std::string full = package + "/srv/" + name;
  return {full, handle_of<rosidl_service_type_support_t>(package, "srv", name, kForRcl),
          MessageType(full + " request", members->request_members_),
          MessageType(full + " response", members->response_members_)};
}

std::shared_ptr<void> MessageType::make() const {
  const MessageMembers* members = members_;
  void* message = ::operator new(members->size_of_);
  members->init_function(message, rosidl_runtime_cpp::MessageInitialization::ALL);
  return {message, [members](void* made) {
            members->fini_function(made);
            ::operator delete(made);
          }};
}

std::optional<MessageType::Place> MessageType::place(const std::string& path) const {
  const MessageMembers* members = members_;
  std::size_t offset = 0, begin = 0;
  while (true) {
    const std::size_t dot = path.find('.', begin);
    const std::string name = path.substr(begin, dot - begin);
    const FieldOf* field = nullptr;
    for (std::uint32_t i = 0; i < members->member_count_ && field == nullptr; ++i) {
      if (name == members->members_[i].name_) field = &members->members_[i];
    }
    if (field == nullptr) return {};
    offset += field->offset_;
    if (dot == std::string::npos) return Place{field, offset};
    if (field->type_id_ != rosidl_typesupport_introspection_cpp::ROS_TYPE_MESSAGE || field->is_array_)
      return {};
    members = static_cast<const MessageMembers*>(field->members_->data);
    begin = dot + 1;
  }
}

MessageType::Place MessageType::need(const std::string& path) const {
  if (const auto found = place(path)) return *found;
  throw std::invalid_argument(fmt::format("{} has no field '{}'; found {}", name_, path,
                                          paths().empty() ? "no field at all" : joined(paths())));
}

std::vector<std::string> MessageType::paths() const {
  std::vector<std::string> paths;
  add_paths(*members_, "", paths);
  return paths;
}

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
