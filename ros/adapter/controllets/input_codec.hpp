#pragma once

#include <functional>
#include <memory>
#include <rosidl_runtime_cpp/traits.hpp>
#include <rosidl_typesupport_cpp/message_type_support.hpp>
#include <string>
#include <vector>

// For a controllet one of whose inputs comes in a message type of one's own. The library with the controllet
// (core/modes/plugin.hpp) says how to read it, nothing else: topics, checks, frames and counters stay the
// adapter's.
//
//   MULTIPANDA_INPUT_CODECS(codecs) {
//     codecs.push_back(multipanda::ros::input_codec<my_msgs::msg::Wall>("virtual_wall", "wall",
//         [](const my_msgs::msg::Wall& message, multipanda::ros::InputValues& values) {
//           values.numbers = {message.distance};  // in the order of Target; SI units
//         }));
//   }
namespace multipanda::ros {

// What a message says.
struct InputValues {
  std::vector<double> numbers;  // in the order of Target (core/reference/target.hpp): pose x y z, w x y z ...
  std::string frame;            // frame_id; "": the input's own
  std::string refusal;          // why it cannot be taken; "": it can
};

struct InputCodec {
  std::string controllet, input;  // type of the controllet, name of its input
  std::string message_type;       // "my_msgs/msg/Wall"
  const rosidl_message_type_support_t* type_support = nullptr;
  std::function<std::shared_ptr<void>()> make_message;
  // Executor's thread; anything it throws refuses the message.
  std::function<void(const void* message, InputValues& values)> read;
};

template <class M>
InputCodec input_codec(std::string controllet, std::string input,
                       std::function<void(const M&, InputValues&)> read) {
  return {.controllet = std::move(controllet),
          .input = std::move(input),
          .message_type = rosidl_generator_traits::name<M>(),
          .type_support = rosidl_typesupport_cpp::get_message_type_support_handle<M>(),
          .make_message = [] { return std::make_shared<M>(); },
          .read = [read = std::move(read)](
                      const void* message,
                      InputValues& values) { read(*static_cast<const M*>(message), values); }};
}

inline constexpr unsigned kCodecVersion = 1;  // raised whenever this header changes

// The codecs that the libraries of a scene bring. Libraries without any are ordinary. Throws
// std::runtime_error for one that was made for another version.
std::vector<InputCodec> codecs_of(const std::vector<std::string>& plugins);

}  // namespace multipanda::ros

// NOLINTBEGIN(bugprone-macro-parentheses)
#define MULTIPANDA_INPUT_CODECS(codecs)                                                          \
  extern "C" __attribute__((visibility("default"))) unsigned multipanda_input_codecs_version() { \
    return ::multipanda::ros::kCodecVersion;                                                     \
  }                                                                                              \
  extern "C" __attribute__((visibility("default"))) void multipanda_input_codecs(                \
      std::vector<::multipanda::ros::InputCodec>& codecs)
// NOLINTEND(bugprone-macro-parentheses)
