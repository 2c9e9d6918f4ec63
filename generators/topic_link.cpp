#include "generators/topic_link.hpp"

#include "runtime/ros_module.hpp"

namespace multipanda {

std::unique_ptr<SetPointLink> make_topic_link(const TopicWords& words) {
  const auto make = reinterpret_cast<SetPointLink* (*)(const TopicWords&)>(
      ros_module_function("multipanda_make_topic_link"));
  return std::unique_ptr<SetPointLink>(make(words));
}

}  // namespace multipanda
