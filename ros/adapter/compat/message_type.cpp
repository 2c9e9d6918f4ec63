#include "ros/adapter/compat/message_type.hpp"

#include <dlfcn.h>
#include <new>
#include <rosidl_typesupport_introspection_cpp/field_types.hpp>
#include <rosidl_typesupport_introspection_cpp/service_introspection.hpp>
#include <stdexcept>

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

}  // namespace multipanda::ros
