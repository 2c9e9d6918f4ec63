#include "ros/rcl/node.hpp"

#include <cstdlib>
#include <rcl/graph.h>
#include <rcl/node_options.h>
#include <rcutils/types/string_array.h>

#include "ros/rcl/context.hpp"

namespace multipanda::ros {

Node::Node(Context& context, const std::string& name, const std::string& name_space)
    : own_(rcl_get_zero_initialized_node()), node_(&own_) {
  rcl_node_options_t options = rcl_node_get_default_options();
  options.enable_rosout = false;  // rcl's log is not used here
  const rcl_ret_t made = rcl_node_init(&own_, name.c_str(), name_space.c_str(), context.handle(), &options);
  const std::string why = take_rcl_error();
  disregard(rcl_node_options_fini(&options));
  if (made != RCL_RET_OK)
    throw RclError("creating the node \"" + name + "\" in the namespace \"" + name_space +
                   "\" failed: " + why);
}

Node::Node(rcl_node_t* borrowed) : own_(rcl_get_zero_initialized_node()), node_(borrowed) {}

Node::~Node() {
  if (node_ == &own_) disregard(rcl_node_fini(&own_));
}

std::string Node::name() const { return rcl_node_get_name(node_); }
std::string Node::name_space() const { return rcl_node_get_namespace(node_); }
std::string Node::full_name() const { return rcl_node_get_fully_qualified_name(node_); }

std::string Node::resolve(const std::string& name, bool service) const {
  char* resolved = nullptr;
  check(rcl_node_resolve_name(node_, name.c_str(), rcl_get_default_allocator(), service, false, &resolved),
        "resolving the name \"" + name + "\"");
  std::string text = resolved;
  rcl_get_default_allocator().deallocate(resolved, nullptr);
  return text;
}

std::vector<EntityInfo> Node::entities() const {
  const std::lock_guard lock(mutex_);
  return entities_;
}

void Node::describe(EntityInfo info) {
  const std::lock_guard lock(mutex_);
  entities_.push_back(std::move(info));
}

std::vector<std::string> Node::other_nodes() const {
  rcutils_string_array_t names = rcutils_get_zero_initialized_string_array();
  rcutils_string_array_t spaces = rcutils_get_zero_initialized_string_array();
  check(rcl_get_node_names(node_, rcl_get_default_allocator(), &names, &spaces), "listing nodes");
  std::vector<std::string> others;
  for (std::size_t i = 0; i < names.size; ++i) {
    std::string full = std::string(spaces.data[i]);
    if (full.empty() || full.back() != '/') full += '/';
    full += names.data[i];
    if (full != full_name()) others.push_back(full);
  }
  disregard(rcutils_string_array_fini(&names));
  disregard(rcutils_string_array_fini(&spaces));
  return others;
}

std::size_t Node::publishers_of(const std::string& topic) const {
  std::size_t count = 0;
  check(rcl_count_publishers(node_, resolve(topic).c_str(), &count), "counting publishers of " + topic);
  return count;
}

}  // namespace multipanda::ros
