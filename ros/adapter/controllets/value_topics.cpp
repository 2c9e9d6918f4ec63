#include <algorithm>
#include <cmath>
#include <std_msgs/msg/float64_multi_array.hpp>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/controllets/inputs.hpp"
#include "ros/adapter/state/messages.hpp"

namespace multipanda::ros {
namespace {

void fill(const ReferenceSample& sample, geometry_msgs::msg::PoseStamped& message) {
  const auto& v = sample.values;
  set_vector(message.pose.position, v.data());
  set_rotation(message.pose.orientation, Quaternion(v[3], v[4], v[5], v[6]));
}

void fill(const ReferenceSample& sample, geometry_msgs::msg::TwistStamped& message) {
  set_vector(message.twist.linear, sample.values.data());
  set_vector(message.twist.angular, sample.values.data() + 3);
}

void fill(const ReferenceSample& sample, geometry_msgs::msg::WrenchStamped& message) {
  set_vector(message.wrench.force, sample.values.data());
  set_vector(message.wrench.torque, sample.values.data() + 3);
}

void fill(const ReferenceSample& sample, std_msgs::msg::Float64& message) { message.data = sample.values[0]; }

void fill(const ReferenceSample& sample, sensor_msgs::msg::JointState& message) {
  const auto n = static_cast<std::ptrdiff_t>(sample.size);
  message.position.assign(sample.values.begin(), sample.values.begin() + n);
  message.velocity.assign(sample.rates.begin(), sample.rates.begin() + n);
}

// Returns whether the k-th output of an active instance is published. The controllet's own outputs come
// first, then those of its features.
std::function<bool()> switched_on(const Instance& instance, std::size_t k) {
  std::size_t first = instance.descriptor().outputs.size();
  if (k < first) return [] { return true; };
  for (std::size_t feature = 0; feature < instance.feature_count(); ++feature) {
    first += instance.feature_descriptor(feature).outputs.size();
    if (k < first) return [&instance, feature] { return instance.feature_on(feature); };
  }
  return [] { return false; };
}

// A publisher and its message, which is reused. Publisher's thread.
template <class M>
struct ValueTopic {
  ValueTopic(const AdapterContext& run, const std::string& name, const Doc& doc)
      : publisher(*run.node, name, Qos::reliable(), doc) {}
  // Fills and sends the message if it has a subscriber.
  void show(auto fill_it) {
    if (publisher.subscribers() == 0) return;
    fill_it(message);
    publisher.publish(message);
  }
  Publisher<M> publisher;
  M message;
};

}  // namespace

ValueTopics::ValueTopics(const AdapterContext& run, const std::vector<InputCodec>& codecs)
    : stamps_(run.stamps),
      references_due_(run.options->rates_hz.references, run.backend->period()),
      outputs_due_(run.options->rates_hz.outputs, run.backend->period()) {
  const MultimodeController& modes = *run.modes;
  for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
    const Instance& instance = modes.instance(i);
    auto& topics = references_.emplace_back();
    for (const Reference& input : instance.inputs()) {
      topics.emplace_back();
      if (!references_due_.off() && codec_for(codecs, instance, input.spec()) == nullptr)
        topics.back() = reference_publisher(run, instance, input);
    }
    if (!outputs_due_.off()) add_outputs(run, instance, run.layout->instances[i]);
  }
}

ValueTopics::ShowReference ValueTopics::reference_publisher(const AdapterContext& run,
                                                            const Instance& instance,
                                                            const Reference& input) {
  const InputSpec& spec = input.spec();
  const std::string name = topic_of(instance.name(), spec.name) + "/reference";
  const Doc doc{references_due_.text(run.backend->period()) + " while active",
                "The set-point that is followed now: " + spec.doc};
  return with_message(spec.quantity, [&]<class M>() -> ShowReference {
    auto topic = std::make_shared<ValueTopic<M>>(run, name, doc);
    if constexpr (std::is_same_v<M, sensor_msgs::msg::JointState>) {
      const ArmIndex arm = instance.arm_list()[spec.arm];
      topic->message.name = joint_names(run.modes->arm_name(arm), run.models[arm]->joint_count());
    } else if constexpr (requires { topic->message.header; }) {
      topic->message.header.frame_id = spec.frame;
    }
    return [topic](const ReferenceSample& sample, [[maybe_unused]] std::int64_t stamp_ns) {
      topic->show([&](M& message) {
        if constexpr (requires { message.header; }) message.header.stamp = to_time(stamp_ns);
        fill(sample, message);
      });
    };
  });
}

void ValueTopics::add_outputs(const AdapterContext& run, const Instance& instance,
                              const RecordLayout::Instance& layout) {
  const auto specs = instance.output_specs();
  for (std::size_t k = 0; k < layout.outputs.size(); ++k) {
    const RecordLayout::Output& output = layout.outputs[k];
    const std::string name = topic_of(instance.name(), output.name);
    const bool of_feature = k >= instance.descriptor().outputs.size();
    const Doc doc{outputs_due_.text(run.backend->period()) +
                      (of_feature ? " while active and switched on" : " while active"),
                  k < specs.size() ? specs[k].doc : ""};
    const auto runs = switched_on(instance, k);
    if (output.size == 1) {
      auto topic = std::make_shared<ValueTopic<std_msgs::msg::Float64>>(run, name, doc);
      outputs_.push_back({output.offset, 1, runs, [topic](const double* values) {
                            topic->show([&](auto& message) { message.data = values[0]; });
                          }});
      continue;
    }
    auto topic = std::make_shared<ValueTopic<std_msgs::msg::Float64MultiArray>>(run, name, doc);
    outputs_.push_back({output.offset, output.size, runs, [topic, n = output.size](const double* values) {
                          topic->show([&](auto& message) { message.data.assign(values, values + n); });
                        }});
  }
}

void ValueTopics::take(const CycleRecord& record) {
  if (references_due_.due(record.cycle)) {
    const std::int64_t now = stamps_.of(record);
    for (std::size_t k = 0; k < record.reference_count; ++k) {
      const ReferenceSample& sample = record.references[k];
      if (const auto& show = references_.at(sample.instance).at(sample.input)) show(sample, now);
    }
  }
  if (outputs_due_.due(record.cycle)) {
    for (const auto& output : outputs_) {
      const double* values = record.outputs.data() + output.offset;
      // NaN means not active.
      if (output.runs() && !std::all_of(values, values + output.size, [](double v) { return std::isnan(v); }))
        output.show(values);
    }
  }
}

}  // namespace multipanda::ros
