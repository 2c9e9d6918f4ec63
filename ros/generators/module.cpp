#include "ros/generators/topic_link.hpp"

// What the program finds in libmultipanda_ros.so (runtime/ros_module.hpp).
extern "C" __attribute__((visibility("default"))) multipanda::SetPointLink* multipanda_make_topic_link(
    const multipanda::TopicWords& words) {
  return new multipanda::ros::TopicLink(words);
}
