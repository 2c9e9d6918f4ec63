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

// Receives the messages of one topic. Its address tells the topics of an input apart.
struct Entrance {
  InputPort& port;
  Delivery delivery;
};

void receive(const Entrance& entrance, const InputCodec& codec, const void* message, double waited_s) {
  InputValues values;
  try {
    codec.read(message, values);
  } catch (const std::exception& error) {
    values.refusal = error.what();
  } catch (...) {
    values.refusal = "its codec threw something other than std::exception; repair the codec";
  }
  if (!values.refusal.empty()) return entrance.port.refuse(values.refusal);
  entrance.port.receive(values.numbers, values.frame, entrance.delivery, waited_s, &entrance);
}

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

// Calls subscribe(topic, QoS, doc, entrance) for the stream of an input and for its goals.
template <class Subscribe>
void both_topics(InputPort& port, const std::string& more, Subscribe subscribe) {
  for (const Delivery delivery : {Delivery::stream, Delivery::goal}) {
    const bool goal = delivery == Delivery::goal;
    subscribe("~/" + port.name() + (more.empty() ? "" : "/" + more) + (goal ? "/goal" : ""),
              goal ? kGoalQos : kStreamQos, doc_of(port, delivery),
              std::make_shared<const Entrance>(Entrance{port, delivery}));
  }
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
  both_topics(port, codec.topic,
              [&](const std::string& topic, const Qos& qos, const Doc& doc, auto entrance) {
                subscriptions_.push_back(std::make_unique<AnySubscription>(
                    *run.executor, *run.node, topic, codec.type_support, codec.message_type, qos, doc,
                    codec.make_message(), [codec, entrance](const void* message, double waited_s) {
                      receive(*entrance, codec, message, waited_s);
                    }));
              });
}

void Inputs::open(const AdapterContext& run, InputPort& port) {
  both_topics(port, "", [&](const std::string& topic, const Qos& qos, const Doc& doc, auto entrance) {
    with_message(port.spec().quantity, [&]<class M>() {
      subscriptions_.push_back(std::make_unique<Subscription<M>>(
          *run.executor, *run.node, topic, qos, doc, [entrance](const M& message, double waited_s) {
            entrance->port.receive(message, entrance->delivery, waited_s, entrance.get());
          }));
    });
  });
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
