#include "ros/adapter/controllets/inputs.hpp"

#include <algorithm>
#include <map>
#include <stdexcept>

#include <fmt/format.h>

#include "common/text.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/controllets/mode_services.hpp"
#include "ros/adapter/controllets/parameter_services.hpp"

namespace multipanda::ros {

namespace {

// Only the newest message of a stream matters; goals must not be lost.
const Qos kStreamQos = Qos::sensor(1);
const Qos kGoalQos = Qos::reliable(10);

// A subscription with a message type known only to its codec.
class CodecSubscription : public SubscriptionBase {
 public:
  CodecSubscription(const AdapterContext& run, const std::string& name, const Qos& qos, const Doc& doc,
                    const InputCodec& codec, InputPort& port, Delivery delivery)
      : SubscriptionBase(*run.executor, *run.node, name, codec.type_support, codec.message_type, qos, doc),
        codec_(codec),
        port_(port),
        delivery_(delivery),
        message_(codec.make_message()) {
    open();
  }
  ~CodecSubscription() override { close(); }

 private:
  bool take() override {
    if (!take_any(message_.get())) return false;
    InputValues values;
    try {
      codec_.read(message_.get(), values);
    } catch (const std::exception& error) {
      values.refusal = error.what();
    } catch (...) {
      values.refusal = "its codec threw something other than std::exception; repair the codec";
    }
    if (values.refusal.empty()) {
      port_.receive(values.numbers, values.frame, delivery_, waited_s(), this);
    } else {
      port_.refuse(values.refusal);
    }
    return true;
  }

  InputCodec codec_;
  InputPort& port_;
  Delivery delivery_;
  std::shared_ptr<void> message_;
};

template <class M>
class InputSubscription : public SubscriptionBase {
 public:
  InputSubscription(const AdapterContext& run, const std::string& name, const Qos& qos, const Doc& doc,
                    InputPort& port, Delivery delivery)
      : SubscriptionBase(*run.executor, *run.node, name,
                         rosidl_typesupport_cpp::get_message_type_support_handle<M>(),
                         rosidl_generator_traits::name<M>(), qos, doc),
        port_(port),
        delivery_(delivery) {
    open();
  }
  ~InputSubscription() override { close(); }

 private:
  bool take() override {
    if (!take_any(&message_)) return false;
    port_.receive(message_, delivery_, waited_s(), this);
    return true;
  }

  InputPort& port_;
  Delivery delivery_;
  M message_;  // reused, so that its sequences keep their memory
};

std::string unit_text(Quantity quantity) {
  switch (quantity) {
    case Quantity::pose:
      return "[m, unit quaternion]";
    case Quantity::twist:
      return "[m/s, rad/s]";
    case Quantity::wrench:
      return "[N, N m]";
    case Quantity::joints:
      return "position [rad], by name in any order";
    case Quantity::scalar:
      break;
  }
  return "";
}

Doc doc_of(const InputPort& port, Delivery delivery) {
  const InputSpec& spec = port.spec();
  std::string text = spec.doc;
  if (const auto unit = unit_text(spec.quantity); !unit.empty()) text += " " + unit;
  if (const auto frames = port.reader().frames(); !frames.empty())
    text += "; frame_id: empty (" + spec.frame + ")" +
            (frames.size() > 1 ? ", " + joined(frames) : std::string());
  if (delivery == Delivery::goal) return {"once", "goal, approached smoothly: " + text};
  return {fmt::format("up to 1000 Hz; silent for {:g} s: held", spec.timeout_s), "stream: " + text};
}

bool applies(const InputCodec& codec, const Instance& instance, const InputSpec& input) {
  if (codec.controllet.empty()) return codec.quantity == input.quantity;
  return codec.controllet == instance.descriptor().type && codec.input == input.name;
}

// Only a codec for a single input may omit its own topic.
bool is_topic(const InputCodec& codec) {
  const std::string& name = codec.topic;
  if (name.empty()) return !codec.controllet.empty();
  constexpr const char* kLetters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_";
  return std::string(kLetters).find(name[0]) != std::string::npos &&
         name.find_first_not_of(std::string(kLetters) + "0123456789") == std::string::npos &&
         name.find("__") == std::string::npos && name != "goal" && name != "reference";
}

}  // namespace

const InputCodec* codec_for(const std::vector<InputCodec>& codecs, const Instance& instance,
                            const InputSpec& input) {
  const auto found = std::find_if(codecs.begin(), codecs.end(), [&](const InputCodec& codec) {
    return codec.topic.empty() && applies(codec, instance, input);
  });
  return found == codecs.end() ? nullptr : &*found;
}

std::vector<const InputCodec*> more_codecs_for(const std::vector<InputCodec>& codecs,
                                               const Instance& instance, const InputSpec& input) {
  std::vector<const InputCodec*> found;
  for (const auto& codec : codecs) {
    if (!codec.topic.empty() && applies(codec, instance, input)) found.push_back(&codec);
  }
  return found;
}

void check_codecs(const std::vector<InputCodec>& codecs, const MultimodeController& modes) {
  for (const auto& codec : codecs) {
    if (!is_topic(codec)) {
      throw std::invalid_argument(fmt::format(
          "input codec for {}: topic '{}': expected letters, digits and _, no digit first, no name of the "
          "adapter's own{}",
          codec.message_type, codec.topic,
          codec.controllet.empty() ? "; a codec for a quantity needs one" : ""));
    }
  }
  for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
    const Instance& instance = modes.instance(i);
    const std::string& type = instance.descriptor().type;
    for (const Reference& reference : instance.inputs()) {
      std::map<std::string, const InputCodec*> topics;
      for (const auto& codec : codecs) {
        if (!applies(codec, instance, reference.spec())) continue;
        const auto [other, added] = topics.emplace(codec.topic, &codec);
        if (!added) {
          throw std::invalid_argument(fmt::format(
              "two input codecs, for {} and {}, have the same topic of input '{}' of '{}': give one of them "
              "another topic",
              other->second->message_type, codec.message_type, reference.spec().name, type));
        }
      }
    }
    for (const auto& codec : codecs) {
      if (codec.controllet != type || instance.find_input(codec.input) < instance.inputs().size()) continue;
      throw std::invalid_argument("input codec for " + codec.message_type + ": " +
                                  has_no(type, "input", codec.input, names_in(instance.descriptor().inputs)));
    }
  }
}

