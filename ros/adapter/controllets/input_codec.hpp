#pragma once

#include <functional>
#include <memory>
#include <rosidl_runtime_cpp/traits.hpp>
#include <rosidl_typesupport_cpp/message_type_support.hpp>
#include <string>
#include <vector>

#include "core/reference/reference.hpp"

// Lets inputs of controllets take message types of the user's own, in place of the standard one or beside it.
// A library of the scene (core/plugin/plugin.hpp) reads the message; topics, checks, frames and counters
// remain the adapter's.
//
//   MULTIPANDA_INPUT_CODECS(codecs) {
//     codecs.push_back(multipanda::ros::input_codec<my_msgs::msg::Wall>("virtual_wall", "wall",
//         [](const my_msgs::msg::Wall& message, multipanda::ros::InputValues& values) {
//           values.numbers = {message.distance};  // in the order of Target; SI units
//         }));
//     // Beside the standard type, for every input that takes poses: ~/<instance>/<input>/tracker, .../goal.
//     codecs.push_back(multipanda::ros::input_codec_for<TransformStamped>(Quantity::pose, "tracker", read));
//   }
//
// The newest message over all topics of an input counts: only one sender at a time should stream to it.
namespace multipanda::ros {

// The content of one message.
struct InputValues {
  std::vector<double> numbers;  // in the order of Target (core/reference/target.hpp): pose x y z, w x y z ...
  std::string frame;            // frame_id; empty: the input's own frame
  std::string refusal;          // reason for a refusal; empty: accepted
};

struct InputCodec {
  std::string controllet, input;       // type of the controllet, name of its input; empty: see `quantity`
  Quantity quantity = Quantity::pose;  // without a controllet: every input of this quantity
  std::string topic;                   // ~/<instance>/<input>/<topic>; empty: the input's own topic
  std::string message_type;            // "my_msgs/msg/Wall"
  const rosidl_message_type_support_t* type_support = nullptr;
  std::function<std::shared_ptr<void>()> make_message;
  // Runs in the executor's thread. An exception refuses the message.
  std::function<void(const void* message, InputValues& values)> read;
};

// A codec for one input of a type of controllet. With `topic` (letters, digits and _) the message has a
// topic of its own beside the input's.
template <class M>
InputCodec input_codec(std::string controllet, std::string input,
                       std::function<void(const M&, InputValues&)> read, std::string topic = "") {
  return {.controllet = std::move(controllet),
          .input = std::move(input),
          .topic = std::move(topic),
          .message_type = rosidl_generator_traits::name<M>(),
          .type_support = rosidl_typesupport_cpp::get_message_type_support_handle<M>(),
          .make_message = [] { return std::make_shared<M>(); },
          .read = [read = std::move(read)](
                      const void* message,
                      InputValues& values) { read(*static_cast<const M*>(message), values); }};
}

// A codec for every input of a quantity, of any controllet, on a topic of its own beside the input's.
template <class M>
InputCodec input_codec_for(Quantity quantity, std::string topic,
                           std::function<void(const M&, InputValues&)> read) {
  InputCodec codec = input_codec<M>("", "", std::move(read), std::move(topic));
  codec.quantity = quantity;
  return codec;
}

inline constexpr unsigned kCodecVersion = 2;  // increased with every change of this header

// Returns the codecs in the libraries of a scene; a library need not have any. Throws std::runtime_error for
// a library built for another version.
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
