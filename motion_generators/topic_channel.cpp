#include "motion_generators/set_point_channel.hpp"
#include "runtime/run_adapter.hpp"

namespace multipanda {

std::unique_ptr<SetPointChannel> make_topic_link(const TopicArguments& arguments) {
  const auto make = reinterpret_cast<SetPointChannel* (*)(const TopicArguments&)>(
      ros_module_function("multipanda_make_topic_link"));
  return std::unique_ptr<SetPointChannel>(make(arguments));
}

}  // namespace multipanda