Inputs::Inputs(const AdapterContext& run, const std::vector<InputCodec>& codecs) {
  MultimodeController& modes = *run.modes;
  check_codecs(codecs, modes);
  for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
    for (std::size_t k = 0; k < modes.instance(i).inputs().size(); ++k) {
      ports_.push_back(std::make_unique<InputPort>(run, i, k));
      InputPort& port = *ports_.back();
      if (const InputCodec* codec = codec_for(codecs, modes.instance(i), port.spec())) {
        open(run, port, *codec);
      } else {
        open(run, port);
      }
      for (const InputCodec* codec : more_codecs_for(codecs, modes.instance(i), port.spec()))
        open(run, port, *codec);
    }
  }
}

void Inputs::open(const AdapterContext& run, InputPort& port, const InputCodec& codec) {
  const std::string topic = "~/" + port.name() + (codec.topic.empty() ? "" : "/" + codec.topic);
  for (const Delivery delivery : {Delivery::stream, Delivery::goal}) {
    const bool goal = delivery == Delivery::goal;
    subscriptions_.push_back(
        std::make_unique<CodecSubscription>(run, topic + (goal ? "/goal" : ""), goal ? kGoalQos : kStreamQos,
                                            doc_of(port, delivery), codec, port, delivery));
  }
}

void Inputs::open(const AdapterContext& run, InputPort& port) {
  switch (port.spec().quantity) {
    case Quantity::pose:
      return subscribe<geometry_msgs::msg::PoseStamped>(run, port);
    case Quantity::twist:
      return subscribe<geometry_msgs::msg::TwistStamped>(run, port);
    case Quantity::wrench:
      return subscribe<geometry_msgs::msg::WrenchStamped>(run, port);
    case Quantity::joints:
      return subscribe<sensor_msgs::msg::JointState>(run, port);
    case Quantity::scalar:
      return subscribe<std_msgs::msg::Float64>(run, port);
  }
}

template <class M>
void Inputs::subscribe(const AdapterContext& run, InputPort& port) {
  for (const Delivery delivery : {Delivery::stream, Delivery::goal}) {
    const bool goal = delivery == Delivery::goal;
    subscriptions_.push_back(std::make_unique<InputSubscription<M>>(
        run, "~/" + port.name() + (goal ? "/goal" : ""), goal ? kGoalQos : kStreamQos, doc_of(port, delivery),
        port, delivery));
  }
}

std::vector<Diagnostic> Inputs::diagnostics() const {
  std::vector<Diagnostic> lines;
  for (const auto& port : ports_) lines.push_back(port->diagnostic());
  return lines;
}

AdapterParts make_controllets(const AdapterContext& run, const Inputs*& inputs) {
  const auto codecs = codecs_of(run.scene->plugins);
  AdapterParts parts;
  parts.push_back(std::make_unique<ModeServices>(run, codecs));
  auto made = std::make_unique<Inputs>(run, codecs);
  inputs = made.get();
  parts.push_back(std::move(made));
  parts.push_back(std::make_unique<ValueTopics>(run, codecs));
  if (run.options->parameter_services) parts.push_back(std::make_unique<ParameterServices>(run));
  return parts;
}

}  // namespace multipanda::ros
