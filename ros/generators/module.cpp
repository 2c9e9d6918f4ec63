#include "ros/generators/topic_channel.hpp"

// Symbols looked up in libmultipanda_ros.so by the program (runtime/run_adapter.hpp).
extern "C" __attribute__((visibility("default"))) multipanda::SetPointChannel* multipanda_make_topic_link(
    const multipanda::TopicArguments& arguments) {
  return new multipanda::ros::TopicChannel(arguments);
}
