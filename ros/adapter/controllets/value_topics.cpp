
#include <algorithm>
#include <cmath>
#include <geometry_msgs/msg/pose_stamped.hpp>
#include <geometry_msgs/msg/twist_stamped.hpp>
#include <geometry_msgs/msg/wrench_stamped.hpp>
#include <sensor_msgs/msg/joint_state.hpp>
#include <std_msgs/msg/float64.hpp>
#include <std_msgs/msg/float64_multi_array.hpp>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/controllets/inputs.hpp"

namespace multipanda::ros {
namespace {

template <class Header>
void stamp(Header& header, std::int64_t ns) {
  header.stamp.sec = static_cast<std::int32_t>(ns / 1'000'000'000);
  header.stamp.nanosec = static_cast<std::uint32_t>(ns % 1'000'000'000);
}

template <class Three>
void set(Three& to, const double* v) {
  to.x = v[0];
  to.y = v[1];
  to.z = v[2];
}

void fill(const ReferenceSample& sample, geometry_msgs::msg::PoseStamped& message) {
  set(message.pose.position, sample.values.data());
  message.pose.orientation.w = sample.values[3];
  set(message.pose.orientation, sample.values.data() + 4);
}

void fill(const ReferenceSample& sample, geometry_msgs::msg::TwistStamped& message) {
  set(message.twist.linear, sample.values.data());
  set(message.twist.angular, sample.values.data() + 3);
}

void fill(const ReferenceSample& sample, geometry_msgs::msg::WrenchStamped& message) {
  set(message.wrench.force, sample.values.data());
  set(message.wrench.torque, sample.values.data() + 3);
}

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
  Publisher<M> publisher;
  M message;
};

template <class M>
auto shower(std::shared_ptr<ValueTopic<M>> topic) {
  return [topic = std::move(topic)](const ReferenceSample& sample, std::int64_t stamp_ns) {
    if (topic->publisher.subscribers() == 0) return;
    stamp(topic->message.header, stamp_ns);
    fill(sample, topic->message);
    topic->publisher.publish(topic->message);
  };
}

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
  const auto make = [&]<class M>(const M& prototype) {
    auto topic = std::make_shared<ValueTopic<M>>(run, name, doc);
    topic->message = prototype;
    return shower(std::move(topic));
  };
  const auto framed = [&]<class M>(M message) {
    message.header.frame_id = spec.frame;
    return make(message);
  };
  switch (spec.quantity) {
    case Quantity::pose:
      return framed(geometry_msgs::msg::PoseStamped());
    case Quantity::twist:
      return framed(geometry_msgs::msg::TwistStamped());
    case Quantity::wrench:
      return framed(geometry_msgs::msg::WrenchStamped());
    case Quantity::joints: {
      sensor_msgs::msg::JointState message;
      const ArmIndex arm = instance.arm_list()[spec.arm];
      message.name = joint_names(run.modes->arm_name(arm), run.models[arm]->joint_count());
      return make(message);
    }
    case Quantity::scalar:
      break;
  }
  auto topic = std::make_shared<ValueTopic<std_msgs::msg::Float64>>(run, name, doc);
  return [topic](const ReferenceSample& sample, std::int64_t) {
    topic->message.data = sample.values[0];
    if (topic->publisher.subscribers() > 0) topic->publisher.publish(topic->message);
  };
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
                            topic->message.data = values[0];
                            if (topic->publisher.subscribers() > 0) topic->publisher.publish(topic->message);
                          }});
      continue;
    }
    auto topic = std::make_shared<ValueTopic<std_msgs::msg::Float64MultiArray>>(run, name, doc);
    outputs_.push_back({output.offset, output.size, runs, [topic, n = output.size](const double* values) {
                          topic->message.data.assign(values, values + n);
                          if (topic->publisher.subscribers() > 0) topic->publisher.publish(topic->message);
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
